"""Every condition of the supervisor: its test, its meaning and what an operator does about it.

`docs/supervisor.md` is made from this table and from `supervisor.TRANSITIONS`.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import msgspec

from companion.config import SupervisorLimits
from companion.records import Condition, EkfStatus, VehicleState, Z
from companion.supervision.handover import REFUSED_S, HandOverStep

C = Condition

CLOCK_DOUBT_S = 2.0
"""After one jump the clock contradicts itself until the second answer to TIMESYNC; two clocks always do."""

RESET_SETTLE_S = 3.0
"""Another reset of the autopilot's estimate may follow within this time."""


class Watched(msgspec.Struct, frozen=True, kw_only=True):
    """What takes time to observe (`monitor.py`): how long something lasted, what was reported recently."""

    ekf: EkfStatus | None = None
    """The newest report, None before the first."""
    ekf_doubt_s: float = 0.0
    pilot_deflection: float = 0.0
    rebooted: bool = False
    leaking: bool = False
    failsafe_surfaces: bool = False
    """Whether a failsafe changed the mode to SURFACE: mode and failsafe came with the same heartbeat."""
    failsafe: bool = False
    """Whether the autopilot reports a failsafe that our steering should have ended."""
    battery_low_s: float = 0.0
    saturated_s: float = 0.0
    off_track_s: float = 0.0
    tilted_s: float = 0.0
    innovation_m: float = 0.0
    innovation_deg: float = 0.0
    """Mean absolute innovation: measurement minus prediction."""
    samples_dropped: bool = False
    config_changed: bool = False
    peer_changed: bool = False


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """What one tick observed: the vehicle's state and everything else that the conditions test."""

    state: VehicleState
    mode_right: bool
    """Whether the flight mode is one in which our present state steers or hands over."""
    parameters: Mapping[str, float]
    watched: Watched
    preflight_failure: str = ""
    """The rows of `check` that forbid engaging, in words."""
    wants_position: bool = False
    """Whether x and y are held, or would be with a position."""
    wants_ground: bool = False
    """Whether an altitude over the ground is to be kept."""
    finite: bool = True
    late_s: float = 0.0
    misses_motor: bool = False
    """Whether the others cannot do the work of a motor that gives no thrust."""
    full_override: bool = False
    """Whether the pilot overrides all axes, by stick or button on the ground station's link."""
    pilot_timeout_s: float = math.inf
    """Largest permitted age of the ground station's heartbeat; infinite where none is needed."""
    surface_on_loss: bool = False
    hand_over: HandOverStep = HandOverStep.NONE
    ramped_down: bool = False
    stop: bool = False
    engage: bool = False
    clear: bool = False


class ConditionSpec(NamedTuple):
    """One condition: its test, the keys of [supervisor] that it uses, and the texts for operators."""

    condition: Condition
    holds: Callable[[Observation, SupervisorLimits], bool]
    keys: tuple[str, ...]
    description: str
    remedy: str


def _link_lost(o: Observation, limits: SupervisorLimits) -> bool:
    ages = o.state.ages
    return not (ages.link_s <= limits.link_timeout_s and ages.heartbeat_s <= limits.heartbeat_timeout_s)


def pilot_failsafe_acts(parameters: Mapping[str, float], limits: SupervisorLimits) -> bool:
    """Tell whether the autopilot stops the thrusters in time when this computer dies."""
    acts = parameters.get("FS_PILOT_INPUT", 0.0) >= 1.0
    return acts and parameters.get("FS_PILOT_TIMEOUT", math.inf) <= limits.max_pilot_timeout_s


def depth_is_fresh(state: VehicleState, limits: SupervisorLimits) -> bool:
    """Tell whether an accepted depth is recent enough."""
    return state.ages.depth_s <= limits.depth_timeout_s


def ekf_is_doubtful(ekf: EkfStatus, limits: SupervisorLimits) -> bool:
    """Tell whether the autopilot's estimator doubts compass, velocity or depth now."""
    return not ekf.variance <= limits.max_ekf_variance


def voltage_is_low(voltage_v: float, limits: SupervisorLimits) -> bool:
    """Tell whether the voltage is below the limit; BATTERY_LOW needs it to last."""
    return voltage_v < limits.min_voltage_v


def _ekf_unhealthy(o: Observation, limits: SupervisorLimits) -> bool:
    ekf = o.watched.ekf
    return not (ekf and ekf.attitude and ekf.depth and o.watched.ekf_doubt_s <= limits.ekf_doubt_s)


def _out_of_bounds(o: Observation, limits: SupervisorLimits) -> bool:
    margin_m = limits.depth_margin_m
    return not -margin_m <= o.state.eta[Z] <= limits.max_depth_m + margin_m


