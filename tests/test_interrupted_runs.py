"""A study and a benchmark that are killed, or interrupted, and continued give what uninterrupted ones give."""

import json
import logging
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from process_tree import descendants, survivors
from small_cases import BODIES, MASS_AND_RATE, ROLLING

from satsep_ot.studies.study_runs import list_runs, load_runs

pytestmark = pytest.mark.slow

CASE = f"""name = "small"
{BODIES}table = "tables/push.csv"
{MASS_AND_RATE}cant = {{ quantity = "springs.cant.each", sigma = 0.02 }}
{ROLLING}[[requirements]]
name = "slow"
quantity = "axial_velocity"
minimum = 0.245
"""
METHODS = ["ActiveSubspace", "FORM", "SubsetSampling", "MonteCarlo"]


def case_file(folder):
    (folder / "tables").mkdir()
    (folder / "tables" / "push.csv").write_text("stroke_mm,force_N\n0,2.0\n10,1.0\n", encoding="utf-8")
    path = folder / "small.toml"
    path.write_text(CASE, encoding="utf-8")
    return path


def start(*arguments):
    command = [sys.executable, "-m", "satsep_ot", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(*arguments):
    with start(*arguments) as process:
        out, errors = process.communicate(timeout=500)
    assert process.returncode == 0, errors
    return out, errors


def stop(label, number, *arguments):
    """Start the program, and send it a signal as soon as it says that it is at this label, or a later one."""
    with start(*arguments) as process:
        while not re.search(label, line := process.stderr.readline()):
            assert line, f"it ended before {label}"
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    return process.returncode, errors


def without_timings(path):
    """The numbers of results.json; the time of day and the seconds are what an interruption may change."""
    results = json.loads((path / "results.json").read_text(encoding="utf-8"))
    del results["finished"]
    for row in results["rows"]:
        del row["seconds"]
    return results


def compare(cut, whole):
    """Two studies have the same results to the last bit, the same files, and no leftovers."""
    assert without_timings(cut) == without_timings(whole)
    left, right = (sorted(str(path.relative_to(folder)) for path in folder.rglob("*")) for folder in (cut, whole))
    assert left == right
    for name in list_runs(whole):
        one, other = load_runs(cut, name), load_runs(whole, name)
        assert np.array_equal(one.inputs, other.inputs)
        assert np.array_equal(one.outputs, other.outputs)
        assert np.array_equal(one.weights, other.weights, equal_nan=True)
    for name in ("motion.json", "case.toml", "tables/push.csv"):
        assert (cut / name).read_bytes() == (whole / name).read_bytes()


def test_a_study_that_is_killed_again_and_again(tmp_path):
    case = case_file(tmp_path)
    options = ["--seed", 5, "--runs", 300_000, "--tolerances", 1, "--methods", *METHODS]
    finish("study", case, "--output", tmp_path / "whole", *options)
    cut = ["study", case, "--output", tmp_path / "cut", *options]
    code, errors = stop("Monte Carlo runs", signal.SIGINT, *cut)
    assert code == 130, errors
    assert f"what was finished is kept in {tmp_path / 'cut'}: the same command with --resume continues" in errors
    for label in ("active subspaces from gradients", r"\([23] of 9\)", r"\([56] of 9\)"):
        code, errors = stop(label, signal.SIGKILL, *cut, "--resume")
        assert code == -signal.SIGKILL, errors
    code, errors = stop(r"\([78] of 9\)", signal.SIGINT, *cut, "--resume")
    assert code == 130, errors
    for label in (r"\(2 of 2\)", "% +figures and report"):
        code, errors = stop(label, signal.SIGKILL, *cut, "--resume")
        assert code == -signal.SIGKILL, errors
    _, errors = finish(*cut, "--resume")
    compare(tmp_path / "cut", tmp_path / "whole")
    # The directory has all that is needed: the case in it is the same case.
    out, _ = finish("study", tmp_path / "cut" / "case.toml", "--output", tmp_path / "cut", *options, "--resume")
    assert "report.html" in out


def compare_tables(cut, whole):
    tables = []
    for folder in (cut, whole):
        table = json.loads((folder / "benchmark.json").read_text(encoding="utf-8"))
        tables.append([{key: value for key, value in row.items() if key != "seconds"} for row in table])
    assert tables[0] == tables[1]


def test_a_benchmark_that_is_killed_and_interrupted(tmp_path):
    options = ["--problems", "RP8", "RP107", "--methods", "ActiveSubspace", "FORM", "--repetitions", 4]
    finish("benchmark", "--output", tmp_path / "whole", *options)
    cut = ["benchmark", "--output", tmp_path / "cut", *options]
    code, errors = stop("RP107: ActiveSubspace", signal.SIGKILL, *cut)
    assert code == -signal.SIGKILL, errors
    # As by a power failure, in the middle of a line.
    with (tmp_path / "cut" / "runs.jsonl").open("a", encoding="utf-8") as stream:
        stream.write('{"key": "[\\"RP8')
    code, errors = stop("RP8: FORM", signal.SIGINT, *cut, "--resume")
    assert code == 130, errors
    assert "--resume continues" in errors
    finish(*cut, "--resume")
    compare_tables(tmp_path / "cut", tmp_path / "whole")


# With workers. --------------------------------------------------------------------------------------------------------

# As `python -m satsep_ot`, but with a checkpoint after almost every chunk, to be killed between two of them.
OFTEN = """
from satsep_ot import cli
from satsep_ot.methods.parallel import stream_storage
stream_storage.CHECKPOINT_INTERVAL = 0.1
raise SystemExit(cli.main())
"""
RUNS = 400_000
SAMPLE = ["--seed", 5, "--runs", RUNS, "--tolerances", 0, "--methods", "SubsetSampling", "MonteCarlo"]


class Running:
    """The program at work."""

    def __init__(self, log, *arguments):
        self._log = log
        with log.open("w", encoding="utf-8") as stream:
            command = [sys.executable, "-c", OFTEN, *map(str, arguments)]
            self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stream)

    def said(self, text=""):
        return text in self._log.read_text(encoding="utf-8")

    def wait_for(self, moment):
        """What the moment gives when it has come."""
        end = time.monotonic() + 120.0
        while not (found := moment()):
            assert self.process.poll() is None, f"it ended before: {self._log.read_text(encoding='utf-8')}"
            assert time.monotonic() < end, f"it never came: {self._log.read_text(encoding='utf-8')}"
            time.sleep(0.002)
        return found

    def workers(self):
        return descendants(self.process.pid, "multiprocessing.spawn")

    def kill(self):
        """Kill the process that was started; nothing that it has started lives on."""
        family = descendants(self.process.pid)
        self.process.kill()
        assert self.process.wait() == -signal.SIGKILL
        assert not survivors(family)

    def finish(self):
        code = self.process.wait(timeout=500)
        return code, self._log.read_text(encoding="utf-8")


