"""A body that turns as it is pushed, and the watch that looks for the motor that does not push."""

import math

import numpy as np
import pytest

from companion.core import thruster_watch
from companion.core.allocation import FACTORS, PER_NEWTON, allocate, delivered, thrusters, without_motor
from companion.core.thruster_watch import EXCUSED_S, START, Levers, Parameters, rest

DT_S = 0.02
HEAVY = thrusters("vectored_6dof", (1e6,) * 6, True)
BELIEVED = Parameters(HEAVY, 0.45, 0.37, 0.5, 0.15)
LEVERS = Levers(0.085, 0.0, 0.085, 0.0)
REACH = (1.0,) * 6


class Body:
    """Roll, pitch and yaw of a vehicle that answers `gain` times as strongly, and is held by stiff springs.

    A motor that is dead keeps `keeps` of its push, and pushes `stuck_n` besides; `offset_m` is where a
    payload hangs that heave carries. `motor_s` is when a motor was first accused.
    """

    def __init__(self, gain=1.0, offset_m=(0.0, 0.0), lag_s=0.08, keeps=0.0, stuck_n=0.0, levers=LEVERS):
        self.gain, self.offset_m, self.lag_s, self.keeps = gain, offset_m, lag_s, keeps
        self.stuck_n, self.levers = stuck_n, levers
        self.angle, self.rate, self.moment = np.zeros(3), np.zeros(3), np.zeros(3)
        self.watch, self.t_s, self.motor_s = START, 0.0, None

    def run(self, seconds, dead=0, amplitude=(4.0, 4.0, 16.0), payload_n=0.0):
        """Push surge, sway and heave to and fro as waves ask for it, and hold the angles."""
        for _ in range(round(seconds / DT_S)):
            self.t_s += DT_S
            waves = np.sin(self.t_s * np.array([1.1, 1.3, 1.6]) + [0.0, 1.0, 2.0])
            X, Y, Z = amplitude * waves - [0.0, 0.0, payload_n]
            K, M, N = (-8.0 * self.angle - 4.0 * self.rate) / self.gain
            K, M = K + 0.085 * Y, M - 0.085 * X
            axes, _ = allocate(HEAVY, (X, Y, Z, N, K, M), 16.0, REACH)
            given = np.array(delivered(HEAVY, axes, 16.0))
            if dead:
                left = np.array(delivered(without_motor(HEAVY, dead), axes, 16.0))
                given = left + self.keeps * (given - left)
                given += self.stuck_n * np.array(FACTORS["vectored_6dof"][dead - 1]) * PER_NEWTON
            moment = np.array([given[4] - 0.085 * given[1], given[5] + 0.085 * given[0], given[3]])
            moment += payload_n * np.array([self.offset_m[1], -self.offset_m[0], 0.0])
            self.moment += (moment - self.moment) * (1.0 - math.exp(-DT_S / self.lag_s))
            acceleration = self.gain * self.moment / [0.45, 0.37, 0.5] - 0.5 * self.rate
            self.rate = self.rate + DT_S * acceleration
            self.angle = self.angle + DT_S * self.rate
            turning = (*self.angle[:2].tolist(), *self.rate.tolist())
            self.watch = thruster_watch.watch(
                BELIEVED, self.watch, axes, 16.0, turning, self.levers, 0.0, DT_S
            )
            if self.watch.dead + self.watch.reversed > 0 and self.motor_s is None:
                self.motor_s = self.t_s
        return self.watch.dead


@pytest.mark.parametrize(("dead", "gain"), [*((dead, 1.0) for dead in range(1, 9)), (2, 0.5), (7, 0.5)])
def test_the_dead_motor_is_found(dead, gain):
    body = Body(gain)
    vertical = dead > 4
    used = (4.0, 4.0, 16.0) if vertical else (12.0, 12.0, 6.0)
    assert body.run(10.0, amplitude=used) == 0
    assert body.run(20.0, dead, amplitude=used) == dead


@pytest.mark.parametrize(
    ("motor", "keeps"), [*((motor, -1.0) for motor in range(1, 9)), (5, -0.6), (8, -0.6)]
)
def test_the_reversed_motor_is_found_and_not_called_dead(motor, keeps):
    body = Body(keeps=keeps)
    used = (4.0, 4.0, 16.0) if motor > 4 else (12.0, 12.0, 6.0)
    body.run(10.0, amplitude=used)
    while body.motor_s is None and body.t_s < 20.0:
        body.run(DT_S, motor, amplitude=used)
    assert (body.watch.reversed, body.watch.dead) == (motor, 0)


@pytest.mark.parametrize("motor", [5, 8])
def test_a_motor_that_keeps_two_fifths_of_its_push_is_not_dead(motor):
    """A Heavy that was allocated around such a motor turned over: the motor still pushed."""
    body = Body(gain=0.8, keeps=0.4)
    body.run(3.0, amplitude=(0.0, 0.0, 16.0))
    body.run(9.0, motor, amplitude=(0.0, 0.0, 16.0))
    assert body.motor_s is None


@pytest.mark.parametrize("stuck_n", [-9.0, 12.0])
@pytest.mark.parametrize("motor", [1, 2, 3, 4])
def test_a_stuck_horizontal_motor_accuses_no_vertical_one(motor, stuck_n):
    """It tilts the vehicle as well: a sound vertical motor was found dead, and vehicles turned over."""
    body = Body(stuck_n=stuck_n)
    body.run(3.0, amplitude=(0.0, 0.0, 10.0))
    body.run(7.0, motor, amplitude=(0.0, 0.0, 10.0))
    assert body.motor_s is None


@pytest.mark.parametrize("gain", [1 / 3, 1.0, 3.0])
def test_motors_that_are_wrong_alike_are_not_dead(gain):
    assert Body(gain).run(60.0) == 0


@pytest.mark.parametrize("offset_m", [(0.3, 0.0), (0.0, 0.2)])
def test_a_payload_beside_the_centre_is_no_dead_motor(offset_m):
    body = Body(offset_m=offset_m)
    assert body.run(10.0) == 0
    assert body.run(30.0, payload_n=8.0) == 0
    assert body.motor_s is None


def test_a_motor_that_pushes_again_is_taken_back_and_nobody_is_accused_for_a_while():
    body = Body()
    body.run(5.0)
    assert body.run(10.0, dead=7) == 7
    assert body.run(6.0) == 0
    assert body.run(10.0, dead=5) == 0
    assert body.watch.excused_s > 0.0
    assert body.run(EXCUSED_S, dead=5) == 5


def test_who_rests_forgets_all_but_the_dead_motor():
    body = Body()
    body.run(10.0, dead=6)
    assert rest(body.watch) == START._replace(dead=6)


def test_a_motor_that_has_nothing_to_do_is_not_missed():
    body = Body()
    assert body.run(30.0, dead=6, amplitude=(0.0, 0.0, 0.0)) == 0
