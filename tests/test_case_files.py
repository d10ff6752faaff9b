"""Files that are not what a case or a table should be: refused in one sentence, at once and in little memory."""

import os
import resource
import time
import tracemalloc

import pytest
from small_cases import BODIES, MASS_AND_RATE, SMALL

from satsep_ot import cli
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.force_table import parse_force_table

TABLE = "stroke_mm,force_N\n0,2\n5,1.5\n10,1\n"
MARK = b"\xef\xbb\xbf"


def with_table(name):
    return BODIES + f'table = "{name}"\n'


def test_a_byte_order_mark_is_accepted(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(MARK + with_table("spring.csv").replace("\n", "\r\n").encode())
    (tmp_path / "spring.csv").write_bytes(MARK + TABLE.replace("\n", "\r\n").encode())
    case = load_case(path)
    assert case.separation.springs.tables[0].tolist() == [[0.0, 2.0], [0.005, 1.5], [0.01, 1.0]]
    assert case.text.startswith("[platform]")


def not_regular(kind, path):
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to({"device": "/dev/zero", "null device": "/dev/null", "directory": path.parent}[kind])


@pytest.mark.parametrize("kind", ["pipe", "device", "null device", "directory"])
def test_what_is_no_regular_file_is_refused_at_once(kind, tmp_path, capsys):
    not_regular(kind, tmp_path / "mine.toml")
    not_regular(kind, tmp_path / "spring.csv")
    (tmp_path / "table.toml").write_text(with_table("spring.csv"), encoding="utf-8")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.monotonic()
    for name, word in (("mine.toml", "give a regular file"), ("table.toml", "spring.csv")):
        assert cli.main(["simulate", str(tmp_path / name)]) == 2
        said = capsys.readouterr().err
        assert word in said
        assert said.count("\n") == 1
    assert time.monotonic() - start < 5.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


def test_a_table_is_not_read_through_a_link_out_of_the_folder(tmp_path):
    folder, other = tmp_path / "case", tmp_path / "other"
    folder.mkdir(), other.mkdir()
    (other / "spring.csv").write_text(TABLE, encoding="utf-8")
    (folder / "spring.csv").write_text(TABLE, encoding="utf-8")
    (folder / "file.csv").symlink_to(other / "spring.csv")
    (folder / "below").symlink_to(other)
    (folder / "within.csv").symlink_to("spring.csv")
    for name in ("file.csv", "below/spring.csv"):
        (folder / "mine.toml").write_text(with_table(name), encoding="utf-8")
        with pytest.raises(CaseError, match=f"'{name}' is a link out of the folder of the case file"):
            load_case(folder / "mine.toml")
    (folder / "mine.toml").write_text(with_table("within.csv"), encoding="utf-8")
    (tmp_path / "linked.toml").symlink_to(folder / "mine.toml")
    assert load_case(folder / "mine.toml").files == {"within.csv": TABLE}
    # The folder of a case is that of the name by which it is called.
    with pytest.raises(CaseError, match="no such file"):
        load_case(tmp_path / "linked.toml")


@pytest.mark.parametrize("cell", ["1_0", "١٠", "１０", "inf", "nan", "1e", "0x10", "1,5", "--1", "1 0", "١e1", ""])
def test_what_is_no_number_in_plain_digits_is_refused(cell):
    with pytest.raises(ValueError, match=r"row 3 = .*two finite numbers"):
        parse_force_table(f"stroke_mm,force_N\n0,220\n{cell},55", "spring.csv")
    with pytest.raises(CaseError, match="a percentage such as"):
        parse_case(SMALL + MASS_AND_RATE.replace("sigma = 0.03", f'sigma = "{cell} %"'))
    for arguments in (["--at", cell], ["--tolerance", cell]):
        with pytest.raises(SystemExit):
            cli.main(["simulate", *arguments])
    for arguments in (["--seed", cell], ["--runs", cell], ["--precision", cell]):
        with pytest.raises(SystemExit):
            cli.main(["study", *arguments])


@pytest.mark.parametrize("cell", ["10", " 10.", "+1e1", "1.0E+01\t", "010"])
def test_numbers_in_plain_digits_are_read(cell):
    assert parse_force_table(f"stroke_mm,force_N\n0,220\n{cell},55", "spring.csv")[1, 0] == pytest.approx(0.01)


MASS = SMALL.replace("mass = 10\n", "mass = {}\n", 1)
ENORMOUS = {
    "parts of a key": ".".join("a" * 100_000) + " = 1\n",
    "parts of a heading": f"[{' . '.join('a' * 100_000)}]\n",
    "quoted parts": '."'.join(['"a\\""'] + ['\\""'] * 100_000) + " = 1\n",
    "parts in an inline table": "x = {" + ".".join(["'a'"] * 100_000) + " = 1}\n",
    "digits": MASS.format("9" * 100_000),
    "hexadecimal digits": MASS.format("0x" + "f" * 100_000),
    "binary digits": MASS.format("0b" + "1" * 100_000),
    "digits of a list": SMALL.replace("[1, 1, 1]", f"[1, 1, {'9' * 4000}]", 1),
    "depth of lists": "x = " + "[" * 100_000 + "]" * 100_000 + "\n",
    "depth of tables": "x = " + "{a=" * 100_000 + "1" + "}" * 100_000 + "\n",
    "letters of a key": "k" * 1_000_000 + " = 1\n",
    "letters of a name": f'name = "{"n" * 1_000_000}"\n' + SMALL,
    "letters of a choice": SMALL + f'force_line = "{"g" * 1_000_000}"\n',
    "lines": "x = '''" + "\n" * 1_000_000,
    "characters": "#" * 5_000_000,
}


@pytest.mark.parametrize("what", ENORMOUS)
def test_what_is_enormous_ends_in_one_sentence_at_once(what, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(ENORMOUS[what], encoding="utf-8")
    start = time.process_time()
    tracemalloc.start()
    with pytest.raises(CaseError) as caught:
        load_case(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Tracing takes most of the time.
    assert time.process_time() - start < 3.0
    assert peak < 200e6
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert len(said.removeprefix(f"{path}: ")) < 400
    assert "\n" not in said
    assert "sys." not in said


def test_sentences_with_many_dots_are_no_long_keys():
    text = "# " + "a. b. " * 40 + "\n" + 'description = "' + "1.2.3. " * 30 + '"\n' + SMALL
    assert parse_case(text).description.startswith("1.2.3.")
