"""What the supervisor looks at: every condition with its test, what it means and what an operator does.

`docs/supervisor.md` is made from this table and from `supervisor.TRANSITIONS`.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import msgspec

from companion.config import Supervisor as Limits
from companion.records import Condition, EkfStatus, VehicleState, Z
from companion.supervision.handover import REFUSED_S, HandOverStep

C = Condition

CLOCK_DOUBT_S = 2.0
"""A clock that is set anew contradicts itself until the second answer to TIMESYNC; two autopilots go on."""

RESET_SETTLE_S = 3.0
"""So long after a reset of the autopilot's estimate another one may follow."""


class Watched(msgspec.Struct, frozen=True, kw_only=True):
    """What takes a while to be seen (`watch.py`): how long something has held, or was said a while ago."""

    ekf: EkfStatus | None = None
    """The newest report, None before the first."""
    ekf_doubt_s: float = 0.0
    pilot_deflection: float = 0.0
    rebooted: bool = False
    leaking: bool = False
    failsafe_surfaces: bool = False
    """Whether one took the vehicle to SURFACE: mode and failsafe came with the same heartbeat."""
    failsafe: bool = False
    """Whether the autopilot reports a failsafe that our steering should have ended."""
    battery_low_s: float = 0.0
    saturated_s: float = 0.0
    off_track_s: float = 0.0
    tilted_s: float = 0.0
    innovation_m: float = 0.0
    innovation_deg: float = 0.0
    """By how much measurements missed what was expected, averaged."""
    samples_dropped: bool = False
    config_changed: bool = False
    peer_changed: bool = False


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """What one tick saw, beside the vehicle's state."""

    state: VehicleState
    mode_right: bool
    """Whether the flight mode is one that our present state steers or hands over in."""
    parameters: Mapping[str, float]
    watched: Watched
    preflight_failure: str = ""
    """The rows of `check` that forbid engaging, in words."""
    holds_position: bool = False
    finite: bool = True
    late_s: float = 0.0
    full_override: bool = False
    """Whether the pilot takes everything, by the sticks or a button of our own second link."""
    pilot_timeout_s: float = math.inf
    """How old the ground station's heartbeat may be: infinite where none is needed."""
    surface_on_loss: bool = False
    hand_over: HandOverStep = HandOverStep.NONE
    ramped_down: bool = False
    stop: bool = False
    engage: bool = False
    clear: bool = False


class ConditionSpec(NamedTuple):
    """One condition: how it is seen, the keys of [supervisor] that decide, and words for people."""

    condition: Condition
    holds: Callable[[Observation, Limits], bool]
    keys: tuple[str, ...]
    description: str
    remedy: str


def _link_lost(o: Observation, limits: Limits) -> bool:
    ages = o.state.ages
    return not (ages.link_s <= limits.link_timeout_s and ages.heartbeat_s <= limits.heartbeat_timeout_s)


def pilot_failsafe_acts(parameters: Mapping[str, float], limits: Limits) -> bool:
    """Tell whether the autopilot stops the thrusters in time when this computer dies."""
    acts = parameters.get("FS_PILOT_INPUT", 0.0) >= 1.0
    return acts and parameters.get("FS_PILOT_TIMEOUT", math.inf) <= limits.max_pilot_timeout_s


def depth_is_fresh(state: VehicleState, limits: Limits) -> bool:
    """Tell whether a believable depth came of late."""
    return state.ages.depth_s <= limits.depth_timeout_s


def ekf_is_doubtful(ekf: EkfStatus, limits: Limits) -> bool:
    """Tell whether the autopilot's estimator doubts compass, velocity or depth now."""
    return not ekf.variance <= limits.max_ekf_variance


def voltage_is_low(voltage_v: float, limits: Limits) -> bool:
    """Tell whether the battery is nearly empty, if this lasts."""
    return voltage_v < limits.min_voltage_v


def _ekf_unhealthy(o: Observation, limits: Limits) -> bool:
    ekf = o.watched.ekf
    return not (ekf and ekf.attitude and ekf.depth and o.watched.ekf_doubt_s <= limits.ekf_doubt_s)


