"""True runs in a checkpoint file: what was killed continues to the same bits, and what does not belong is refused."""

import hashlib
import json
import signal
import subprocess
import sys

import numpy as np
import openturns as ot
import pytest

from satsep_ot import ActiveSubspaceReliability, ReliabilityComparison
from satsep_ot.methods.common.run_log import CheckpointFile, IncompleteBlockError, RunLog, fingerprintOf
from satsep_ot.methods.comparison.simulations import MonteCarlo

# The function ends its own process after some runs, in the middle of a block.
SCRIPT = """
import os, signal, sys
import numpy as np
import openturns as ot
from satsep_ot import ActiveSubspaceReliability, ReliabilityComparison
from satsep_ot.methods.comparison.simulations import MonteCarlo, SubsetSampling

kind, file, killed, seed = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
runs = 0

def simulate(x):
    global runs
    runs += 1
    if runs == killed:
        os.kill(os.getpid(), signal.SIGKILL)
    return [x[0] + 0.5 * x[1] - 0.1 * x[1] ** 2]

vector = ot.CompositeRandomVector(ot.PythonFunction(2, 1, simulate), ot.RandomVector(ot.Normal(2)))
event = ot.ThresholdEvent(vector, ot.Greater(), 3.0)
ot.RandomGenerator.SetSeed(seed)
if kind == "one":
    task = ActiveSubspaceReliability(event)
else:
    task = ReliabilityComparison(
        event, ["ActiveSubspace", "FORM", SubsetSampling(levelSize=100), MonteCarlo(size=300, blockSize=100)]
    )
    task.setMaximumEvaluations(400)
task.setCheckpointFile(file or None)
task.run()
result = task.getResult()
if kind == "one":
    print(result.getProbabilityEstimate(), result.getVarianceEstimate(), result.getPhases())
    print(np.array(result.getInputSample()).tobytes().hex(), np.array(result.getOutputSample()).tobytes().hex())
else:
    for row in result.getRows():
        row.seconds = 0.0
        print(row)
print(runs)
"""


def ended(kind, file, killed=0, seed=3):
    """Exit code, answer and number of runs of a script that kills itself at its run number `killed`."""
    command = [sys.executable, "-c", SCRIPT, kind, str(file), str(killed), str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    *answer, runs = done.stdout.splitlines() or ["0"]
    return done.returncode, answer, int(runs)


@pytest.mark.parametrize(("kind", "kills"), [("one", (5, 14, 60)), ("all", (40, 170, 300))])
def test_a_killed_script_continues_to_the_same_bits(kind, kills, tmp_path):
    code, answer, runs = ended(kind, "")
    assert code == 0
    file = tmp_path / "runs"
    sizes = [0]
    for seed, killed in enumerate(kills):
        # The seed of the first one is the seed of all.
        assert ended(kind, file, killed, 3 if seed == 0 else seed)[0] == -signal.SIGKILL
        sizes.append(file.stat().st_size)
        assert sizes[-1] > sizes[-2]
    code, continued, rest = ended(kind, file, seed=9)
    assert (code, continued) == (0, answer)
    assert rest < runs - sum(kills) / 3
    # Nothing is left to do but one run of the check.
    assert ended(kind, file) == (0, answer, 1)


def threshold(function, law=None, value=3.0):
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(2) if law is None else law))
    return ot.ThresholdEvent(vector, ot.Greater(), value)


def values(x):
    x = np.asarray(x, dtype=float)
    return x[:, :1] + 0.5 * x[:, 1:] - 0.1 * x[:, 1:] ** 2


def started(file, evaluate=values, **changes):
    ot.RandomGenerator.SetSeed(0)
    algorithm = ActiveSubspaceReliability(threshold(ot.PythonFunction(2, 1, func_sample=evaluate), **changes))
    algorithm.setCheckpointFile(file)
    return algorithm


def answer(algorithm):
    algorithm.run()
    result = algorithm.getResult()
    return result.getProbabilityEstimate(), result.getVarianceEstimate(), np.array(result.getInputSample()).tolist()


class Failing:
    """A function that fails at some of the points that it has seen, by their numbers, and counts the others."""

    def __init__(self, numbers):
        self.numbers, self.points, self.runs = numbers, [], 0

    def __call__(self, x):
        for row in np.asarray(x, dtype=float).tolist():
            if row not in self.points:
                self.points.append(row)
            if self.points.index(row) in self.numbers:
                raise ArithmeticError("no licence")
            self.runs += 1
        return values(x)


