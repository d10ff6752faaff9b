"""Reliability methods side by side, on one event or on published problems."""
