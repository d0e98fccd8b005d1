"""What the supervisor looks at, and what it says."""

from enum import IntFlag, StrEnum, auto

import msgspec


class State(StrEnum):
    """The supervisor's states."""

    IDLE = "IDLE"
    READY = "READY"
    ACTIVE = "ACTIVE"
    RAMP_DOWN = "RAMP_DOWN"
    HAND_OVER = "HAND_OVER"
    PILOT = "PILOT"
    FAULT = "FAULT"


class Condition(IntFlag):
    """What the supervisor looks at, a bit each; what comes first causes what comes later.

    Its words are in `companion.telemetry.conditions`, its test in `companion.supervision.conditions`.
    """

    LINK_LOST = auto()
    REBOOTED = auto()
    TICK_LATE = auto()
    NON_FINITE = auto()
    CLOCK_INCONSISTENT = auto()
    DELAY_TOO_LONG = auto()
    DEPTH_JUMPED = auto()
    DEPTH_STALE = auto()
    ATTITUDE_STALE = auto()
    POSITION_STALE = auto()
    GROUND_LOST = auto()
    YAW_RESET = auto()
    POSITION_RESET = auto()
    DEPTH_OUT_OF_BOUNDS = auto()
    THRUSTER_MISSED = auto()
    THRUSTER_DEAD = auto()
    TILTED = auto()
    TILT_PERSISTS = auto()
    EKF_UNHEALTHY = auto()
    LEAK = auto()
    BATTERY_LOW = auto()
    AUTOPILOT_FAILSAFE = auto()
    FAILSAFE_SURFACES = auto()
    FAILSAFE_UNSAFE = auto()
    PREFLIGHT_FAILURE = auto()
    SATURATED = auto()
    OFF_TRACK = auto()
    CLOCK_JUMPED = auto()
    INNOVATION_LARGE = auto()
    QUEUE_FULL = auto()
    CONFIG_CHANGED = auto()
    PEER_CHANGED = auto()
    PILOT_TAKEOVER = auto()
    PILOT_LOST = auto()
    PILOT_LOST_SURFACE = auto()
    DISARMED = auto()
    WRONG_MODE = auto()
    RAMPED_DOWN = auto()
    HAND_OVER_HELD = auto()
    HANDED_OVER = auto()
    SURFACED = auto()
    HAND_OVER_REFUSED = auto()
    OPERATOR_STOP = auto()
    ENGAGE_ASKED = auto()
    CLEAR_ASKED = auto()


class Verdict(msgspec.Struct, frozen=True):
    """The supervisor's word for this tick. `authority` 0..1 scales the wrench: 0 is neutral.

    `warnings` are the conditions that only warn; with `freeze` learning is frozen.
    `remedy` is the one thing to do that gets the operator on.
    """

    state: State
    conditions: Condition
    authority: float
    reason: str
    warnings: Condition = Condition(0)
    freeze: bool = False
    remedy: str = ""
