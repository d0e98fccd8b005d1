import math
from typing import Any

import numpy as np
import pytest
from mavlink_wire import received, seen
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.ardusub import manual_control_reach, quantise
from companion.mavlink.decode import Decoder
from companion.mavlink.encode import Commands
from companion.mavlink.pilot_frames import pilot_sticks
from companion.records import (
    Attitude,
    AxisCommand,
    Battery,
    Depth,
    DepthRate,
    DepthSensor,
    EkfOrigin,
    FirmwareVersion,
    Heartbeat,
    Leak,
    LinkCounters,
    Parameter,
    PilotGain,
    PilotInput,
    PilotToggle,
    Position,
    Pressure,
    Range,
    ReceiverChannels,
    ServoOutput,
    StatusText,
    TimeSync,
)
from companion.telemetry.modes import Mode
from lab.identify.telemetry import motors_of

T = 100.0
NAN, INF = math.nan, math.inf
COMMANDS = Commands(1, 1)
PRESSURE_PARAMETERS = ("BARO_PRIMARY", "BARO2_GND_PRESS", "BARO_SPEC_GRAV")


def about(x: float) -> Any:
    """Stand for any number near x."""
    return pytest.approx(x)


@pytest.fixture
def counters():
    return LinkCounters()


@pytest.fixture
def decoder(counters):
    return Decoder(counters)


def convert(decoder, message, t_s=T):
    return tuple(decoder.to_events(received(message), t_s))


def attitude(boot_ms=2500, roll=0.1, yaw=3.0, r=0.03):
    return mavlink.MAVLink_attitude_message(boot_ms, roll, -0.2, yaw, 0.01, 0.02, r)


def heartbeat(base_mode, mode, status):
    return mavlink.MAVLink_heartbeat_message(12, 3, base_mode, mode, status, 3)


def sys_status(millivolts, present=0, health=0):
    return mavlink.MAVLink_sys_status_message(present, present, health, 0, millivolts, *(0,) * 8)


def named(name, value):
    return mavlink.MAVLink_named_value_float_message(0, name, value)


def version(number):
    none = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(0, number, 0, 0, 0, none, none, none, 0, 0, 1)


def local_position(x, vy=-0.25):
    return mavlink.MAVLink_local_position_ned_message(3000, x, -2.0, 9.0, 0.5, vy, 9.0)


def manual_control(*sticks):
    return mavlink.MAVLink_manual_control_message(1, *sticks, 0)


def override(*channels):
    return mavlink.MAVLink_rc_channels_override_message(1, 1, *channels)


def global_position(relative_alt=0, vz=0, boot_ms=2500):
    return mavlink.MAVLink_global_position_int_message(boot_ms, 0, 0, 0, relative_alt, 0, 0, vz, 0)


def vfr_hud(alt=0.0, climb=0.0):
    return mavlink.MAVLink_vfr_hud_message(0.0, 0.0, 0, 0, alt, climb)


def servo(time_us, port=0, first=1500):
    return mavlink.MAVLink_servo_output_raw_message(time_us, port, first, *range(1501, 1508))


def pressure(boot_ms, hpa):
    return mavlink.MAVLink_scaled_pressure2_message(boot_ms, hpa, 0.0, 0)


def statustext(text, key=0, chunk=0):
    return mavlink.MAVLink_statustext_message(4, text, key, chunk)


def battery(cells, key=0):
    cells = [*cells, *[65535] * (10 - len(cells))]
    return mavlink.MAVLink_battery_status_message(key, 0, 0, 0, cells, 0, 0, 0, 0)


def distance(quality=0, sensor=0, cm=250, orientation=25, limits_cm=(30, 5000)):
    field = {"signal_quality": quality}
    return mavlink.MAVLink_distance_sensor_message(0, *limits_cm, cm, 1, sensor, orientation, 0, **field)


def ekf_report(flags, velocity=0.1, depth=0.2, compass=0.3):
    return mavlink.MAVLink_ekf_status_report_message(flags, velocity, 9.0, depth, compass, 9.0, 9.0)


SOUND_EKF = mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS


