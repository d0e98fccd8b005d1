"""What the conditions test: what one tick observed, and what takes time to observe."""

import math
from collections.abc import Mapping, Sequence

import msgspec

from companion.config import GroundStation, SupervisorLimits
from companion.records import (
    LEVEL,
    Angles,
    Dofs,
    EkfStatus,
    Event,
    Flags,
    LoopHealth,
    Request,
    VehicleState,
)
from companion.supervision.handover import HandOverStep
from companion.telemetry.glossary import NO_DETAILS, Details

UPSIDE_DOWN_COS = math.cos(math.radians(100.0))
"""A vehicle with two dead motors swings between 60 and 104° and holds its depth: it is not turned over."""


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """What the engine observed in one tick."""

    state: VehicleState
    dt_s: float
    loop: LoopHealth
    held: Flags
    """The degrees of freedom that are held, or while nothing is those that would be."""
    angles: Angles = LEVEL
    events: Sequence[Event] = ()
    requests: Sequence[Request] = ()
    awaits_position: bool = False
    """This and the three next: as guidance has them."""
    offers_position: bool = False
    wants_ground: bool = False
    doubts_range: bool = False
    dofs: Dofs | None = None
    finite: bool = True
    """Whether all that the last tick computed was finite."""
    misses_motor: bool = False
    """Whether the other motors cannot replace one that gives no thrust."""
    full_override: bool = False
    """Whether the pilot overrides all axes, by stick or button on the ground station's link."""
    details: Details = NO_DETAILS
    """For PREFLIGHT_FAILURE the rows of `check` that forbid engaging; for LINK_LOST what arrives instead."""


class Watched(msgspec.Struct, kw_only=True):
    """What takes time to observe (`monitor.py`): how long something lasted, what was reported recently."""

    ekf: EkfStatus | None = None
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
    """Time in saturation minus half of the time out of it."""
    pull_n: float = 0.0
    """The largest disturbance of that time, along what is saturated."""
    unanswered_s: float = 0.0
    """Time of full vertical thrust, minus half of the time without it, since the depth last changed."""
    off_track_s: float = 0.0
    tilted_s: float = 0.0
    """Too far from its angle, and from its depth."""
    upside_down_s: float = 0.0
    """Time upside down minus a quarter of the time upright, while we or the autopilot steer."""
    other_first: bool = False
    other_came: bool = False
    """Whether another Holdfast with our ids was there first, or does not release it; or came later."""
    listened: bool = True
    """Whether our contact has lasted long enough for another Holdfast to be heard."""
    lost_s: float = 0.0
    """Authority that interruptions took recently, in seconds of full authority."""
    interruption: str = ""
    """The last one, in words."""
    unsteady: bool = False
    innovation_m: float = 0.0
    innovation_deg: float = 0.0
    """Mean absolute innovation: measurement minus prediction."""
    samples_dropped: bool = False
    config_changed: bool = False
    peer_changed: bool = False


class Situation(msgspec.Struct, frozen=True, kw_only=True):
    """What the conditions test: the observation, and what the supervision knows beside it."""

    observed: Observation
    state: VehicleState
    """What is believed of the vehicle."""
    watched: Watched
    parameters: Mapping[str, float]
    ground_station: GroundStation
    tick_s: float
    mode_right: bool
    """Whether the flight mode is one in which our present state steers or hands over."""
    active: bool = False
    steered: bool = False
    """Whether the last tick was ACTIVE, and carried authority."""
    hand_over: HandOverStep = HandOverStep.NONE
    ramped_down: bool = False
    engage: bool = False
    """Whether engaging is requested, and confirmed by the autopilot's failsafe."""


def pilot_failsafe_acts(parameters: Mapping[str, float], limits: SupervisorLimits) -> bool:
    """Tell whether the autopilot stops the thrusters in time when this computer dies."""
    acts = parameters.get("FS_PILOT_INPUT", 0.0) >= 1.0
    return acts and parameters.get("FS_PILOT_TIMEOUT", math.inf) <= limits.max_pilot_timeout_s


def depth_is_fresh(state: VehicleState, limits: SupervisorLimits) -> bool:
    """Tell whether an accepted depth is recent enough."""
    return state.ages.depth_s <= limits.depth_timeout_s


def interruption(observed: Observation, limits: SupervisorLimits, tick_s: float) -> str:
    """Return, in words, that a tick is too late, or depth or attitude too old to steer by; empty if not."""
    ages, late_s = observed.state.ages, observed.dt_s - tick_s
    if not late_s <= limits.late_tick_s:
        return f"a tick was {late_s:.2f} s late"
    if not depth_is_fresh(observed.state, limits):
        return f"no depth for {ages.depth_s:.2f} s"
    return "" if ages.attitude_s <= limits.attitude_timeout_s else f"no attitude for {ages.attitude_s:.2f} s"


def ekf_is_doubtful(ekf: EkfStatus, limits: SupervisorLimits) -> bool:
    """Tell whether the autopilot's estimator doubts compass, velocity or depth now."""
    return not ekf.variance <= limits.max_ekf_variance


def voltage_is_low(voltage_v: float, limits: SupervisorLimits) -> bool:
    """Tell whether the voltage is below the limit; BATTERY_LOW needs it to last."""
    return voltage_v < limits.min_voltage_v


def upside_down(state: VehicleState) -> bool:
    """Tell whether it is tilted by more than 100°; an unknown tilt counts as more."""
    return not math.cos(state.roll) * math.cos(state.pitch) >= UPSIDE_DOWN_COS


def tilted(observed: Observation, limits: SupervisorLimits) -> bool:
    """Tell whether roll or pitch is too far from its held angle; an unknown one counts as too far."""
    state, (roll_d, pitch_d) = observed.state, observed.angles
    most_rad = math.radians(limits.max_tilt_deg)
    return not (abs(state.roll - roll_d) <= most_rad and abs(state.pitch - pitch_d) <= most_rad)
