"""What lasts, and what was said a while ago."""

from math import nan, pi, radians
from typing import Any

import numpy as np
import pytest
from builders import RESTING
from msgspec import structs
from test_supervisor import LIMITS, SAFE

from companion.config import Config
from companion.records import (
    Condition,
    EkfStatus,
    Heartbeat,
    Leak,
    LoopHealth,
    Parameter,
    PilotInput,
    Reboot,
    State,
    Verdict,
)
from companion.supervision.monitor import ANNOUNCED_S, FAILSAFE_SETTLE_S, LEAK_REPEAT_S, Monitor
from companion.supervision.situation import Observation

CONFIG = Config(supervisor=LIMITS)
TICK_S = 1.0 / CONFIG.loop.rate_hz
FULL_N = CONFIG.heave.max_force
ALL = np.ones(4, bool)


class Seen:
    """A watch and its time."""

    def __init__(self):
        self.watch, self.now_s = Monitor(), 100.0

    def step(self, *events, dt_s=TICK_S, dofs=None, state=RESTING, dropped=0, peers=0, **changes):
        self.now_s += dt_s
        parameters, authority = changes.pop("parameters", SAFE), changes.pop("authority", 1.0)
        previous = Verdict(changes.pop("previous", State.ACTIVE), Condition(0), authority, "")
        stamped = [structs.replace(event, t_s=self.now_s) for event in events]
        health = LoopHealth(1, 50.0, 0.0, 0.0, 0, dropped, peer_changes=peers)
        state = structs.replace(state, t_s=self.now_s)
        given: dict[str, Any] = {"held": ALL, "dofs": dofs} | changes
        observed = Observation(state=state, dt_s=dt_s, loop=health, events=stamped, **given)
        return self.watch.step(observed, CONFIG, parameters, previous)

    def later(self, seconds, **changes):
        """After a gap without ticks."""
        return self.step(dt_s=seconds, **changes)


class Dofs:
    def __init__(self, saturated=(False,) * 4, e=(0.0,) * 4, heave_n=0.0):
        self.saturated, self.e, self.tau = np.array(saturated), np.array(e), (0.0, 0.0, heave_n, 0.0)


@pytest.fixture
def seen():
    return Seen()


@pytest.mark.parametrize(
    ("event", "field", "for_s"),
    [(Leak(0.0), "leaking", LEAK_REPEAT_S), (Reboot(0.0), "rebooted", ANNOUNCED_S)],
)
def test_what_was_said_holds_for_its_time(seen, event, field, for_s):
    assert getattr(seen.step(event), field)
    assert getattr(seen.later(for_s - 0.01), field)
    assert not getattr(seen.later(0.02), field)


@pytest.mark.parametrize(("over", "doubt"), [(0.0, False), (0.01, True), (nan, True)])
def test_the_ekf_may_doubt_itself_for_a_moment(seen, over, doubt):
    seen.step(EkfStatus(0.0, True, True, LIMITS.max_ekf_variance + over))
    assert seen.step().ekf_doubt_s == pytest.approx(2 * TICK_S if doubt else 0.0)
    assert seen.step(EkfStatus(0.0, True, True, 0.1)).ekf_doubt_s == 0.0


@pytest.mark.parametrize(("count", "field"), [("peers", "peer_changed"), ("dropped", "samples_dropped")])
def test_what_is_counted_is_reported_for_a_while_each_time(seen, count, field):
    assert not getattr(seen.step(), field)
    assert getattr(seen.step(**{count: 1}), field)
    assert getattr(seen.later(ANNOUNCED_S - 0.01, **{count: 1}), field)
    assert not getattr(seen.later(0.02, **{count: 1}), field)
    assert getattr(seen.step(**{count: 2}), field)


def test_changes_are_reported_reading_is_not_one(seen):
    assert not seen.step(Parameter(0.0, "NEW", 1.0), Parameter(0.0, "FS_PILOT_INPUT", 2.0)).config_changed
    assert seen.step(Parameter(0.0, "FS_PILOT_INPUT", 1.0)).config_changed
    assert seen.later(ANNOUNCED_S - 0.01).config_changed
    assert not seen.later(0.02).config_changed
    seen.watch.config_changed()
    assert seen.step().config_changed
    assert not seen.later(ANNOUNCED_S + 0.01).config_changed


def test_how_long_it_lasts_starts_anew_after_a_break(seen):
    low = structs.replace(RESTING, voltage_v=LIMITS.min_voltage_v - 0.1)
    assert seen.step(state=low).battery_low_s == pytest.approx(TICK_S)
    assert seen.step(state=low).battery_low_s == pytest.approx(2 * TICK_S)
    assert seen.step().battery_low_s == 0.0


