"""True runs made elsewhere: the same bits as by a function, any interruptions, and what does not belong is refused."""

import json
import subprocess
import sys

import numpy as np
import openturns as ot
import pytest

from satsep_ot import ActiveSubspaceReliability, AskTellReliability
from satsep_ot.methods.reliability.ask_tell import outsideFunction

LAW = ot.JointDistribution([ot.Normal(), ot.Uniform(-2.0, 2.0)])
NAMES = ["force", "play"]


def smooth(x):
    x = np.asarray(x, dtype=float)
    return x[:, :1] + 0.5 * x[:, 1:] - 0.1 * x[:, 1:] ** 2


def pair(x):
    return np.hstack([smooth(x), np.asarray(x, dtype=float)[:, 1:]])


def nothing(x):
    """Never fails: the algorithm looks for modes, and hands over to crude Monte Carlo."""
    return np.zeros((len(x), 1))


def withGap(x):
    """Has no value where the force is extreme."""
    return np.where(np.asarray(x, dtype=float)[:, :1] < -2.5, np.nan, smooth(x))


def algorithmOf(function, threshold=2.5, policy="raise", maximum=1500):
    vector = ot.CompositeRandomVector(function, ot.RandomVector(LAW))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), threshold))
    algorithm.setNonFinitePolicy(policy)
    algorithm.setMaximumEvaluations(maximum)
    algorithm.setTargetCoefficientOfVariation(0.2)
    return algorithm


def asked(file, **settings):
    return AskTellReliability(algorithmOf(outsideFunction(NAMES, ["y"]), **settings), file)


def direct(evaluate, **settings):
    ot.RandomGenerator.SetSeed(0)
    function = ot.PythonFunction(2, 1, func_sample=evaluate)
    function.setInputDescription(NAMES)
    algorithm = algorithmOf(function, **settings)
    algorithm.run()
    return algorithm.getResult()


def bits(result):
    return (
        result.getProbabilityEstimate(), result.getVarianceEstimate(), result.getPhases(), result.getReason(),
        np.array(result.getInputSample()).tobytes(), np.array(result.getOutputSample()).tobytes(),
    )  # fmt: skip


def answered(study, evaluate):
    blocks = 0
    while (block := study.ask()) is not None:
        study.tell(block, evaluate(block))
        blocks += 1
    return study.getResult(), blocks


@pytest.mark.parametrize(
    ("evaluate", "settings", "method"),
    [
        (smooth, {}, "ActiveSubspace"),
        (nothing, {"maximum": 120}, "MonteCarlo"),
        (withGap, {"policy": "safe"}, "ActiveSubspace"),
    ],
)
def test_told_outputs_give_the_bits_of_the_function(evaluate, settings, method, tmp_path):
    expected = direct(evaluate, **settings)
    assert expected.getMethod() == method
    ot.RandomGenerator.SetSeed(0)
    result, blocks = answered(asked(tmp_path / "state", **settings), evaluate)
    assert bits(result) == bits(expected)
    assert blocks > 3
    assert list(result.getInputSample().getDescription()) == NAMES


def test_components_are_asked_for_without_a_comparison(tmp_path):
    """The outputs are all that there is: the event's own function is the composition, and is not evaluated."""
    composition = ot.SymbolicFunction(["y", "z"], ["y + 0.1 * z"])
    made = []

    def evaluate(x):
        made.append(len(x))
        return pair(x)

    def algorithm(components):
        found = algorithmOf(ot.ComposedFunction(composition, components))
        found.setComponents(components, composition)
        return found

    ot.RandomGenerator.SetSeed(0)
    whole = algorithm(ot.PythonFunction(2, 2, func_sample=pair))
    whole.run()
    expected = whole.getResult()
    ot.RandomGenerator.SetSeed(0)
    result, _ = answered(
        AskTellReliability(algorithm(outsideFunction(NAMES, ["y", "z"])), tmp_path / "state"), evaluate
    )
    assert bits(result) == bits(expected)
    # The comparison counts, as in the direct run.
    assert sum(made) == result.getEvaluationNumber() - 1


def test_a_gradient_of_the_function_is_not_asked_for(tmp_path):
    algorithm = algorithmOf(ot.SymbolicFunction(NAMES, ["force + 0.5 * play - 0.1 * play^2"]))
    ot.RandomGenerator.SetSeed(0)
    result, _ = answered(AskTellReliability(algorithm, tmp_path / "state"), smooth)
    assert result.getProbabilityEstimate() == direct(smooth).getProbabilityEstimate()


SCRIPT = """
import sys
import numpy as np
import openturns as ot
from satsep_ot import ActiveSubspaceReliability, AskTellReliability
from satsep_ot.methods.reliability.ask_tell import outsideFunction

what, directory, seed = sys.argv[1], sys.argv[2], int(sys.argv[3])
law = ot.JointDistribution([ot.Normal(), ot.Uniform(-2.0, 2.0)])
vector = ot.CompositeRandomVector(outsideFunction(["force", "play"], ["y"]), ot.RandomVector(law))
algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 2.5))
algorithm.setMaximumEvaluations(1500)
algorithm.setTargetCoefficientOfVariation(0.2)
ot.RandomGenerator.SetSeed(seed)
study = AskTellReliability(algorithm, f"{directory}/state")
if what == "ask":
    block = study.ask()
    block.exportToCSVFile(f"{directory}/block.csv")
else:
    x = ot.Sample.ImportFromCSVFile(f"{directory}/block.csv")
    a = np.array(x)
    study.tell(x, a[:, :1] + 0.5 * a[:, 1:] - 0.1 * a[:, 1:] ** 2)
"""


