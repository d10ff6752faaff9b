"""Force-stroke tables: what is right arrives in SI, what is wrong is one sentence with file, row and value."""

import numpy as np
import pytest

from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.force_table import checked_force_table, force_table_text, parse_force_table

GOOD = "stroke_mm,force_N\n0,220\n10,150.5\n\n30, 55\n"
CASE = (
    "[platform]\nmass = 10\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
    "[satellite]\nmass = 1\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
    "[springs]\ncount = 3\nradius = 100\nstroke = 30\n"
)
ROWS = "[[0, 220], [10, 150.5], [30, 55]]"
TABLE = np.array([[0.0, 220.0], [0.01, 150.5], [0.03, 55.0]])


def written(tmp_path, text):
    path = tmp_path / "push.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(path):
    return parse_force_table(force_table_text(path), str(path))


@pytest.mark.parametrize("text", [GOOD, "\ufeff" + GOOD, GOOD.replace("\n", "\r\n"), GOOD.strip()])
def test_a_file(text, tmp_path):
    np.testing.assert_allclose(read(written(tmp_path, text)), TABLE, rtol=1e-15)


FILES = {
    "unsorted": ("h,f\n0,220\n20,150\n10,55\n", ["row 4 = 10,55", "above that of the row before, 20 mm"]),
    "twice": ("h,f\n0,220\n20,150\n20,55\n", ["row 4 = 20,55", "above"]),
    "negative force": ("h,f\n0,220\n20,-1\n", ["row 3 = 20,-1", "force must not be negative"]),
    "negative stroke": ("h,f\n-1,220\n20,1\n", ["row 2 = -1,220", "first stroke must be 0 mm"]),
    "late start": ("h,f\n5,220\n20,1\n", ["row 2 = 5,220", "first stroke must be 0 mm"]),
    "too short": ("h,f\n0,220\n", ["1 rows", "there must be 2 to 1000"]),
    "too long": ("h,f\n" + "\n".join(f"{n},1" for n in range(1001)), ["1001 rows"]),
    "empty": ("\n\n", ["the file is empty", "header"]),
    "no header": ("0,220\n30,55\n", ["row 1 = '0,220' holds numbers", "header"]),
    "text": ("h,f\n0,220\n30,much\n", ["row 3 = 30,much", "two finite numbers"]),
    "NaN": ("h,f\n0,nan\n30,1\n", ["row 2 = 0,nan", "two finite numbers"]),
    "infinite": ("h,f\n0,1\ninf,1\n", ["row 3 = inf,1", "two finite numbers"]),
    "three columns": ("h,f,g\n0,1,2\n30,1,2\n", ["row 2 = 0,1,2", "two finite numbers"]),
    "one column": ("h\n0\n30\n", ["row 2 = 0", "two finite numbers"]),
    "not text": (b"\xff\xfe\x00", ["not UTF-8"]),
}


@pytest.mark.parametrize("name", FILES)
def test_files_that_are_no_table(name, tmp_path):
    text, words = FILES[name]
    path = written(tmp_path, text)
    for refused, error in (
        (lambda: read(path), ValueError),
        (lambda: parse_case(CASE + 'table = "push.csv"', str(tmp_path / "mine.toml")), CaseError),
    ):
        with pytest.raises(error) as caught:
            refused()
        for word in (str(path), *words):
            assert word in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_file_without_end_or_with_a_cell_without_end_is_refused(tmp_path):
    with pytest.raises(ValueError, match="more than 1000000 characters; give a shorter one"):
        force_table_text(written(tmp_path, "h,f\n" + "0" * 2_000_000))
    with pytest.raises(ValueError, match=r"mine: the file cannot be read \(field larger than field limit"):
        parse_force_table("h,f\n0," + "1" * 200_000, "mine")


def test_rows_that_are_none():
    with pytest.raises(ValueError, match=r"mine: row 2 = \[1\]: it must be two finite numbers"):
        checked_force_table([[0, 1], [1]], "mine")
    with pytest.raises(ValueError, match="mine: row 1 = 3: it must be two finite numbers"):
        checked_force_table([3, 4], "mine")


def test_a_file_is_found_beside_the_case_that_names_it(tmp_path):
    written(tmp_path, GOOD)
    (tmp_path / "mine.toml").write_text(CASE + 'table = "push.csv"\n', encoding="utf-8")
    springs = load_case(tmp_path / "mine.toml").separation.springs
    for table in springs.tables:
        np.testing.assert_allclose(table, TABLE)
    assert springs.stiffness.tolist() == springs.deformation.tolist() == [0.0] * 3


def test_a_table_for_one_spring_beside_linear_ones():
    for stiffness in ("100", "[100, 0, 100]"):
        text = CASE + f"stiffness = {stiffness}\ndeformation = 40\ntable = {{ 2 = {ROWS} }}\n"
        springs = parse_case(text).separation.springs
        assert springs.stiffness.tolist() == [100.0, 0.0, 100.0]
        assert springs.deformation.tolist() == [0.04, 0.0, 0.04]
        assert [table is None for table in springs.tables] == [True, False, True]
        np.testing.assert_allclose(springs.tables[1], TABLE)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"table = {ROWS}\nstiffness = 3", "springs.stiffness = 3, but it must be left out"),
        (
            f"stiffness = [1, 2, 3]\ndeformation = 40\ntable = {{ 2 = {ROWS} }}",
            "springs.stiffness = [1, 2, 3], but it must be 0 for each spring that has a force-stroke table",
        ),
        (f"stiffness = 1\ndeformation = 40\ntable = {{ 4 = {ROWS} }}", "springs.table.4 is not a known key"),
        (f"table = {ROWS.replace('30', '25')}", "the last stroke is 25 mm, but it must be the spring's stroke of 30"),
        ("table = [[0, 220], [20, 150], [10, 55]]", "springs.table: row 3 = [10, 55]: the stroke must be above"),
        ("stiffness = 1\ndeformation = 4\ntable = { 3 = [[0, 2]] }", "springs.table.3: 1 rows"),
        ("table = 3", "springs.table = 3, but it must be rows"),
        ("table = 'none.csv'", "springs.table: none.csv: there is no such file"),
        ("table = '.'", "it is a directory; give a regular file"),
        ("table = 'a\\u0000b'".replace("'", '"'), "but it must be rows [[stroke, force], ...] or the name"),
    ],
)
def test_tables_that_are_refused_in_a_case(text, words):
    with pytest.raises(CaseError) as caught:
        parse_case(CASE + text, "mine.toml")
    assert words in str(caught.value)
    assert str(caught.value).startswith("mine.toml: springs.")
