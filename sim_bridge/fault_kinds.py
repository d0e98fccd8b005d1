"""What can break: one table of kinds, and the record of one fault."""

from math import inf, isfinite
from typing import Annotated, Literal, NamedTuple

import msgspec
from msgspec import Meta
from pymavlink.dialects.v20 import ardupilotmega as mavlink

LARGEST_FLOAT = 3.4e38
"""Largest float of 32 bits, as MAVLink has them."""


class FaultKind(NamedTuple):
    """One row of the table."""

    effect: str
    """What happens from at_s for duration_s."""
    value: str = ""
    """What `value` is; empty if the kind has none."""
    low: float = -inf
    high: float = inf
    """Range of `value`."""
    on_firmware: bool = False
    """Whether it can be done to the real ArduSub as well."""


FAULT_KINDS: dict[str, FaultKind] = {
    "message_frozen": FaultKind("telemetry named `message` repeats what it said last"),
    "message_stopped": FaultKind("telemetry named `message` is not sent"),
    "message_nan": FaultKind("the float fields of `message` are NaN"),
    "message_extreme": FaultKind("its float fields are `value`, its signed integers at their largest", "any"),
    "clear": FaultKind("once: every fault that holds ends"),
    "link_cut": FaultKind("nothing passes, either way", on_firmware=True),
    "link_delayed": FaultKind("everything passes later, either way", "s", 0.0, 10.0, on_firmware=True),
    "link_lossy": FaultKind("datagrams get lost, either way", "probability", 0.0, 1.0, on_firmware=True),
    "link_duplicating": FaultKind(
        "datagrams come twice, either way", "probability", 0.0, 1.0, on_firmware=True
    ),
    "reboot": FaultKind("once: the autopilot restarts", on_firmware=True),
    "disarm": FaultKind("once: the motors are disarmed", on_firmware=True),
    "mode": FaultKind("once: another flight mode", "its number", 0.0, 255.0, on_firmware=True),
    "stick": FaultKind(
        "a ground station with its own link moves the stick of `axis` (x, y, z, r); the others rest",
        "deflection; z is positive up",
        -1.0,
        1.0,
    ),
    "parameter": FaultKind("once: `parameter` gets another value", "that value", on_firmware=True),
    "thruster": FaultKind(
        "number `thruster` keeps only this part of its thrust; below 0 it pushes the other way",
        "part",
        -1.0,
        1.0,
        on_firmware=True,
    ),
    "thruster_stuck": FaultKind(
        "number `thruster` runs at this PWM, whatever it is told", "µs", 1100.0, 1900.0, on_firmware=True
    ),
    "leak": FaultKind("a leak detector is wet"),
    "ekf": FaultKind("the EKF has no solution, and reports this variance", "variance", 0.0, 1e6),
    "depth_shifted": FaultKind(
        "once: relative_alt reads deeper from now on", "m", -1000.0, 1000.0, on_firmware=True
    ),
    "yaw_reset": FaultKind(
        "`count` times over duration_s: the EKF turns yaw and motion over ground", "degrees", -360.0, 360.0
    ),
    "position_reset": FaultKind(
        "`count` times over duration_s: the EKF's position is further north", "m", -1e5, 1e5
    ),
    "origin_late": FaultKind(
        "the EKF takes no origin, and gets one at the end; under water that puts relative_alt off by 0.1 m"
    ),
    "depth_noise": FaultKind(
        "the EKF's depth has so much more slow noise", "m, standard deviation", 0.0, 1.0
    ),
    "depth_lag": FaultKind(
        "the EKF's depth comes later and shows 0.71 of what is faster than 20 s, as with GPS (0.15 s)",
        "s",
        0.0,
        0.4,
    ),
    "dvl_out": FaultKind("the DVL does not measure"),
    "range_out": FaultKind("the rangefinder hears no echo"),
    "range_false": FaultKind("the rangefinder hears something else, so far away", "m", 0.0, 1000.0),
    "range_answers": FaultKind(
        "the rangefinder's changes come with this factor: 0 is stuck, -1 the wrong sign",
        "factor",
        -10.0,
        10.0,
    ),
    "range_scaled": FaultKind(
        "the rangefinder's range is multiplied: 3.28 in feet, 2 the second echo", "factor", 0.0, 100.0
    ),
    "range_quality": FaultKind(
        "the rangefinder tells this quality of its signal: 0 unknown, 1 none", "%", 0.0, 100.0
    ),
    "compass": FaultKind(
        "magnetic north is turned clockwise; the EKF follows with 12.5 s", "degrees", -180.0, 180.0
    ),
    "voltage": FaultKind("the battery's open-circuit voltage", "V", 0.0, 60.0, on_firmware=True),
}


class Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One scripted fault; `at_s` counts from the simulation's start."""

    kind: str
    at_s: Annotated[float, Meta(ge=0)] = 0.0
    duration_s: Annotated[float, Meta(gt=0)] = 1e9
    message: str = ""
    """message_*: the MAVLink name, or empty for every telemetry message."""
    parameter: str = ""
    axis: Literal["x", "y", "z", "r"] = "z"
    """stick: as MANUAL_CONTROL names them."""
    thruster: Annotated[int, Meta(ge=1, le=8)] = 1
    count: Annotated[int, Meta(ge=1, le=1000)] = 1
    """yaw_reset, position_reset: how many, spread over duration_s."""
    value: float = 0.0

    def __post_init__(self) -> None:
        kind = FAULT_KINDS.get(self.kind)
        if kind is None:
            raise ValueError(f"no fault of kind '{self.kind}'; there are {', '.join(FAULT_KINDS)}")
        if self.kind == "parameter" and not self.parameter:
            raise ValueError("a fault of kind 'parameter' needs its name in 'parameter'")
        if self.message and not hasattr(mavlink, f"MAVLINK_MSG_ID_{self.message}"):
            raise ValueError(f"message = '{self.message}': is no message of MAVLink")
        if abs(self.value) > LARGEST_FLOAT and isfinite(self.value):
            raise ValueError(f"value {self.value:g} is no float of 32 bits")
        if kind.value and not kind.low <= self.value <= kind.high:
            raise ValueError(
                f"value of a fault of kind '{self.kind}' must be within {kind.low:g}..{kind.high:g}"
            )