def test_each_call_may_be_a_process_of_its_own_and_the_state_keeps_the_seed(tmp_path):
    for seed in range(2):
        # The seed of the first one is the seed of all.
        for what in ("ask", "tell"):
            subprocess.run([sys.executable, "-c", SCRIPT, what, str(tmp_path), str(seed)], check=True)
    result, _ = answered(asked(tmp_path / "state"), smooth)
    assert bits(result) == bits(direct(smooth))


def kept(file):
    return file.read_bytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x, y: (x[:-1], y[:-1]), r"inputs have the shape \(\d, 2\); \(\d, 2\) was asked for"),
        (lambda x, y: (x, y[:-1]), r"outputs have the shape \(\d, 1\); \(\d, 1\) was asked for; tell the whole block"),
        (lambda x, y: (x, np.hstack([y, y])), r"outputs have the shape \(\d, 2\)"),
        (lambda x, y: (x, y[:, 0]), r"outputs have the shape \(\d,\)"),
        (lambda x, y: (x + [[0.0, 1e-3]], y), "play of row 0 is .* was asked for"),
        (lambda x, y: (x[::-1], y[::-1]), "not those that were asked for: force of row 0"),
        (lambda x, y: (x, np.where(np.arange(len(y))[:, None] == 1, np.nan, y)), r"1 of \d runs .* row 1: \[nan\]"),
        (lambda x, y: (x, np.full(y.shape, np.inf)), "not finite, the first is row 0"),
    ],
)
def test_a_block_that_does_not_fit_is_refused_and_nothing_is_lost(change, message, tmp_path):
    study = asked(tmp_path / "state")
    block = study.ask()
    before = kept(tmp_path / "state")
    with pytest.raises(ValueError, match=message):
        study.tell(*change(np.array(block), smooth(block)))
    assert kept(tmp_path / "state") == before
    study.tell(block, smooth(block))
    assert study.ask() != block


def test_two_processes_cannot_tell_the_same_block(tmp_path):
    one, other = asked(tmp_path / "state"), asked(tmp_path / "state")
    block = one.ask()
    assert other.ask() == block
    one.tell(block, smooth(block))
    with pytest.raises(ValueError, match="written by another computation too"):
        other.tell(block, smooth(block))
    with pytest.raises(ValueError, match="told before"):
        other.tell(block, smooth(block))
    assert other.ask() == one.ask() != block


def test_a_block_that_was_told_is_refused_also_at_the_end(tmp_path):
    study = asked(tmp_path / "state")
    with pytest.raises(RuntimeError, match=r"no result yet; tell the outputs of what ask\(\) gives"):
        study.getResult()
    first = study.ask()
    assert study.ask() == first
    study.tell(first, smooth(first))
    before = kept(tmp_path / "state")
    for _ in range(2):
        with pytest.raises(ValueError, match=r"told before; ask\(\) has the next one"):
            study.tell(first, smooth(first))
    assert kept(tmp_path / "state") == before
    second = study.ask()
    study.tell(second, smooth(second))
    answered(study, smooth)
    with pytest.raises(ValueError, match="told before"):
        study.tell(second, smooth(second))
    with pytest.raises(RuntimeError, match="no block of runs is asked for any more"):
        study.tell([[9.0, 1.0]], [[0.0]])


def test_runs_far_from_likely_inputs_need_no_value(tmp_path):
    study = asked(tmp_path / "state")
    first = study.ask()
    study.tell(first, smooth(first))
    # The next block looks far out.
    wide = study.ask()
    study.tell(wide, np.where(np.arange(wide.getSize())[:, None] == 0, np.nan, smooth(wide)))
    result, _ = answered(study, smooth)
    assert "1 runs far from where inputs are likely gave no value" in result.getReason()


def test_the_state_of_another_study_is_refused(tmp_path):
    file = tmp_path / "state"
    study = asked(file)
    block = study.ask()
    study.tell(block, smooth(block))
    before = kept(file)
    for other, what in (
        (asked(file, threshold=2.6), "another event"),
        (asked(file, policy="safe"), "another nonFinitePolicy"),
        (AskTellReliability(algorithmOf(outsideFunction([*NAMES], ["z"])), file), "another event"),
    ):
        for call in (other.ask, lambda other=other: other.tell(block, smooth(block))):
            with pytest.raises(ValueError, match=f"checkpoint of another computation, with {what}"):
                call()
    assert kept(file) == before
    file.write_bytes(json.dumps({"no": "state"}).encode() + b"\n")
    with pytest.raises(ValueError, match="is no checkpoint, or it is damaged"):
        asked(file).ask()


def test_the_function_that_has_no_values_says_so():
    with pytest.raises(RuntimeError, match="evaluated elsewhere; use AskTellReliability"):
        algorithmOf(outsideFunction(NAMES, ["y"])).run()
