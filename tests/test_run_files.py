"""Blocks of runs in CSV files: the bits of the function in any order of rows, and what does not fit is refused."""

import csv
import math

import openturns as ot
import pytest
from test_ask_tell import NAMES, algorithmOf, asked, bits, direct, smooth

from satsep_ot import AskTellReliability
from satsep_ot.methods.reliability.ask_tell import outsideFunction
from satsep_ot.methods.reliability.run_files import RunFiles, RunsNeeded


def answer(inputs, outputs, change=lambda rows: rows, evaluate=smooth, withInputs=False):
    """What a program on a cluster does: read the inputs, write the outputs, in another order."""
    with open(inputs, newline="") as stream:
        asked = list(csv.DictReader(stream))
    rows = []
    for row in asked:
        y = evaluate([[float(row[name]) for name in NAMES]])[0, 0]
        rows.append({"run": row["run"], "y": repr(float(y)), "seconds": "600"} | (row if withInputs else {}))
    rows = change(rows[::-1])
    with open(outputs, "w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0] if rows else ["run", "y"])
        writer.writeheader()
        writer.writerows(rows)


def finished(files, study, **how):
    """The result, and how often runs were asked for."""
    for count in range(1000):
        try:
            return files.advance(study), count
        except RunsNeeded as needed:
            answer(needed.inputs, needed.outputs, **how)
    raise AssertionError


@pytest.mark.parametrize("withInputs", [False, True])
def test_files_give_the_bits_of_the_function(withInputs, tmp_path):
    ot.RandomGenerator.SetSeed(0)
    result, blocks = finished(RunFiles(tmp_path / "runs"), asked(tmp_path / "state"), withInputs=withInputs)
    assert bits(result) == bits(direct(smooth))
    assert len(list((tmp_path / "runs").iterdir())) == 2 * blocks > 6


def test_a_lost_state_is_made_again_from_the_files(tmp_path):
    results = []
    for _ in range(2):
        ot.RandomGenerator.SetSeed(0)
        (tmp_path / "state").unlink(missing_ok=True)
        results.append(finished(RunFiles(tmp_path), asked(tmp_path / "state")))
    assert bits(results[0][0]) == bits(results[1][0])
    assert results[1][1] == 0


def test_runs_of_one_computation_serve_another(tmp_path):
    """The first runs are the same, whatever the event."""
    files, counts = RunFiles(tmp_path), []
    for threshold in (2.5, 2.7):
        before = len(files.runs())
        ot.RandomGenerator.SetSeed(0)
        result, _ = finished(files, asked(tmp_path / f"state-{threshold}", threshold=threshold))
        ot.RandomGenerator.SetSeed(0)
        assert bits(result) == bits(direct(smooth, threshold=threshold))
        counts.append(len(files.runs()) - before - result.getEvaluationNumber())
    assert counts[0] == 0 > counts[1]


def test_a_block_is_as_large_as_the_user_wants(tmp_path):
    sizes = {}
    for size in (None, 40):
        algorithm = algorithmOf(outsideFunction(NAMES, ["y"]))
        algorithm.setBlockSize(size)
        assert algorithm.getBlockSize() == size
        ot.RandomGenerator.SetSeed(0)
        study = AskTellReliability(algorithm, tmp_path / f"{size}")
        blocks = sizes[size] = []
        while (block := study.ask()) is not None:
            blocks.append(block.getSize())
            study.tell(block, smooth(block))
        function = algorithmOf(ot.PythonFunction(2, 1, func_sample=smooth))
        function.setBlockSize(size)
        ot.RandomGenerator.SetSeed(0)
        function.run()
        assert bits(study.getResult())[:2] == bits(function.getResult())[:2]
    # Wide runs are a part of a block.
    assert sizes[None][2] < 8 < 20 < sizes[40][2]
    assert len(sizes[40]) < len(sizes[None])
    with pytest.raises(ValueError, match="the block size is 0; it must be a positive integer, or None"):
        algorithm.setBlockSize(0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[1:], r"1 of \d runs are missing, the first is \d-[0-9a-f]{6}; give the whole block"),
        (lambda rows: [*rows, rows[0]], "rows for .* runs; give each run once"),
        (lambda rows: [], "has no rows"),
        (lambda rows: [row | {"run": "1-000000"} for row in rows], "'1-000000' was not asked for in"),
        (lambda rows: [*rows, rows[0] | {"run": "99-000000"}], "the run '99-000000' is none of block-1-inputs.csv"),
        (lambda rows: [{"row" if k == "run" else k: v for k, v in row.items()} for row in rows], "has no column 'run'"),
        (lambda rows: [{"run": row["run"], "z": row["y"]} for row in rows], "has no column 'y'; give a column for"),
        (lambda rows: [row | {"y": "nan"} for row in rows], r"has the outputs \[nan\], which must be finite"),
        (lambda rows: [row | {"y": ""} for row in rows], r"has the outputs \[nan\], which must be finite"),
        (lambda rows: [row | {"y": "1,5"} for row in rows], "'y' of the run .* is '1,5'; give a number"),
        (lambda rows: [row | {"play": "0.25"} for row in rows], "run .*: the inputs are not those .* play of row 0 is"),
    ],
)  # fmt: skip
def test_outputs_that_do_not_fit_are_refused_and_nothing_is_lost(change, message, tmp_path):
    files, study = RunFiles(tmp_path / "runs"), asked(tmp_path / "state")
    with pytest.raises(RunsNeeded) as needed:
        files.advance(study)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    given = tmp_path / "given.csv"
    answer(needed.value.inputs, given, change)
    with pytest.raises(ValueError, match=message):
        files.tell(study, given)
    given.unlink()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    # The same by a file that lies where it is looked for: it says so each time, until the file is mended.
    if "was not asked for" not in message and "no rows" not in message:
        answer(needed.value.inputs, needed.value.outputs, change)
        for _ in range(2):
            with pytest.raises(ValueError, match=message):
                files.advance(study)
        needed.value.outputs.unlink()
    answer(needed.value.inputs, given)
    assert files.tell(study, given) == needed.value.outputs
    with pytest.raises(ValueError, match=r"block-1-inputs\.csv was told before, by .*; ask for the next block"):
        files.tell(study, given)
    with pytest.raises(
        RunsNeeded, match=r"their inputs are in .*block-2-inputs\.csv; write their outputs to .*block-2-outputs\.csv"
    ):
        files.advance(study)