def _out_of_bounds(o: Observation, limits: Limits) -> bool:
    margin_m = limits.depth_margin_m
    return not -margin_m <= o.state.eta[Z] <= limits.max_depth_m + margin_m


def _innovation_large(o: Observation, limits: Limits) -> bool:
    seen = o.watched
    return not (
        seen.innovation_m <= limits.max_innovation_m and seen.innovation_deg <= limits.max_innovation_deg
    )


def tilted(state: VehicleState, limits: Limits) -> bool:
    """Tell whether it rolls or pitches too far; an attitude that is not known counts as such."""
    most_rad = math.radians(limits.max_tilt_deg)
    return not (abs(state.roll) <= most_rad and abs(state.pitch) <= most_rad)


def _pilot_lost(o: Observation, _: Limits) -> bool:
    return not o.state.ages.pilot_s <= o.pilot_timeout_s


# What is not known counts against permission: hence `not x <= limit`, which a NaN meets.
# Of several that hold, an operator is told the first one's remedy (`supervisor.remedy`).
CONDITIONS = (
    ConditionSpec(
        C.LINK_LOST,
        _link_lost,
        ("link_timeout_s", "heartbeat_timeout_s"),
        "nothing, or no heartbeat, came from the autopilot",
        "look at cable, router and link.endpoint",
    ),
    ConditionSpec(
        C.DEPTH_STALE,
        lambda o, limits: not depth_is_fresh(o.state, limits),
        ("depth_timeout_s",),
        "no new, believable depth came",
        "look whether vehicle.depth_source streams and moves",
    ),
    ConditionSpec(
        C.ATTITUDE_STALE,
        lambda o, limits: not o.state.ages.attitude_s <= limits.attitude_timeout_s,
        ("attitude_timeout_s",),
        "no new attitude came",
        "look whether ATTITUDE streams",
    ),
    ConditionSpec(
        C.POSITION_STALE,
        lambda o, limits: o.holds_position and not o.state.ages.position_s <= limits.position_timeout_s,
        ("position_timeout_s",),
        "position is held, and no new one came",
        "look at the DVL; engage again without it to hold depth and heading",
    ),
    ConditionSpec(
        C.DEPTH_JUMPED,
        lambda o, limits: o.state.depth_refused,
        ("max_depth_jump_m",),
        "a depth lay so far from the expected one that it was left out; if it stays there, depth is stale",
        "look at the depth sensor",
    ),
    ConditionSpec(
        C.YAW_RESET,
        lambda o, limits: o.state.ages.yaw_reset_s <= RESET_SETTLE_S,
        (),
        "the autopilot's EKF corrected its yaw at once, less than 3 s ago; the heading that is held turned "
        "with it, and the vehicle stays where it points",
        "give the heading anew if it shall be another; calibrate the compass if this comes again and again",
    ),
    ConditionSpec(
        C.POSITION_RESET,
        lambda o, limits: o.state.ages.position_reset_s <= RESET_SETTLE_S,
        (),
        "the autopilot's EKF corrected its position at once, less than 3 s ago; the place that is held moved "
        "with it, and the vehicle stays where it is",
        "give the place anew if it shall be another; look at the DVL if this comes again and again",
    ),
    ConditionSpec(
        C.DEPTH_OUT_OF_BOUNDS,
        _out_of_bounds,
        ("max_depth_m", "depth_margin_m"),
        "the depth is above the surface or below what was allowed",
        "take over; look at the sensor's zero, and at max_depth_m",
    ),
    ConditionSpec(
        C.TILTED,
        lambda o, limits: tilted(o.state, limits),
        ("max_tilt_deg",),
        "it rolls or pitches so far that only heave and levelling are left: x, y and heading are let go",
        "slower, less current, or a heading that meets it; look for a thruster that is dead or reversed",
    ),
    ConditionSpec(
        C.TILT_PERSISTS,
        lambda o, limits: not o.watched.tilted_s <= limits.off_track_s,
        ("max_tilt_deg", "off_track_s"),
        "it stays tilted, so we cannot right it: the autopilot tries, in STABILIZE and then ALT_HOLD",
        "look for what tilts it: a load beside the centre, a snagged tether, a dead or reversed thruster",
    ),
    ConditionSpec(
        C.EKF_UNHEALTHY,
        _ekf_unhealthy,
        ("max_ekf_variance", "ekf_doubt_s"),
        "the autopilot's estimator has no attitude or no depth, or has doubted compass, velocity or depth "
        "for a while",
        "wait until it has settled; calibrate the compass, look at the depth sensor",
    ),
    ConditionSpec(
        C.LEAK,
        lambda o, limits: o.watched.leaking,
        (),
        "the autopilot said Leak Detected, less than 25 s ago (it repeats itself every 20 s)",
        "bring it up",
    ),
    ConditionSpec(
        C.BATTERY_LOW,
        lambda o, limits: not o.watched.battery_low_s <= limits.battery_low_s,
        ("min_voltage_v", "battery_low_s"),
        "the battery is nearly empty",
        "bring it up",
    ),
    ConditionSpec(
        C.AUTOPILOT_FAILSAFE,
        lambda o, limits: o.watched.failsafe,
        (),
        "a failsafe of the autopilot's own is latched (system status 5) though we steer",
        "read the autopilot's messages",
    ),
    ConditionSpec(
        C.FAILSAFE_SURFACES,
        lambda o, limits: o.watched.failsafe_surfaces and not o.mode_right,
        (),
        "a failsafe of the autopilot's own (leak, battery) changed the flight mode to SURFACE",
        "read the autopilot's messages",
    ),
    ConditionSpec(
        C.REBOOTED,
        lambda o, limits: o.watched.rebooted,
        (),
        "the autopilot's clock went backwards: it started anew",
        "find out why (power?)",
    ),
    ConditionSpec(
        C.FAILSAFE_UNSAFE,
        lambda o, limits: not pilot_failsafe_acts(o.parameters, limits),
        ("max_pilot_timeout_s",),
        "FS_PILOT_INPUT is 0 or not known, or FS_PILOT_TIMEOUT too long: nothing would stop the thrusters if "
        "this computer died",
        "set FS_PILOT_INPUT to 2",
    ),
    ConditionSpec(
        C.PREFLIGHT_FAILURE,
        lambda o, limits: bool(o.preflight_failure),
        (),
        "a row of the pre-dive list is refused (frame, steering id, InputHold...); the reason names it",
        "`holdfast check` says how to fix it",
    ),
    ConditionSpec(
        C.SATURATED,
        lambda o, limits: not o.watched.saturated_s <= limits.saturated_s,
        ("saturated_s",),
        "an axis has given all it can for long: it is about to be carried off",
        "less current, a slower path, or more max_force",
    ),
    ConditionSpec(
        C.OFF_TRACK,
        lambda o, limits: not o.watched.off_track_s <= limits.off_track_s,
        ("max_error_m", "max_error_deg", "off_track_s"),
        "it is far from where it should be, and stays there",
        "look for what holds or drives it: tether, current, a dead thruster",
    ),
    ConditionSpec(
        C.DELAY_TOO_LONG,
        lambda o, limits: not o.state.delays.total_s <= limits.max_delay_s,
        ("max_delay_s",),
        "telemetry and commands are later than any gains bear",
        "look at the link's load; run on the vehicle instead of topside",
    ),
    ConditionSpec(
        C.CLOCK_JUMPED,
        lambda o, limits: not o.state.clock_doubt_s <= 0.0,
        (),
        "a stamp or an answer to TIMESYNC contradicts the autopilot's clock, and none has set it anew yet",
        "nothing if it was once; if it goes on, look for a second autopilot with this system id",
    ),
    ConditionSpec(
        C.CLOCK_INCONSISTENT,
        lambda o, limits: not o.state.clock_doubt_s <= CLOCK_DOUBT_S,
        (),
        f"stamps and answers to TIMESYNC have contradicted each other for {CLOCK_DOUBT_S:g} s",
        "look for a second autopilot with this system id on the link, and at what relays TIMESYNC",
    ),
    ConditionSpec(
        C.INNOVATION_LARGE,
        _innovation_large,
        ("max_innovation_m", "max_innovation_deg"),
        "where it is held, it keeps not being where the estimator expects: sensor, model or clock is wrong",
        "look at the depth's and heading's noise and at the delays",
    ),
    ConditionSpec(
        C.NON_FINITE,
        lambda o, limits: not o.finite,
        (),
        "a computed value was not finite: a bug",
        "keep the recording and tell us",
    ),
    ConditionSpec(
        C.TICK_LATE,
        lambda o, limits: not o.late_s <= limits.late_tick_s,
        ("late_tick_s",),
        "this process did not run in time",
        "look at the computer's load",
    ),
    ConditionSpec(
        C.QUEUE_FULL,
        lambda o, limits: o.watched.samples_dropped,
        (),
        "telemetry was dropped, because nobody took it in time",
        "look at whoever subscribes; holding is not affected",
    ),
    ConditionSpec(
        C.CONFIG_CHANGED,
        lambda o, limits: o.watched.config_changed,
        (),
        "our configuration or a parameter of the autopilot changed while running, less than 2 s ago",
        "see that it was you",
    ),
    ConditionSpec(
        C.PEER_CHANGED,
        lambda o, limits: o.watched.peer_changed,
        (),
        "a link that listens turned to another sender less than 2 s ago: the one before had fallen silent",
        "see that it was you; list the addresses in link.allow or ground_station.allow, or set a signing key",
    ),
    ConditionSpec(
        C.PILOT_TAKEOVER,
        lambda o, limits: o.full_override or not o.watched.pilot_deflection <= limits.pilot_deflection,
        ("pilot_deflection", "pilot_hold_s"),
        "somebody else moves a stick",
        "let go of the stick; engage again",
    ),
    ConditionSpec(
        C.PILOT_LOST,
        _pilot_lost,
        (),
        "no heartbeat came from the ground station for ground_station.timeout_s",
        "look at the tether and the ground station; its sticks have the vehicle again at once",
    ),
    ConditionSpec(
        C.PILOT_LOST_SURFACE,
        lambda o, limits: o.surface_on_loss and _pilot_lost(o, limits),
        (),
        "the same, and ground_station.on_loss says to surface",
        "the same",
    ),
    ConditionSpec(C.DISARMED, lambda o, limits: not o.state.armed, (), "the motors are off", "arm it"),
    ConditionSpec(
        C.WRONG_MODE,
        lambda o, limits: not o.mode_right,
        (),
        "the flight mode is another than vehicle.steering_mode: somebody changed it",
        "engage, which asks for the mode",
    ),
    ConditionSpec(
        C.RAMPED_DOWN,
        lambda o, limits: o.ramped_down,
        ("ramp_down_s",),
        "authority has come down to nothing",
        "nothing",
    ),
    ConditionSpec(
        C.HANDED_OVER,
        lambda o, limits: o.hand_over is HandOverStep.DONE,
        ("keep_alt_hold_s",),
        "ALT_HOLD has the vehicle, and a pilot steers or `keep_alt_hold_s` is over",
        "nothing",
    ),
    ConditionSpec(
        C.SURFACED,
        lambda o, limits: o.hand_over is HandOverStep.SURFACED,
        (),
        "on reaching the surface the firmware changed from SURFACE to ALT_HOLD",
        "nothing",
    ),
    ConditionSpec(
        C.HAND_OVER_REFUSED,
        lambda o, limits: o.hand_over is HandOverStep.REFUSED,
        (),
        f"ALT_HOLD was not there {REFUSED_S:g} s after handing over began",
        "nothing",
    ),
    ConditionSpec(C.OPERATOR_STOP, lambda o, limits: o.stop, (), "the operator asked to stop", "nothing"),
    ConditionSpec(C.ENGAGE_ASKED, lambda o, limits: o.engage, (), "the operator asked to engage", "nothing"),
    ConditionSpec(C.CLEAR_ASKED, lambda o, limits: o.clear, (), "the operator cleared the fault", "nothing"),
)

_TESTS = tuple((spec.condition.value, spec.holds) for spec in CONDITIONS)


def assess(seen: Observation, limits: Limits) -> Condition:
    """Return the conditions that hold this tick; what is not known counts against permission."""
    return Condition(sum(bit for bit, holds in _TESTS if holds(seen, limits)))