def kept(directory):
    """How many runs of the sample are kept for the next one."""
    path = directory / "steps" / "sample.checkpoint"
    return json.loads(path.read_text(encoding="utf-8"))["summary"]["size"] if path.exists() else 0


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A case, and the directory of its study that nobody disturbed, without workers."""
    folder = tmp_path_factory.mktemp("undisturbed")
    case = case_file(folder)
    finish("study", case, "--output", folder / "whole", *SAMPLE)
    return case, folder / "whole"


def kill_and_continue(undisturbed, folder, *options):
    """A study that is killed at several moments, from the first one of its sample on, beside one that is not."""
    (case, whole), cut = undisturbed, folder / "cut"
    command = ["study", case, "--output", cut, *SAMPLE, *options, "--resume"]
    shares = []
    for moment in (
        lambda study: study.said("Monte Carlo runs"),
        lambda study: "--workers" not in options or study.workers(),
        lambda study: kept(cut) > 0.1 * RUNS,
        lambda study: kept(cut) > 0.3 * RUNS,
        lambda study: kept(cut) > 0.6 * RUNS,
        lambda study: study.said("rolling: SubsetSampling"),
    ):
        study = Running(folder / "log", *command)
        study.wait_for(lambda study=study, moment=moment: moment(study))
        study.kill()
        shares.append(kept(cut) / RUNS)
    # The whole sample was not made again and again; its checkpoint is gone when it is finished.
    assert shares[2] > 0.1
    assert shares == sorted(shares[:-1]) + [0.0]
    assert Running(folder / "log", *command).finish()[0] == 0
    compare(cut, whole)


def test_a_study_with_workers_that_is_killed(undisturbed, tmp_path):
    kill_and_continue(undisturbed, tmp_path, "--workers", 2)


def test_a_study_on_a_cluster_that_is_killed(undisturbed, tmp_path):
    """The cluster of the user stays, and does not go on with what nobody waits for."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as cluster:  # fmt: skip
        kill_and_continue(undisturbed, tmp_path, "--dask", cluster.scheduler_address)
        with distributed.Client(cluster) as client:
            assert len(client.nthreads()) == 2
            assert not any(client.processing().values())


