"""Multivariate polynomial regression: bases, fits, predictions and the exact distribution of a polynomial."""
