"""Streams of a real dive: what is refused is not asked for again, what a ground station takes comes back."""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import HEADING_RAD, Dive, Somebody, active

from companion.mavlink import autopilot
from companion.mavlink.streams import streams
from companion.records import State
from companion.records.events import Attitude


def attitudes(dive):
    """How many of them the last tick took in."""
    return sum(isinstance(event, Attitude) for event in dive.engine.events)


def slowest_hz(heard):
    """Their least rate over 0.4 s, of their numbers by tick."""
    return min(sum(heard[i : i + 20]) for i in range(len(heard) - 20)) / 0.4


def test_a_ground_stations_parameter_transfer_is_borne():
    """It slows every stream fourfold for as long as it lasts."""
    dive = active("waves.enabled=true", seconds=8.0)
    station = Somebody()
    ask = station.frame(mavlink.MAVLink_param_request_list_message(1, 1))
    heard = []
    for _ in range(200):
        dive.tap.to_vehicle.append(ask)
        step = dive.run(0.02)[-1]
        assert step.sample.verdict.state is State.ACTIVE
        heard.append(attitudes(dive))
    assert slowest_hz(heard) < 20.0, "else nothing slowed down"
    steps = dive.run(3.0)
    for _ in range(50):
        steps += dive.run(0.02)
        heard.append(attitudes(dive))
    assert dive.state is State.ACTIVE
    assert sum(heard[-50:]) > 45
    assert np.abs([step.truth.eta[2] - 1.0 for step in steps]).max() < 0.05


def test_streams_that_another_station_turned_down_are_asked_for_again():
    dive = active("waves.enabled=true", seconds=3.0)
    slow = mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1)
    dive.tap.to_vehicle.append(Somebody().frame(slow))
    heard = []
    for _ in range(200):
        dive.run(0.02)
        heard.append(attitudes(dive))
    assert slowest_hz(heard) < 30.0, "else nothing slowed down"
    assert sum(heard[-50:]) > 45
    assert dive.state is State.ACTIVE


def test_a_ground_station_that_keeps_turning_streams_down_does_not_turn_the_vehicle():
    """MAVProxy sets all streams of its port to 4 Hz every 15 s; seen live, the heading swung with each."""
    dive = active("waves.enabled=true", seconds=10.0)
    slow = mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1)
    steps = []
    for _ in range(2):
        dive.tap.to_vehicle.append(Somebody().frame(slow))
        steps += dive.run(8.0)
    assert np.degrees(np.abs([step.truth.eta[5] - HEADING_RAD for step in steps])).max() < 2.0
    assert np.std([step.truth.eta[2] for step in steps]) < 0.010
    assert dive.state is State.ACTIVE


def texts_of(dive, seconds):
    return [text.text for step in dive.run(seconds) for text in step.sample.texts]


def test_the_autopilot_refuses_nothing_that_we_ask_for():
    said = texts_of(Dive(arm=False, engage=False), 60.0)
    assert not [text for text in said if text.startswith("No ap_message")]


def test_a_refusal_is_said_once(monkeypatch):
    """A firmware that does not stream messages which we ask for: every ground station is told, but once."""
    unknown = {mavlink.MAVLINK_MSG_ID_ODOMETRY: 50.0, mavlink.MAVLINK_MSG_ID_WIND_COV: 1.0}
    monkeypatch.setattr(autopilot, "streams", lambda *args, **names: streams(*args, **names) | unknown)
    dive = Dive(arm=False, engage=False)
    said = texts_of(dive, 60.0)
    for message in unknown:
        assert said.count(f"No ap_message for mavlink id ({message})") == 1
