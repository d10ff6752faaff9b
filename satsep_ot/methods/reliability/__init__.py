"""Probability of an event: surrogates, proposals, true runs, sensitivities."""

from satsep_ot.moved_modules import forwarding

__getattr__ = forwarding(__name__)
