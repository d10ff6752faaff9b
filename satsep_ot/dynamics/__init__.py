"""Two rigid bodies pushed apart by springs: numpy, numba and scipy only; SI units and radians."""
