"""What keeps roll and pitch level: signs, bounds, and the vertical group that heave shares."""

import math

import numpy as np
import pytest
from true_thrust import FRAMES, true_wrench

from companion import assembly
from companion.config import load_config
from companion.core.allocation import allocate, delivered, motors, thrusters
from companion.core.levelling import (
    LEAST_SHARE,
    START,
    Response,
    Turn,
    level,
    levelling_of,
    rested,
)
from companion.records import NEUTRAL, AxisCommand, Condition, State, Verdict
from companion.supervision.guard import Envelope, guard
from sim_bridge.sim_config import load_config as load_plant

LAG_S, OMEGA, TICK_S = 0.15, 5.0, 0.02
NEAR_S = 0.0
REST = (0.0, 0.0)
MAX_TAU = (70.0, 70.0, 100.0, 12.0, 5.0, 5.0)
ACTIVE = Verdict(State.ACTIVE, Condition(0), 1.0, "")
REACH = (1.0,) * 6


class Vehicle:
    """Roll and pitch of a vehicle, and what is known of them."""

    def __init__(self, max_nm=4.0):
        self.parts = [
            levelling_of(inertia, OMEGA, lever_m, max_nm, LAG_S)
            for inertia, lever_m in ((0.4, 0.085), (0.3, -0.085))
        ]
        self.states = [START, START]


def stepped(part, state, angle, rate, force, delay_s=NEAR_S, *, learn=True, gain=1.0, adapts=True):
    turn = Turn(angle, rate, force, moment=0.0, learns=learn, straight=True)
    return level(part, state, turn, Response(delay_s, gain, adapts), TICK_S)


def moments(angles=REST, rates=REST, force=REST, delay_s=NEAR_S, *, of=None, learn=False, gain=1.0):
    """Return K and M beside the forces X and Y."""
    vehicle = of or Vehicle()
    X, Y = force
    found = [
        stepped(part, state, angle, rate, push, delay_s, learn=learn, gain=gain)
        for part, state, angle, rate, push in zip(
            vehicle.parts, vehicle.states, angles, rates, (Y, X), strict=True
        )
    ]
    vehicle.states = [state for state, _ in found]
    return np.array([moment for _, moment in found])


def tried(true_m, told_m, ticks, *, moving=True, adapts=True, askew_nm=0.0):
    """Return the lever that is in use after a force was pushed whose lever is `true_m`."""
    roll, state, sent, angle, rate = levelling_of(0.4, OMEGA, told_m, 12.0, LAG_S), START, 0.0, 0.0, 0.0
    for tick in range(ticks):
        force = (20.0 + 15.0 * math.sin(0.5 * tick * TICK_S)) if moving else 0.0
        state, sent = stepped(roll, state, angle, rate, force, adapts=adapts)
        rate += TICK_S * (sent - true_m * force + askew_nm - 0.5 * rate) / 0.4
        angle += TICK_S * rate
    return state, state.lever.lever_m + told_m


@pytest.mark.parametrize(("true_m", "told_m"), [(0.01, 0.085), (0.085, 0.0), (-0.03, 0.03), (0.085, 0.085)])
@pytest.mark.parametrize("askew_nm", [0.0, 0.4])
def test_it_learns_how_far_below_the_horizontal_thrusters_push(true_m, told_m, askew_nm):
    _, found_m = tried(true_m, told_m, 1000, askew_nm=askew_nm)
    assert abs(found_m - true_m) <= max(0.5 * abs(told_m - true_m), 0.015)


def test_a_lever_of_which_nothing_was_seen_is_the_one_that_was_told():
    _, found_m = tried(0.01, 0.085, 1000, moving=False, askew_nm=0.4)
    assert found_m == 0.085
    assert rested(tried(0.01, 0.085, 1000)[0]).lever.lever_m < -0.04


def test_violent_swings_leave_it_stiff_enough():
    """What ended a tilt of 25° once left a tenth of the frequency: the vehicle then lay on its side."""
    one, left = Vehicle(12.0), []
    for tick in range(1000):
        moments(np.array([0.4 * math.sin(9.0 * tick * TICK_S), 0.0]), of=one, learn=True)
        left.append(one.states[0].oscillation.gain_scale)
    assert left[45] == 1.0
    assert min(left) == pytest.approx(LEAST_SHARE)