def test_off_track_is_counted_back_while_it_is_on_track_and_forgotten_when_nobody_steers(seen):
    """A vehicle that turns round and round is on its heading once in each turn."""
    far = Dofs((False,) * 4, (0.0, 0.0, 0.0, radians(LIMITS.max_error_deg + 1.0)))
    for _ in range(3):
        off_track_s = seen.step(dofs=far).off_track_s
    assert off_track_s == pytest.approx(3 * TICK_S)
    assert seen.step(dofs=Dofs()).off_track_s == pytest.approx(2 * TICK_S)
    assert seen.step(dofs=Dofs(), authority=0.0).off_track_s == 0.0


def test_what_lasts_goes_on_while_telemetry_is_interrupted(seen):
    far = Dofs((False, False, True, False), (0.0, 0.0, LIMITS.max_error_m + 0.1, 0.0))
    tilted = structs.replace(RESTING, roll=radians(LIMITS.max_tilt_deg + 1.0))
    silent = structs.replace(RESTING, ages=structs.replace(RESTING.ages, depth_s=0.51))
    seen.step(state=tilted, dofs=far)
    for authority in (1.0, 0.0, 0.0):
        watched = seen.step(state=silent, dofs=Dofs(), authority=authority)
    assert watched.saturated_s == watched.off_track_s == watched.tilted_s == pytest.approx(4 * TICK_S)
    assert watched.unsteady
    assert watched.interruption == "no depth for 0.51 s"


def test_lost_authority_adds_up_but_not_that_of_engaging(seen):
    seen.step(previous=State.READY, authority=0.0)
    for i in range(round(LIMITS.ramp_up_s / TICK_S)):
        seen.step(authority=i * TICK_S / LIMITS.ramp_up_s)
    began_s = seen.step().lost_s
    assert began_s == pytest.approx(0.0, abs=TICK_S)
    for _ in range(25):
        lost = seen.step(authority=0.6)
    assert lost.lost_s == pytest.approx(began_s + 0.4 * 25 * TICK_S)
    assert seen.later(1.0).lost_s == pytest.approx(began_s + 0.4 * 25 * TICK_S - 0.1)
    assert seen.later(60.0).lost_s == 0.0


def cut_off(seen, share, seconds, **what):
    """Thrust that is cut off for this share of each wave of 5 s, against 60 N."""
    state = structs.replace(RESTING, disturbance=(60.0, 0.0, 90.0, 0.0))
    for tick in range(round(seconds / TICK_S)):
        full = tick * TICK_S % 5.0 < 5.0 * share
        seen.step(state=state, dofs=Dofs((full, full, False, False)), **what)
    return seen.watch.watched


def test_thrust_that_is_cut_off_in_each_wave_is_not_enough_and_what_pulls_then_is_known(seen):
    assert cut_off(seen, 0.2, 60.0).saturated_s < LIMITS.saturated_s
    watched = cut_off(seen, 0.5, 30.0)
    assert watched.saturated_s > LIMITS.saturated_s
    assert watched.pull_n == 60.0
    assert cut_off(seen, 0.0, 20.0).saturated_s == watched.pull_n == 0.0
    assert cut_off(seen, 1.0, 9.0, held=~ALL).saturated_s == 0.0


def at_depth(z_m):
    return structs.replace(RESTING, eta=(*RESTING.eta[:2], z_m, RESTING.eta[3]))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_full_vertical_thrust_that_moves_nothing_is_counted(seen, way):
    push = Dofs(heave_n=way * FULL_N)
    for _ in range(11):
        unanswered_s = seen.step(dofs=push).unanswered_s
    assert unanswered_s == pytest.approx(11 * TICK_S)
    assert seen.step(dofs=Dofs()).unanswered_s == pytest.approx(unanswered_s - 0.5 * TICK_S)
    assert seen.step(dofs=push, state=at_depth(RESTING.eta[2] + 0.06)).unanswered_s <= TICK_S
    assert seen.step(dofs=push, authority=0.0).unanswered_s == 0.0


@pytest.mark.parametrize(
    ("dofs", "held"),
    [
        (Dofs(heave_n=0.9 * FULL_N), ALL),
        (Dofs(heave_n=FULL_N), np.array([True, True, False, True])),
        (Dofs(heave_n=nan), ALL),
    ],
)
def test_less_thrust_or_a_depth_that_is_not_held_does_not_count(seen, dofs, held):
    for _ in range(10):
        assert seen.step(dofs=dofs, held=held).unanswered_s == 0.0


def test_a_tilted_vehicle_does_not_get_the_thrust_that_is_asked(seen):
    for _ in range(10):
        over = structs.replace(RESTING, roll=radians(70.0))
        assert seen.step(dofs=Dofs(heave_n=FULL_N), state=over).unanswered_s == 0.0


