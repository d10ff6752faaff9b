"""Published probabilities that differ from ours: the numbers of the page, by quadrature."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

PAGE = Path(__file__).parent.parent / "docs" / "openturns.md"


def rp111():
    """P(|x1 x2| > 12.5) of two standard normal inputs."""
    return quad(lambda x: 4.0 * norm.pdf(x) * norm.sf(12.5 / x), 1e-9, 40.0, epsrel=1e-10, points=[2.0, 3.5, 5.0])[0]


def rp77():
    """P(x1 - x2 - x3 < 0 for x3 at most 5, x3 - x2 < 0 for larger ones)."""
    below = quad(lambda x: norm.pdf(x, 4.0) * norm.sf((10.0 - x) / np.sqrt(1.25)), -10.0, 5.0, epsrel=1e-10)[0]
    return below + quad(lambda x: norm.pdf(x, 4.0) * norm.sf(x), 5.0, 20.0, epsrel=1e-10)[0]


@pytest.mark.parametrize(
    ("name", "found", "published"),
    [("RP77", rp77, "2.87e-7"), ("RP107", lambda: norm.sf(5.0), "2.92e-7"), ("RP111", rp111, "7.65e-7")],
)
def test_the_page_has_what_quadrature_gives_beside_what_was_published(name, found, published):
    (line,) = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| {name} ")]
    _, _, ours, theirs, _ = (cell.strip() for cell in line.split("|"))
    assert ours == f"{found():.3e}".replace("e-0", "e-")
    assert theirs == published
    assert abs(float(theirs) / found() - 1.0) > 0.01
