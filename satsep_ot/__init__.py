"""Reliability of small satellite separation: an OpenTURNS plugin."""

__version__ = "0.1.0"
