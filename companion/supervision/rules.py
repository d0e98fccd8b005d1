"""When each condition of the supervisor holds, and what it does; `Condition` itself has its words.

A condition that neither blocks nor warns, and that `TRANSITIONS` does not list, changes nothing.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from companion.config import SupervisorLimits
from companion.records import Condition, Request, State, X, Z
from companion.supervision.handover import HandOverStep
from companion.supervision.situation import Situation, interruption, pilot_failsafe_acts, tilted

C, S = Condition, State
NOTHING = Condition(0)

CLOCK_DOUBT_S = 2.0
"""After one jump the clock contradicts itself until the second answer to TIMESYNC; two clocks always do."""
UNANSWERED_S = 3.0
"""A vehicle that full thrust moves has moved by then, even against a load that nearly takes that thrust."""
UPSIDE_DOWN_S = 2.0
"""A vehicle whose motors push as they are told is upright again by then, even out of a wave."""
RESET_SETTLE_S = 3.0
"""Another reset of the autopilot's estimate may follow within this time."""
SAMPLE_S = 0.1
"""Between two values of the slowest source of depth: a silence of the link looks longer by this."""
MOST_LOST = 0.8
"""What interruptions may take of the authority, times `link_timeout_s`: one that ends in time always fits."""


class Rule(NamedTuple):
    """When a condition holds, and what it does beside transitions.

    It `blocks` engaging, `warns` in ACTIVE, and `freezes` learning there.
    """

    holds: Callable[[Situation, SupervisorLimits], bool]
    blocks: bool = False
    warns: bool = False
    freezes: bool = False


def _bound_s(
    now: Situation, limits: SupervisorLimits, timeout_s: float, allowed_s: float = SAMPLE_S
) -> float:
    """Return the age at which a signal ends control; its timeout is given.

    While ACTIVE it is `link_timeout_s`: until then it is INTERRUPTED.
    """
    return max(timeout_s, limits.link_timeout_s + allowed_s) if now.active else timeout_s


def _depth_stale(now: Situation, limits: SupervisorLimits) -> bool:
    state, timeout_s = now.state, limits.depth_timeout_s
    if not state.depth_refused:  # a depth that jumped is no silence
        timeout_s = _bound_s(now, limits, timeout_s)
    return not state.ages.depth_s <= timeout_s


def _attitude_stale(now: Situation, limits: SupervisorLimits) -> bool:
    return not now.state.ages.attitude_s <= _bound_s(now, limits, limits.attitude_timeout_s)


def _tick_late(now: Situation, limits: SupervisorLimits) -> bool:
    return not now.observed.dt_s - now.tick_s <= _bound_s(now, limits, limits.late_tick_s, allowed_s=0.0)


def _link_lost(now: Situation, limits: SupervisorLimits) -> bool:
    ages = now.state.ages
    if not (ages.link_s <= limits.link_timeout_s and ages.heartbeat_s <= limits.heartbeat_timeout_s):
        return True
    # Depth and attitude time out sooner; where nothing else came meanwhile either, the link is the cause. A
    # hand-over needs neither of them, and goes on for the link's own timeout.
    silent_s = 0.5 * min(limits.depth_timeout_s, limits.attitude_timeout_s)
    if ages.link_s <= silent_s or now.hand_over is not HandOverStep.NONE:
        return False
    return _depth_stale(now, limits) or _attitude_stale(now, limits)


def _wants_position(now: Situation) -> bool:
    return now.steered and (now.observed.held[X] or now.observed.awaits_position)


def _position_stale(now: Situation, limits: SupervisorLimits) -> bool:
    return _wants_position(now) and not now.state.ages.position_s <= limits.position_timeout_s


def _ground_lost(now: Situation, _: SupervisorLimits) -> bool:
    return now.steered and now.observed.wants_ground and not now.state.ground.known


def _out_of_bounds(now: Situation, limits: SupervisorLimits) -> bool:
    margin_m = limits.depth_margin_m
    return not -margin_m <= now.state.eta[Z] <= limits.max_depth_m + margin_m


def _ekf_unhealthy(now: Situation, limits: SupervisorLimits) -> bool:
    ekf = now.watched.ekf
    return not (ekf and ekf.attitude and ekf.depth and now.watched.ekf_doubt_s <= limits.ekf_doubt_s)


