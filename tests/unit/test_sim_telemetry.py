"""Rates, origins, links and noise of what the double tells."""

from typing import Any

import numpy as np
import pytest
from builders import STILL_SENSORS, pulled
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import SET_INTERVAL, Station, override, vehicle

QUIET = [f"sensors.{name}=0.0" for name in STILL_SENSORS]
STEADY = "initial.eta=[0, 0, 5, 0, 0, 0]"


def test_streams_slow_down_fourfold_during_a_parameter_transfer():
    station = Station(vehicle())
    station.command(SET_INTERVAL, 30, 5000).run(0.5)
    for _ in range(3):
        station.say(mavlink.MAVLink_param_request_list_message(1, 1)).run(0.02)
    heard = station.run(1.5)
    during = [t for t, m in heard if m.get_type() == "ATTITUDE" and t <= heard.times("PARAM_VALUE")[-1]]
    assert np.diff(during).min() == pytest.approx(0.02)
    assert np.diff(heard.times("ATTITUDE"))[-1] == pytest.approx(0.005)


def test_both_links_forward_each_others_heartbeats_but_not_steering():
    rov = vehicle()
    first, second = Station(rov, link=0), Station(rov, link=1, system=200)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    second.say(beat).run(0.05)
    seen = second.run(0.05)
    out: list[Any] = []
    message = beat.pack(first.packer)
    for link, data in rov.step([(0, message), (0, override(yaw=5).pack(first.packer))]):
        if link == 1:
            out += second.parser.parse_buffer(data) or []
    systems = [m.get_srcSystem() for m in out if m.get_type() == "HEARTBEAT"]
    assert 255 in systems
    assert not [m for m in [*out, *(m for _, m in seen)] if m.get_type() == "RC_CHANNELS_OVERRIDE"]


def test_without_an_origin_altitudes_are_zero_while_relative_alt_and_climb_are_right():
    station = Station(vehicle(STEADY, *QUIET, pulled(5)))
    heard = station.run(3.0)
    assert {m.alt for m in heard.of("VFR_HUD")} == {0.0}
    assert {m.alt for m in heard.of("GLOBAL_POSITION_INT")} == {0}
    depth, sink = station.rov.truth().eta[2], station.rov.truth().nu[2]
    position = heard.last("GLOBAL_POSITION_INT")
    assert position.relative_alt / 1000 == pytest.approx(-depth, abs=0.06)
    assert position.vz / 100 == pytest.approx(sink, abs=0.02)
    assert heard.last("VFR_HUD").climb == pytest.approx(-sink, abs=0.01)
    assert heard.last("AHRS2").altitude == pytest.approx(-depth, abs=0.06)


def test_noise_is_what_was_measured_on_the_firmware():
    station = Station(vehicle(STEADY, "sensors.drift_m=0.0"))
    station.command(SET_INTERVAL, 33, 20000).command(SET_INTERVAL, 74, 20000).run(0.1)
    heard = station.run(60.0)
    depth = np.array([m.relative_alt for m in heard.of("GLOBAL_POSITION_INT")]) / 1000
    climb = np.array([m.climb for m in heard.of("VFR_HUD")])
    assert 0.002 < depth.std() < 0.004
    assert 0.003 < climb.std() < 0.0052
    assert 0.0005 < np.diff(depth).std() < 0.0015
    correlation = np.corrcoef(climb[:-40], climb[40:])[0, 1]
    assert correlation == pytest.approx(np.exp(-1), abs=0.2)


def test_depth_is_late_by_its_delay():
    late = []
    for delay in (0.0, 0.1):
        rov = vehicle(STEADY, *QUIET, f"sensors.depth_delay_s={delay}", pulled(20))
        station = Station(rov)
        station.command(SET_INTERVAL, 33, 5000).run(4.0)
        late.append(station.run(0.05).last("GLOBAL_POSITION_INT").relative_alt / 1000)
    speed = rov.truth().nu[2]
    assert late[1] - late[0] == pytest.approx(0.1 * speed, abs=0.003)


def test_battery_sags_under_load():
    rov = vehicle("battery.resistance_ohm=0.02", STEADY)
    station = Station(rov).arm()
    rest = station.run(1.0).last("SYS_STATUS").voltage_battery
    loaded = station.run(3.0, override(forward=400)).last("SYS_STATUS")
    assert loaded.voltage_battery < rest - 500
    assert loaded.current_battery > 4000
    assert rov.truth().voltage_v < 15.6
    before = station.run(1.0, override(forward=400)).last("BATTERY_STATUS")
    after = station.run(20.0, override(forward=400)).last("BATTERY_STATUS")
    used = after.current_consumed - before.current_consumed
    assert used == pytest.approx(after.current_battery / 100 * 20 / 3.6, rel=0.05)
