"""Names of modules as version 0.1.0 had them, kept for one version: pickles and OpenTURNS studies name modules.

A module that moves gets a row in `MOVED`, a name that changes on the way one in `RENAMED`. Where the old name is that
of a package or module today, that one also needs ``__getattr__ = forwarding(__name__)``, since Python finds it without
asking here.
"""

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
from collections.abc import Callable, Sequence
from typing import Any

from satsep_ot.deprecation import warnDeprecated

# Old module, without "satsep_ot.": the modules that have its names now.
MOVED: dict[str, tuple[str, ...]] = {
    "methods.active_dimension": ("methods.subspaces.dimension",),
    "methods.active_subspace": ("methods.subspaces.algorithm",),
    "methods.active_subspace_result": ("methods.subspaces.result",),
    "methods.active_variables": ("methods.subspaces.variables",),
    "methods.benchmark_problems": ("methods.comparison.problems", "methods.comparison.problem"),
    "methods.chunk_scheduler": ("methods.parallel.scheduler", "methods.parallel.chunks"),
    "methods.comparison": (
        "methods.comparison.comparison",
        "methods.comparison.methods",
        "methods.comparison.method",
        "methods.common.tables",
    ),
    "methods.executors": ("methods.parallel.executors",),
    "methods.failure_sample": ("methods.reliability.sensitivity",),
    "methods.function_noise": ("methods.subspaces.noise",),
    "methods.importance_proposal": (
        "methods.reliability.proposal",
        "methods.reliability.mixture",
        "methods.reliability.estimate",
    ),
    "methods.index_sets": ("methods.polynomials.index_sets",),
    "methods.inverse_regression": ("methods.subspaces.inverse_regression",),
    "methods.limit_state_event": ("methods.reliability.limit_state", "methods.common.margins", "openturns_adapter"),
    "methods.limit_state_surrogate": ("methods.reliability.surrogate",),
    "methods.monte_carlo_stream": ("methods.parallel.monte_carlo_stream", "methods.parallel.block_summary"),
    "methods.parallel_function": ("methods.parallel.function", "openturns_adapter"),
    "methods.polynomial_basis": ("methods.polynomials.basis", "methods.polynomials.fit"),
    "methods.polynomial_design": ("methods.polynomials.design",),
    "methods.polynomial_distribution": ("methods.polynomials.distribution",),
    "methods.polynomial_prediction": ("methods.polynomials.prediction",),
    "methods.polynomial_regression": (
        "methods.polynomials.regression",
        "methods.polynomials.regression_result",
        "methods.polynomials.families",
        "methods.polynomials.fit",
    ),
    "methods.reliability": ("methods.reliability.algorithm", "methods.reliability.result"),
    "methods.reliability_benchmark": (
        "methods.comparison.benchmark",
        "methods.comparison.benchmark_result",
        "methods.comparison.problem",
    ),
    "methods.reliability_methods": (
        "methods.comparison.methods",
        "methods.comparison.method",
        "methods.comparison.approximations",
        "methods.comparison.simulations",
        "methods.comparison.active_subspace",
        "openturns_adapter",
    ),
    "methods.reliability_result": (
        "methods.reliability.result",
        "methods.reliability.estimate",
        "methods.reliability.surrogate_view",
        "methods.common.intervals",
    ),
    "methods.result_storage": ("methods.common.storage", "openturns_adapter"),
    "methods.ridge_approximation": ("methods.subspaces.ridge_approximation",),
    "methods.single_thread": ("methods.common.single_thread",),
    "methods.standard_space": ("methods.common.standard_space",),
    "methods.subset_simulation": ("methods.reliability.subset_simulation",),
    "methods.subspace_estimation": ("methods.subspaces.estimation",),
    "methods.true_runs": ("methods.reliability.true_runs",),
    "methods.variable_projection": ("methods.subspaces.variable_projection",),
    "studies.animation": ("studies.telling.animation",),
    "studies.figures": ("studies.telling.figures", "studies.telling.motion"),
    "studies.report": ("studies.telling.report", "studies.telling.document"),
    "studies.verdicts": ("studies.telling.verdicts",),
}
# What has another name in its new module.
RENAMED = {
    "methods.parallel_function._Shared": "Shared",
    "methods.reliability_result.IntervalLaw": "ConfidenceInterval",
    "methods.polynomial_regression._Reduction": "PolynomialFamilies",
}
_PACKAGE = "satsep_ot."


def forwarding(name: str) -> Callable[[str], Any]:
    """The ``__getattr__`` of a module whose names have moved: it finds them, with a DeprecationWarning.

    Parameters
    ----------
    name : str
        Full name of the module, a row of `MOVED`.

    Examples
    --------
    >>> import warnings
    >>> from satsep_ot.moved_modules import forwarding
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", DeprecationWarning)
    ...     forwarding("satsep_ot.methods.reliability")("ActiveSubspaceReliability").__module__
    'satsep_ot.methods.reliability.algorithm'
    """
    old = name.removeprefix(_PACKAGE)

    def find(attribute):
        # Python asks any module for names with underscores, and a package for its own modules.
        package = "__path__" in vars(sys.modules[name])
        own = attribute.startswith("__") or (package and importlib.util.find_spec(f"{name}.{attribute}"))
        new = RENAMED.get(f"{old}.{attribute}", attribute)
        for home in () if own else MOVED[old]:
            module = importlib.import_module(_PACKAGE + home)
            if hasattr(module, new):
                warnDeprecated(f"{name}.{attribute}", f"{module.__name__}.{new}")
                return getattr(module, new)
        raise AttributeError(f"module '{name}' has no attribute '{attribute}'")

    return find


def restoring(**fields: str | None) -> Callable[[Any, dict[str, Any]], None]:
    """The ``__setstate__`` of a class whose attributes had other names: new name, or None for what is left out.

    Examples
    --------
    >>> from satsep_ot.moved_modules import restoring
    >>> class Point:
    ...     __setstate__ = restoring(_x="x", _cache=None)
    >>> point = Point()
    >>> point.__setstate__({"_x": 1.0, "y": 2.0, "_cache": 3.0})
    >>> vars(point)
    {'x': 1.0, 'y': 2.0}
    """

    def restore(self, state):
        names = {name: fields.get(name, name) for name in state}
        # Not by setattr: the object may be frozen.
        vars(self).update({new: state[name] for name, new in names.items() if new is not None})

    return restore


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the old modules, after all other finders have not."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname.startswith(_PACKAGE) and fullname.removeprefix(_PACKAGE) in MOVED:
            return importlib.machinery.ModuleSpec(fullname, self)
        return None

    def exec_module(self, module: types.ModuleType) -> None:
        module.__getattr__ = forwarding(module.__name__)  # type: ignore[method-assign]


def install() -> None:
    """Let imports and pickles find the old names."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
