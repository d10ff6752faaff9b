"""Active subspaces: estimation, dimension, active variables, ridges without gradients."""