class TestRanges:
    @pytest.mark.parametrize(
        ("parameters", "quality", "sound"),
        [
            *[({}, quality, quality in (0, 90, 100)) for quality in (0, 1, 2, 10, 50, 89, 90, 100)],
            *[({"RNGFND_SQ_MIN": 40.0}, quality, quality in (0, 40)) for quality in (0, 1, 39, 40)],
            *[({"RNGFND_SQ_MIN": 0.0}, quality, quality != 1) for quality in (0, 1, 2)],
        ],
    )
    def test_a_weak_signal_is_no_range(self, counters, parameters, quality, sound):
        got = convert(Decoder(counters, parameters=parameters), distance(quality, sensor=3))
        assert got == ((Range(T, 2.5, 3),) if sound else ())

    @pytest.mark.parametrize(
        ("told", "sound"),
        [
            ({"limits_cm": (0, 0)}, True),
            ({"cm": 29}, False),
            ({"cm": 5001}, False),
            ({"cm": 0, "limits_cm": (0, 0)}, False),
            ({"orientation": 0}, False),
            ({"orientation": 24}, False),
        ],
    )
    def test_what_looks_elsewhere_or_is_beyond_its_limits_is_no_range(self, decoder, told, sound):
        assert bool(convert(decoder, distance(**told))) is sound


PARAMETER = mavlink.MAVLink_param_value_message(b"FS_PILOT_INPUT", 2.0, 2, 1370, 7)


