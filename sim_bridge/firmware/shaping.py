"""What ArduSub's loops share: bounds, first-order low-passes, and speeds that brake in time."""

import math


def clip(value: float, limit: float) -> float:
    """Return `value` within ±`limit`."""
    if value < limit:
        return value if value > -limit else -limit
    return max(limit, -limit)


def smoothing(cutoff_hz: float, dt: float) -> float:
    """Share of the way that the firmware's first-order low-pass goes in a step of `dt` (s); 0 Hz is none."""
    return dt / (dt + 1.0 / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0


def braking(error: float, p: float, most: float, dt: float) -> float:
    """Return the speed towards what is `error` away: p times that near it, farther off as if it braked.

    The firmware's square-root controller: `most` is how hard it brakes; without it, p rules, and without p
    the root.
    """
    near = most / (p * p) if p else 0.0
    if most <= 0.0 or (p and abs(error) <= near):
        speed = p * error
    else:
        speed = math.copysign(math.sqrt(2.0 * most * (abs(error) - 0.5 * near)), error)
    return clip(speed, abs(error) / dt)
