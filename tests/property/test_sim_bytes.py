"""Whatever bytes arrive, the vehicle neither raises nor leaves the finite numbers; no stick can break it."""

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import Station, is_finite, vehicle


@given(st.lists(st.binary(max_size=400), max_size=8))
def test_any_bytes(chunks):
    rov = vehicle()
    for chunk in chunks:
        rov.step([(0, chunk), (3, chunk)])
    assert is_finite(rov)


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
