"""ArduSub's motor mixing (AP_Motors6DOF): six demands in -1..1 to motor outputs in -1..1."""

from collections.abc import Sequence

Demand = tuple[float, float, float, float, float, float]
"""roll, pitch, yaw, throttle (up), forward, lateral; each -1..1."""
Outputs = tuple[float, float, float, float, float, float, float, float]
"""One for each motor; those that a frame does not have are at rest."""


def mix(frame: str, demand: Demand) -> list[float]:
    """Motor outputs in -1..1, saturation shared as the frame shares it."""
    return list(mix_six_dof(demand)) if frame == "vectored_6dof" else list(mix_vectored(demand)[:6])


def mix_six_dof(demand: Demand) -> Outputs:
    """Mix for `vectored_6dof`: the four vertical and the four horizontal motors share saturation.

    Each group is divided by its largest output above 1.
    """
    roll, pitch, yaw, throttle, forward, lateral = demand
    a, b = yaw - forward + lateral, -yaw - forward - lateral
    c, d = -yaw + forward + lateral, yaw + forward - lateral
    e, f = roll - pitch - throttle, -roll - pitch - throttle
    g, h = roll + pitch - throttle, -roll + pitch - throttle
    across = max(1.0, abs(a), abs(b), abs(c), abs(d))
    upright = max(1.0, abs(e), abs(f), abs(g), abs(h))
    return a / across, b / across, c / across, d / across, e / upright, f / upright, g / upright, h / upright


def mix_vectored(demand: Demand) -> Outputs:
    """Mix for `vectored`: clipped motor by motor; heave limits surge at the rear of the travel."""
    roll, _, yaw, throttle, forward, lateral = demand
    left = max(0.0, 1.0 - abs(throttle))
    limited = max(-left, min(left, forward))
    front, rear = (forward, limited) if forward > 0.0 else (limited, forward)
    return (
        _clip(yaw - front + lateral),
        _clip(-yaw - front - lateral),
        _clip(-yaw + rear + lateral),
        _clip(yaw + rear - lateral),
        _clip(roll - throttle),
        _clip(-roll - throttle),
        0.0,
        0.0,
    )


def motor_pwm(outputs: Sequence[float], directions: Sequence[float]) -> list[int]:
    """PWM = 1500 + 400 · output (µs), with MOT_n_DIRECTION applied; no thrust-curve correction."""
    return [int(1500 + 400 * output * way) for output, way in zip(outputs, directions, strict=True)]


def _clip(value: float) -> float:
    return max(-1.0, min(1.0, value))
