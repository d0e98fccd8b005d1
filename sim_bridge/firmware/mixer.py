"""ArduSub's motor mixing (AP_Motors6DOF): six demands in -1..1 to motor outputs in -1..1."""

from collections.abc import Sequence

FACTORS: dict[str, tuple[tuple[int, int, int, int, int, int], ...]] = {
    # roll, pitch, yaw, throttle, forward, lateral
    "vectored": (
        (0, 0, 1, 0, -1, 1),
        (0, 0, -1, 0, -1, -1),
        (0, 0, -1, 0, 1, 1),
        (0, 0, 1, 0, 1, -1),
        (1, 0, 0, -1, 0, 0),
        (-1, 0, 0, -1, 0, 0),
    ),
    "vectored_6dof": (
        (0, 0, 1, 0, -1, 1),
        (0, 0, -1, 0, -1, -1),
        (0, 0, -1, 0, 1, 1),
        (0, 0, 1, 0, 1, -1),
        (1, -1, 0, -1, 0, 0),
        (-1, -1, 0, -1, 0, 0),
        (1, 1, 0, -1, 0, 0),
        (-1, 1, 0, -1, 0, 0),
    ),
}

Demand = tuple[float, float, float, float, float, float]
"""roll, pitch, yaw, throttle (up), forward, lateral; each -1..1."""


def mix(frame: str, demand: Demand) -> list[float]:
    """Motor outputs in -1..1, saturation shared as the frame shares it.

    `vectored_6dof`: the vertical and the horizontal group are each divided by their largest output above 1.
    `vectored`: summed and clipped per motor; heave limits surge on the pair at the rear of the travel.
    """
    factors = FACTORS[frame]
    roll, pitch, yaw, throttle, forward, lateral = demand
    if frame == "vectored_6dof":
        vertical = [r * roll + p * pitch + t * throttle for r, p, _, t, _, _ in factors]
        horizontal = [y * yaw + f * forward + s * lateral for _, _, y, _, f, s in factors]
        largest_v = max(1.0, *map(abs, vertical))
        largest_h = max(1.0, *map(abs, horizontal))
        return [_clip(v / largest_v + h / largest_h) for v, h in zip(vertical, horizontal, strict=True)]
    limit = max(0.0, 1.0 - abs(throttle))
    outputs = []
    for r, p, y, t, f, s in factors:
        limited = max(-limit, min(limit, forward)) if f * forward > 0 else forward
        turned = r * roll + p * pitch + y * yaw
        outputs.append(_clip(turned + t * throttle + f * limited + s * lateral))
    return outputs


def motor_pwm(outputs: Sequence[float], directions: Sequence[float]) -> list[int]:
    """PWM = 1500 + 400 · output (µs), with MOT_n_DIRECTION applied; no thrust-curve correction."""
    return [int(1500 + 400 * output * way) for output, way in zip(outputs, directions, strict=True)]


def _clip(value: float) -> float:
    return max(-1.0, min(1.0, value))
