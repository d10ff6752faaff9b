"""Margins: how far values are from the threshold of an event, at most 0 inside of it."""

import math
from collections.abc import Callable

import numpy as np
import openturns as ot


def thresholdMargin(operator: ot.ComparisonOperator, threshold: float) -> Callable:
    """Function of values (n,) that is at most 0 where the operator holds between the value and the threshold.

    Raises
    ------
    ValueError
        The threshold is not finite, or the operator has no side.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.common.margins import thresholdMargin
    >>> thresholdMargin(ot.ComparisonOperator(ot.Greater()), 5.0)(np.array([4.0, 6.0]))
    array([ 1., -1.])
    """
    if not math.isfinite(threshold):
        raise ValueError(f"the threshold of the event is {threshold}; it must be finite")
    if operator.compare(-1.0, 0.0) == operator.compare(1.0, 0.0):
        raise ValueError(
            f"the comparison of the event is {operator.getImplementation().getClassName()}; give one with a side, "
            "such as Greater or LessOrEqual"
        )
    # 0 > 0 tells a strict operator, -1 < 0 one that looks below.
    strict = not operator.compare(0.0, 0.0)
    sign = 1.0 if operator.compare(-1.0, 0.0) else -1.0

    def margin(values):
        result = sign * (values - threshold)
        return np.where(result == 0.0, np.finfo(float).tiny, result) if strict else result

    return margin
