"""Units in which outputs of any size can be squared."""

import numpy as np

# Squares of numbers between these, and sums of many, are far from the ends of what a double can hold.
SMALLEST, LARGEST = 1e-120, 1e120


def output_units(*arrays: np.ndarray) -> np.ndarray:
    """A power of two for each output, by which it is divided before it is squared; 1 for outputs of usual size.

    Parameters
    ----------
    arrays : ndarrays (..., p)
        Of the same outputs, for instance values and gradients.

    Returns
    -------
    ndarray (p,)

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.common.units import output_units
    >>> output_units(np.array([[3.0, 2.0**-998, 0.0], [5.0, 3.0 * 2.0**-998, 0.0]])) / [1.0, 2.0**-997, 1.0]
    array([1., 1., 1.])
    """
    size = np.max([np.abs(array).reshape(-1, array.shape[-1]).max(axis=0) for array in arrays], axis=0)
    usual = (size == 0.0) | ((size > SMALLEST) & (size < LARGEST))
    return np.where(usual, 1.0, np.ldexp(1.0, np.frexp(size)[1] - 1))
