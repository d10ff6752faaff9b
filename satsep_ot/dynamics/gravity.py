"""The Earth as the orbits see it."""

EARTH_GRAVITATIONAL_PARAMETER = 3.986004418e14  # m3/s2, WGS 84
EARTH_RADIUS = 6378137.0  # m, equatorial, WGS 84