def test_a_run_that_raises_leaves_the_others_of_its_block(tmp_path):
    expected = answer(started(None))
    failing = Failing({2})
    algorithm = started(tmp_path / "runs", failing)
    with pytest.raises(RuntimeError, match=r"the other 5 runs of the block and the 0 before it: 1 of 6 .* no licence"):
        algorithm.run()
    inputs, outputs = algorithm.getRuns()
    assert inputs.getSize() == 5
    np.testing.assert_array_equal(values(inputs), outputs)
    failing.numbers, failing.runs = set(), 0
    assert answer(started(tmp_path / "runs", failing)) == expected
    # Five were there, and one of them was made again to compare the functions.
    assert failing.runs == len(expected[2]) - 5 + 1


def test_a_block_is_not_tried_to_its_end_where_all_runs_fail():
    failing, points = Failing(range(4, 100)), np.arange(40.0).reshape(20, 2)
    with pytest.raises(IncompleteBlockError, match="16 of 20 runs failed or were not tried") as caught:
        RunLog().values("f", points, failing, 1)
    assert caught.value.done.tolist() == [True] * 4 + [False] * 16
    # Three that fail are enough.
    assert len(failing.points) == 7
    with pytest.raises(ArithmeticError, match="no licence"):
        RunLog().values("f", points[4:], failing, 1)
    # Far out, where the function may well have no value, each one is tried.
    assert np.isnan(RunLog().values("f", points, failing, 1, tolerant=True)).sum() == 16
    assert len(failing.points) == 20


def test_what_gave_no_value_far_out_gives_none_again(tmp_path):
    def evaluate(x, radius=4.0):
        if (np.abs(np.asarray(x)) > radius).any():
            raise ArithmeticError("no steady state")
        return values(x)

    expected = answer(started(tmp_path / "runs", evaluate))
    # It would have values now: another run would teach other things.
    assert answer(started(tmp_path / "runs", lambda x: evaluate(x, 100.0))) == expected


def test_exact_gradients_are_kept(tmp_path):
    asked = []

    def evaluate(x):
        return [max(x[0] ** 3, 1e5 * (x[1] - 3.6))]

    def gradient(x):
        asked.append(x)
        first = x[0] ** 3 > 1e5 * (x[1] - 3.6)
        return [[3.0 * x[0] ** 2 * first], [1e5 * (not first)]]

    # Two modes of very different slopes, which no surrogate follows.
    function = ot.PythonFunction(2, 1, evaluate, gradient=gradient)
    results = []
    for _ in range(2):
        algorithm = ActiveSubspaceReliability(threshold(function, value=40.0))
        algorithm.setCheckpointFile(tmp_path / "runs")
        results.append((answer(algorithm), algorithm.getResult().getGradientNumber(), len(asked)))
    assert results[0] == results[1]
    assert len(asked) > 0


def test_what_is_of_another_computation_is_refused_in_a_sentence(tmp_path):
    file = tmp_path / "runs"
    answer(started(file))

    def refused(sentence, **changes):
        algorithm = started(file, **changes)
        with pytest.raises(ValueError, match=sentence) as caught:
            algorithm.run()
        assert str(file) in str(caught.value)

    refused("with another distribution, another event;", law=ot.Normal([0.0, 0.1], [1.0, 1.0], ot.CorrelationMatrix(2)))
    refused("with another event;", value=3.1)
    refused("of another model: at input", evaluate=lambda x: 1.001 * values(x))
    algorithm = started(file)
    algorithm.setTargetCoefficientOfVariation(0.1)
    with pytest.raises(ValueError, match="with another targetCoefficientOfVariation; give another file"):
        algorithm.run()
    # Without the check the first difference that matters is found, if there is one.
    algorithm = started(file, lambda x: 1.001 * values(x))
    algorithm.setCheckpointFile(file, checksModel=False)
    assert answer(algorithm) == answer(started(file))