class TestSignsAndScales:
    @pytest.mark.parametrize(
        ("message", "events"),
        [
            (heartbeat(209, 19, 4), [Heartbeat(T, True, Mode.MANUAL, 4)]),
            (heartbeat(81, 0, 3), [Heartbeat(T, False, Mode.STABILIZE, 3)]),
            (attitude(), [Attitude(T, 2.5, *map(about, (0.1, -0.2, 3.0, 0.01, 0.02, 0.03)))]),
            (global_position(relative_alt=-5000), [Depth(T, 2.5, 5.0)]),
            (vfr_hud(alt=7.0, climb=-0.3), [DepthRate(T, None, about(0.3))]),
            (local_position(1.0), [Position(T, 3.0, 1.0, -2.0, 0.5, -0.25)]),
            (battery([16000]), [Battery(T, 16.0)]),
            (battery([4000] * 4), [Battery(T, 16.0)]),
            (battery([]), []),
            (battery([0]), []),
            (battery([5000], key=1), [Battery(T, 5.0)]),
            (sys_status(15500), [Battery(T, 15.5)]),
            (sys_status(65535), []),
            (sys_status(0), []),
            (sys_status(0, present=15, health=15), [DepthSensor(T, True)]),
            (sys_status(0, present=15, health=7), [DepthSensor(T, False)]),
            (named(b"PilotGain", 0.5), [PilotGain(T, 0.5)]),
            (named(b"InputHold", 1.0), [PilotToggle(T, "InputHold", True)]),
            (named(b"RollPitch", 0.0), [PilotToggle(T, "RollPitch", False)]),
            (named(b"Lights1", 1.0), []),
            (PARAMETER, [Parameter(T, "FS_PILOT_INPUT", 2.0)]),
            (version(0x04070000), [FirmwareVersion(T, "4.7.0 (dev)", (4, 7, 0))]),
            (version(0x040501FF), [FirmwareVersion(T, "4.5.1", (4, 5, 1))]),
            (version(0x040601C0), [FirmwareVersion(T, "4.6.1 (rc)", (4, 6, 1))]),
            (mavlink.MAVLink_rc_channels_message(0, 16, *[1500] * 18, 255), [ReceiverChannels(T, 16)]),
            (mavlink.MAVLink_system_time_message(1, 2), []),
            *[
                (manual_control(*sticks), [PilotInput(T, deflection)])
                for sticks, deflection in [
                    ((0, 0, 500, 0), 0.0),
                    ((250, 0, 500, 0), 0.25),
                    ((0, -1000, 500, 0), 1.0),
                    ((0, 0, 0, 0), 1.0),
                    ((0, 0, 750, 0), 0.5),
                    ((0, 0, 500, -100), 0.1),
                    ((32767, 0, 500, 0), 1.0),
                ]
            ],
            *[
                (override(*channels), [PilotInput(T, deflection)])
                for channels, deflection in [
                    ((1500,) * 8, 0.0),
                    ((65535,) * 8, 0.0),
                    ((0,) * 8, 0.0),
                    ((1500, 1500, 1300, 1500, 1500, 1500, 1900, 1900), 0.5),
                    ((1500, 1500, 1500, 2000, 65535, 1500, 0, 0), 1.0),
                ]
            ],
        ],
        ids=str,
    )
    def test_a_message_is_these_events(self, decoder, counters, message, events):
        assert convert(decoder, message) == tuple(events)
        assert counters.implausible == 0

    def test_depth_of_pressure(self, counters):
        """Of the barometer in the water, against the surface and the water that the autopilot knows."""
        reported = dict(zip(PRESSURE_PARAMETERS, (1.0, 1e5, 1.025), strict=True))
        decoder = Decoder(counters, depth_source="pressure", parameters=reported)
        below_m, all_m = 1e5 / (9800 * 1.025), 2e5 / (9800 * 1.025)
        felt = Pressure(T, 1.0, about(all_m))
        assert convert(decoder, pressure(1000, 2000.0)) == (Depth(T, 1.0, about(below_m)), felt)
        alone = Decoder(counters, parameters=reported)
        assert convert(alone, pressure(1000, 2000.0)) == (felt,), "beside relative_alt"
        hull = mavlink.MAVLink_scaled_pressure_message(1010, 2100.0, 0.0, 0)
        assert convert(decoder, hull) == ()
        reported |= {"BARO_PRIMARY": 0.0, "BARO1_GND_PRESS": 1.1e5}
        event, _ = convert(decoder, hull)
        assert event.z_m == pytest.approx(below_m)

    @pytest.mark.parametrize("unknown", range(3))
    def test_pressure_is_no_depth_before_the_autopilot_has_told_its_zero(self, counters, unknown):
        reported = dict(zip(PRESSURE_PARAMETERS, (1.0, 1e5, 1.025), strict=True))
        del reported[PRESSURE_PARAMETERS[unknown]]
        decoder = Decoder(counters, depth_source="pressure", parameters=reported)
        assert not any(isinstance(event, Depth) for event in convert(decoder, pressure(1000, 2000.0)))

    @pytest.mark.parametrize("hpa", [NAN, INF, -INF, 3e38])
    def test_an_absurd_pressure_is_none(self, counters, hpa):
        reported = dict(zip(PRESSURE_PARAMETERS, (1.0, 1e5, 1.0), strict=True))
        for source in ("relative_alt", "pressure"):
            assert (
                convert(Decoder(counters, depth_source=source, parameters=reported), pressure(1, hpa)) == ()
            )
        assert counters.implausible == 2

    def test_a_repeated_pressure_is_no_new_reading(self, counters):
        reported = dict(zip(PRESSURE_PARAMETERS, (1.0, 1e5, 1.0), strict=True))
        decoder = Decoder(counters, depth_source="pressure", parameters=reported)
        stamps = (1000, 1020, 1040, 1210, 1230)
        got = [len(convert(decoder, pressure(ms, 1500.0))) for ms in stamps]
        assert got == [2, 0, 0, 2, 0]

    def test_the_origin_is_reported_when_it_changes(self, decoder):
        def at(lat, boot_ms):
            return mavlink.MAVLink_global_position_int_message(boot_ms, lat, 0, 0, -1000, 0, 0, 0, 0)

        reported = [
            convert(decoder, at(lat, ms))[1:] for ms, lat in enumerate((0, 0, 471234567, 471234567, 0))
        ]
        assert reported == [(), (), (EkfOrigin(T, True),), (), (EkfOrigin(T, False),)]


