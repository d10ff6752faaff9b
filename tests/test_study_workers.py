"""`satsep-ot study --workers` and `--dask`: the numbers of a study without, and errors that say what to do."""

import json
import logging
import os
import signal

import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL

from satsep_ot import cli
from satsep_ot.methods.parallel.scheduler import ChunkScheduler
from satsep_ot.studies.separation_study import SeparationStudy

CASE = SMALL + MASS_AND_RATE + ROLLING


def study(folder, output, *arguments, sigma=0.4):
    path = folder / "case.toml"
    path.write_text(CASE.replace("0.4", str(sigma)), encoding="utf-8")
    options = ["--runs", "12000", "--methods", "MonteCarlo", "--output", str(folder / output)]
    return cli.main(["study", str(path), *options, *arguments])


def numbers(folder, output):
    document = json.loads((folder / output / "results.json").read_text(encoding="utf-8"))
    for row in document["rows"]:
        del row["seconds"]
    return document["rows"], document["quantities"]


@pytest.mark.slow
def test_workers_change_no_number(tmp_path, capsys):
    assert study(tmp_path, "alone") == 0
    assert study(tmp_path, "two", "--workers", "2") == 0
    assert numbers(tmp_path, "two") == numbers(tmp_path, "alone")
    outputs = [(tmp_path / name / "runs" / "sample.npy").read_bytes() for name in ("alone", "two")]
    assert outputs[0] == outputs[1]


@pytest.mark.slow
def test_a_cluster_changes_no_number(tmp_path, capsys):
    distributed = pytest.importorskip("distributed")
    assert study(tmp_path, "alone") == 0
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as cluster:  # fmt: skip
        assert study(tmp_path, "dask", "--dask", cluster.scheduler_address) == 0
    assert numbers(tmp_path, "dask") == numbers(tmp_path, "alone")


@pytest.mark.slow
def test_an_address_where_nobody_answers(tmp_path, capsys):
    pytest.importorskip("distributed")
    assert study(tmp_path, "never", "--dask", "tcp://127.0.0.1:9") == 2
    said = capsys.readouterr().err
    assert "satsep-ot: no Dask scheduler answers at tcp://127.0.0.1:9 within 10 s" in said
    assert not (tmp_path / "never").exists()


def test_what_is_no_address(tmp_path, capsys):
    pytest.importorskip("distributed")
    assert study(tmp_path, "never", "--dask", "here") == 2
    assert "satsep-ot: here is no address of a Dask scheduler, such as tcp://" in capsys.readouterr().err


def test_without_dask_the_error_says_what_to_install(tmp_path, capsys, monkeypatch):
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "distributed" else found(name))
    assert study(tmp_path, "never", "--dask", "tcp://127.0.0.1:9") == 2
    assert "--dask needs the package distributed, which satsep-ot[distributed] installs" in capsys.readouterr().err


@pytest.mark.slow
def test_runs_that_fail_on_a_worker_are_named(tmp_path, capsys):
    assert study(tmp_path, "wild", "--workers", "1", sigma=1e9) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("satsep-ot: rows 0 to 11999 could not be computed in 3 attempts")
    assert "SeparationError: row " in said


@pytest.mark.parametrize("arguments", [["--workers", "0"], ["--workers", "2", "--dask", "tcp://127.0.0.1:9"]])
def test_bad_options(arguments, tmp_path, capsys):
    with pytest.raises(SystemExit) as caught:
        study(tmp_path, "never", *arguments)
    assert caught.value.code == 2


@pytest.mark.slow
def test_a_stopped_worker_does_not_change_a_number(tmp_path, capsys, monkeypatch):
    """Every process of the first pool is stopped as soon as it is there."""
    pools = []
    limit = ChunkScheduler.setMeasuredTimeout
    monkeypatch.setattr(ChunkScheduler, "setMeasuredTimeout", lambda scheduler: limit(scheduler, 20.0, 2.0))
    make = ChunkScheduler.getExecutor

    def stopping(scheduler):
        pool = make(scheduler)
        if pool not in pools:
            pools.append(pool)
            if len(pools) == 1:
                pool.submit(abs, -1), pool.submit(abs, -1)
                for process in pool._processes.values():
                    os.kill(process.pid, signal.SIGSTOP)
        return pool

    assert study(tmp_path, "alone") == 0
    monkeypatch.setattr(ChunkScheduler, "getExecutor", stopping)
    assert study(tmp_path, "two", "--workers", "2") == 0
    assert len(pools) >= 2
    assert numbers(tmp_path, "two") == numbers(tmp_path, "alone")


def test_workers_of_another_kind_are_refused_or_stated_in_the_report(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("satsep_ot.studies.sample.processorDescription", lambda: "Zen, numpy 0")
    assert study(tmp_path, "refused", "--workers", "1") == 2
    said = capsys.readouterr().err
    assert "where Zen, numpy 0 is used" in said
    assert "study --mixed-processors" in said
    assert study(tmp_path, "accepted", "--workers", "1", "--mixed-processors") == 0
    page = (tmp_path / "accepted" / "report.html").read_text(encoding="utf-8")
    assert "made by processors or versions of 2 kinds" in page
    origin = json.loads((tmp_path / "accepted" / "origin.json").read_text(encoding="utf-8"))
    assert "numpy" in origin["about"]["processor"]


def test_the_answer_does_not_wait_for_the_pictures(tmp_path, monkeypatch, capsys):
    def save(self):
        raise OSError("no space for the pictures")

    monkeypatch.setattr(SeparationStudy, "save", save)
    assert study(tmp_path, "full") == 2
    shown = capsys.readouterr()
    assert "Any requirement violated" in shown.out
    assert "no space for the pictures" in shown.err