def _innovation_large(now: Situation, limits: SupervisorLimits) -> bool:
    metres, degrees = now.watched.innovation_m, now.watched.innovation_deg
    return not (metres <= limits.max_innovation_m and degrees <= limits.max_innovation_deg)


def _pilot_lost(now: Situation, _: SupervisorLimits) -> bool:
    ground = now.ground_station
    needed = ground.endpoint and ground.on_loss != "hold"
    return not now.state.ages.pilot_s <= (ground.timeout_s if needed else math.inf)


def _pilot_takes_over(now: Situation, limits: SupervisorLimits) -> bool:
    return now.observed.full_override or not now.watched.pilot_deflection <= limits.pilot_deflection


# An unknown value counts against permission: hence `not x <= limit`, which is true for NaN.
RULES: dict[Condition, Rule] = {
    C.LINK_LOST: Rule(_link_lost, blocks=True),
    C.REBOOTED: Rule(lambda now, _: now.watched.rebooted, blocks=True),
    C.TICK_LATE: Rule(_tick_late, blocks=True),
    C.OTHER_FIRST: Rule(lambda now, _: now.watched.other_first, blocks=True),
    C.OTHER_CAME: Rule(lambda now, _: now.watched.other_came, warns=True),
    C.INTERRUPTED: Rule(
        lambda now, limits: now.active and bool(interruption(now.observed, limits, now.tick_s))
    ),
    C.INTERRUPTED_OFTEN: Rule(
        lambda now, limits: not now.watched.lost_s <= MOST_LOST * limits.link_timeout_s
    ),
    C.UNSTEADY: Rule(lambda now, _: now.watched.unsteady, warns=True),
    C.NON_FINITE: Rule(lambda now, _: not now.observed.finite, blocks=True),
    C.CLOCK_INCONSISTENT: Rule(lambda now, _: not now.state.clock_doubt_s <= CLOCK_DOUBT_S, blocks=True),
    C.DELAY_TOO_LONG: Rule(
        lambda now, limits: not now.state.delays.total_s <= limits.max_delay_s, blocks=True
    ),
    C.DEPTH_JUMPED: Rule(lambda now, _: now.state.depth_refused, blocks=True, warns=True, freezes=True),
    C.DEPTH_DOUBTED: Rule(lambda now, _: now.state.depth_doubt != "", blocks=True, warns=True, freezes=True),
    C.DEPTH_STALE: Rule(_depth_stale, blocks=True),
    C.ATTITUDE_DOUBTED: Rule(
        lambda now, _: now.state.attitude_doubt != "", blocks=True, warns=True, freezes=True
    ),
    C.ATTITUDE_STALE: Rule(_attitude_stale, blocks=True),
    C.POSITION_DOUBTED: Rule(
        lambda now, _: now.state.position_doubt != "" and _wants_position(now), warns=True
    ),
    C.POSITION_STALE: Rule(_position_stale, warns=True),
    C.POSITION_UNUSED: Rule(lambda now, _: now.observed.offers_position, warns=True),
    C.GROUND_LOST: Rule(_ground_lost, warns=True),
    C.GROUND_DOUBTED: Rule(lambda now, _: now.steered and now.observed.doubts_range, warns=True),
    C.YAW_RESET: Rule(lambda now, _: now.state.ages.yaw_reset_s <= RESET_SETTLE_S, warns=True),
    C.POSITION_RESET: Rule(lambda now, _: now.state.ages.position_reset_s <= RESET_SETTLE_S, warns=True),
    C.DEPTH_RESET: Rule(lambda now, _: now.state.ages.depth_reset_s <= RESET_SETTLE_S, warns=True),
    C.HEADING_WRONG: Rule(lambda now, _: now.state.heading_check.doubtful, warns=True),
    C.DEPTH_OUT_OF_BOUNDS: Rule(_out_of_bounds, blocks=True),
    C.THRUSTER_MISSED: Rule(lambda now, _: now.observed.misses_motor, blocks=True),
    C.THRUSTER_DEAD: Rule(
        lambda now, _: now.state.dead_motor > 0 and not now.observed.misses_motor, warns=True
    ),
    C.THRUSTER_REVERSED: Rule(lambda now, _: now.state.reversed_motor > 0, warns=True),
    C.TURNED_OVER: Rule(lambda now, _: not now.watched.upside_down_s <= UPSIDE_DOWN_S),
    C.TILTED: Rule(lambda now, limits: tilted(now.observed, limits), blocks=True, warns=True, freezes=True),
    C.TILT_PERSISTS: Rule(lambda now, limits: not now.watched.tilted_s <= limits.off_track_s),
    C.EKF_UNHEALTHY: Rule(_ekf_unhealthy, blocks=True),
    C.LEAK: Rule(lambda now, _: now.watched.leaking, blocks=True),
    C.BATTERY_LOW: Rule(
        lambda now, limits: not now.watched.battery_low_s <= limits.battery_low_s, blocks=True, warns=True
    ),
    C.AUTOPILOT_FAILSAFE: Rule(lambda now, _: now.watched.failsafe),
    C.FAILSAFE_SURFACES: Rule(lambda now, _: now.watched.failsafe_surfaces and not now.mode_right),
    C.FAILSAFE_UNSAFE: Rule(lambda now, limits: not pilot_failsafe_acts(now.parameters, limits), blocks=True),
    C.PREFLIGHT_FAILURE: Rule(lambda now, _: C.PREFLIGHT_FAILURE in now.observed.details, blocks=True),
    C.SATURATED: Rule(
        lambda now, limits: not now.watched.saturated_s <= limits.saturated_s, warns=True, freezes=True
    ),
    C.THRUST_UNANSWERED: Rule(lambda now, _: not now.watched.unanswered_s <= UNANSWERED_S),
    C.THRUST_OPPOSED: Rule(lambda now, _: now.state.heave_opposed),
    C.OFF_TRACK: Rule(lambda now, limits: not now.watched.off_track_s <= limits.off_track_s),
    C.CLOCK_JUMPED: Rule(lambda now, _: not now.state.clock_doubt_s <= 0.0, warns=True, freezes=True),
    C.INNOVATION_LARGE: Rule(_innovation_large, blocks=True),
    C.QUEUE_FULL: Rule(lambda now, _: now.watched.samples_dropped, warns=True),
    C.CONFIG_CHANGED: Rule(lambda now, _: now.watched.config_changed, warns=True),
    C.PEER_CHANGED: Rule(lambda now, _: now.watched.peer_changed, warns=True),
    C.PILOT_TAKEOVER: Rule(_pilot_takes_over),
    C.PILOT_LOST: Rule(_pilot_lost, blocks=True),
    C.PILOT_LOST_SURFACE: Rule(
        lambda now, limits: now.ground_station.on_loss == "surface" and _pilot_lost(now, limits)
    ),
    C.DISARMED: Rule(lambda now, _: not now.state.armed, blocks=True),
    C.WRONG_MODE: Rule(lambda now, _: not now.mode_right, blocks=True),
    C.RAMPED_DOWN: Rule(lambda now, _: now.ramped_down),
    C.HAND_OVER_HELD: Rule(lambda now, _: now.hand_over is HandOverStep.HELD),
    C.HANDED_OVER: Rule(lambda now, _: now.hand_over is HandOverStep.DONE),
    C.SURFACED: Rule(lambda now, _: now.hand_over is HandOverStep.SURFACED),
    C.HAND_OVER_REFUSED: Rule(lambda now, _: now.hand_over is HandOverStep.REFUSED),
    C.OPERATOR_STOP: Rule(lambda now, _: Request.STOP in now.observed.requests),
    C.ENGAGE_ASKED: Rule(lambda now, _: now.engage and now.watched.listened),
    C.CLEAR_ASKED: Rule(lambda now, _: Request.CLEAR_FAULT in now.observed.requests),
}

