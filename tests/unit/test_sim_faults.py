"""Each kind of fault does what its row of the table says, from its time, for its duration."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import CONFIG, SET_INTERVAL, Station, is_finite, override, vehicle

from sim_bridge.commands import shipped
from sim_bridge.fault_kinds import FAULT_KINDS, Fault
from sim_bridge.faults import Faults
from sim_bridge.listing import listing
from sim_bridge.sim_config import ConfigError, fault_of
from sim_bridge.zenoh_link import answer


def station_with(*faults, **options):
    rov = vehicle("initial.eta=[0,0,5,0,0,0]", **options)
    station = Station(rov)
    station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 20000).run(0.98)
    for fault in faults:
        rov.inject(Fault(**fault))
    return station


def attitudes(station, seconds):
    return station.run(seconds).of("ATTITUDE")


def test_a_frozen_message_repeats_itself():
    station = station_with({"kind": "message_frozen", "message": "ATTITUDE", "at_s": 1.0, "duration_s": 1.0})
    station.run(0.06)
    frozen = attitudes(station, 0.8)
    assert len(frozen) > 30
    assert len({(m.time_boot_ms, m.roll) for m in frozen}) == 1
    station.run(0.3)
    assert len({m.time_boot_ms for m in attitudes(station, 0.5)}) > 20


def test_nan_and_extreme_messages():
    station = station_with({"kind": "message_nan", "message": "ATTITUDE", "at_s": 1.0, "duration_s": 0.5})
    station.run(0.04)
    assert all(math.isnan(m.roll) for m in attitudes(station, 0.4))
    station = station_with(
        {"kind": "message_extreme", "message": "GLOBAL_POSITION_INT", "at_s": 1.0, "value": 1e30}
    )
    assert station.run(1.0).last("GLOBAL_POSITION_INT").relative_alt == 2147483647
    station = station_with({"kind": "message_extreme", "message": "VFR_HUD", "at_s": 1.0, "value": -1e6})
    assert station.run(1.0).last("VFR_HUD").alt == -1e6


@pytest.mark.parametrize(
    ("kind", "share", "seconds", "heard", "within"),
    [("link_lossy", 0.3, 20.0, 700, 70), ("link_duplicating", 1.0, 1.0, 100, 4)],
)
def test_a_link_loses_its_share_or_says_things_twice(kind, share, seconds, heard, within):
    station = station_with({"kind": kind, "at_s": 0.0, "value": share})
    assert len(attitudes(station, seconds)) == pytest.approx(heard, abs=within)


def test_a_stuck_thruster_obeys_nobody():
    rov = vehicle("initial.eta=[0,0,5,0,0,0]")
    station = Station(rov).arm()
    rov.inject(Fault("thruster_stuck", at_s=rov.time_s, duration_s=2.0, thruster=3, value=1700))
    station.run(1.5, override())
    assert rov.truth().thrust_n[2] == pytest.approx(17.9, rel=0.05)
    assert rov.truth().motor_pwm[2] == 1500
    station.run(2.0, override())
    assert abs(rov.truth().thrust_n[2]) < 0.1


def test_a_stick_moves_the_vehicle_and_every_link_hears_of_it():
    rov, heard = vehicle(), mavlink.MAVLink(None)
    rov.open_link(0)
    sticks = []
    rov.inject(Fault("stick", axis="z", value=-1.0, duration_s=1.0))
    for _ in range(round(2.0 / rov.step_s)):
        out = b"".join(data for _, data in rov.step())
        messages = heard.parse_buffer(out) or []
        sticks += [m for m in messages if m.get_type() == "MANUAL_CONTROL"]
    assert len(sticks) == 10  # a second of ten a second: then it is released
    assert {(m.get_srcSystem(), m.target, m.x, m.y, m.z, m.r) for m in sticks} == {(255, 1, 0, 0, 0, 0)}
    assert rov.autopilot.pilot.channels[2] < 1500  # down


def test_clear_ends_what_holds_and_leaves_what_comes_later():
    faults = Faults(
        (Fault("leak", at_s=0.1), Fault("clear", at_s=0.5), Fault("ekf", at_s=1.0)), np.random.default_rng(1)
    )
    for at_s, held in ((0.4, {"leak"}), (0.8, set()), (1.2, {"ekf"})):
        faults.advance(at_s)
        assert {kind for kind in ("leak", "clear", "ekf") if faults.holds(kind)} == held


def test_a_fault_of_the_command_line():
    assert fault_of("leak") == Fault("leak")
    assert fault_of("message_frozen,message=ATTITUDE,at_s=3") == Fault(
        "message_frozen", message="ATTITUDE", at_s=3.0
    )
    for text, word in (
        ("leek", "leek"),
        ("leak,at_s", "key=value"),
        ("leak,at_s=-1", "at_s"),
        ("leak,a=1", "a"),
    ):
        with pytest.raises(ConfigError, match=word):
            fault_of(text)


@given(
    st.one_of(
        st.binary(max_size=60),
        st.fixed_dictionaries(
            {"kind": st.sampled_from(sorted(FAULT_KINDS))},
            optional={
                "value": st.floats(allow_nan=False, allow_infinity=False),
                "at_s": st.floats(0, 0.1),
                "duration_s": st.floats(0.01, 1e308),
                "thruster": st.integers(-1, 9),
                "count": st.integers(0, 20),
                "parameter": st.sampled_from(["", "FS_LEAK_ENABLE", "BARO_SPEC_GRAV", "NO_SUCH"]),
                "message": st.sampled_from(["", "ATTITUDE", "NO_SUCH"]),
            },
        ).map(msgspec.json.encode),
    )
)
def test_whatever_is_asked_for_live_the_vehicle_goes_on(payload):
    rov = vehicle("sensors.dvl=true", "initial.eta=[0,0,3,0,0,0]")
    asked: list[Fault] = []
    reply = answer(payload, asked.append)
    assert reply.done == bool(asked)
    for fault in asked:
        rov.inject(fault)
    Station(rov).run(0.4, override())
    assert is_finite(rov)


def test_a_parameter_that_ardusub_does_not_have_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match="ArduSub has none of this name; is it FS_PILOT_INPUT or "):
        vehicle("faults=[{kind='parameter', parameter='FS_PILOT_INPT'}]")
    with pytest.raises(ValueError, match="FS_PILOT_TIMEOUTT"):
        vehicle("parameters.FS_PILOT_TIMEOUTT=1.0")


def test_the_list_names_every_shipped_dive_and_every_fault():
    text = listing(shipped())
    assert all(f"\n  {name} " in text for name in shipped())
    assert set(shipped().values()) == set(CONFIG.parent.glob("sim*.toml"))
    assert all(f"\n  {kind} " in text for kind in FAULT_KINDS)


def test_a_yaw_reset_turns_yaw_and_motion_over_ground_but_no_rate_and_no_place():
    adrift = ("current.enabled=true", "current.speed_m_s=0.3", "current.direction_deg=0")
    rov = vehicle("initial.eta=[2,1,5,0,0,0]", "sensors.dvl=true", *adrift)
    station = Station(rov)
    station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 20000)
    station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20000).run(1.0)
    (x, y), psi = rov.truth().eta[:2], rov.truth().eta[5]
    rov.inject(Fault("yaw_reset", at_s=rov.time_s, duration_s=0.2, value=45.0, count=2))
    heard = station.run(0.3)
    assert heard.last("ATTITUDE").yaw == pytest.approx(psi + math.pi / 2, abs=0.05)
    assert abs(heard.last("ATTITUDE").yawspeed) < 0.1
    place = heard.last("LOCAL_POSITION_NED")
    assert (place.x, place.y) == pytest.approx((x, y), abs=0.15)
    assert [m.text for m in heard.of("STATUSTEXT")].count(
        "EKF3 IMU0 MAG0 in-flight yaw alignment complete"
    ) == 2
    place = station.run(8.0).last("LOCAL_POSITION_NED")
    north, east = rov.truth().eta[:2] - (x, y)
    assert north > 1.0
    assert (place.x - x, place.y - y) == pytest.approx((-east, north), abs=0.15)


def heights(station, seconds):
    """Return what relative_alt says and what is true, m."""
    pairs = []
    for _ in range(round(seconds / 0.05)):
        heard = station.run(0.05).of("GLOBAL_POSITION_INT")
        pairs += [(m.relative_alt / 1000.0, -station.rov.truth().eta[2]) for m in heard]
    return zip(*pairs, strict=True)


def streaming_depth(*overrides):
    rov = vehicle("initial.eta=[0,0,5,0,0,0]", *overrides)
    station = Station(rov)
    station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 50000).run(1.0)
    return rov, station


def test_noise_of_the_depth_is_slow_and_as_large_as_asked():
    rov, station = streaming_depth()
    rov.inject(Fault("depth_noise", at_s=rov.time_s, duration_s=40.0, value=0.02))
    reported, true = heights(station, 40.0)
    errors = np.subtract(reported, true)
    assert np.std(errors) == pytest.approx(0.02, rel=0.4)
    assert np.std(np.diff(errors)) < 0.4 * np.std(errors)
    station.run(0.2)
    reported, true = heights(station, 10.0)
    assert np.std(np.subtract(reported, true)) < 0.008


def test_a_depth_that_lags_shows_a_part_of_the_motion_later():
    quiet = [f"sensors.depth_{name}_m=0.0" for name in ("slow", "white")]
    rov, station = streaming_depth(*quiet, "waves.enabled=true", "waves.height_m=1.0", "waves.period_s=5.0")
    rov.inject(Fault("depth_lag", at_s=rov.time_s, value=0.15))
    reported, true = map(np.array, heights(station, 30.0))
    reported, true = reported - reported.mean(), true - true.mean()
    left = [float(np.std(reported[10:] - 0.71 * true[10 - late : len(true) - late])) for late in range(10)]
    assert 0.15 <= 0.05 * left.index(min(left)) <= 0.25
    assert min(left) < 0.2 * np.std(true)
