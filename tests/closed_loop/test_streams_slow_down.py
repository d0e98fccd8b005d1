"""Streams of a real dive: what is refused is not asked for again, what a ground station takes comes back."""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import HEADING_RAD, Dive, Somebody, active

from companion.records import State


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
    said = texts_of(Dive(arm=False, engage=False), 20.0)
    assert not [text for text in said if text.startswith("No ap_message")]
