"""When each condition of the supervisor holds; `companion.telemetry.conditions` has its words."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import msgspec

from companion.config import SupervisorLimits
from companion.records import Condition, EkfStatus, VehicleState, Z
from companion.supervision.handover import HandOverStep

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


class ConditionTest(NamedTuple):
    """When a condition holds, and the keys of [supervisor] that decide."""

    holds: Callable[[Observation, SupervisorLimits], bool]
    keys: tuple[str, ...] = ()


def _link_lost(o: Observation, limits: SupervisorLimits) -> bool:
    ages = o.state.ages
    if not (ages.link_s <= limits.link_timeout_s and ages.heartbeat_s <= limits.heartbeat_timeout_s):
        return True
    # Depth and attitude time out sooner; where nothing else came meanwhile either, the link is the cause. A
    # hand-over needs neither of them, and goes on for the link's own timeout.
    blind = not (depth_is_fresh(o.state, limits) and ages.attitude_s <= limits.attitude_timeout_s)
    silent_s = 0.5 * min(limits.depth_timeout_s, limits.attitude_timeout_s)
    return blind and o.hand_over is HandOverStep.NONE and not ages.link_s <= silent_s


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
TESTS: dict[Condition, ConditionTest] = {
    C.LINK_LOST: ConditionTest(
        _link_lost, ("link_timeout_s", "heartbeat_timeout_s", "depth_timeout_s", "attitude_timeout_s")
    ),
    C.REBOOTED: ConditionTest(lambda o, limits: o.watched.rebooted),
    C.TICK_LATE: ConditionTest(lambda o, limits: not o.late_s <= limits.late_tick_s, ("late_tick_s",)),
    C.NON_FINITE: ConditionTest(lambda o, limits: not o.finite),
    C.CLOCK_INCONSISTENT: ConditionTest(lambda o, limits: not o.state.clock_doubt_s <= CLOCK_DOUBT_S),
    C.DELAY_TOO_LONG: ConditionTest(
        lambda o, limits: not o.state.delays.total_s <= limits.max_delay_s, ("max_delay_s",)
    ),
    C.DEPTH_JUMPED: ConditionTest(lambda o, limits: o.state.depth_refused, ("max_depth_jump_m",)),
    C.DEPTH_STALE: ConditionTest(lambda o, limits: not depth_is_fresh(o.state, limits), ("depth_timeout_s",)),
    C.ATTITUDE_STALE: ConditionTest(
        lambda o, limits: not o.state.ages.attitude_s <= limits.attitude_timeout_s, ("attitude_timeout_s",)
    ),
    C.POSITION_STALE: ConditionTest(
        lambda o, limits: o.wants_position and not o.state.ages.position_s <= limits.position_timeout_s,
        ("position_timeout_s",),
    ),
    C.GROUND_LOST: ConditionTest(lambda o, _: o.wants_ground and not o.state.ground.known),
    C.YAW_RESET: ConditionTest(lambda o, limits: o.state.ages.yaw_reset_s <= RESET_SETTLE_S),
    C.POSITION_RESET: ConditionTest(lambda o, limits: o.state.ages.position_reset_s <= RESET_SETTLE_S),
    C.DEPTH_OUT_OF_BOUNDS: ConditionTest(_out_of_bounds, ("max_depth_m", "depth_margin_m")),
    C.THRUSTER_MISSED: ConditionTest(lambda o, limits: o.misses_motor),
    C.THRUSTER_DEAD: ConditionTest(lambda o, limits: o.state.dead_motor > 0 and not o.misses_motor),
    C.TILTED: ConditionTest(lambda o, limits: tilted(o.state, limits), ("max_tilt_deg",)),
    C.TILT_PERSISTS: ConditionTest(
        lambda o, limits: not o.watched.tilted_s <= limits.off_track_s, ("max_tilt_deg", "off_track_s")
    ),
    C.EKF_UNHEALTHY: ConditionTest(_ekf_unhealthy, ("max_ekf_variance", "ekf_doubt_s")),
    C.LEAK: ConditionTest(lambda o, limits: o.watched.leaking),
    C.BATTERY_LOW: ConditionTest(
        lambda o, limits: not o.watched.battery_low_s <= limits.battery_low_s,
        ("min_voltage_v", "battery_low_s"),
    ),
    C.AUTOPILOT_FAILSAFE: ConditionTest(lambda o, limits: o.watched.failsafe),
    C.FAILSAFE_SURFACES: ConditionTest(lambda o, limits: o.watched.failsafe_surfaces and not o.mode_right),
    C.FAILSAFE_UNSAFE: ConditionTest(
        lambda o, limits: not pilot_failsafe_acts(o.parameters, limits), ("max_pilot_timeout_s",)
    ),
    C.PREFLIGHT_FAILURE: ConditionTest(lambda o, limits: bool(o.preflight_failure)),
    C.SATURATED: ConditionTest(
        lambda o, limits: not o.watched.saturated_s <= limits.saturated_s, ("saturated_s",)
    ),
    C.OFF_TRACK: ConditionTest(
        lambda o, limits: not o.watched.off_track_s <= limits.off_track_s,
        ("max_error_m", "max_error_deg", "off_track_s"),
    ),
    C.CLOCK_JUMPED: ConditionTest(lambda o, limits: not o.state.clock_doubt_s <= 0.0),
    C.INNOVATION_LARGE: ConditionTest(_innovation_large, ("max_innovation_m", "max_innovation_deg")),
    C.QUEUE_FULL: ConditionTest(lambda o, limits: o.watched.samples_dropped),
    C.CONFIG_CHANGED: ConditionTest(lambda o, limits: o.watched.config_changed),
    C.PEER_CHANGED: ConditionTest(lambda o, limits: o.watched.peer_changed),
    C.PILOT_TAKEOVER: ConditionTest(
        lambda o, limits: o.full_override or not o.watched.pilot_deflection <= limits.pilot_deflection,
        ("pilot_deflection", "pilot_hold_s"),
    ),
    C.PILOT_LOST: ConditionTest(_pilot_lost),
    C.PILOT_LOST_SURFACE: ConditionTest(lambda o, limits: o.surface_on_loss and _pilot_lost(o, limits)),
    C.DISARMED: ConditionTest(lambda o, limits: not o.state.armed),
    C.WRONG_MODE: ConditionTest(lambda o, limits: not o.mode_right),
    C.RAMPED_DOWN: ConditionTest(lambda o, limits: o.ramped_down, ("ramp_down_s",)),
    C.HAND_OVER_HELD: ConditionTest(lambda o, limits: o.hand_over is HandOverStep.HELD),
    C.HANDED_OVER: ConditionTest(lambda o, limits: o.hand_over is HandOverStep.DONE, ("keep_alt_hold_s",)),
    C.SURFACED: ConditionTest(lambda o, limits: o.hand_over is HandOverStep.SURFACED),
    C.HAND_OVER_REFUSED: ConditionTest(lambda o, limits: o.hand_over is HandOverStep.REFUSED),
    C.OPERATOR_STOP: ConditionTest(lambda o, limits: o.stop),
    C.ENGAGE_ASKED: ConditionTest(lambda o, limits: o.engage),
    C.CLEAR_ASKED: ConditionTest(lambda o, limits: o.clear),
}

_HOLDS = tuple((condition.value, test.holds) for condition, test in TESTS.items())


def assess(seen: Observation, limits: SupervisorLimits) -> Condition:
    """Return the conditions that hold this tick; an unknown value counts against permission."""
    return Condition(sum([bit for bit, holds in _HOLDS if holds(seen, limits)]))
