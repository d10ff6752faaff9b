"""Multivariate polynomial regression: bases, fits, predictions and the exact law of a polynomial."""
