"""How many heavy runs a study of the reference case takes, with this package's simulator as the cheap model.

    python tests/benchmarks/heavy_study.py

The heavy program is the same case with contact of the satellite's ring on the deck, lateral rates 3 % larger, a spin
2 % smaller and a velocity 0.1 % smaller. Its true probabilities are from 200,000 crude Monte Carlo runs. The study is
called again and again, as a user does, each time with the outputs of the block that it has asked for.
"""

import contextlib
import csv
import io
import platform
import tempfile
from importlib import metadata, resources
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot import cli
from satsep_ot.model.case import load_case, parse_case
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.telling.document import read_results

QUANTITIES = ["rate_x", "rate_z", "rate_y", "axial_velocity", "clearance"]
FACTORS = [1.03, 1.03, 0.98, 0.999, 1.0]
SIZE, SEED, BLOCK = 200_000, 12345, 40


def heavy_function():
    """The simulator behind the heavy program."""
    text = (resources.files("satsep_ot.model") / "cases" / "reference.toml").read_text(encoding="utf-8")
    contact = "[contact]\nradius = 300.0\npoints = 12\n# "
    return SeparationFunction(
        parse_case(text.replace("# [contact]  ", contact, 1)), quantities=QUANTITIES, countsEndings=True
    )


def heavy_program(heavy, inputs, outputs):
    """Outputs of a block of runs."""
    with open(inputs, newline="") as stream:
        asked = list(csv.DictReader(stream))
    values = FACTORS * heavy.evaluate([[float(row[name]) for name in heavy.getInputDescription()] for row in asked])
    with open(outputs, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["run", *heavy.getOutputDescription()])
        writer.writerows([row["run"], *map(repr, value)] for row, value in zip(asked, values.tolist(), strict=True))


def truth(heavy):
    """The probability of each violation, and of any."""
    problem = SeparationProblem("reference")
    _, composition = problem.getMeasuredComponents(None, ofAll=True)
    ot.RandomGenerator.SetSeed(SEED)
    values = FACTORS * heavy.evaluate(problem.getDistribution().getSample(SIZE))
    found = {}
    for entry in load_case("reference").requirements:
        compose = problem.getMeasuredComponents(entry.name, ofAll=True)[1]
        compared = np.array(compose(values))[:, 0]
        found[entry.name] = np.mean(compared > entry.limit if entry.is_maximum else compared < entry.limit)
    found["any requirement"] = np.mean(np.array(composition(values))[:, 0] < 0.0)
    return found


def main():
    print("$ python tests/benchmarks/heavy_study.py")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("openturns", "numpy", "numba"))
    print(f"{versions}, Python {platform.python_version()}")
    print(f"seed 0, blocks of at least {BLOCK} runs; truth: {SIZE:,} runs, seed {SEED}", flush=True)
    heavy = heavy_function()
    expected = truth(heavy)
    with tempfile.TemporaryDirectory() as folder:
        results, runs = Path(folder) / "results", Path(folder) / "runs"
        arguments = ["study", "reference", "--output", str(results), "--heavy", str(runs), "--block", str(BLOCK)]
        calls = 1
        while True:
            with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
                code = cli.main([*arguments, "--runs", "10000", "--gradients", "0"])
            if code != 4:
                break
            calls += 1
            for inputs in runs.glob("block-*-inputs.csv"):
                outputs = inputs.with_name(inputs.name.replace("inputs", "outputs"))
                if not outputs.exists():
                    heavy_program(heavy, inputs, outputs)
        print("requirement       truth      probability  95 % interval            runs")
        for row in read_results(results / "results.json").rows:
            print(
                f"{row.requirement:16} {expected[row.requirement]:.3e}  {row.probability:.3e}    "
                f"{row.lower95:.3e} to {row.upper95:.3e}  {row.evaluations:4}"
            )
        made = sum(len(path.read_text().splitlines()) - 1 for path in runs.glob("block-*-outputs.csv"))
        print(f"{made} heavy runs in {len(list(runs.glob('block-*-outputs.csv')))} blocks, {calls} calls of the study")


if __name__ == "__main__":
    main()
