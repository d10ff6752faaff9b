"""Two-level Bayesian updating of the inputs of any function from measured outputs."""

from collections.abc import Sequence

import numpy as np

from satsep_ot.methods.updating.experiments import Experiment, MeasurementModel
from satsep_ot.methods.updating.misfit import findMisfits, madeUpCampaigns
from satsep_ot.methods.updating.posterior import UpdatingError, samplePosterior
from satsep_ot.methods.updating.result import TwoLevelUpdatingResult
from satsep_ot.methods.updating.two_level import TwoLevelInputs
from satsep_ot.openturns_object import OpenTURNSObject


class TwoLevelUpdating(OpenTURNSObject):
    """Posterior of what experiments share: values, means and sigmas of inputs.

    Parameters
    ----------
    inputs : :class:`~satsep_ot.methods.updating.two_level.TwoLevelInputs`
    experiments : sequence of :class:`~satsep_ot.methods.updating.experiments.Experiment`

    Raises
    ------
    UpdatingError
        No experiment, none with a measurement, or an error that is not positive.

    Examples
    --------
    A mean known to 1 is measured ten times with a scatter of 0.5 and an error of 0.5:

    >>> import openturns as ot
    >>> from satsep_ot.methods.updating.algorithm import TwoLevelUpdating
    >>> from satsep_ot.methods.updating.experiments import Experiment, FunctionModel, Measurement
    >>> from satsep_ot.methods.updating.two_level import TwoLevelInputs
    >>> inputs = TwoLevelInputs(ot.Normal(0.0, 0.5), meanUncertainty=[1.0])
    >>> model = FunctionModel(ot.SymbolicFunction("x", "x"))
    >>> tests = [Experiment(str(k), model, (Measurement("y", 0, 0.7, 0.5),)) for k in range(10)]
    >>> updating = TwoLevelUpdating(inputs, tests)
    >>> updating.run()
    >>> [f"{number[0]:.4f}" for number in updating.getResult().getMoments()]
    ['0.6667', '0.2182']
    """

    def __init__(self, inputs: TwoLevelInputs, experiments: Sequence[Experiment]) -> None:
        self._inputs, self._experiments = inputs, list(experiments)
        self._size = 4000
        self._result: TwoLevelUpdatingResult | None = None
        if not any(experiment.measurements for experiment in self._experiments):
            raise UpdatingError("there is no test with a measurement; give at least one")
        for experiment in self._experiments:
            for row in experiment.measurements:
                if not (np.isfinite(row.value) and 0.0 < row.error < np.inf):
                    raise UpdatingError(
                        f"test {experiment.name}: {row.name} = {row.value} with sigma = {row.error}; "
                        "both must be finite, and the sigma positive"
                    )

    def _shown(self):
        return {"inputs": self._inputs.getDimension(), "experiments": len(self._experiments), "size": self._size}

    def setSize(self, size: int) -> None:
        """Draws of importance sampling, 4000 by default."""
        if size < 1000:
            raise ValueError(f"size = {size}; it must be at least 1000")
        self._size = size

    def run(self) -> None:
        """Check the measurements against the model, then sample the posterior.

        Raises
        ------
        UpdatingError
            A measurement that is far outside what the model reaches or what the others allow, or conditions under
            which the model cannot be computed.
        """
        model = MeasurementModel(self._inputs, self._experiments)
        misfits = findMisfits(model, madeUpCampaigns(model))
        posterior = samplePosterior(model, self._size)
        self._result = TwoLevelUpdatingResult(self._inputs, posterior, misfits, model.evaluations, model.gradients)

    def getResult(self) -> TwoLevelUpdatingResult:
        """What `run` found."""
        if self._result is None:
            raise RuntimeError("There is no result yet; call run() first.")
        return self._result
