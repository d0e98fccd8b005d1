"""The last check of every axis before it is sent: finite, bounded, slew-limited, only if permitted."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.control.bounds import clamped, limited
from companion.records import NEUTRAL, AxisCommand, Verdict
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

    The loss of permission is not slew-limited: neutral at once. Authority scales forces, before the thruster
    curve (`control.actuation`): a ramp of an axis would not be a ramp of the force.
    """
    permitted = verdict.state in CARRY_AUTHORITY and 0.0 < verdict.authority <= 1.0
    permitted = permitted and all(map(math.isfinite, wanted))
    step = envelope.max_slew_per_s * dt_s
    most = (*(envelope.max_axis,) * 4, *(envelope.max_tilt_axis,) * 2)
    return AxisCommand(
        *[
            (_slewed(limited(axis, m), last, step) if permitted else 0.0) if is_held else _stick(stick)
            for is_held, axis, last, m, stick in zip(held, wanted, previous, most, sticks, strict=True)
        ]
    )


def _slewed(axis: float, last: float, step: float) -> float:
    last = last if math.isfinite(last) else 0.0
    return clamped(axis, last - step, last + step)


def _stick(deflection: float) -> float:
    return limited(deflection, 1.0) if math.isfinite(deflection) else 0.0
