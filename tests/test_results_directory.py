"""Whose a directory is: nothing of anybody else's is overwritten, and nothing is continued that is not the same."""

import errno
import fcntl
import hashlib
import json
import math

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.common.storage import TEMPORARY
from satsep_ot.studies.results_directory import DirectoryError, ResultsDirectory, digest, file_stem

IDENTITY = {"case": "a1", "seed": 0, "methods": ["FORM", "SORM"], "versions": {"numpy": "2.4", "scipy": "1.17"}}
PATTERNS = ("results.json", "steps/*", "figures/*")


def open_directory(path, identity=IDENTITY, kind="study", **options):
    return ResultsDirectory(path, kind, identity, PATTERNS, **options)


def begin(path, **options):
    """A directory with one finished step, closed again."""
    directory = open_directory(path, **options)
    directory.keep(("spin", "FORM"), {"probability": 1.0 / 3.0})
    directory.close()


def test_a_step_comes_back_to_the_last_bit(tmp_path):
    directory = open_directory(tmp_path / "new" / "one")
    values = [0.1, 1.0 / 3.0, 5e-324, 1.7976931348623157e308, -0.0, 2.0**53 + 2.0]
    directory.keep(("spin", "FORM"), {"values": values})
    assert directory.finished("spin", "FORM")["values"] == values
    assert math.copysign(1.0, directory.finished("spin", "FORM")["values"][4]) == -1.0
    assert directory.finished("spin", "SORM") is None
    directory.keep(("spin", "SORM"), {"values": [math.nan, math.inf, -math.inf]})
    assert np.array_equal(directory.finished("spin", "SORM")["values"], [np.nan, np.inf, -np.inf], equal_nan=True)
    with pytest.raises(TypeError, match="not JSON serializable"):
        directory.keep(("spin", "MonteCarlo"), {"values": np.zeros(2)})
    assert directory.finished("spin", "MonteCarlo") is None


def test_another_identity_is_refused_with_what_differs(tmp_path):
    begin(tmp_path)
    for change, words in (
        ({"case": "b2"}, "of another case: give another directory, or --overwrite to lose that one"),
        ({"seed": 7}, "with seed = 0 instead of 7"),
        ({"methods": ["FORM"]}, "with methods = FORM SORM instead of FORM"),
        ({"versions": {"numpy": "1.26", "scipy": "1.17"}}, "with numpy 2.4 instead of 1.26:"),
    ):
        for options in ({}, {"resume": True}):
            with pytest.raises(DirectoryError, match="holds another study") as caught:
                open_directory(tmp_path, {**IDENTITY, **change}, **options)
            assert words in str(caught.value)
            assert "\n" not in str(caught.value)
    assert open_directory(tmp_path, resume=True).finished("spin", "FORM") is not None


def test_the_same_is_refused_until_it_is_said_what_is_wanted(tmp_path):
    begin(tmp_path)
    with pytest.raises(DirectoryError, match="holds this study already: --resume continues from what is finished"):
        open_directory(tmp_path)
    with pytest.raises(DirectoryError, match="exclude each other"):
        open_directory(tmp_path, resume=True, overwrite=True)
    directory = open_directory(tmp_path, resume=True)
    assert directory.finished("spin", "FORM") == {"probability": 1.0 / 3.0}
    directory.close()
    assert open_directory(tmp_path, overwrite=True).finished("spin", "FORM") is None


def test_resume_begins_where_nothing_is(tmp_path):
    assert open_directory(tmp_path / "new", resume=True).finished("spin", "FORM") is None
    assert open_directory(tmp_path / "other", overwrite=True).finished("spin", "FORM") is None


@pytest.mark.parametrize("options", [{}, {"resume": True}, {"overwrite": True}])
def test_foreign_files_are_refused_and_stay(tmp_path, options):
    (tmp_path / "results.json").write_text("precious", encoding="utf-8")
    with pytest.raises(DirectoryError, match=r"holds other files, such as results.json, and no study"):
        open_directory(tmp_path, **options)
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]
    with pytest.raises(DirectoryError, match="is not a directory"):
        open_directory(tmp_path / "results.json", **options)


@pytest.mark.parametrize("options", [{}, {"resume": True}, {"overwrite": True}])
def test_another_kind_and_another_version_are_refused(tmp_path, options):
    begin(tmp_path)
    with pytest.raises(DirectoryError, match="holds a study, not a benchmark"):
        open_directory(tmp_path, kind="benchmark", **options)
    origin = tmp_path / "origin.json"
    content = json.loads(origin.read_text(encoding="utf-8"))
    origin.write_text(json.dumps({**content, "format": 99}), encoding="utf-8")
    with pytest.raises(DirectoryError, match="what another version has written"):
        open_directory(tmp_path, **options)
    origin.write_text("{", encoding="utf-8")
    with pytest.raises(DirectoryError, match=r"origin.json cannot be read"):
        open_directory(tmp_path, **options)


