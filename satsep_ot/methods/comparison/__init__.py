"""Reliability methods side by side, on one event or on published problems."""

from satsep_ot.moved_modules import forwarding

__getattr__ = forwarding(__name__)
