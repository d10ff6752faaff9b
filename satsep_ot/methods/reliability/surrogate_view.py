"""What remains of a surrogate when its run is over."""

import dataclasses

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate

# Points of each axis of the picture of the limit state.
_CONTOUR_POINTS = 61


@dataclasses.dataclass
class SurrogateView:
    """Directions of a surrogate, its native function, and the picture of its limit state.

    Attributes
    ----------
    directions : array (d, k)
    dimensions : list of int
        Active directions of each component.
    active : array (n, k)
        The variables of the surrogate at the true runs.
    outputs : array (n, p)
        The modelled outputs there.
    metaModel : :py:class:`openturns.Function` or None
    reason : str
        Why there is no native function.
    axes, contour : array (2, m), array (m * m,)
        The surrogate's limit state in the plane of the first two variables, the first one fast; empty with one
        variable.
    """

    directions: np.ndarray
    dimensions: list[int]
    active: np.ndarray
    outputs: np.ndarray
    metaModel: ot.Function | None
    reason: str
    axes: np.ndarray
    contour: np.ndarray

    @staticmethod
    def of(surrogate: LimitStateSurrogate, limitState: LimitStateEvent, runs: Runs) -> "SurrogateView":
        """The view of a surrogate."""
        active = surrogate.reduce(runs.u)
        metaModel, reason = None, ""
        try:
            metaModel = surrogate.nativeFunction(limitState.space)
        except ValueError as error:
            reason = str(error)
        axes, contour = np.zeros((2, 0)), np.zeros(0)
        if active.shape[1] > 1:
            # The level 0 where the other active variables are at their median among the failed runs.
            rows = runs.failed if runs.failed.any() else np.ones(len(active), dtype=bool)
            bounds = [(active[:, j].min() - 0.5, active[:, j].max() + 0.5) for j in range(2)]
            axes = np.array([np.linspace(*bound, _CONTOUR_POINTS) for bound in bounds])
            first, second = np.meshgrid(*axes)
            y = np.repeat(np.median(active[rows], axis=0)[None], first.size, axis=0)
            y[:, 0], y[:, 1] = first.reshape(-1), second.reshape(-1)
            contour = surrogate.margin(surrogate.predict(y))
        dimensions = [fit.model.dimension for fit in surrogate.components]
        outputs = limitState.smooth(runs.outputs)
        return SurrogateView(surrogate.directions, dimensions, active, outputs, metaModel, reason, axes, contour)
