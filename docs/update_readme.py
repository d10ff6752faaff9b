"""Put what is printed now into the README: the screen of a study, and the line of its Python script.

satsep-ot study --output DIR > screen.txt
python docs/update_readme.py screen.txt
"""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"
WIDTH = 108


def shown_screen(text):
    """The lines of a study's screen that the README shows: the verdicts, the table, and two halved tolerances each."""
    verdicts, table = text.split("\n\nProbability of violating", 1)
    table, rest = table.split("\nRemarks\n", 1)
    halved = [line for line in rest.splitlines() if " with half the scatter of " in line]
    lines = []
    for line in verdicts.splitlines():
        lines += textwrap.wrap(line, WIDTH, initial_indent="", subsequent_indent="    ", drop_whitespace=True) or [""]
    lines += ["", *("Probability of violating" + table).splitlines(), "Remarks", "...", *halved[:4], "..."]
    return "\n".join(line.rstrip() for line in lines)


def main():
    text = README.read_text(encoding="utf-8")
    screen = shown_screen(Path(sys.argv[1]).read_text(encoding="utf-8"))
    text = re.sub(
        r"(<!-- screen: begin -->\n```text\n).*?(\n```\n<!-- screen: end -->)",
        lambda match: match[1] + screen + match[2],
        text,
        flags=re.DOTALL,
    )
    script = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    printed = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.rstrip()
    text = re.sub(
        r"(```text\n)ActiveSubspaceReliabilityResult\(.*?\)(\n```)", lambda match: match[1] + printed + match[2], text
    )
    README.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