def test_it_cancels_what_the_horizontal_thrusters_tilt():
    """They sit below the centre of gravity: (0, 0, z) x (X, Y, 0) = (-z Y, z X, 0)."""
    X, Y = 20.0, -10.0
    tilts = np.cross([0.0, 0.0, 0.085], [X, Y, 0.0])[:2]
    np.testing.assert_allclose(moments(force=np.array([X, Y])) + tilts, 0.0, atol=1e-12)


def test_it_is_bounded():
    wild = moments(np.array([3.0, -3.0]), np.array([9.0, -9.0]), np.array([1e3, 1e3]), 0.1, learn=True)
    assert np.abs(wild).max() <= 4.0


@pytest.mark.parametrize("frame", ["vectored_6dof", "vectored"])
def test_the_true_vehicle_gets_the_moment_and_heave_keeps_its_force(frame):
    """Through ArduSub's mixer and the stand-in's own geometry."""
    pitch_nm = -1.5 if frame == "vectored_6dof" else 0.0
    one = thrusters(frame, MAX_TAU, True)
    wanted = (0.0, 0.0, 20.0, 0.0, 2.0, pitch_nm)
    axes, _ = allocate(one, wanted, 16.0, REACH)
    np.testing.assert_allclose(delivered(one, axes, 16.0), wanted, rtol=0.03, atol=0.02)
    _, _, heave, _, roll, pitch = true_wrench(frame, axes)
    assert heave == pytest.approx(20.0, abs=0.8)
    lever = load_plant(FRAMES[frame]).thrusters.vertical_m[1] / 0.218
    assert roll == pytest.approx(2.0 * lever, abs=0.2)
    assert pitch == pytest.approx(pitch_nm, abs=0.15)


def test_heave_and_tilt_share_their_motors_and_say_so():
    one = thrusters("vectored_6dof", (70.0, 70.0, 300.0, 12.0, 5.0, 5.0), True)
    axes, saturated = allocate(one, (0.0, 0.0, 290.0, 0.0, 4.0, 0.0), 16.0, REACH)
    assert np.abs(motors(one, axes)).max() <= 1.0 + 1e-9
    assert saturated == (False, False, True, False, True, True)


def test_guard_keeps_roll_and_pitch_below_what_tumbles_it_and_at_zero_unless_levelling():
    wild = AxisCommand(heave=1.0, roll=1.0, pitch=-1.0)
    sent = guard(wild, ACTIVE, NEUTRAL, Envelope(1.0, 1e6, 0.4), 0.02)
    assert (sent.heave, sent.roll, sent.pitch) == (1.0, 0.4, -0.4)
    sent = guard(wild, ACTIVE, NEUTRAL, Envelope(1.0, 1e6), 0.02)
    assert (sent.heave, sent.roll, sent.pitch) == (1.0, 0.0, 0.0)
    assert guard(AxisCommand(roll=math.nan), ACTIVE, NEUTRAL, Envelope(1.0, 1.0, 0.4), 0.02) == NEUTRAL
    assert guard(wild, ACTIVE, NEUTRAL, Envelope(1.0, 5.0, 0.4), 0.02).roll == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("overrides", "ours"),
    [
        ((), (1, 1, 1, 1, 1, 1)),
        (('vehicle.frame="vectored"',), (1, 1, 1, 1, 1, 0)),
        (('vehicle.steering_mode="stabilize"',), (1, 1, 1, 1, 0, 0)),
    ],
)
def test_which_axes_are_ours(overrides, ours):
    """Those that the frame can move, but for those that the firmware keeps level itself."""
    config = load_config(overrides=overrides)
    axes, _ = allocate(assembly.thrusters(config), (9.0, 9.0, 9.0, 2.0, 2.0, 2.0), 16.0, REACH)
    assert tuple(bool(axis) for axis in axes) == ours
    assert assembly.actuation(config).levels == bool(ours[4])