def test_overwrite_removes_what_is_its_own_and_nothing_else(tmp_path):
    begin(tmp_path, files={"case.toml": "first", "tables/push.csv": "0,1", "edited.csv": "0,2"})
    (tmp_path / "results.json").write_text("{}", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "one.svg").touch()
    (tmp_path / "edited.csv").write_text("0,3", encoding="utf-8")
    open_directory(tmp_path, {**IDENTITY, "case": "b2"}, overwrite=True, files={"case.toml": "second"})
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {"case.toml", "edited.csv", "manifest.json", "notes.txt", "origin.json"}
    assert (tmp_path / "case.toml").read_text(encoding="utf-8") == "second"


def test_overwrite_reaches_for_nothing_outside(tmp_path):
    """Not even where a directory from elsewhere names it."""
    outside = tmp_path / "outside.csv"
    outside.write_text("0,1", encoding="utf-8")
    begin(tmp_path / "study", files={"case.toml": "first"})
    origin = tmp_path / "study" / "origin.json"
    content = json.loads(origin.read_text(encoding="utf-8"))

    content["files"]["../outside.csv"] = content["files"][str(outside)] = hashlib.sha256(b"0,1").hexdigest()
    origin.write_text(json.dumps(content), encoding="utf-8")
    open_directory(tmp_path / "study", overwrite=True)
    assert outside.exists()


def test_a_case_that_was_edited_in_the_directory_is_not_lost(tmp_path):
    begin(tmp_path, files={"case.toml": "first"})
    (tmp_path / "case.toml").write_text("edited", encoding="utf-8")
    with pytest.raises(DirectoryError, match=r"case.toml has been changed since"):
        open_directory(tmp_path, overwrite=True, files={"case.toml": "first"})
    # Before anything was removed.
    assert (tmp_path / "steps").exists()
    directory = open_directory(tmp_path, {**IDENTITY, "case": "b2"}, overwrite=True, files={"case.toml": "edited"})
    assert directory.finished("spin", "FORM") is None
    assert (tmp_path / "case.toml").read_text(encoding="utf-8") == "edited"


def test_a_file_with_the_name_of_a_result_is_refused(tmp_path):
    for name in ("results.json", "origin.json", "figures/one.svg"):
        with pytest.raises(DirectoryError, match="it needs another name"):
            open_directory(tmp_path / "new", files={name: "text"})


def test_what_a_killed_process_left_is_cleared_away(tmp_path):
    begin(tmp_path)
    for place in (tmp_path, tmp_path / "steps"):
        (place / f"{TEMPORARY}123-abcd").write_text("half", encoding="utf-8")
    open_directory(tmp_path, resume=True)
    assert not list(tmp_path.rglob(f"{TEMPORARY}*"))


def test_two_at_once_are_refused(tmp_path):
    first = open_directory(tmp_path)
    for options in ({"resume": True}, {"overwrite": True}):
        with pytest.raises(DirectoryError, match="another process is at work in"):
            open_directory(tmp_path, **options)
    first.close()
    open_directory(tmp_path, resume=True)


def test_a_file_system_without_locks_will_do(tmp_path, monkeypatch):
    def refuse(descriptor, operation):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    begin(tmp_path)
    assert open_directory(tmp_path, resume=True).finished("spin", "FORM") is not None


def test_a_step_that_cannot_be_read_is_named(tmp_path):
    directory = open_directory(tmp_path)
    directory.keep(("spin", "FORM"), {})
    (tmp_path / "steps" / "spin--FORM.json").write_text('{"step"', encoding="utf-8")
    with pytest.raises(DirectoryError, match=r"spin--FORM.json cannot be read .* remove it"):
        directory.finished("spin", "FORM")


def test_different_names_have_different_files():
    names = ["a b", "a-b", "a_b", "a  b", " a b", "a/b", "../a", "..", ".", "", "ä", "a" * 60, "a" * 61, "a" * 62, "A"]
    pairs = [(first, second) for first in names for second in names]
    stems = {file_stem(pair) for pair in pairs}
    assert len(stems) == len(pairs)
    assert all("/" not in stem and not stem.startswith(".") and len(stem) < 200 for stem in stems)


def test_the_digest_sees_every_number():
    things = [
        {"a": np.array([1.0, 2.0])}, {"a": np.array([1.0, np.nextafter(2.0, 3.0)])}, {"b": np.array([1.0, 2.0])},
        {"a": np.array([[1.0, 2.0]])}, {"a": [1.0, 2.0]}, {"a": (1, 2)}, {"a": [[1.0], [2.0]]}, {"a": None},
        ot.Normal(0.0, 1.0), ot.Normal(0.0, 1.0 + 1e-15), ot.Uniform(0.0, 1.0),
        ot.JointDistribution([ot.Normal()] * 2), ot.JointDistribution([ot.Normal()] * 2, ot.ClaytonCopula(2.0)),
        ot.TruncatedNormal(0.0, 1.0, -1.0, 1.0),
    ]  # fmt: skip
    assert len({digest(thing) for thing in things}) == len(things)
    assert digest(things) == digest(list(things))


def test_a_directory_shows_what_it_holds(tmp_path):
    directory = open_directory(tmp_path / "out")
    assert repr(directory) == f"ResultsDirectory({str(tmp_path / 'out')!r}, 'study')"
    directory.close()
