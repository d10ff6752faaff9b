"""The reliability methods that can be compared, by name, each with documented settings."""

from satsep_ot.methods.comparison.active_learning import AKMCS, AKMCSFeasibility
from satsep_ot.methods.comparison.active_subspace import ActiveSubspace, SafeActiveSubspace
from satsep_ot.methods.comparison.approximations import FORM, SORM, MultiFORM, SORMHohenbichler, SORMTvedt
from satsep_ot.methods.comparison.method import ReliabilityMethod
from satsep_ot.methods.comparison.simulations import (
    NAIS,
    ActiveLineSampling,
    ControlledImportanceSampling,
    CrossEntropy,
    DirectionalSampling,
    ImportanceSampling,
    LatinHypercube,
    LineSampling,
    MonteCarlo,
    QuasiMonteCarlo,
    SubsetSampling,
)
from satsep_ot.methods.comparison.surrogates import ChaosMonteCarlo, InverseRegressionChaos, PaperChain

# The methods by name, each with its default settings.
METHODS: dict[str, type[ReliabilityMethod]] = {
    method.name: method
    for method in (
        ActiveSubspace,
        SafeActiveSubspace,
        FORM,
        MultiFORM,
        SORM,
        SORMHohenbichler,
        SORMTvedt,
        SubsetSampling,
        MonteCarlo,
        LatinHypercube,
        QuasiMonteCarlo,
        ImportanceSampling,
        ControlledImportanceSampling,
        CrossEntropy,
        NAIS,
        DirectionalSampling,
        LineSampling,
        ActiveLineSampling,
        AKMCS,
        AKMCSFeasibility,
        PaperChain,
        ChaosMonteCarlo,
        InverseRegressionChaos,
    )
}


def makeMethod(method: str | ReliabilityMethod) -> ReliabilityMethod:
    """The method of that name with its default settings, or the method itself."""
    if isinstance(method, ReliabilityMethod):
        return method
    if method not in METHODS:
        raise ValueError(f"no reliability method is called {method!r}; there are {', '.join(METHODS)}")
    return METHODS[method]()
