"""POSHOLD and GUIDED of the stand-in; `lab.parity` compares them with the firmware."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import ALT_HOLD, GUIDED, POSHOLD, STABILIZE, Station, override, vehicle

from sim_bridge.fault_kinds import Fault
from sim_bridge.firmware import track
from sim_bridge.firmware.messages import M_PER_DEGREE

REPOSITION, YAW = mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_CMD_CONDITION_YAW
LOCAL, OFFSET, BODY = 1, 7, 8
POSITION, VELOCITY, MOVING = 0b110111111000, 0b110111000111, 0b110111000000
WITH_YAW, WITH_YAW_RATE = ~(1 << 10), ~(1 << 11)
DVL = ("sensors.dvl=true", "initial.eta=[0, 0, 8, 0, 0, 0]")


def target(frame, mask, place=(0, 0, 0), velocity=(0, 0, 0), yaw=0.0, rate=0.0):
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *place, *velocity, 0, 0, 0, yaw, rate
    )


def guided(*overrides):
    return Station(vehicle(*DVL, *overrides)).arm(GUIDED)


def place(station):
    return station.rov.truth().eta[:3]


@pytest.mark.parametrize("length", [0.001, 0.5, 2.0, 10.0])
def test_a_track_ends_where_it_shall_within_its_limits(length):
    way, progress, dt = track.plan(length, 1.0, 2.5, 1.0, 5.2), track.Progress(), 0.005
    speeds, accelerations = [], []
    while progress.time_s < track.duration_s(way) - dt:
        progress = track.advance(way, progress, dt)
        speeds.append(progress.speed)
        accelerations.append(abs(progress.acceleration))
    assert progress.way == pytest.approx(length, rel=1e-3)
    assert max(speeds) <= 1.0001
    assert max(accelerations) <= 2.5
    assert max(np.abs(np.diff(accelerations))) <= 1.0001 * dt
    assert progress.speed == pytest.approx(0.0, abs=1e-3)
    assert track.advance(way, progress, dt)[1:] == (length, 0.0, 0.0)


def test_poshold_goes_by_stick_over_ground_and_holds_where_it_stops():
    station = Station(vehicle(*DVL, "current.enabled=true", "current.speed_m_s=0.2")).arm(POSHOLD)
    station.run(15.0, override(forward=200))
    truth = station.rov.truth()
    north, east = truth.eta[:2]
    asked_m_s = 2.0 * (200.0 / 400.0 - 0.25 * 0.5)
    station.run(2.0, override(forward=200))
    assert (place(station)[0] - north) / 2.0 == pytest.approx(asked_m_s, abs=0.08)
    assert abs(place(station)[1] - east) < 0.1
    station.run(20.0, override())
    held = place(station)
    station.run(5.0, override())
    assert np.abs(place(station) - held).max() < 0.1


def test_poshold_without_its_position_takes_the_sticks_as_effort():
    station = Station(vehicle(*DVL)).arm(POSHOLD)
    station.rov.autopilot.control.located = False
    station.run(0.2, override(forward=200))
    assert station.rov.truth().motor_pwm[2] == pytest.approx(1500 + 400 * 0.375, abs=10)


def test_poshold_stays_when_the_ekf_resets_its_position():
    station = Station(vehicle(*DVL)).arm(POSHOLD)
    station.run(3.0, override())
    held = place(station)
    station.rov.inject(Fault("position_reset", at_s=station.rov.time_s, value=3.0))
    station.run(4.0, override())
    assert np.abs(place(station) - held).max() < 0.1


def test_guided_goes_to_a_waypoint_deeper_and_holds_it():
    station = guided()
    station.say(target(OFFSET, POSITION, (1.5, -0.5, 0.8))).run(12.0, override())
    assert place(station) == pytest.approx([1.5, -0.5, 8.8], abs=0.15)


def test_guided_takes_a_new_waypoint_on_its_way():
    station = guided()
    station.say(target(LOCAL, POSITION, (4.0, 0.0, 8.0))).run(2.5, override())
    station.say(target(LOCAL, POSITION, (0.0, 0.5, 8.0))).run(14.0, override())
    assert place(station)[:2] == pytest.approx([0.0, 0.5], abs=0.15)


def test_guided_keeps_a_velocity_in_the_body_frame_for_three_seconds():
    station = guided("initial.eta=[0, 0, 8, 0, 0, 1.5]")
    station.say(target(BODY, VELOCITY, velocity=(0.4, 0.0, 0.2))).run(2.9, override())
    moving = station.rov.truth().nu
    assert moving[0] > 0.15
    assert moving[2] > 0.1
    assert place(station)[1] > 0.3
    station.run(4.0, override())
    assert np.abs(station.rov.truth().nu[:3]).max() < 0.05


def test_a_place_that_moves_is_followed_twice_as_fast_as_asked_as_the_firmware_does():
    station = guided()
    station.say(target(LOCAL, MOVING, (0.5, 0.0, 8.0), (0.1, 0.0, 0.0))).run(16.0, override())
    assert place(station)[0] == pytest.approx(0.5 + 3.0 * 2.0 * 0.1, abs=0.12)


def test_guided_turns_to_a_heading_and_swings_there():
    station = guided()
    station.say(target(OFFSET, POSITION & WITH_YAW, yaw=1.0)).run(4.0, override())
    headings = [station.run(0.1, override()) and station.rov.truth().eta[5] for _ in range(30)]
    assert np.mean(headings) == pytest.approx(1.0, abs=0.1)
    assert np.ptp(headings) > 0.2
    station.command(YAW, 90.0, 20.0, 1.0, 0.0).run(8.0, override())
    headings = [station.run(0.1, override()) and station.rov.truth().eta[5] for _ in range(30)]
    assert np.mean(headings) == pytest.approx(math.pi / 2, abs=0.1)


def test_a_yaw_rate_goes_on_and_the_pilot_s_stick_rules():
    station = guided()
    station.say(target(LOCAL, VELOCITY & WITH_YAW_RATE, rate=0.3)).run(2.0, override())
    before = station.rov.truth().eta[5]
    station.run(3.0, override())
    assert station.rov.truth().eta[5] - before == pytest.approx(0.9, abs=0.25)
    station.run(2.0, override(yaw=-200))
    assert station.rov.truth().nu[5] < -0.2


@pytest.mark.parametrize(
    "message",
    [
        target(LOCAL, POSITION, (math.nan, 0.0, 8.0)),
        target(LOCAL, VELOCITY, velocity=(math.inf, 0.0, 0.0)),
        target(3, POSITION, (5.0, 0.0, 8.0)),
        target(LOCAL, 0, (5.0, 0.0, 8.0)),
        target(LOCAL, 0b111111111, (5.0, 0.0, 8.0)),
    ],
    ids=["nan", "inf", "frame", "acceleration", "nothing"],
)
def test_a_target_that_cannot_be_taken_moves_nothing(message):
    station = guided()
    before = place(station)
    station.say(message).run(3.0, override())
    assert np.abs(place(station) - before)[:2].max() < 0.1


def test_targets_are_for_guided_alone():
    station = Station(vehicle(*DVL)).arm(ALT_HOLD)
    station.say(target(LOCAL, POSITION, (5.0, 0.0, 8.0))).run(3.0, override())
    assert np.abs(place(station)[:2]).max() < 0.1


def reposition(north_m, flags, frame=0):
    latitude = round(north_m / M_PER_DEGREE * 1e7)
    return mavlink.MAVLink_command_int_message(
        1, 1, frame, REPOSITION, 0, 0, -1, flags, 0, 0, latitude, 0, -8.0
    )


def test_do_reposition_needs_guided_or_the_flag_and_a_place():
    station = Station(vehicle(*DVL)).arm(STABILIZE)
    for message, result in (
        (reposition(2.0, 0), 2),
        (reposition(0.0, 1), 2),
        (reposition(2.0, 1, frame=1), 2),
        (reposition(2.0, 1, frame=3), 4),
        (reposition(2.0, 1), 0),
    ):
        assert station.say(message).run(0.1, override()).result(REPOSITION) == result
    assert station.command(REPOSITION, -1, 1).run(0.1).result(REPOSITION) == 3
    assert station.rov.truth().mode == GUIDED
    station.run(9.0, override())
    assert place(station)[0] == pytest.approx(2.0, abs=0.15)


def test_do_reposition_without_a_position_fails():
    station = Station(vehicle()).arm(STABILIZE)
    assert station.say(reposition(2.0, 1)).run(0.1, override()).result(REPOSITION) == 4
    assert station.rov.truth().mode == STABILIZE


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_no_value_of_a_parameter_stops_it(value):
    station = guided()
    for name in station.rov.autopilot.params.names:
        if name.startswith(("PSC_", "WPNAV_", "PILOT_", "ATC_", "ANGLE_")):
            station.say(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
    station.say(target(OFFSET, POSITION, (1.0, 0.0, 1.0))).run(0.5, override())
    station.say(target(OFFSET, MOVING, (1.0, 0.0, 1.0), (0.1, 0.0, 0.0))).run(0.5, override())
    station.say(target(OFFSET, VELOCITY, velocity=(0.1, 0.0, 0.0))).run(0.5, override())
    station.command(176, 1, POSHOLD).run(0.5, override(forward=100))
    station.command(176, 1, GUIDED).run(0.5, override(forward=100))
    assert np.isfinite(station.rov.truth().eta).all()
