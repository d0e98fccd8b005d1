"""The estimator against a known motion, whose telemetry is late and on another clock."""

# Arrays stand where the equations have numbers.
# mypy: disable-error-code="arg-type, operator"

import math

import numpy as np
import pytest
from alone import Estimate

from companion import assembly
from companion.config import load_config
from companion.core import observers
from companion.core.observer import INTERVALS, ObserverState, Push, advance, expected, rates
from companion.core.observers import MAX_EXTRAPOLATION_S
from companion.core.positioning import Model, coriolis_and_damping, inertia, jacobian, to_body
from companion.records import (
    PSI,
    ZERO,
    Attitude,
    Battery,
    Depth,
    DepthRate,
    PilotGain,
    Position,
    TimeSync,
    X,
    Y,
    Z,
    vector,
)

CONFIG = load_config()
TICK_S = 0.02
START_S = 1000.0
BOOT_S = -977.0
"""Autopilot's clock minus ours."""

M = np.array([axis.mass for axis in CONFIG.axes])
D1 = np.array([axis.linear_damping for axis in CONFIG.axes])
D2 = np.array([axis.quadratic_damping for axis in CONFIG.axes])
MODEL = Model(*(vector(column.tolist()) for column in (M, D1, D2)))
LAG_S = CONFIG.thrusters.lag_s
D = np.array([2.0, -1.5, 6.0, -0.2])


def estimator(**changes):
    config = load_config(overrides=[f"{key}={value}" for key, value in changes.items()])
    return Estimate(config)


class Vehicle:
    """The nominal vehicle, each DOF by its own (psi near 0), at 1 ms; commands act `command_s` late."""

    def __init__(self, command_s):
        self.t_s, self.q, self.v, self.f = START_S, np.zeros(4), np.zeros(4), D
        self.sent = [(START_S, D)]
        self.command_s = command_s
        self.past = []

    def until(self, t_s):
        while self.t_s < t_s - 1e-9:
            held = next(
                u for at_s, u in reversed(self.sent) if at_s <= self.t_s - self.command_s or at_s == START_S
            )
            J = jacobian(self.q[PSI])
            force = self.f - coriolis_and_damping(MODEL, J, to_body(J, self.v)) - D
            self.v = self.v + 1e-3 * force / inertia(MODEL, J)
            self.q = self.q + 1e-3 * self.v
            self.f = held + (self.f - held) * math.exp(-1e-3 / LAG_S)
            self.t_s += 1e-3
            self.past.append((self.t_s, self.q.copy(), self.v.copy()))

    def at(self, t_s):
        i = min(max(round((t_s - START_S) * 1e3) - 1, 0), len(self.past) - 1)
        return self.past[i][1], self.past[i][2]


def events_at(vehicle, t_s, up_s):
    """Telemetry of t_s, which arrives `up_s` later; positions and rates have the configured ages."""
    arrives, boot = t_s + up_s, t_s + BOOT_S
    axes = [CONFIG.axes[dof] for dof in (X, Z, PSI)]
    qx, qz, qp = (vehicle.at(t_s - axis.sensor_delay_s)[0] for axis in axes)
    vx, vz, vp = (vehicle.at(t_s - axis.rate_delay_s)[1] for axis in axes)
    return [
        Attitude(arrives, boot, 0.0, 0.0, qp[PSI], 0.0, 0.0, vp[PSI]),
        Depth(arrives, boot, qz[Z]),
        DepthRate(arrives, None, vz[Z]),
        Position(arrives, boot, qx[X], qx[Y], vx[X], vx[Y]),
    ]


def swing(t_s):
    """Thrust that keeps changing, about what holds against D."""
    return np.array([6.0, 5.0, 15.0, 0.1]) * np.sin(np.array([0.8, 0.9, 1.1, 2.0]) * t_s) + D


