"""Put what is printed now into the README: the screen of a study, what is true, and the line of its script.

satsep-ot study --output DIR > screen.txt
python docs/update_readme.py screen.txt
"""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

from satsep_ot.studies.method_benchmark import REFERENCE_VIOLATIONS, reference_probability

README = Path(__file__).parent.parent / "README.md"
WIDTH = 108


def shown_screen(text):
    """The lines of a study's screen that the README shows: the verdicts, the table, and two halved tolerances each."""
    verdicts, table = text.split("\n\nProbability of violating", 1)
    table, rest = table.split("\nRemarks\n", 1)
    # The command folds at 160 columns.
    verdicts = re.sub(r" ?\n(?! |$)", " ", verdicts)
    halved = [line for line in rest.splitlines() if " with half the scatter of " in line]
    lines = []
    for line in verdicts.splitlines():
        lines += textwrap.wrap(line, WIDTH, initial_indent="", subsequent_indent="    ", drop_whitespace=True) or [""]
    lines += ["", *("Probability of violating" + table).splitlines(), "Remarks", "...", *halved[:4], "..."]
    return "\n".join(line.rstrip() for line in lines)


def truth_table(screen):
    """Which intervals of a shown screen hold the probability that is known, and how many do not."""
    misses = dict.fromkeys(("ActiveSubspace", "MonteCarlo"), 0)
    lines = ["| violation of | known | ActiveSubspace | MonteCarlo |", "|---|---:|---|---|"]
    for requirement in REFERENCE_VIOLATIONS:
        truth, deviation = reference_probability(requirement)
        cells = []
        for method in misses:
            row = re.search(rf"^{requirement}\n(?:\w+ .*\n)*?{method} +\S+ +(\S+)\.\.(\S+)", screen, re.MULTILINE)
            lower, upper = map(float, row.groups())
            side = "below" if truth < lower else "above"
            inside = lower <= truth <= upper
            misses[method] += not inside
            cells.append("inside" if inside else f"**{side}** {row[1]} to {row[2]}")
        lines.append(f"| {requirement} | {truth:.3e} ± {100 * deviation / truth:.2f} % | {' | '.join(cells)} |")
    number, total, sharing = 2 * len(REFERENCE_VIOLATIONS), sum(misses.values()), misses["MonteCarlo"]
    which = {2: "both"}.get(total, "all") if sharing == total else f"{sharing} of them"
    shared = f", {which} on one Monte Carlo sample" if sharing > 1 else ""
    said = f"One 95 % interval in twenty misses by design; of these {number}, {total} do{shared}."
    return "\n".join([*lines, "", said])


def between(name, inside, text):
    """The text with what stands between two marks replaced."""
    marks = f"<!-- {name}: begin -->\n", f"\n<!-- {name}: end -->"
    return re.sub(rf"({marks[0]}).*?({marks[1]})", lambda found: found[1] + inside + found[2], text, flags=re.DOTALL)


def main():
    text = README.read_text(encoding="utf-8")
    screen = shown_screen(Path(sys.argv[1]).read_text(encoding="utf-8"))
    text = between("screen", f"```text\n{screen}\n```", text)
    text = between("truth", truth_table(screen), text)
    script = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    printed = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.rstrip()
    text = re.sub(
        r"(```text\n)ActiveSubspaceReliabilityResult\(.*?\)(\n```)", lambda match: match[1] + printed + match[2], text
    )
    README.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
