"""Two-level Bayesian updating: what measured outputs of any function say of its inputs, and of its failures."""
