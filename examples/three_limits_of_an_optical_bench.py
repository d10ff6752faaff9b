"""
FORM fails on two of three limits; this does not
================================================

A model of your own with 12 inputs and three limits: a bench for a telescope on six struts. Its smooth outputs are
components of the limits; two processes make the runs; the script is killed in the middle and continues; the tables go
to pandas and LaTeX. It needs pandas, which the package itself does not: ``pip install pandas``.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas

# %%
# The model, as a module of its own that each process can import. A run takes 5 ms here. Its outputs are smooth; two of
# the limits on them are not: the tilt is a length of two components, and the focus may be off to either side.
MODEL = """
import time
import numpy as np
import openturns as ot

ANGLES = np.arange(6) * np.pi / 3.0  # of the struts around the bench
INPUTS = [*(f"length{i}" for i in range(1, 7)), "stiffness", "mass", "shake", "warm", "warm_x", "warm_y"]
OUTPUTS = ["tilt_x", "tilt_y", "focus", "stress"]

def bench(sample):
    x = np.asarray(sample, dtype=float)
    time.sleep(0.005 * len(x))
    stiffness, mass, shake, warm, warm_x, warm_y = x[:, 6:].T
    # Changes of the struts' lengths [um]: as made, by the temperature, and by the load.
    heat = warm[:, None] + warm_x[:, None] * np.cos(ANGLES) + warm_y[:, None] * np.sin(ANGLES)
    length = x[:, :6] + 3.6 * heat + (0.4 * mass * shake / stiffness)[:, None] * np.cos(ANGLES)
    tilt_x, tilt_y = (8.0 * (length * side).mean(axis=1) for side in (np.sin(ANGLES), np.cos(ANGLES)))
    focus = length.mean(axis=1) * (1.0 + 0.01 * warm)
    return np.column_stack([tilt_x, tilt_y, focus, mass * (9.81 + 3.0 * shake) / stiffness])

def law():
    found = ot.JointDistribution(
        [ot.Normal(0.0, 2.0)] * 6  # lengths [um]
        + [
            ot.LogNormalMuSigma(12.0, 1.0).getDistribution(),  # stiffness [N/um]
            ot.Normal(20.0, 1.0),  # mass [kg]
            ot.Gumbel(0.3, 0.5),  # shake [m/s2]
            ot.Normal(0.0, 0.8),  # warm [K]
            ot.Normal(0.0, 0.5),  # warm_x [K]
            ot.Normal(0.0, 0.5),  # warm_y [K]
        ]
    )
    found.setDescription(INPUTS)
    return found

# Formula of each limit's value, and the largest value that is allowed.
LIMITS = {
    "tilt": ("sqrt(tilt_x^2 + tilt_y^2)", 33.0),  # [um/m]
    "focus": ("abs(focus)", 10.0),  # [um]
    "stress": ("stress", 32.0),  # [MPa]
}
"""

# %%
# The script: each limit by FORM and by ActiveSubspace, in two processes, with a file of all true runs.
SCRIPT = """
import json
from pathlib import Path

import openturns as ot
from bench import INPUTS, LIMITS, OUTPUTS, bench, law
from satsep_ot import ParallelFunction, ReliabilityComparison
from satsep_ot.methods.parallel.executors import processes

if __name__ == "__main__":
    model = ot.PythonFunction(len(INPUTS), len(OUTPUTS), func_sample=bench)
    model.setInputDescription(INPUTS)
    model.setOutputDescription(OUTPUTS)
    with processes(2)() as workers:
        parallel = ot.Function(ParallelFunction(model, workers))
        for name, (formula, largest) in LIMITS.items():
            limit = ot.SymbolicFunction(OUTPUTS, [formula])
            vector = ot.CompositeRandomVector(ot.ComposedFunction(limit, parallel), ot.RandomVector(law()))
            event = ot.ThresholdEvent(vector, ot.Greater(), largest)
            comparison = ReliabilityComparison(event, ["FORM", "ActiveSubspace"])
            comparison.setComponents(parallel, limit)
            comparison.setMaximumEvaluations(3000)
            comparison.setCheckpointFile(f"{name}.runs")
            comparison.run()
            result = comparison.getResult()
            Path(f"{name}.json").write_text(json.dumps(result.getTable()))
            Path(f"{name}.tex").write_text(result.toLatex())
"""
folder = tempfile.TemporaryDirectory()
directory = Path(folder.name)
(directory / "bench.py").write_text(MODEL, encoding="utf-8")
(directory / "study.py").write_text(SCRIPT, encoding="utf-8")
command = [sys.executable, "study.py"]

# %%
# It is killed while it is busy with the second limit. Started again, it takes from the files what is there.
first = subprocess.Popen(command, cwd=directory)
second_limit = directory / "focus.runs"
while first.poll() is None and not (second_limit.exists() and second_limit.stat().st_size > 40_000):
    time.sleep(0.05)
first.kill()
killed = first.wait() != 0
kept = sum(path.read_text(encoding="utf-8").count('"inputs"') for path in directory.glob("*.runs"))
print(f"killed: {killed}; blocks of runs that are kept: {kept}")
subprocess.run(command, cwd=directory, check=True)

# %%
# One table for pandas. FORM takes a limit for a plane at one point: of the tilt, which fails in all directions, it sees
# one, and of the focus, which fails on both sides, one side.
names = ("tilt", "focus", "stress")
frames = [
    pandas.DataFrame(json.loads((directory / f"{name}.json").read_text(encoding="utf-8"))).assign(limit=name)
    for name in names
]
table = pandas.concat(frames).set_index(["limit", "method"])
columns = ["probability", "lower95", "upper95", "evaluations"]
print(table[columns].to_string(float_format="{:.2e}".format))
for name in names:
    ratio = table.loc[(name, "FORM"), "probability"] / table.loc[(name, "ActiveSubspace"), "probability"]
    print(f"{name}: FORM gives {ratio:.2f} of the probability")

# %%
# The same for LaTeX, with booktabs.
latex = (directory / "tilt.tex").read_text(encoding="utf-8")
print(latex)
folder.cleanup()
