"""Probability of an event: surrogates, proposals, true runs, sensitivities."""