def test_a_vehicle_that_full_thrust_moves_is_answered(seen):
    for step in range(200):
        watched = seen.step(dofs=Dofs(heave_n=FULL_N), state=at_depth(3.0 + 0.03 * step * TICK_S))
        assert watched.unanswered_s < 2.0


def test_a_vehicle_that_turns_over_and_over_is_level_at_times(seen):
    over = structs.replace(RESTING, roll=radians(90.0))
    for _ in range(4):
        tilted_s = seen.step(state=over).tilted_s
    assert tilted_s == pytest.approx(4 * TICK_S)
    assert seen.step().tilted_s == pytest.approx(3 * TICK_S)
    assert seen.step(state=over, authority=0.0).tilted_s == 0.0, "one that lay on its side on deck is engaged"


@pytest.mark.parametrize("tilted", [{"roll": 2.0}, {"roll": -pi, "pitch": 0.3}])
def test_a_vehicle_upside_down_is_counted_while_we_or_the_autopilot_steer(seen, tilted):
    over = structs.replace(RESTING, **tilted)
    assert seen.step(state=over, authority=0.0, previous=State.IDLE).upside_down_s == 0.0
    assert seen.step(state=over).upside_down_s == pytest.approx(TICK_S)
    handed = {"authority": 0.0, "previous": State.HAND_OVER}
    assert seen.step(state=over, **handed).upside_down_s == pytest.approx(2 * TICK_S)
    assert seen.step().upside_down_s == pytest.approx(1.75 * TICK_S)
    unsteered = {"authority": 0.0, "previous": State.FAULT}
    assert seen.step(state=over, **unsteered).upside_down_s == pytest.approx(1.75 * TICK_S)
    assert seen.step(**unsteered).upside_down_s == 0.0


@pytest.mark.parametrize(
    ("e", "counts"),
    [
        ((0.0, 0.0, LIMITS.max_error_m + 0.01, 0.0), True),
        ((0.0, -LIMITS.max_error_m - 0.01, 0.0, 0.0), True),
        ((0.0, 0.0, 0.0, -radians(LIMITS.max_error_deg) - 0.01), True),
        ((0.0, 0.0, LIMITS.max_error_m - 0.01, radians(LIMITS.max_error_deg) - 0.01), False),
        ((0.0, 0.0, nan, 0.0), True),
    ],
)
def test_off_track_by_metres_and_by_degrees(seen, e, counts):
    assert (seen.step(dofs=Dofs(e=e)).off_track_s > 0.0) == counts
    assert seen.step(dofs=Dofs(e=e), held=~ALL).off_track_s == 0.0
    assert seen.step(dofs=Dofs(e=e), authority=0.0).off_track_s == 0.0


def test_a_failsafe_counts_once_our_steering_should_have_ended_it(seen):
    latched, calm = Heartbeat(0.0, True, 19, 5), Heartbeat(0.0, True, 19, 4)
    assert not seen.step(latched).failsafe
    assert not seen.later(FAILSAFE_SETTLE_S - 0.1).failsafe
    seen.step(latched)
    assert not seen.step().failsafe
    seen.later(0.3)
    assert seen.step(latched).failsafe
    assert not seen.step(calm).failsafe
    seen.step(latched)
    assert not seen.step(latched, authority=0.0).failsafe
    assert not seen.step(latched).failsafe


def test_surprise_is_an_average_and_forgets_what_is_not_finite(seen):
    missed = structs.replace(RESTING, innovation=(0.0, 0.0, -0.4, radians(20.0)))
    assert seen.step(state=missed).innovation_m < LIMITS.max_innovation_m
    for _ in range(200):
        o = seen.step(state=missed)
    assert o.innovation_m == pytest.approx(0.4, rel=0.01)
    assert o.innovation_deg == pytest.approx(20.0, rel=0.01)
    for _ in range(200):
        o = seen.step()
    assert o.innovation_m < 0.01
    assert seen.step(state=structs.replace(RESTING, innovation=(nan,) * 4)).innovation_m == 0.0


def test_a_pilot_counts_as_steering_for_a_while(seen):
    assert seen.step(PilotInput(0.0, 0.8)).pilot_deflection == 0.8
    assert seen.step(PilotInput(0.0, 0.0)).pilot_deflection == 0.8
    assert seen.later(LIMITS.pilot_hold_s - 0.05).pilot_deflection == 0.8
    assert seen.later(0.1).pilot_deflection == 0.0
    assert seen.step(PilotInput(0.0, LIMITS.pilot_deflection)).pilot_deflection == 0.0
    assert seen.watch.pilot_heard_s == seen.now_s
