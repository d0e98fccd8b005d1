"""External physics for ArduSub's JSON backend: what the firmware reads, and when the body moves."""

import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from sim_bridge.physics.body import Physics
from sim_bridge.physics.json_physics import Asked, DrivenBody, Responder, Sensed, reply
from sim_bridge.physics.plant import GRAVITY, state_of
from sim_bridge.sim_config import load_config

HEAVY = Path(__file__).parents[2] / "config" / "sim.toml"
REST = (1500,) * 16


def packet(number=0, rate_hz=400, pwm=REST):
    magic = {16: 18458, 32: 29569}[len(pwm)]
    return struct.pack(f"<HHI{len(pwm)}H", magic, rate_hz, number, *pwm)


def read(data):
    """As the firmware reads it, but for its literal parser, which `test_arrays_...` imitates."""
    text = data.decode()
    assert text.startswith("\n")
    assert text.endswith("\n")
    return json.loads(text)


def motion(eta=(0.0,) * 6, nu=(0.0,) * 6, acceleration=(0.0, 0.0, 0.0)):
    return Sensed(state_of(eta, nu), acceleration)


def body(*overrides):
    config = load_config(HEAVY, ("current.enabled=false", *overrides))
    return DrivenBody(Physics(config, 1), config.battery.voltage_v)


def test_rolled_to_starboard_gravity_is_felt_to_port_and_pitched_up_to_the_bow():
    rolled = read(reply(0.0, motion(eta=(0, 0, 0, 0.5, 0, 0))))["imu"]["accel_body"]
    assert rolled == pytest.approx([0.0, -GRAVITY * math.sin(0.5), -GRAVITY * math.cos(0.5)])
    pitched = read(reply(0.0, motion(eta=(0, 0, 0, 0, 0.5, 0))))["imu"]["accel_body"]
    assert pitched == pytest.approx([GRAVITY * math.sin(0.5), 0.0, -GRAVITY * math.cos(0.5)])


def test_position_is_ned_and_velocity_is_turned_from_body_to_ned():
    said = read(reply(1.0, motion(eta=(3, -2, 7, 0, 0, math.pi / 2), nu=(1, 0.5, 0.25, 0.1, 0.2, 0.3))))
    assert said["position"] == pytest.approx([3.0, -2.0, 7.0])
    assert said["velocity"] == pytest.approx([-0.5, 1.0, 0.25], abs=1e-8), "the bow looks east"
    assert said["imu"]["gyro"] == pytest.approx([0.1, 0.2, 0.3])
    half = math.sqrt(0.5)
    assert said["quaternion"] == pytest.approx([half, 0.0, 0.0, half], abs=1e-8)


def test_arrays_follow_their_colon_at_once_because_the_firmware_reads_no_space_there():
    text = reply(0.1, motion()).decode()
    for key in ("gyro", "accel_body", "position", "quaternion", "velocity"):
        assert f'"{key}":[' in text
    assert text.index('"imu"') < text.index('"gyro"') < text.index('"accel_body"')


def test_the_firmware_never_truncates_a_step_to_one_microsecond_less():
    responder, before, lost = Responder(lambda frame, dt_s: motion()), 0.0, 0
    for number in range(4_000):
        stamp = read(responder.answer(packet(number, 400), 0.0))["timestamp"]
        lost += int((stamp - before) * 1e6) != 2500
        before = stamp
    assert lost == 0
    assert before == pytest.approx(10.0, abs=1e-6)


def test_the_sea_is_the_same_at_every_frame_rate():
    """The same seed and time give the same water, so that dives at different speeds compare."""
    depths = []
    for rate_hz in (200, 400, 1000):
        one = body(
            "waves.enabled=true", "tether.enabled=true", "hull.net_buoyancy_n=0", "initial.eta=[0,0,2,0,0,0]"
        )
        responder = Responder(one.move)
        for number in range(5 * rate_hz):
            responder.answer(packet(number, rate_hz), 0.0)
        depths.append(one.physics.state[2])
    assert np.ptp(depths) < 2e-3
    assert abs(depths[0] - 2.0) > 0.01, "the sea does move it"


def test_a_loads_time_counts_from_the_first_turn_of_a_motor():
    one = body("load={enabled=true, weight_n=20, on_s=1, off_s=2}", "initial.eta=[0,0,5,0,0,0]")
    on = []
    for number in range(2000):
        pwm = (1500,) * 15 + (1500,) if number < 400 else (1501, *(1500,) * 15)
        one.move(Asked(400, number, pwm), 0.0025)
        on.append(one.physics.environment.load_on)
    assert one.turned_s == pytest.approx(1.0, abs=0.003)
    assert on.index(True) / 400 == pytest.approx(2.0, abs=0.01)
    assert sum(on) / 400 == pytest.approx(1.0, abs=0.01)