class TestAbsurdity:
    @pytest.mark.parametrize(
        "message",
        [
            attitude(yaw=NAN),
            attitude(yaw=INF),
            attitude(yaw=6.4),
            attitude(roll=-6.4),
            attitude(r=-1e3),
            global_position(relative_alt=-12_001_000),
            global_position(relative_alt=12_001_000),
            vfr_hud(climb=NAN),
            vfr_hud(climb=21.0),
            vfr_hud(climb=-21.0),
            local_position(NAN),
            local_position(0.0, vy=INF),
            named(b"PilotGain", NAN),
            named(b"PilotGain", 1.01),
            named(b"PilotGain", -0.01),
            named(b"InputHold", NAN),
            mavlink.MAVLink_param_value_message(b"X", NAN, 9, 1, 1),
            *(ekf_report(SOUND_EKF, **{k: v}) for k in ("velocity", "depth", "compass") for v in (NAN, INF)),
            mavlink.MAVLink_timesync_message(-5, round(T * 1e9)),
        ],
    )
    def test_is_counted_and_says_nothing(self, decoder, counters, message):
        assert convert(decoder, message) == ()
        assert counters.implausible == 1

    def test_an_absurd_attitude_does_not_move_the_clock(self, decoder):
        convert(decoder, attitude(boot_ms=1000))
        convert(decoder, attitude(boot_ms=2_000_000_000, yaw=NAN))
        assert convert(decoder, servo(1_010_000))[0].boot_s == pytest.approx(1.01)


class TestBootClock:
    def test_servo_output_waits_for_a_clock(self, decoder):
        assert convert(decoder, servo(1_000_000)) == ()
        convert(decoder, attitude(boot_ms=1000))
        (event,) = convert(decoder, servo(1_000_000))
        assert event == ServoOutput(T, 1.0, (1500, 1501, 1502, 1503, 1504, 1505, 1506, 1507))

    def test_servo_output_of_port_1_and_absurd_pulses_are_dropped(self, decoder, counters):
        convert(decoder, attitude(boot_ms=1000))
        assert convert(decoder, servo(1_000_000, port=1)) == ()
        assert counters.implausible == 0
        assert convert(decoder, servo(1_000_000, first=65535)) == ()
        assert counters.implausible == 1

    @pytest.mark.parametrize("wraps", [1, 3])
    def test_microseconds_that_wrapped_are_unwrapped(self, decoder, wraps):
        wrap_s = 2**32 / 1e6
        for boot_s in (wraps * wrap_s - 0.02, wraps * wrap_s + 0.02):
            convert(decoder, attitude(boot_ms=round(boot_s * 1e3)))
            (event,) = convert(decoder, servo(round(boot_s * 1e6) % 2**32))
            assert event.boot_s == pytest.approx(boot_s, abs=1e-5)

    def test_milliseconds_that_wrap_go_on(self, decoder):
        wrap_s = 2**32 / 1e3
        assert convert(decoder, attitude(boot_ms=2**32 - 10))[0].boot_s == pytest.approx(wrap_s - 0.01)
        assert convert(decoder, attitude(boot_ms=10))[0].boot_s == pytest.approx(wrap_s + 0.01)

    def test_a_reboot_goes_back(self, decoder, counters):
        convert(decoder, attitude(boot_ms=3_000_000))
        for boot_ms in range(4000, 4400, 20):
            assert convert(decoder, attitude(boot_ms))[0].boot_s == pytest.approx(1e-3 * boot_ms)
        assert convert(decoder, servo(4_410_000))[0].boot_s == pytest.approx(4.41)

    @pytest.mark.parametrize("absurd", [2**32 - 1, 2**31])
    def test_an_absurd_stamp_counts_no_wrap(self, decoder, absurd):
        convert(decoder, attitude(boot_ms=4000))
        convert(decoder, attitude(boot_ms=absurd))
        assert convert(decoder, attitude(boot_ms=4020))[0].boot_s == pytest.approx(4.02)
        assert convert(decoder, servo(4_030_000))[0].boot_s == pytest.approx(4.03)

    def test_an_absurd_timesync_does_not_move_the_clock(self, decoder):
        convert(decoder, attitude(boot_ms=4000))
        convert(decoder, mavlink.MAVLink_timesync_message(2**63 - 1, round((T - 0.004) * 1e9)))
        assert convert(decoder, attitude(boot_ms=4020))[0].boot_s == pytest.approx(4.02)

    def test_timesync_answers_ours_alone(self, decoder):
        ours = round((T - 0.004) * 1e9)
        boot_ns = 50 * 86_400 * 10**9
        (event,) = convert(decoder, mavlink.MAVLink_timesync_message(boot_ns, ours))
        assert event == TimeSync(T, about(T - 0.004), 50 * 86_400.0)
        assert convert(decoder, mavlink.MAVLink_timesync_message(0, 12345)) == ()
        assert convert(decoder, mavlink.MAVLink_timesync_message(7, round(1.7e18))) == ()
        later_ms = (50 * 86_400_000 + 20) % 2**32
        assert convert(decoder, attitude(boot_ms=later_ms))[0].boot_s == pytest.approx(50 * 86_400 + 0.02)