BLOCKING = Condition(sum(condition for condition, rule in RULES.items() if rule.blocks))
WARNS = Condition(sum(condition for condition, rule in RULES.items() if rule.warns))
FREEZES = Condition(sum(condition for condition, rule in RULES.items() if rule.freezes))

_HOLDS = tuple((condition.value, rule.holds) for condition, rule in RULES.items())


def assess(now: Situation, limits: SupervisorLimits) -> Condition:
    """Return the conditions that hold this tick; an unknown value counts against permission."""
    return Condition(sum([bit for bit, holds in _HOLDS if holds(now, limits)]))


class Transition(NamedTuple):
    """In state `at`: go `to` if any bit of `when` is set (or `when` is empty) and no bit of `unless` is."""

    at: State
    when: Condition
    unless: Condition
    to: State
    words: str = ""

    @property
    def because(self) -> str:
        """Why, in words: those of the condition where the row has none of its own."""
        return self.words or self.when.text


T = Transition


def _from(at: State, *ways: tuple[State, *tuple[Condition, ...]]) -> Iterator[Transition]:
    """Give the rows of a state: where it goes, and by which conditions."""
    return (T(at, condition, NOTHING, to) for to, *conditions in ways for condition in conditions)


# The first row that matches is taken, one row a tick.
TRANSITIONS = (
    *_from(S.IDLE, (S.FAULT, C.NON_FINITE)),
    T(S.IDLE, NOTHING, BLOCKING, S.READY, "all conditions for engaging are met"),
    *_from(S.READY, (S.FAULT, C.NON_FINITE)),
    T(S.READY, BLOCKING, NOTHING, S.IDLE, "a condition for engaging is not met"),
    T(S.READY, C.ENGAGE_ASKED, C.PILOT_TAKEOVER | C.OPERATOR_STOP, S.ACTIVE, "engaged"),
    *_from(
        S.ACTIVE,
        (S.FAULT, C.NON_FINITE, C.LINK_LOST, C.REBOOTED, C.DEPTH_STALE, C.ATTITUDE_STALE),
        (S.IDLE, C.DISARMED),
        (S.FAULT, C.TURNED_OVER),
        (S.HAND_OVER, C.FAILSAFE_SURFACES),
        (S.PILOT, C.WRONG_MODE, C.PILOT_TAKEOVER),
        (S.RAMP_DOWN, C.OTHER_FIRST, C.FAILSAFE_UNSAFE, C.PREFLIGHT_FAILURE),
        (S.RAMP_DOWN, C.EKF_UNHEALTHY, C.DEPTH_OUT_OF_BOUNDS, C.TICK_LATE),
        (S.HAND_OVER, C.LEAK),
        (S.RAMP_DOWN, C.AUTOPILOT_FAILSAFE),
        (S.HAND_OVER, C.PILOT_LOST_SURFACE),
        (S.RAMP_DOWN, C.PILOT_LOST, C.OPERATOR_STOP, C.THRUST_UNANSWERED, C.THRUST_OPPOSED),
        (S.HAND_OVER, C.INTERRUPTED_OFTEN, C.DELAY_TOO_LONG, C.CLOCK_INCONSISTENT, C.INNOVATION_LARGE),
        (S.HAND_OVER, C.THRUSTER_MISSED),
    ),
    # The autopilot does not know of a reversed motor: its modes would turn the vehicle over.
    T(S.ACTIVE, C.TILT_PERSISTS, C.THRUSTER_REVERSED, S.HAND_OVER),
    T(S.ACTIVE, C.OFF_TRACK, C.THRUSTER_REVERSED, S.HAND_OVER),
    *_from(S.ACTIVE, (S.RAMP_DOWN, C.TILT_PERSISTS, C.OFF_TRACK)),
    *_from(
        S.RAMP_DOWN,
        (S.FAULT, C.NON_FINITE, C.LINK_LOST, C.REBOOTED, C.DEPTH_STALE, C.ATTITUDE_STALE),
        (S.HAND_OVER, C.FAILSAFE_SURFACES),
        (S.PILOT, C.WRONG_MODE, C.PILOT_TAKEOVER),
        (S.IDLE, C.DISARMED, C.RAMPED_DOWN),
    ),
    *_from(
        S.HAND_OVER,
        (S.FAULT, C.NON_FINITE, C.LINK_LOST, C.REBOOTED, C.TURNED_OVER),
        (S.HAND_OVER, C.FAILSAFE_SURFACES),
        (S.PILOT, C.WRONG_MODE, C.PILOT_TAKEOVER),
        (S.IDLE, C.DISARMED),
        (S.PILOT, C.OPERATOR_STOP),
        (S.FAULT, C.HAND_OVER_REFUSED),
        (S.PILOT, C.HANDED_OVER),
        (S.HAND_OVER, C.SURFACED, C.HAND_OVER_HELD),
    ),
    *_from(S.PILOT, (S.FAULT, C.NON_FINITE)),
    T(S.PILOT, C.ENGAGE_ASKED, C.PILOT_TAKEOVER, S.IDLE),
    T(S.FAULT, C.CLEAR_ASKED, C.NON_FINITE, S.IDLE),
)
