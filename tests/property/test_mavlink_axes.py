"""Whatever is demanded, the vehicle gets a bounded command, and we know which."""

from hypothesis import given
from hypothesis import strategies as st

from companion.config import LinkSection
from companion.mavlink.ardusub import manual_control_reach, quantise
from companion.mavlink.codec import Codec
from companion.mavlink.encode import Commands
from companion.records import AxisCommand

COMMANDS = Commands(1, 1)
CODEC = Codec(LinkSection())
HALF_US = 0.5 / 400 + 1e-9

any_command = st.builds(AxisCommand, *[st.floats()] * 6)
unit = st.floats(-1.0, 1.0)
unit_command = st.builds(AxisCommand, *[unit] * 6)
any_gain = st.floats()
gain = st.floats(0.1, 1.0)
throttle_gain = st.floats(0.5, 4.0)


@given(any_command)
def test_override_is_bounded_or_leaves_alone(command):
    message = COMMANDS.rc_override(command)
    channels = [getattr(message, f"chan{n}_raw") for n in range(1, 19)]
    assert all(1100 <= us <= 1900 for us in channels[2:6])
    assert all(us == 65535 for us in channels[:2] + channels[6:8])
    assert not any(channels[8:])
    CODEC.encode(message)


@given(any_command, any_gain, any_gain)
def test_manual_control_is_bounded(command, gain, throttle_gain):
    message = COMMANDS.manual_control(command, gain, throttle_gain)
    assert all(-1000 <= stick <= 1000 for stick in (message.x, message.y, message.r))
    assert 0 <= message.z <= 1000
    CODEC.encode(message)


@given(unit_command)
def test_override_rounds_by_half_a_step_at_most(command):
    applied = quantise(command, "rc_override")
    assert all(abs(a - b) <= HALF_US for a, b in zip(applied, command, strict=True))
    assert quantise(applied, "rc_override") == applied


@given(unit_command, gain, throttle_gain)
def test_manual_control_undoes_the_gain(command, gain, throttle_gain):
    """Half a stick step, and the whole µs that the firmware cuts off (two for the throttle)."""
    applied = quantise(command, "manual_control", gain, throttle_gain)
    reach = manual_control_reach(gain, throttle_gain)
    for name, full_stick, steps, cut_us in (
        ("surge", gain, 1000, 1),
        ("sway", gain, 1000, 1),
        ("yaw", gain, 1000, 1),
        ("heave", gain * throttle_gain, 500, 2),
    ):
        limit = getattr(reach, name)
        wanted = min(limit, max(-limit, getattr(command, name)))
        assert abs(getattr(applied, name) - wanted) <= full_stick / steps / 2 + cut_us / 400 + 1e-6


@given(unit, unit, gain)
def test_more_demand_never_gives_less(a, b, gain):
    low, high = sorted((a, b))
    for path in ("rc_override", "manual_control"):
        less = quantise(AxisCommand(low, low, low, low), path, gain)
        more = quantise(AxisCommand(high, high, high, high), path, gain)
        assert all(x <= y for x, y in zip(less, more, strict=True))