def dive(seconds=12.0, up_s=0.03, command_s=0.06, commands=swing, every=1, **changes):
    """Run estimator and vehicle; return the last state and the vehicle, one second of truth beyond it.

    There is no echo: half the round trip, `up_s`, counts as part of the command's way.
    """
    settings = {"delays.telemetry_s": up_s, "delays.command_s": command_s - up_s} | changes
    est, vehicle = estimator(**settings), Vehicle(command_s)
    flying, state = [], None
    for k in range(1, round(seconds / TICK_S) + 1):
        now_s = START_S + k * TICK_S
        vehicle.until(now_s)
        if k > 5 and k % every == 0:
            flying += events_at(vehicle, now_s - 0.01, up_s)
        if k % 12 == 0:
            flying.append(TimeSync(now_s + up_s, now_s - up_s, now_s + BOOT_S))
        flying.sort(key=lambda event: event.t_s)
        here = [event for event in flying if event.t_s <= now_s]
        flying = flying[len(here) :]
        state = est.step(now_s, here)
        u = commands(now_s - START_S)
        est.sent(now_s, ZERO, vector(u.tolist()))
        vehicle.sent.append((now_s, u))
        vehicle.sent = vehicle.sent[-40:]
    return state, vehicle


def test_a_climb_rate_is_younger_than_the_depth_that_comes_with_it():
    """It is the accelerometer's. Both were dated back by 12 ms: 60° of what a light vehicle does at 7 Hz."""
    core = assembly.observers(CONFIG)
    expected = observers.outlook(observers.start(core))
    heard = [Depth(START_S, START_S + BOOT_S, 2.0), DepthRate(START_S, START_S + BOOT_S, 0.1)]
    inputs = assembly.estimator(CONFIG).take(START_S, heard, expected).inputs
    (depth_m, depth_s), (sink_mps, sink_s) = inputs.positions[Z], inputs.rates[Z]
    assert (depth_m, sink_mps) == (2.0, 0.1)
    assert sink_s - depth_s == pytest.approx(0.009)


@pytest.mark.parametrize(("up_s", "command_s"), [(0.005, 0.01), (0.03, 0.06), (0.1, 0.12)])
def test_late_telemetry_is_brought_up_to_now_and_ahead(up_s, command_s):
    """Where it is now, and where a command sent now begins to act, through the commands on their way."""
    state, vehicle = dive(up_s=up_s, command_s=command_s)
    now_q, now_v = vehicle.at(state.t_s)
    assert state.ahead_s == pytest.approx(command_s + CONFIG.thrusters.lead_s)
    np.testing.assert_allclose(state.eta, now_q, atol=0.008)
    np.testing.assert_allclose(state.eta_dot, now_v, atol=0.02)
    vehicle.until(state.t_s + command_s)
    u_now = vehicle.sent[-1][1]
    vehicle.sent.append((state.t_s + TICK_S, u_now))
    vehicle.until(state.t_s + state.ahead_s)
    ahead_q, ahead_v = vehicle.at(state.t_s + state.ahead_s)
    np.testing.assert_allclose(state.eta_ahead, ahead_q, atol=0.012)
    np.testing.assert_allclose(state.eta_dot_ahead, ahead_v, atol=0.03)


@pytest.mark.parametrize("since_s", [0.04, 0.1, 0.16])
def test_a_command_on_its_way_is_foreseen_and_not_felt_too_early(since_s):
    """80 N of heave sent `since_s` ago, 120 ms of delay: now it moves as it does, ahead as it will."""

    def kick(t_s):
        return D + np.array([0.0, 0.0, 80.0 if t_s >= 8.0 else 0.0, 0.0])

    state, vehicle = dive(seconds=8.0 + since_s, up_s=0.06, command_s=0.12, commands=kick)
    assert state.eta_dot[Z] == pytest.approx(vehicle.at(state.t_s)[1][Z], abs=0.012)
    vehicle.until(state.t_s + state.ahead_s)
    will_be = vehicle.at(state.t_s + state.ahead_s)[1][Z]
    assert will_be > 0.02
    assert state.eta_dot_ahead[Z] == pytest.approx(will_be, abs=0.025)


