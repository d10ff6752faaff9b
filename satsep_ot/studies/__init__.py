"""Whole studies: the chain from a case to probabilities, tables and figures."""
