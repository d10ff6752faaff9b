"""The separation as an OpenTURNS function, distribution and events, built from a case file."""
