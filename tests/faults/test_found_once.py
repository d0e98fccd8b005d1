"""Promises that were once not kept: each test stands for a bug that a reviewer found."""

import numpy as np
import pytest
from virtual import Dive, Somebody, active, hold

from companion.core.allocation import allocate, delivered, thrusters
from companion.records import State

MAX_TAU = (70.0, 70.0, 100.0, 12.0, 5.0, 5.0)
START_S = 1000.0


def test_a_stall_longer_than_the_burst_still_ends_in_neutral_frames():
    dive = active()
    woke_s = dive.t_s + 1.4
    dive.tap.asleep_until_s = woke_s
    dive.run(3.2)
    frames = [axes for t_s, axes in dive.tap.frames if t_s >= woke_s - 1e-6]
    assert frames
    assert not any(frames[-1])
    assert dive.motors_rest()


@pytest.mark.parametrize(
    ("frame", "heave_n", "voltage_v"),
    [("vectored", -100.0, 16.0), ("vectored_6dof", -100.0, 12.0), ("vectored", 100.0, 12.0)],
)
def test_a_motor_at_the_end_of_its_curve_is_reported(frame, heave_n, voltage_v):
    motors = thrusters(frame, MAX_TAU, True)
    axes, saturated = allocate(motors, (0.0, 0.0, heave_n, 0.0, 0.0, 0.0), voltage_v, (1.0,) * 6)
    assert abs(delivered(motors, axes, voltage_v)[2] - heave_n) > 2.0
    assert saturated[:4] == (False, False, True, False)


def test_a_pilot_who_steers_at_ten_hertz_is_never_engaged_against():
    somebody, dive = Somebody(), Dive("parameters.FS_PILOT_INPUT=1")

    def spoil(t_s, inbox):
        if round(t_s / 0.02) % 5 == 0:
            return [*inbox, (round((START_S + t_s) * 1e9), somebody.stick())]
        return inbox

    dive.tap.spoil = spoil
    dive.run(6.0)
    assert State.ACTIVE not in dive.states_since(0.0)


def test_no_false_delay_is_believed():
    dive = Dive("current.enabled=true", setpoint=hold(z=2.0), seed=2)
    dive.until(State.ACTIVE)
    delays = [step.sample.state.delays for step in dive.run(6.0)]
    assert max(delay.command_s for delay in delays) < 0.06


def test_a_gain_that_leaves_no_reach_makes_no_nan():
    motors = thrusters("vectored_6dof", MAX_TAU, True)
    assert np.isfinite(allocate(motors, (0.0,) * 6, 16.0, (1.0, 1.0, 0.0, 1.0, 1.0, 1.0))[0]).all()


def test_datagrams_from_a_routers_queue_are_no_reboot():
    """Some datagrams 1.5 s late, one among the new ones of each tick."""
    dive = active(seconds=4.0)
    since_s = dive.t_s
    kept: list[bytes] = []

    def late(t_s, inbox):
        if t_s < since_s + 0.1:
            kept.extend(data for _, data in inbox)
        elif t_s > since_s + 1.6 and kept:
            return [*inbox, (round((START_S + t_s) * 1e9), kept.pop(0))]
        return inbox

    dive.tap.spoil = late
    dive.run(4.0)
    assert dive.states_since(since_s) == [State.ACTIVE]


def test_somebody_elses_frames_do_not_keep_our_link_alive():
    dive = Dive(arm=False, engage=False)
    dive.run(2.5)
    somebody = Somebody()
    dive.fault("link_cut")
    dive.tap.spoil = lambda t_s, inbox: [*inbox, (round((START_S + t_s) * 1e9), somebody.stick(1500))]
    dive.run(3.0)
    assert dive.step.sample.state.ages.link_s > 2.0