class TestManualControl:
    @pytest.mark.parametrize("gain", [0.0, -1.0, NAN, INF])
    def test_absurd_gain_is_neutral(self, gain):
        message = COMMANDS.manual_control(AxisCommand(1.0, 1.0, 1.0, 1.0), gain, 1.0)
        assert (message.x, message.y, message.z, message.r) == (0, 0, 500, 0)
        assert manual_control_reach(gain, 1.0) == AxisCommand()


@pytest.mark.parametrize("gain", [0.1, 0.25, 0.35, 0.5, 0.62500001, 1.0])
def test_neutral_stays_neutral(gain):
    assert quantise(AxisCommand(), "manual_control", gain, 1.0) == AxisCommand()


@pytest.mark.parametrize(
    ("flags", "attitude", "depth"),
    [
        (SOUND_EKF, True, True),
        (SOUND_EKF | mavlink.EKF_CONST_POS_MODE, True, True),
        (SOUND_EKF & ~mavlink.EKF_ATTITUDE, False, True),
        (SOUND_EKF & ~mavlink.EKF_VELOCITY_VERT, True, False),
        (SOUND_EKF & ~mavlink.EKF_POS_VERT_ABS, True, False),
        (SOUND_EKF | mavlink.EKF_UNINITIALIZED, True, False),
        (0, False, False),
    ],
)
def test_what_the_ekf_says_it_has(decoder, flags, attitude, depth):
    (event,) = convert(decoder, ekf_report(flags))
    assert (event.attitude, event.depth) == (attitude, depth)


@pytest.mark.parametrize("worst", ["velocity", "depth", "compass"])
def test_the_ekfs_worst_variance_counts_but_not_the_horizontal_ones(decoder, worst):
    (event,) = convert(decoder, ekf_report(SOUND_EKF, **{worst: 0.7}))
    assert event.variance == pytest.approx(0.7)


def test_a_text_cannot_forge_a_line_of_the_log_or_steer_a_terminal(decoder):
    """Control and format characters come out escaped; a chunk is still judged by its own length."""
    (forged,) = convert(decoder, statustext(b"ok\n2026 ACTIVE: engaged\x1b[2J\x7f\t"))
    assert forged.text == "ok\\n2026 ACTIVE: engaged\\x1b[2J\\x7f\\t"
    assert convert(decoder, statustext(b"\r" * 50, 7, 0)) == ()
    (joined,) = convert(decoder, statustext(b"end", 7, 1))
    assert joined.text == "\\r" * 50 + "end"


@pytest.mark.parametrize(
    ("text", "leak"), [("Leak Detected", True), ("LEAK DETECTED", True), ("No leak", False)]
)
def test_a_leak_is_told_from_other_texts(decoder, text, leak):
    events = convert(decoder, mavlink.MAVLink_statustext_message(2, text.encode(), 0, 0))
    assert events[0] == StatusText(T, 2, text)
    assert (Leak(T) in events) == leak


def test_the_battery_is_the_first_that_has_a_voltage(decoder):
    """Of an autopilot whose first battery monitor is off, the second; of two, the first from then on."""
    told = [battery([0], key=0), battery([15000], key=2), sys_status(0), battery([15100], key=2)]
    told += [battery([16000], key=0), battery([15200], key=2), sys_status(16100)]
    volts = [event.voltage_v for message in told for event in convert(decoder, message)]
    assert volts == [15.0, 15.1, 16.0, 16.1]


