"""Metres north and east of an origin from degrees, as ArduPilot computes them.

Source: ArduPilot's libraries/AP_Common/Location.cpp. From the EKF's origin they are the vehicle's x and y.
"""

import math

METRES_PER_DEGREE = 111318.84502145034
"""ArduPilot's LOCATION_SCALING_FACTOR, per degree."""

Degrees = tuple[float, float]
"""Latitude and longitude."""


def metres(place: Degrees, origin: Degrees) -> tuple[float, float]:
    """Return how far north and east of the origin a place is."""
    scale = math.cos(math.radians(0.5 * (place[0] + origin[0])))
    east_deg = (place[1] - origin[1] + 180.0) % 360.0 - 180.0
    return (place[0] - origin[0]) * METRES_PER_DEGREE, east_deg * METRES_PER_DEGREE * scale
