"""What the messages that steer made of the thrust, as ArduSub takes them (joystick.cpp, GCS_Common.cpp).

| what counts        | where                                                                              |
|--------------------|------------------------------------------------------------------------------------|
| a message          | from MAV_GCS_SYSID; MANUAL_CONTROL for this system, an override also for all of them |
| its demand         | MANUAL_CONTROL times PilotGain, heave also times JS_THR_GAIN; an override as it is |
| of several senders | the last one on each channel, for STALE_S                                          |
| as thrust          | while armed: in MANUAL on every axis, in STABILIZE on surge, sway and heave        |

Elsewhere the demand is unknown, NaN and not 0: the firmware or a hand may have moved the vehicle.
"""

import math
import operator
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.arrays import Array
from companion.identify.sample_table import HOLDS_S, Rows, in_order
from companion.mavlink.ardusub import LEAVE_ALONE, SPAN_US, STICK, STICK_NEUTRAL_Z, from_pwm_us

Message = tuple[float, str, int, tuple[float, ...]]
"""When it arrived (s), its name, the system that sent it, its numbers."""
Said = Mapping[str, Array]
"""What a vehicle said: by message rows in order of time, when it arrived (s), and its numbers."""

MANUAL_CONTROL, OVERRIDE = "MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE"
OVERRIDE_SIGNS: Final = (1.0, 1.0, -1.0, 1.0, 1.0, 1.0)
STALE_S: Final = 1.5
"""A demand counts for no longer: the pilot-input failsafe acts 0.1 to 3 s after the last one."""
UNKNOWN: Final = (math.nan,) * 6
MANUAL, STABILIZE = 19, 0
DIRECT: Final[dict[float, tuple[float, ...]]] = {MANUAL: (1.0,) * 6, STABILIZE: (1.0, 1.0, 1.0, *UNKNOWN[3:])}
"""The axes on which a stick is thrust, by custom_mode."""
STATION, DEFAULT_STATION = ("PARAM_VALUE MAV_GCS_SYSID", "PARAM_VALUE SYSID_MYGCS"), 255.0
TOGGLES: Final = ("NAMED_VALUE_FLOAT InputHold", "NAMED_VALUE_FLOAT RollPitch")
"""NAMED_VALUE_FLOATs that say whether a pilot's button keeps or redirects what MANUAL_CONTROL says."""


def acted(heard: Iterable[Message], system: int, said: Said) -> tuple[Rows, str]:
    """Return the demands on surge, sway, heave (down), yaw, roll, pitch, and in words what counts of `heard`.

    The vehicle is `system`. There are no demands where no message acted.
    """
    messages = sorted(heard)
    t_s = np.array([message[0] for message in messages])
    mode, gain = held(t_s, said.get("HEARTBEAT"), 3), held(t_s, said.get("NAMED_VALUE_FLOAT PilotGain"), 1)
    armed = is_armed(t_s, said.get("HEARTBEAT"))
    for toggle in TOGGLES:
        if toggle in said:
            gain[held(t_s, said[toggle], 1) != 0.0] = math.nan
    throttle_gain = said["PARAM_VALUE JS_THR_GAIN"][-1, 1] if "PARAM_VALUE JS_THR_GAIN" in said else 1.0
    station = next((said[name][-1, 1] for name in STATION if name in said), DEFAULT_STATION)
    demand, rows, left_out = [0.0] * 6, list[tuple[float, ...]](), Counter[str]()
    for i, (at_s, name, sender, (target, *fields)) in enumerate(messages):
        if sender != station:
            left_out[f"from system {sender}, not MAV_GCS_SYSID"] += 1
        elif target != system and (name == MANUAL_CONTROL or target):
            left_out[f"for system {target:.0f}"] += 1
        else:
            demand = _demand(name, fields, demand, gain[i], throttle_gain)
            acts = DIRECT.get(mode[i], UNKNOWN) if armed[i] == 1.0 else UNKNOWN
            rows.append((at_s, *map(operator.mul, demand, acts)))
            if armed[i] != 1.0:
                left_out["while it was not armed"] += 1
            elif mode[i] not in DIRECT:
                left_out["in another mode than MANUAL and STABILIZE"] += 1
            elif math.isnan(demand[0]):
                left_out["without a PilotGain, with InputHold or with RollPitch"] += 1
    words = " and ".join(sorted({message[1] for message in messages})) or "no message that steers"
    words += " times PilotGain" if MANUAL_CONTROL in words else ""
    words += "".join(f"; not counted: {count} {why}" for why, count in left_out.items())
    return until_stale(rows) if any(x == x for _, *values in rows for x in values) else (), words


def _demand(name: str, fields: list[float], before: list[float], gain: float, throttle: float) -> list[float]:
    """Return what a message demands; a channel that an override leaves alone keeps what it was."""
    if name == OVERRIDE:
        return [
            was if us in (0, LEAVE_ALONE) else sign * from_pwm_us(round(us))
            for us, was, sign in zip(fields, before, OVERRIDE_SIGNS, strict=True)
        ]
    if math.isnan(gain):
        return [*UNKNOWN]
    x, y, up, r, roll, pitch = fields
    level = gain * np.array((x, y, 2.0 * throttle * (STICK_NEUTRAL_Z - up), r)) / STICK
    return [*np.clip(level, -1.0, 1.0).tolist(), roll / SPAN_US, pitch / SPAN_US]


def until_stale(rows: Rows) -> Array:
    """Return rows in order of time, each followed by an unknown one where none replaces it in STALE_S."""
    table = in_order(rows)
    last = np.flatnonzero(np.diff(table[:, 0]) > STALE_S)
    unknown = np.full((last.size, table.shape[1]), math.nan)
    unknown[:, 0] = table[last, 0] + STALE_S
    return np.insert(table, last + 1, unknown, axis=0)


def is_armed(t_s: Array, beats: Array | None) -> Array:
    """Return by time 1 or 0 as the heartbeats say, NaN where unknown."""
    if beats is None:
        return np.full(t_s.size, math.nan)
    armed = beats[:, 2].astype(int) & mavlink.MAV_MODE_FLAG_SAFETY_ARMED != 0
    return held(t_s, np.column_stack((beats[:, 0], armed)), 1)


def held(t_s: Array, table: Array | None, column: int) -> Array:
    """Return the value at each time on which the reports before and after agree, NaN where they do not."""
    if table is None:
        return np.full(t_s.size, math.nan)
    i = np.searchsorted(table[:, 0], t_s, side="right") - 1
    before, after = table[i, column], table[np.minimum(i + 1, len(table) - 1), column]
    known = (i >= 0) & (t_s - table[i, 0] <= HOLDS_S) & (before == after)
    return np.where(known, before, math.nan)
