"""Tables in LaTeX: every sign escaped, columns that fit, whole environments."""

import re

import pytest

from satsep_ot.methods.common.tables import latexTable
from satsep_ot.methods.comparison.benchmark_result import BenchmarkRow, ReliabilityBenchmarkResult
from satsep_ot.methods.comparison.comparison import ReliabilityComparisonResult
from satsep_ot.methods.comparison.method import Row


@pytest.mark.parametrize("sign", list("\\{}&%$#_~^<>"))
def test_every_sign_that_means_something_to_latex_is_escaped(sign):
    table = latexTable([["name", "value"], [f"a{sign}b", "1"]], 1)
    (row,) = [line for line in table.splitlines() if line.startswith("a")]
    cell = row.removesuffix(r" & 1 \\")
    # A control symbol, or a word with its group; no bare sign is left.
    assert re.fullmatch(r"a(\\[{}&%$#_]|\\text\w+\{\})b", cell)
    assert row.count(" & ") == 1


def test_long_text_becomes_paragraphs_that_fit_the_line():
    table = latexTable([["method", "note", "runs"], ["FORM", "a sentence of many words that goes on and on", "12"]], 2)
    (width,) = re.findall(r"p\{([\d.]+)\\linewidth\}", table)
    assert 0.5 < float(width) < 0.9
    assert table.splitlines()[0] == rf"\begin{{tabular}}{{@{{}}lp{{{width}\linewidth}}r@{{}}}}"
    assert table.splitlines()[-1] == r"\end{tabular}"


def test_results_of_comparisons_and_benchmarks_are_tables_of_latex():
    rows = [Row("FORM", 1e-3, evaluations=12, note="100 % of A_B"), Row("SORM")]
    text = ReliabilityComparisonResult(rows).toLatex()
    assert r"coefficient\_of\_variation" in text
    assert "100" not in text
    row = BenchmarkRow("P1", "FORM", repetitions=2, failed=0, bias=0.0, error=0.0, cost=204.0, verdict="right")
    text = ReliabilityBenchmarkResult([row]).toLatex()
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 2
    for line in text.splitlines():
        assert not re.search(r"(?<!\\)[%#_$]", line)