def _innovation_large(o: Observation, limits: SupervisorLimits) -> bool:
    seen = o.watched
    return not (
        seen.innovation_m <= limits.max_innovation_m and seen.innovation_deg <= limits.max_innovation_deg
    )


def tilted(state: VehicleState, limits: SupervisorLimits) -> bool:
    """Tell whether roll or pitch is too large; an unknown attitude counts as too large."""
    most_rad = math.radians(limits.max_tilt_deg)
    return not (abs(state.roll) <= most_rad and abs(state.pitch) <= most_rad)


def _pilot_lost(o: Observation, _: SupervisorLimits) -> bool:
    return not o.state.ages.pilot_s <= o.pilot_timeout_s


# An unknown value counts against permission: hence `not x <= limit`, which is true for NaN.
# If several conditions hold, the operator sees the remedy of the first (`supervisor.remedy`).
CONDITIONS = (
    ConditionSpec(
        C.LINK_LOST,
        _link_lost,
        ("link_timeout_s", "heartbeat_timeout_s"),
        "no message, or no heartbeat, arrived from the autopilot in time",
        "check the cable, the router and link.endpoint",
    ),
    ConditionSpec(
        C.DEPTH_STALE,
        lambda o, limits: not depth_is_fresh(o.state, limits),
        ("depth_timeout_s",),
        "no new, plausible depth arrived in time",
        "check that vehicle.depth_source is streamed and changes",
    ),
    ConditionSpec(
        C.ATTITUDE_STALE,
        lambda o, limits: not o.state.ages.attitude_s <= limits.attitude_timeout_s,
        ("attitude_timeout_s",),
        "no new attitude arrived in time",
        "check that ATTITUDE is streamed",
    ),
    ConditionSpec(
        C.POSITION_STALE,
        lambda o, limits: o.wants_position and not o.state.ages.position_s <= limits.position_timeout_s,
        ("position_timeout_s",),
        "x and y are wanted, and no new position arrived in time: they are released to the pilot, or to "
        "neutral, and held again when it returns; depth and heading are held",
        "check the DVL; steer by hand meanwhile",
    ),
    ConditionSpec(
        C.GROUND_LOST,
        lambda o, _: o.wants_ground and not o.state.ground.known,
        (),
        "an altitude over the ground is to be kept, and no plausible echo came for a second: the depth is "
        "held until the ground is found again",
        "check the rangefinder or the DVL; command a depth",
    ),
    ConditionSpec(
        C.DEPTH_JUMPED,
        lambda o, limits: o.state.depth_refused,
        ("max_depth_jump_m",),
        "a depth was too far from the predicted one and was rejected; if this continues, DEPTH STALE follows",
        "check the depth sensor",
    ),
    ConditionSpec(
        C.YAW_RESET,
        lambda o, limits: o.state.ages.yaw_reset_s <= RESET_SETTLE_S,
        (),
        "the autopilot's EKF reset its yaw less than 3 s ago; the heading setpoint was shifted with it, so "
        "the vehicle does not turn",
        "command the heading again if you want another; calibrate the compass if this happens often",
    ),
    ConditionSpec(
        C.POSITION_RESET,
        lambda o, limits: o.state.ages.position_reset_s <= RESET_SETTLE_S,
        (),
        "the autopilot's EKF reset its position less than 3 s ago; the position setpoint was shifted with "
        "it, so the vehicle does not move",
        "command the position again if you want another; check the DVL if this happens often",
    ),
    ConditionSpec(
        C.DEPTH_OUT_OF_BOUNDS,
        _out_of_bounds,
        ("max_depth_m", "depth_margin_m"),
        "the measured depth is above the surface, or below max_depth_m, by more than the margin",
        "take over; check the zero of the depth sensor, and max_depth_m",
    ),
    ConditionSpec(
        C.THRUSTER_MISSED,
        lambda o, limits: o.misses_motor,
        (),
        "a motor gives no thrust and the others cannot do its work, such as a vertical one of two; the event "
        "and `dead_motor` give its number",
        "bring the vehicle up, and repair it",
    ),
    ConditionSpec(
        C.THRUSTER_DEAD,
        lambda o, limits: o.state.dead_motor > 0 and not o.misses_motor,
        (),
        "a motor gives no thrust, and the others of its group do its work with less force; the event and "
        "`dead_motor` give its number",
        "go on with care: there is no second one to spare",
    ),
    ConditionSpec(
        C.TILTED,
        lambda o, limits: tilted(o.state, limits),
        ("max_tilt_deg",),
        "roll or pitch is too large: only heave and levelling remain; x, y and heading are released",
        "move slower, avoid the current or turn into it; look for a dead or reversed thruster",
    ),
    ConditionSpec(
        C.TILT_PERSISTS,
        lambda o, limits: not o.watched.tilted_s <= limits.off_track_s,
        ("max_tilt_deg", "off_track_s"),
        "the vehicle stays tilted, and Holdfast cannot level it: the autopilot tries, in STABILIZE and then "
        "ALT_HOLD",
        "look for the cause: an off-centre load, a snagged tether, a dead or reversed thruster",
    ),
    ConditionSpec(
        C.EKF_UNHEALTHY,
        _ekf_unhealthy,
        ("max_ekf_variance", "ekf_doubt_s"),
        "the autopilot's EKF reports no attitude or no depth, or its variance of compass, velocity or depth "
        "has been too high for ekf_doubt_s",
        "wait until the EKF has settled; calibrate the compass, check the depth sensor",
    ),
    ConditionSpec(
        C.LEAK,
        lambda o, limits: o.watched.leaking,
        (),
        "the autopilot reported Leak Detected less than 25 s ago (it repeats this every 20 s)",
        "bring the vehicle up",
    ),
    ConditionSpec(
        C.BATTERY_LOW,
        lambda o, limits: not o.watched.battery_low_s <= limits.battery_low_s,
        ("min_voltage_v", "battery_low_s"),
        "the battery voltage has been too low for battery_low_s",
        "bring the vehicle up",
    ),
    ConditionSpec(
        C.AUTOPILOT_FAILSAFE,
        lambda o, limits: o.watched.failsafe,
        (),
        "the autopilot reports a latched failsafe (system status 5) while Holdfast steers",
        "read the autopilot's messages",
    ),
    ConditionSpec(
        C.FAILSAFE_SURFACES,
        lambda o, limits: o.watched.failsafe_surfaces and not o.mode_right,
        (),
        "a failsafe of the autopilot (leak, battery) changed the flight mode to SURFACE",
        "read the autopilot's messages",
    ),
    ConditionSpec(
        C.REBOOTED,
        lambda o, limits: o.watched.rebooted,
        (),
        "the autopilot's clock went backwards: it has rebooted",
        "find the cause, such as the power supply",
    ),
    ConditionSpec(
        C.FAILSAFE_UNSAFE,
        lambda o, limits: not pilot_failsafe_acts(o.parameters, limits),
        ("max_pilot_timeout_s",),
        "FS_PILOT_INPUT is 0 or unknown, or FS_PILOT_TIMEOUT is too long: nothing would stop the thrusters "
        "if this computer failed",
        "set FS_PILOT_INPUT to 2",
    ),
    ConditionSpec(
        C.PREFLIGHT_FAILURE,
        lambda o, limits: bool(o.preflight_failure),
        (),
        "a row of the pre-dive list is refused (such as frame, steering id, InputHold); the reason names it",
        "run `holdfast check`: it says how to fix it",
    ),
    ConditionSpec(
        C.SATURATED,
        lambda o, limits: not o.watched.saturated_s <= limits.saturated_s,
        ("saturated_s",),
        "an axis has been saturated for saturated_s: the vehicle may drift away",
        "avoid the current, slow the path down, or raise max_force",
    ),
    ConditionSpec(
        C.OFF_TRACK,
        lambda o, limits: not o.watched.off_track_s <= limits.off_track_s,
        ("max_error_m", "max_error_deg", "off_track_s"),
        "the vehicle is too far from its reference, and has been for off_track_s",
        "look for the cause: tether, current, a dead thruster",
    ),
    ConditionSpec(
        C.DELAY_TOO_LONG,
        lambda o, limits: not o.state.delays.total_s <= limits.max_delay_s,
        ("max_delay_s",),
        "the delays of telemetry and commands together are too long for any gains",
        "reduce the load of the link; run Holdfast on the vehicle instead of topside",
    ),
    ConditionSpec(
        C.CLOCK_JUMPED,
        lambda o, limits: not o.state.clock_doubt_s <= 0.0,
        (),
        "a time stamp or an answer to TIMESYNC contradicts the estimated clock offset",
        "nothing if it happens once; if it continues, look for a second autopilot with this system id",
    ),
    ConditionSpec(
        C.CLOCK_INCONSISTENT,
        lambda o, limits: not o.state.clock_doubt_s <= CLOCK_DOUBT_S,
        (),
        f"time stamps and answers to TIMESYNC have contradicted each other for {CLOCK_DOUBT_S:g} s",
        "look for a second autopilot with this system id on the link, or a router that changes TIMESYNC",
    ),
    ConditionSpec(
        C.INNOVATION_LARGE,
        _innovation_large,
        ("max_innovation_m", "max_innovation_deg"),
        "in a held degree of freedom measurements keep missing the prediction: sensor, model or clock fails",
        "check the noise of depth and heading, and the delays",
    ),
    ConditionSpec(
        C.NON_FINITE,
        lambda o, limits: not o.finite,
        (),
        "a computed value was not finite: a bug",
        "keep the recording and report it to us",
    ),
    ConditionSpec(
        C.TICK_LATE,
        lambda o, limits: not o.late_s <= limits.late_tick_s,
        ("late_tick_s",),
        "a tick of this process was too late",
        "reduce the load of this computer",
    ),
    ConditionSpec(
        C.QUEUE_FULL,
        lambda o, limits: o.watched.samples_dropped,
        (),
        "telemetry was dropped because Zenoh did not take it in time",
        "check the subscribers; control is not affected",
    ),
    ConditionSpec(
        C.CONFIG_CHANGED,
        lambda o, limits: o.watched.config_changed,
        (),
        "the configuration or a parameter of the autopilot changed less than 2 s ago",
        "nothing if you changed it; else find out who did",
    ),
    ConditionSpec(
        C.PEER_CHANGED,
        lambda o, limits: o.watched.peer_changed,
        (),
        "a listening link accepted another peer less than 2 s ago: the one before had fallen silent",
        "nothing if you changed it; else list addresses in link.allow or ground_station.allow, or set a "
        "signing key",
    ),
    ConditionSpec(
        C.PILOT_TAKEOVER,
        lambda o, limits: o.full_override or not o.watched.pilot_deflection <= limits.pilot_deflection,
        ("pilot_deflection", "pilot_hold_s"),
        "somebody else moves a stick, or the pilot overrides all axes",
        "release the stick; engage again",
    ),
    ConditionSpec(
        C.PILOT_LOST,
        _pilot_lost,
        (),
        "no heartbeat arrived from the ground station for ground_station.timeout_s",
        "check the tether and the ground station; when it returns, its sticks take effect at once",
    ),
    ConditionSpec(
        C.PILOT_LOST_SURFACE,
        lambda o, limits: o.surface_on_loss and _pilot_lost(o, limits),
        (),
        'as PILOT LOST, and ground_station.on_loss is "surface"',
        "as PILOT LOST",
    ),
    ConditionSpec(
        C.DISARMED,
        lambda o, limits: not o.state.armed,
        (),
        "the motors are disarmed",
        "arm the vehicle",
    ),
    ConditionSpec(
        C.WRONG_MODE,
        lambda o, limits: not o.mode_right,
        (),
        "the flight mode is not vehicle.steering_mode",
        "engage: Holdfast then requests the mode",
    ),
    ConditionSpec(
        C.RAMPED_DOWN,
        lambda o, limits: o.ramped_down,
        ("ramp_down_s",),
        "the authority has reached 0",
        "nothing",
    ),
    ConditionSpec(
        C.HANDED_OVER,
        lambda o, limits: o.hand_over is HandOverStep.DONE,
        ("keep_alt_hold_s",),
        "the autopilot holds depth in ALT_HOLD, and a pilot steers or `keep_alt_hold_s` has passed",
        "nothing",
    ),
    ConditionSpec(
        C.SURFACED,
        lambda o, limits: o.hand_over is HandOverStep.SURFACED,
        (),
        "the vehicle reached the surface, and the firmware changed from SURFACE to ALT_HOLD",
        "nothing",
    ),
    ConditionSpec(
        C.HAND_OVER_REFUSED,
        lambda o, limits: o.hand_over is HandOverStep.REFUSED,
        (),
        f"the flight mode was not ALT_HOLD {REFUSED_S:g} s after the hand-over began",
        "nothing",
    ),
    ConditionSpec(C.OPERATOR_STOP, lambda o, limits: o.stop, (), "the operator asked to stop", "nothing"),
    ConditionSpec(C.ENGAGE_ASKED, lambda o, limits: o.engage, (), "the operator asked to engage", "nothing"),
    ConditionSpec(C.CLEAR_ASKED, lambda o, limits: o.clear, (), "the operator cleared the fault", "nothing"),
)

_TESTS = tuple((spec.condition.value, spec.holds) for spec in CONDITIONS)


def assess(seen: Observation, limits: SupervisorLimits) -> Condition:
    """Return the conditions that hold this tick; an unknown value counts against permission."""
    return Condition(sum([bit for bit, holds in _TESTS if holds(seen, limits)]))