def test_runs_without_a_value_follow_the_policy(tmp_path):
    def withGap(x):
        y = smooth(x)
        y[[row[0] < -2.0 for row in x]] = math.nan
        return y

    ot.RandomGenerator.SetSeed(0)
    study = asked(tmp_path / "state", policy="safe")
    assert study.acceptsNonFinite()
    result, _ = finished(RunFiles(tmp_path), study, evaluate=withGap)
    assert bits(result)[:2] == bits(direct(withGap, policy="safe"))[:2]


def test_a_file_of_inputs_that_was_changed_is_refused(tmp_path):
    files, study = RunFiles(tmp_path), asked(tmp_path / "state")
    with pytest.raises(RunsNeeded) as needed:
        files.advance(study)
    path = needed.value.inputs
    text = path.read_text()
    path.write_text(text.replace("0.", "1.", 1))
    with pytest.raises(ValueError, match=r"is not as it was written; remove the file, and it is written again"):
        files.advance(study)
    path.unlink()
    with pytest.raises(RunsNeeded):
        files.advance(study)
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"run,y\n1-0,\xff\n", "is no CSV file of commas"),
        (b"", "has no column 'run'"),
        (b"run;y\n1-0;2\n", "has no column 'run'"),
        (b"run,y,y\n1-0,1,2\n", "has two columns 'y'"),
        (b"run,y\n1-0,1,2\n", "row 2 has 3 cells; the header has 2"),
        (b'run,y\n"1-0,1\n', "is no CSV file of commas"),
    ],
)
def test_what_is_no_table_is_refused(text, message, tmp_path):
    files, study = RunFiles(tmp_path), asked(tmp_path / "state")
    with pytest.raises(RunsNeeded):
        files.advance(study)
    (tmp_path / "given.csv").write_bytes(text)
    with pytest.raises(ValueError, match=message):
        files.tell(study, tmp_path / "given.csv")
