"""The last check of every axis before it is sent: finite, bounded, slew-limited, only if permitted."""

import math
from dataclasses import dataclass

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


def guard(
    command: AxisCommand, verdict: Verdict, previous: AxisCommand, envelope: Envelope, dt_s: float
) -> AxisCommand:
    """Return what may be sent: finite, bounded, slew-limited; neutral unless permitted.

    The loss of permission is not slew-limited: neutral at once. Authority scales forces, before the thruster
    curve (`control.actuation`): a ramp of an axis would not be a ramp of the force.
    """
    wanted = (command.surge, command.sway, command.heave, command.yaw, command.roll, command.pitch)
    permitted = verdict.state in CARRY_AUTHORITY and 0.0 < verdict.authority <= 1.0
    if not (permitted and all(map(math.isfinite, wanted))):
        return NEUTRAL
    step = envelope.max_slew_per_s * dt_s
    last = (previous.surge, previous.sway, previous.heave, previous.yaw, previous.roll, previous.pitch)
    if not all(map(math.isfinite, last)):
        last = (0.0,) * 6
    most = (envelope.max_axis,) * 4 + (envelope.max_tilt_axis,) * 2
    bounded = (max(-m, min(m, axis)) for m, axis in zip(most, wanted, strict=True))
    return AxisCommand(*(max(p - step, min(p + step, axis)) for p, axis in zip(last, bounded, strict=True)))
