"""The simulator, compiled by numba: it knows records, not case files, and imports nothing of the package outside."""
