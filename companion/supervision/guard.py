"""The last check of every axis before it is sent: finite, bounded, slew-limited, only if permitted."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.core.bounds import clamped, limited
from companion.records import NEUTRAL, Axes, AxisCommand, Verdict
from companion.supervision.supervisor import CARRY_AUTHORITY


@dataclass(frozen=True, slots=True)
class Envelope:
    """Limits of what is sent: |axis| at most `max_axis`, its rate at most `max_slew_per_s`.

    Roll and pitch at most `max_tilt_axis`: half of full stick capsizes the vehicle.
    """

    max_axis: float
    max_slew_per_s: float
    max_tilt_axis: float = 0.0


OURS = (True,) * 6


def guard(
    wanted: AxisCommand,
    verdict: Verdict,
    previous: AxisCommand,
    envelope: Envelope,
    dt_s: float,
    sticks: AxisCommand = NEUTRAL,
    held: Sequence[bool] = OURS,
) -> AxisCommand:
    """Return what is sent on every axis; `previous` is what was sent last.

    Axes that are `held` carry what is `wanted`: finite, bounded, slew-limited; neutral unless permitted. The
    others carry the pilot's `sticks` as they are: finite and within full stick.

    The loss of permission is not slew-limited: neutral at once. Authority scales forces, in `core.actuation`.
    """
    permitted = verdict.state in CARRY_AUTHORITY and 0.0 < verdict.authority <= 1.0
    most = (*(envelope.max_axis,) * 4, *(envelope.max_tilt_axis,) * 2)
    ours = bounded(wanted, previous, most, envelope.max_slew_per_s * dt_s) if permitted else NEUTRAL
    if all(held):
        return AxisCommand(*ours)
    return AxisCommand(
        *[axis if is_held else _stick(stick) for is_held, axis, stick in zip(held, ours, sticks, strict=True)]
    )


def bounded(wanted: Axes, last: Axes, most: Axes, step: float) -> Axes:
    """Return the axes within ±`most`, and within `step` of those sent last; neutral if one is not finite."""
    if not math.isfinite(wanted[0] + wanted[1] + wanted[2] + wanted[3] + wanted[4] + wanted[5]):
        return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return (
        _slewed(limited(wanted[0], most[0]), last[0], step),
        _slewed(limited(wanted[1], most[1]), last[1], step),
        _slewed(limited(wanted[2], most[2]), last[2], step),
        _slewed(limited(wanted[3], most[3]), last[3], step),
        _slewed(limited(wanted[4], most[4]), last[4], step),
        _slewed(limited(wanted[5], most[5]), last[5], step),
    )


def _slewed(axis: float, last: float, step: float) -> float:
    last = last if math.isfinite(last) else 0.0
    return clamped(axis, last - step, last + step)


def _stick(deflection: float) -> float:
    return limited(deflection, 1.0) if math.isfinite(deflection) else 0.0
