"""Whatever bytes arrive, the vehicle neither raises nor leaves the finite numbers; no stick can break it."""

import math

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import Station, is_finite, manual, vehicle

floats = st.one_of(st.floats(width=32), st.sampled_from([math.nan, math.inf, -math.inf, 3e38, -1.0, 0.0]))
uint16 = st.integers(0, 65535)
int16 = st.integers(-32768, 32767)
int32 = st.integers(-(2**31), 2**31 - 1)
target = st.sampled_from([0, 1, 1, 1, 2, 255])

commands = st.builds(
    mavlink.MAVLink_command_long_message,
    target,
    st.integers(0, 255),
    st.one_of(st.sampled_from([400, 176, 511, 510, 512, 520, 246, 241, 410]), uint16),
    st.integers(0, 255),
    *[st.one_of(floats, st.integers(-1, 40).map(float))] * 7,
)
overrides = st.lists(uint16, min_size=18, max_size=18).map(
    lambda values: mavlink.MAVLink_rc_channels_override_message(1, 1, *values)
)
manuals = st.builds(manual, int16, int16, int16, int16, uint16, int16, int16, target)
names = st.sampled_from(
    [b"FS_PILOT_TIMEOUT", b"JS_THR_GAIN", b"ATC_ANG_YAW_P", b"PSC_VELZ_P", b"BARO_SPEC_GRAV", b"MAV_SYSID"]
)
sets = st.builds(
    mavlink.MAVLink_param_set_message,
    target,
    target,
    st.one_of(names, st.binary(max_size=16)),
    floats,
    st.just(9),
)
reads = st.builds(mavlink.MAVLink_param_request_read_message, target, target, st.binary(max_size=16), int16)
origins = st.builds(mavlink.MAVLink_set_gps_global_origin_message, target, int32, int32, int32)
streams = st.builds(
    mavlink.MAVLink_request_data_stream_message,
    target,
    target,
    st.integers(0, 255),
    uint16,
    st.integers(0, 255),
)
modes = st.builds(mavlink.MAVLink_set_mode_message, target, st.integers(0, 255), st.integers(0, 2**32 - 1))
depths = st.builds(
    mavlink.MAVLink_set_position_target_global_int_message,
    st.just(0),
    target,
    target,
    st.just(5),
    st.just(0b110111111011),
    int32,
    int32,
    *[floats] * 9,
)
messages = st.lists(
    st.one_of(commands, overrides, manuals, sets, reads, origins, streams, modes, depths),
    min_size=1,
    max_size=12,
)


@given(st.lists(st.binary(max_size=400), max_size=8))
def test_any_bytes(chunks):
    rov = vehicle()
    for chunk in chunks:
        rov.step([(0, chunk), (3, chunk)])
    assert is_finite(rov)


@given(messages)
def test_any_messages(hostile):
    rov = vehicle("initial.eta=[0,0,5,0,0,0]", "parameters={FS_PILOT_INPUT=0, FS_GCS_ENABLE=0}")
    station = Station(rov).arm()
    for message in hostile:
        station.say(message).run(0.02)
    station.run(0.3)
    assert is_finite(rov)
    assert all(1100 <= pwm <= 1900 for pwm in rov.truth().motor_pwm)


@given(
    st.sampled_from([0, 1, 2, 19]),
    st.lists(st.lists(st.integers(1100, 1900), min_size=6, max_size=6), min_size=1, max_size=6),
)
def test_any_stick_in_any_mode_keeps_the_vehicle_in_the_water(mode, sticks):
    rov = vehicle("waves.enabled=true", "initial.eta=[0,0,5,0,0,0]")
    station = Station(rov).arm(mode)
    for stick in sticks:
        station.run(
            0.5, mavlink.MAVLink_rc_channels_override_message(1, 1, *stick, 65535, 65535), every_s=0.1
        )
    assert is_finite(rov)
    assert abs(rov.truth().nu).max() < 30
