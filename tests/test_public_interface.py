"""What `import satsep_ot` offers, and what it must not do."""

import inspect
import subprocess
import sys

import pytest

import satsep_ot

PUBLIC = [name for name in satsep_ot.__all__ if name != "__version__"]


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_are_there_and_documented_with_an_example(name):
    member = getattr(satsep_ot, name)
    assert inspect.getdoc(member)
    assert name in dir(satsep_ot)
    if inspect.isclass(member):
        assert ">>> " in inspect.getdoc(member), name


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'Rocket'"):
        satsep_ot.Rocket  # noqa: B018


def test_import_loads_nothing_heavy_and_changes_nothing():
    program = (
        "import sys, warnings; before = list(warnings.filters); import satsep_ot; "
        "heavy = {'openturns', 'numba', 'numpy', 'matplotlib', 'scipy'} & set(sys.modules); "
        "assert not heavy, heavy; assert list(warnings.filters) == before; "
        "import satsep_ot.studies.separation_study; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
