"""Leads of thrusters are exchanged, or several are reversed: a true word before the vehicle is far away."""

import numpy as np
import pytest
from virtual import HEADING_RAD, Dive, Somebody, hold

from companion.records import Condition, State

DEPTH_M = 3.0
SEA = ("waves.enabled=true", "current.enabled=true", "current.speed_m_s=0.2", "current.direction_deg=40")
START = ("sensors.dvl=true", f"initial.eta=[0,0,{DEPTH_M},0,0,{HEADING_RAD}]")
SIX = {"base": "sim-bluerov2.toml", "companion": ('vehicle.preset="bluerov2"',)}


def exchange(dive, pairs):
    """Let each thruster of a pair run as the other one is told."""
    physics = dive.vehicle.physics
    step = physics.step

    def exchanged(pwm, since_arming_s):
        pwm = list(pwm)
        for one, other in pairs:
            pwm[one - 1], pwm[other - 1] = pwm[other - 1], pwm[one - 1]
        step(pwm, since_arming_s)

    physics.step = exchanged


def begun(*pairs, reverse=(), **arguments):
    """A dive that holds place, depth and heading from now on."""
    dive = Dive(*START, *SEA, setpoint=hold(z=DEPTH_M, x=0.0, y=0.0), **arguments)
    dive.tap.to_vehicle.append(Somebody().origin())
    exchange(dive, pairs)
    for motor in reverse:
        dive.fault("thruster", thruster=motor, value=-1.0)
    return dive.until(State.ACTIVE)


@pytest.mark.parametrize(
    ("pairs", "reverse", "vehicle"),
    [([(5, 8)], (), {}), ([], (5, 6, 7), {}), ([], (5, 6), SIX)],
    ids=["5 and 8 exchanged", "5, 6 and 7 reversed", "5 and 6 of six reversed, and handed over"],
)
def test_vertical_ones_turn_the_vehicle_over_and_thrust_ends(pairs, reverse, vehicle):
    """It stayed upside down, ACTIVE as its depth was held, or ALT_HOLD turned it over for good."""
    dive = begun(*pairs, reverse=reverse, **vehicle)
    steps = dive.run(20.0)
    ended = next(step for step in steps if step.sample.verdict.state is State.FAULT)
    assert ended.t_s - steps[0].t_s < 11.0
    assert ended.sample.verdict.reason == Condition.TURNED_OVER.text
    assert "reversed or exchanged" in ended.sample.verdict.remedy
    roll, pitch = np.transpose([step.truth.eta[3:5] for step in steps[-100:]])
    assert np.degrees(np.arccos(np.cos(roll) * np.cos(pitch))).max() < 10.0
    assert dive.motors_rest()


@pytest.mark.parametrize(
    ("pairs", "most_m"),
    [([(1, 4), (2, 3)], 2.0), ([(1, 4)], 2.5)],
    ids=["surge and sway reversed", "surge and sway exchanged"],
)
def test_horizontal_ones_do_not_take_the_vehicle_away(pairs, most_m):
    """It went 14 m with "not enough thrust", until a heading was called wrong after 19 s, or never."""
    dive = begun(*pairs)
    steps = dive.run(8.0)
    told = next(step for step in steps if step.sample.verdict.warnings & Condition.HEADING_WRONG)
    assert np.hypot(*told.truth.eta[:2]) < most_m
    assert not any(told.sample.requested[:2])
    assert "order of the horizontal motors" in told.sample.verdict.remedy
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