def attitude(t_s, yaw=0.0, r=0.0):
    return Attitude(t_s, t_s + BOOT_S, 0.01, 0.02, yaw, 0.03, 0.04, r)


@pytest.mark.parametrize(("reported", "believed"), [(14.8, 14.8), (2.0, 10.0), (90.0, 20.0)])
def test_the_voltage_is_kept_within_reason_and_the_pilots_gain_is_passed_on(reported, believed):
    state = estimator().step(START_S, [Battery(START_S, reported), PilotGain(START_S, 0.3)])
    assert (state.voltage_v, state.pilot_gain) == (believed, 0.3)


@pytest.mark.parametrize("turn", [-0.6, 0.6])
def test_a_heading_that_crosses_south_does_not_swing_round(turn):
    """Through +-pi at 0.6 rad/s: within a few hundredths of a radian and within the turn's own sign."""
    est = estimator()
    for k in range(400):
        now_s = START_S + k * TICK_S
        yaw = math.remainder(turn * (k * TICK_S - 5.0) + np.pi, math.tau)
        state = est.step(now_s, [attitude(now_s - 0.01, yaw, turn)])
        assert -np.pi <= state.eta[PSI] <= np.pi
        if k > 100:
            assert abs(math.remainder(state.eta[PSI] - yaw, math.tau)) < 0.05
            assert state.eta_dot[PSI] * turn > 0.0


def still(est, since_s, seconds, z):
    state = None
    for k in range(round(seconds / TICK_S)):
        now_s = since_s + k * TICK_S
        state = est.step(
            now_s, [attitude(now_s), Depth(now_s, now_s + BOOT_S, z), DepthRate(now_s, None, 0.0)]
        )
    return state


@pytest.mark.parametrize("stray_s", [-0.4, -0.15, 0.15, 0.4])
def test_stamps_that_stray_do_not_set_it_swinging(stray_s):
    """Samples much older or younger than where the observer stands, as after a stall; the heading is 0."""
    est = estimator()
    still(est, START_S, 3.0, 3.0)
    for k in range(150):
        now_s = START_S + 3.0 + k * TICK_S
        strayed_s = now_s + BOOT_S + (stray_s if k % 3 else 0.0)
        state = est.step(now_s, [Attitude(now_s, strayed_s, 0.0, 0.0, 1e-3 * (-1) ** k, 0.0, 0.0, 0.02)])
        assert abs(state.eta_dot[PSI]) < 0.1
        assert abs(state.eta[PSI]) < 0.05


@pytest.mark.parametrize("number", range(len(INTERVALS)))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_as_far_as_a_sample_is_brought_its_error_does_not_feed_itself(side, number):
    """Error of the observer between samples, (I - K H) A^n; H has the rates by which they are brought."""
    for parameters, m, d1, d2, most_s in zip(
        [one.control[number] for one in estimator().memory.learner.schedule.dofs],
        M,
        D1,
        D2,
        MAX_EXTRAPOLATION_S,
        strict=True,
    ):
        gain = np.transpose((parameters.by_position, parameters.by_rate))
        for speed in (0.0, 0.1, 0.5, 1.0, 2.0):
            push = Push(0.0, m, d1 + speed * d2, TICK_S, 0.0)
            units = [ObserverState(*row) for row in np.eye(6)]
            A = np.transpose([advance(parameters, unit, push, 1.0) for unit in units])
            H = np.transpose(
                [
                    np.subtract(expected(unit), side * most_s * np.array(rates(unit, push, 1.0)))
                    for unit in units
                ]
            )
            closed = (np.eye(6) - gain @ H) @ np.linalg.matrix_power(A, INTERVALS[number])
            assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