def test_a_damaged_file_is_refused_and_a_cut_one_continued(tmp_path):
    file = tmp_path / "runs"
    expected = answer(started(file))
    content = file.read_bytes()
    lines = content.splitlines(keepends=True)
    middle = len(content) // 2
    damaged = [
        content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :],
        b"".join(lines[:3] + lines[4:]),
        b"".join(lines[:3] + lines[2:]),
        b"".join(lines[:-1]) + lines[-1].replace(b"1", b"2"),
        b"",
        b"no checkpoint\n",
        b"\xff\xfe\n",
    ]
    for text in damaged:
        file.write_bytes(text)
        with pytest.raises(ValueError, match="is no checkpoint") as caught:
            started(file).run()
        assert str(caught.value).count("\n") == 0
        assert file.read_bytes() == text
    # As a process leaves it that is killed while it writes.
    for size in (len(content) - 1, len(content) - len(lines[-1]) + 1, len(content) - len(lines[-1])):
        file.write_bytes(content[:size])
        assert answer(started(file)) == expected
        assert file.read_bytes() == content


def test_a_file_of_another_format_is_refused(tmp_path):
    file = tmp_path / "runs"
    CheckpointFile(file, {}, {})
    line = file.read_bytes().partition(b" ")[2].strip().replace(b"checkpoint 1", b"checkpoint 7")
    file.write_bytes(hashlib.sha256(line).hexdigest().encode() + b" " + line + b"\n")
    with pytest.raises(ValueError, match="of another version"):
        CheckpointFile(file, {}, {})


def test_other_calls_than_the_kept_ones_are_refused(tmp_path):
    file = CheckpointFile(tmp_path / "runs", {}, {})
    file.log().values("f", np.ones((2, 2)), values, 1)
    for name, points in (("g", np.ones((2, 2))), ("f", np.ones((1, 2))), ("f", np.full((2, 2), 1.0 + 1e-15))):
        log = CheckpointFile(tmp_path / "runs", {}, {}).log()
        with pytest.raises(ValueError, match="has other runs than this computation asks for"):
            log.values(name, points, values, 1)
        assert log.refused is not None


def test_a_comparison_refuses_other_runs_instead_of_a_row(tmp_path):
    def comparison(size):
        found = ReliabilityComparison(
            threshold(ot.PythonFunction(2, 1, func_sample=values)), [MonteCarlo(size=300, blockSize=100)]
        )
        found.setMaximumEvaluations(size)
        found.setCheckpointFile(tmp_path / "runs")
        return found

    comparison(300).run()
    with pytest.raises(ValueError, match="with another maximum of evaluations;"):
        comparison(200).run()
    # As if another version of OpenTURNS drew other numbers.
    lines = (tmp_path / "runs").read_text().splitlines()
    documents = [json.loads(line.partition(" ")[2]) for line in lines]
    file = CheckpointFile(tmp_path / "other", documents[0]["of"], {})
    file.enterSection("0 MonteCarlo", {"buffer": [1] * 768, "index": 3})
    for document in documents[2:]:
        file._append(document)
    (tmp_path / "runs").write_bytes((tmp_path / "other").read_bytes())
    with pytest.raises(ValueError, match="other runs than this computation asks for"):
        comparison(300).run()


def test_addresses_of_python_objects_are_no_difference():
    first, second = object(), object()
    assert fingerprintOf(method=[first]) == fingerprintOf(method=[second])
    assert fingerprintOf(method=[1.0]) != fingerprintOf(method=[2.0])


def test_two_computations_do_not_share_a_file(tmp_path):
    first, second = (CheckpointFile(tmp_path / "runs", {}, {}).log() for _ in range(2))
    first.values("f", np.ones((2, 2)), values, 1)
    with pytest.raises(ValueError, match="written by another computation too"):
        second.values("f", np.ones((2, 2)), values, 1)


def test_what_is_left_of_a_block_may_fail_again():
    blocks, allowed = [], [2.0]

    def evaluate(x):
        if (x > allowed[0]).any():
            raise ArithmeticError("too large")
        return x

    points = np.array([[1.0], [2.0], [3.0], [4.0]])
    for size, limit in ((2, 2.0), (3, 3.0), (4, 4.0)):
        allowed[0] = limit
        log = RunLog(list(blocks), blocks.append)
        if size < 4:
            with pytest.raises(IncompleteBlockError, match="too large") as caught:
                log.values("f", points, evaluate, 1)
            assert caught.value.done.sum() == size
        else:
            assert log.values("f", points, evaluate, 1).tolist() == points.tolist()
    assert RunLog(blocks).values("f", points, None, 1).tolist() == points.tolist()
