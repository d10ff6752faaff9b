"""What a command prints changes neither what it does nor its exit code."""

import os
import subprocess
import sys

import pytest
from small_cases import MASS_AND_RATE, ODD_NAMES, ROLLING, SMALL

from satsep_ot.commands.printing import console, fail, progress
from satsep_ot.model.case import CaseError, load_case, parse_case

# A reader that leaves at once, one that leaves after a line, streams that are closed.
ENDINGS = ("| true", "| head -1 >/dev/null", "2>&1 | true", ">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-")


def written(tmp_path, text=SMALL):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def rolling(name="rolling"):
    """The text of a case with a requirement of that name."""
    return SMALL + MASS_AND_RATE + ROLLING.replace("rolling", name) + "allowed_probability = 1e-3\n"


def exit_code(words, ending="", **environment):
    """Of a command in a shell, and what came on standard error."""
    command = f"'{sys.executable}' -m satsep_ot {words} {ending}; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, timeout=120, env={**os.environ, **environment}, check=False
    )
    return done.returncode, done.stderr.decode()


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_reader_that_leaves_and_a_closed_stream_change_no_exit_code(ending, tmp_path):
    path = written(tmp_path)
    assert exit_code(f"check {path}", ending) == (0, "")
    code, said = exit_code(f"simulate {tmp_path}/none.toml", ending)
    assert code == 2
    assert "Traceback" not in said
    slow = tmp_path / "slow.toml"
    slow.write_text("horizon = 0.01\n" + SMALL, encoding="utf-8")
    assert exit_code(f"simulate {slow}", ending)[0] == 1
    assert exit_code("--help", ending) == (0, "")


def test_a_study_whose_reader_leaves_is_done_and_judged(tmp_path):
    path = written(tmp_path, rolling())
    words = f"study {path} --methods MonteCarlo --runs 5000 --overwrite --output {tmp_path}/results"
    assert exit_code(words, "| true")[0] == 0
    assert (tmp_path / "results" / "report.html").exists()
    assert exit_code(f"{words} --fail-unless-met", "2>&1 | true")[0] == 3


def test_a_closed_stream_lends_its_number_to_no_file(tmp_path):
    path = written(tmp_path, rolling())
    words = f"study {path} --methods MonteCarlo --runs 5000 --output {tmp_path}/results --json"
    assert exit_code(words, "<&- >&- 2>&-")[0] == 0
    kept = sorted((tmp_path / "results" / "runs").iterdir())
    assert [file.name for file in kept] == ["gradients.npz", "sample.npy"]
    assert kept[1].read_bytes().startswith(b"\x93NUMPY")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_full_disk_behind_standard_output_is_named(tmp_path):
    path = written(tmp_path)
    assert exit_code(f"check {path}", ">/dev/full") == (2, "satsep-ot: standard output: No space left on device\n")
    assert exit_code(f"check {path}", "2>/dev/full") == (0, "")


def test_a_terminal_of_ascii_shows_what_it_can(tmp_path):
    path = written(tmp_path, 'name = "weiß \N{ROCKET}"\n' + SMALL)
    for words in (f"check {path}", f"simulate {path}", f"simulate {tmp_path}/weiß.toml"):
        code, said = exit_code(words, PYTHONIOENCODING="ascii", LC_ALL="C")
        assert code == (2 if "weiß" in words else 0)
        assert "Traceback" not in said
        assert "Error" not in said


def test_control_characters_are_not_obeyed(tmp_path, capsys):
    text = rolling().replace("sigma", 'description = "a\\u001b[2Jb\\u009bc", sigma')
    case = parse_case(f'description = "clear \\u001b[2J \\u0007 all"\n{text}')
    from satsep_ot.commands.case_tables import print_case
    from satsep_ot.model.check_document import check_case

    print_case(console(), check_case(case), "mine\x1b[2J.toml")
    fail("no file \x1b[2J", 2)
    captured = capsys.readouterr()
    for text in (captured.out, captured.err):
        assert not {"\x1b", "\x07", "\x9b"} & set(text)
        assert "\ufffd[2J" in text


@pytest.mark.parametrize("name", ["two\nlines", "tab\there", "\x1b[2J", "\u2028", "\u202egnilev", "\x85", "\ufeff"])
def test_names_are_one_line_without_control_characters(name):
    quoted = "".join(f"\\U{ord(character):08x}" for character in name)
    for text in (rolling(quoted), rolling().replace("rate_y =", f'"{quoted}" ='), f'name = "{quoted}"\n{SMALL}'):
        with pytest.raises(CaseError, match="a name of 1 to 100 printable characters"):
            parse_case(text)


@pytest.mark.parametrize("name", ODD_NAMES)
def test_names_are_printed_as_they_are(name, tmp_path, capsys, monkeypatch):
    from satsep_ot.commands.case_tables import print_case
    from satsep_ot.model.check_document import check_case

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    case = parse_case(rolling(name.replace("\\", "\\\\")))
    print_case(console(), check_case(case), "mine.toml")
    with progress() as show:
        show(case.requirements[0].name, 0.5)
    assert case.requirements[0].name in capsys.readouterr().out


def test_new_takes_the_name_of_any_file_that_a_case_can_have(tmp_path):
    for stem in ("\N{ROCKET}", "שלום", 'quo"te', "back\\slash"):
        path = tmp_path / f"{stem}.toml"
        assert exit_code(f"new '{path}'") == (0, "")
        assert load_case(path).name == stem
    code, said = exit_code(f"new $'{tmp_path}/two\\nlines.toml'")
    assert code == 2
    assert "printable characters" in said
    assert sorted(tmp_path.glob("two*")) == []