def test_workers_of_a_study_that_are_killed(undisturbed, tmp_path):
    """One, and a second one, in the middle: their chunks are made by others. Then all: what was finished is kept."""
    (case, whole), cut = undisturbed, tmp_path / "cut"
    command = ["study", case, *SAMPLE, "--workers", 2, "--output"]
    study = Running(tmp_path / "log", *command, cut)
    for share in (0.1, 0.4):
        study.wait_for(lambda share=share: kept(cut) > share * RUNS)
        os.kill(min(study.workers()), signal.SIGKILL)
    # And a process of the estimates, which begin with the sample.
    study.wait_for(lambda: study.said("SubsetSampling"))
    os.kill(min(study.workers()), signal.SIGKILL)
    code, said = study.finish()
    assert code == 0, said
    compare(cut, whole)

    study = Running(tmp_path / "log", *command, cut, "--overwrite")
    study.wait_for(lambda: kept(cut) > 0.1 * RUNS)
    killed = set()
    while study.process.poll() is None:
        for worker in study.workers():
            os.kill(worker, signal.SIGKILL)
            killed.add(worker)
    code, said = study.finish()
    assert code == 1, said
    error = said.splitlines()[-1]
    found = re.match(r"satsep-ot: rows (\d+) to (\d+) could not be computed in 3 attempts, .* its worker died", error)
    assert found, error
    assert f"what was finished is kept in {cut}: the same command with --resume continues" in error
    assert len(killed) >= 3
    # All that comes before.
    assert kept(cut) == int(found[1]) > 0.1 * RUNS
    code, said = Running(tmp_path / "log", *command, cut, "--resume").finish()
    assert code == 0, said
    compare(cut, whole)


def test_a_benchmark_that_is_killed_after_any_repetition(tmp_path):
    options = ["--problems", "RP8", "RP107", "--methods", "ActiveLineSampling", "FORM", "--repetitions", 5]
    finish("benchmark", "--output", tmp_path / "whole", *options)
    cut, runs = ["benchmark", "--output", tmp_path / "cut", *options, "--resume"], tmp_path / "cut" / "runs.jsonl"
    before = b""
    for lines, workers in ((1, []), (2, ["--workers", 2]), (6, []), (9, ["--workers", 3]), (15, ["--workers", 1])):
        benchmark = Running(tmp_path / "log", *cut, *workers)
        benchmark.wait_for(lambda lines=lines: runs.exists() and runs.read_bytes().count(b"\n") >= lines)
        benchmark.kill()
        # Nothing that was finished is lost or made again.
        assert runs.read_bytes().startswith(before)
        before = runs.read_bytes()
    finish(*cut)
    assert runs.read_bytes().startswith(before)
    assert len(runs.read_text(encoding="utf-8").splitlines()) == 20
    compare_tables(tmp_path / "cut", tmp_path / "whole")