@pytest.mark.parametrize(
    ("pwm_us", "direction", "expected"),
    [(1600, -1.0, 1400), (1600, 1.0, 1600), (1600, 0.0, 1600), (0, -1.0, 0), (1100, -1.0, 1900)],
)
def test_a_reversed_motor_is_turned_round_and_an_idle_one_stays_idle(counters, pwm_us, direction, expected):
    decoder = Decoder(counters, parameters={"MOT_1_DIRECTION": direction})
    convert(decoder, attitude(boot_ms=1000))
    (event,) = convert(decoder, servo(1_000_000, first=pwm_us))
    assert event.pwm_us == (expected, *range(1501, 1508))


@pytest.mark.parametrize(
    ("functions", "expected"),
    [
        ({}, (1, 2, 3, 4, 5, 6, 7, 8)),
        ({1: 34, 2: 33}, (2, 1, 3, 4, 5, 6, 7, 8)),
        ({n: 41 - n for n in range(1, 9)}, (8, 7, 6, 5, 4, 3, 2, 1)),
        ({5: 0, 9: 37}, (1, 2, 3, 4, 9, 6, 7, 8)),
        ({9: 37}, (1, 2, 3, 4, 9, 6, 7, 8)),
        (dict.fromkeys(range(1, 9), 0) | {n: 24 + n for n in range(9, 17)}, (*range(9, 17),)),
        ({7: 0, 8: 59}, (1, 2, 3, 4, 5, 6, 0, 0)),
    ],
    ids=["unknown", "swapped", "reversed", "moved", "moved, the old one unknown", "all moved", "six motors"],
)
def test_motors_are_read_at_the_outputs_that_drive_them(counters, functions, expected):
    """By SERVOn_FUNCTION, in flight and in logs."""
    said = {f"SERVO{output}_FUNCTION": float(function) for output, function in functions.items()}
    decoder = Decoder(counters, parameters=said)
    convert(decoder, attitude(boot_ms=1000))
    message = mavlink.MAVLink_servo_output_raw_message(1_000_000, 0, *range(1501, 1517))
    (event,) = convert(decoder, message)
    assert event.pwm_us == tuple(1500 + output if output else 0 for output in expected)
    row = np.array([[0.0, *(1500.0 + output for output in range(1, 17))]])
    demands = [output / 400.0 for output in expected]
    assert motors_of(row, said, np.ones(1))[0, 1:] == pytest.approx(demands)


def test_the_origin_is_sent_in_ten_millionths_of_a_degree():
    message = seen(COMMANDS.set_origin(47.3977, -8.5456))
    assert (message.latitude, message.longitude) == (473977000, -85456000)
    assert message.target_system == 1


INT16_MAX = 32767


def sticks(x=0, y=0, z=500, r=0, buttons=0, s=0, t=0):
    message = mavlink.MAVLink_manual_control_message(1, x, y, z, r, buttons, 0, 3, s, t)
    return pilot_sticks(received(message), T).sticks


@pytest.mark.parametrize(
    ("moved", "expected"),
    [
        ({"z": 750}, AxisCommand(heave=-0.5)),
        ({"z": 0}, AxisCommand(heave=1.0)),
        ({"s": 200}, AxisCommand(pitch=0.5)),
        ({"t": -100}, AxisCommand(roll=-0.25)),
        ({"x": -32768, "r": 5000, "s": 4000}, AxisCommand(surge=-1.0, yaw=1.0, pitch=1.0)),
        ({"x": INT16_MAX, "y": INT16_MAX, "z": INT16_MAX, "r": INT16_MAX}, AxisCommand()),
    ],
)
def test_the_pilots_sticks_in_our_axes(moved, expected):
    assert sticks(**moved) == expected


def test_chunks_of_another_text_do_not_go_on_with_this_one(decoder):
    """Another id, or a gap in the numbers, begins anew."""
    convert(decoder, statustext(b"a" * 50, 1, 0))
    (cut, whole) = convert(decoder, statustext(b"b", 2, 1))
    assert (cut.text, whole.text) == ("a" * 50, "b")
    convert(decoder, statustext(b"c" * 50, 3, 0))
    (cut, whole) = convert(decoder, statustext(b"d", 3, 2))
    assert (cut.text, whole.text) == ("c" * 50, "d")
