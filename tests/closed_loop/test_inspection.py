"""`holdfast check` against the stand-in vehicle, in virtual time: what it finds; that it moves nothing."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import ROOT, Somebody

from companion.config import load_config
from companion.predive.check import Grade
from companion.predive.inspection import Inspection
from companion.predive.table import verdict
from lab.loop.lockstep import COMPANION_LINK, START_S
from lab.studies.promises import steering
from sim_bridge.sim_config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

OTHERS_LINK = 2
STEPS_A_TICK = 4
DIVED = "initial.eta=[0,0,2,0,0,0]"
HEAVY, SIX = ROOT / "config" / "sim.toml", ROOT / "config" / "sim-bluerov2.toml"
ARDUSUB = ROOT / "config" / "sim-ardusub.toml"
ORIGIN = (47.4, 8.5)
NEUTRAL_STICKS = mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0)
GROUND_STATION = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
STABILIZE, ALT_HOLD, MANUAL = 0, 2, 19


class VehicleInspection:
    """One inspection of one vehicle, to its end."""

    def __init__(self, *plant, arm=False, companion=(), base: Path = HEAVY, pilot=False, **asked):
        self.vehicle = Vehicle(load_plant(base, ("current.enabled=false", *plant)), 1)
        self.inspection = Inspection(load_config(overrides=companion), **asked)
        for link in (COMPANION_LINK, OTHERS_LINK):
            self.vehicle.open_link(link)
        self.sent: list[bytes] = []
        self.modes: list[int] = []
        self.pushed = False
        somebody, station, armed = Somebody(254, 1), Somebody(), False
        out: list[bytes] = []
        while not self.inspection.done and self.vehicle.time_s < 60.0:
            orders = [(COMPANION_LINK, data) for data in out]
            if arm and not armed and self.vehicle.time_s > 2.2:
                armed = True
                orders.append((OTHERS_LINK, somebody.arm()))
            if pilot and (tick := round(self.vehicle.time_s / 0.02)) % 2 == 0:
                orders.append((OTHERS_LINK, station.frame(NEUTRAL_STICKS)))
                orders += [(OTHERS_LINK, station.frame(GROUND_STATION))] * (tick % 50 == 0)
            inbox = []
            for step in range(STEPS_A_TICK):
                for link, data in self.vehicle.step(orders if step == 0 else []):
                    if link == COMPANION_LINK:
                        inbox.append((round((START_S + self.vehicle.time_s) * 1e9), data))
            truth = self.vehicle.truth()
            self.pushed |= any(pwm != 1500 for pwm in truth.motor_pwm)
            if not self.modes or self.modes[-1] != truth.mode:
                self.modes.append(truth.mode)
            out = self.inspection.step(START_S + self.vehicle.time_s, inbox)
            self.sent += out

    @property
    def steered(self):
        return [axes for axes in map(steering, self.sent) if axes is not None]

    def row(self, name):
        (found,) = [row for row in self.inspection.rows if row.name == name]
        return found


def test_a_sound_vehicle_is_found_good_and_nothing_is_steered():
    look = VehicleInspection(origin=ORIGIN)
    assert {row.grade for row in look.inspection.rows} == {Grade.GOOD}
    assert look.inspection.notes == ["the EKF origin was set"]
    assert look.vehicle.time_s < 8.0
    assert not look.steered


def test_a_vehicle_that_somebody_has_armed_is_left_in_its_mode():
    look = VehicleInspection(DIVED, arm=True)
    assert look.modes == [MANUAL]
    assert not look.steered
    assert not look.pushed


@pytest.mark.parametrize(
    ("plant", "arm", "why"),
    [
        ((), True, "not in the water"),
        ((DIVED, 'faults=[{kind="message_stopped", message="GLOBAL_POSITION_INT"}]'), True, "no depth"),
    ],
)
def test_thrusters_are_not_tried_where_they_must_not_be(plant, arm, why):
    look = VehicleInspection(*plant, arm=arm, thrusters=True)
    assert why in look.row("thrusters").found
    assert not look.steered
    assert not look.pushed


def test_asked_for_armed_and_dived_it_tries_every_motor_and_ends_neutral():
    look = VehicleInspection(DIVED, "waves.enabled=true", arm=True, thrusters=True)
    assert look.row("thrusters").grade is Grade.GOOD
    assert "all 8 push in the right direction" in look.row("thrusters").found
    assert look.steered[-1] == (0.0,) * 6
    assert max(abs(axis) for axes in look.steered for axis in axes) <= 0.2
    assert abs(look.vehicle.truth().eta[3:]).max() < 0.5
    assert look.inspection.notes == [
        "nobody steers now: FS_PILOT_INPUT disarms the vehicle unless a pilot steers"
    ]


@pytest.mark.parametrize("motors", [(1, 5), (3, 8)], ids=str)
def test_reversed_motors_are_named(motors):
    """One that pushes sideways and one that pushes up."""
    reversed_ = [f"parameters.MOT_{motor}_DIRECTION=-1" for motor in motors]
    found = VehicleInspection(DIVED, *reversed_, arm=True, thrusters=True).row("thrusters")
    assert found.grade is Grade.REFUSED
    assert "motor {} and {} pushes in the wrong direction".format(*motors) in found.found
    assert "MOT_{}_DIRECTION and MOT_{}_DIRECTION".format(*motors) in found.fix


@pytest.mark.parametrize("motor", [2, 6, 8])
def test_a_reversed_motor_is_not_called_weak_in_waves(motor):
    """Of motor 8 "gives too little thrust" was said: look for a broken propeller."""
    sea = ("waves.enabled=true", f"parameters.MOT_{motor}_DIRECTION=-1")
    found = VehicleInspection(DIVED, *sea, arm=True, thrusters=True).row("thrusters")
    assert found.fix == f"MOT_{motor}_DIRECTION: change the sign"


def test_the_six_thruster_frame():
    reversed_ = [f"parameters.MOT_{motor}_DIRECTION=-1" for motor in (2, 6)]
    frame = ('vehicle.frame="vectored"',)
    look = VehicleInspection(DIVED, *reversed_, arm=True, thrusters=True, companion=frame, base=SIX)
    assert look.row("frame").grade is Grade.GOOD
    assert "motor 2 and 6 pushes in the wrong direction" in look.row("thrusters").found


def test_a_dead_motor_is_named():
    look = VehicleInspection(DIVED, "thrusters.gain=[1,1,1,0.05,1,1,1,1]", arm=True, thrusters=True)
    assert "motor 4 gives too little thrust" in look.row("thrusters").found


def test_a_leak_and_a_tilt_are_no_good_start():
    look = VehicleInspection(DIVED, 'faults=[{kind="leak"}]', "initial.eta=[0,0,1,1.2,0,0]")
    assert look.row("leak").grade is Grade.REFUSED
    assert verdict(look.inspection.rows).startswith("NOT ready: leak: the autopilot reports a leak")


def test_nobody_there():
    look = VehicleInspection('faults=[{kind="link_cut"}]')
    assert look.inspection.done
    (link,) = look.inspection.rows
    assert (link.grade, "nothing arrives at" in link.found) == (Grade.REFUSED, True)


@pytest.mark.parametrize("base", [HEAVY, ARDUSUB])
def test_alone_it_arms_for_the_pulses_and_disarms_again(base):
    """ArduSub's own vehicle answers a heave pulse 2.6 times as strongly: that is no wrong direction."""
    look = VehicleInspection(DIVED, base=base, thrusters=True)
    assert look.row("thrusters").grade is Grade.GOOD
    assert look.pushed
    assert not look.vehicle.truth().armed
    assert look.inspection.notes == ["the vehicle was armed for the test and disarmed after it"]
    assert look.inspection.shutdown_frames() == []


def test_beside_a_pilot_with_neutral_sticks_directions_are_reported():
    look = VehicleInspection(DIVED, arm=True, pilot=True, thrusters=True)
    assert look.row("thrusters").grade is Grade.GOOD
    assert look.vehicle.truth().armed


def test_disarmed_in_the_middle_it_ends_and_does_not_arm_again():
    look = VehicleInspection(
        DIVED, 'faults=[{kind="disarm", at_s=9.0, duration_s=0.1}]', arm=True, thrusters=True
    )
    assert "disarmed" in look.row("thrusters").found
    assert not look.vehicle.truth().armed
