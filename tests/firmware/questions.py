"""What the real ArduSub and our stand-in are both asked. A question takes a partner and gives named answers.

The partner's vehicle has just booted. An answer is compared with the other one's as it is; a float, as Near,
within the larger of the two tolerances.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import ARM, MANUAL, REQUEST, SET_INTERVAL, SET_MODE, Heard, Station, manual

from sim_bridge.firmware.reports import STREAMED

Answers = Iterator[tuple[str, Any]]
REBOOT = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
NAN = math.nan
UNKNOWN_MESSAGE, UNKNOWN_COMMAND = 9999, 59999
MODES = {
    **{"STABILIZE": 0, "ACRO": 1, "ALT_HOLD": 2, "AUTO": 3, "GUIDED": 4, "unknown mode 5": 5, "CIRCLE": 7},
    **{"SURFACE": 9, "POSHOLD": 16, "MANUAL": 19, "MOTOR_DETECT": 20, "SURFTRAK": 21, "unknown mode 99": 99},
}
OFF_CENTRE = {
    **{"x 500": manual(x=500), "y 500": manual(y=500), "z 700": manual(z=700), "z 530": manual(z=530)},
    **{"r 500": manual(r=500), "r 100": manual(r=100), "s 25": manual(s=25), "s 100": manual(s=100)},
    **{"t -100": manual(t=-100), "r, s, t and z": manual(z=900, r=500, s=100, t=100)},
}
STICKS = {
    **{f"x {x}": manual(x=x) for x in (1000, -1000, -32768)},
    **{f"z {z}": manual(z=z) for z in (0, 1000, 520)},
    **{f"r {r}": manual(r=r) for r in (1000, -300)},
    **{"y 500": manual(y=500), "all 1000": manual(1000, 1000, 1000, 1000)},
    **{"beyond": manual(32767, 32767, 32767, 32767), "s 100": manual(s=100), "t -100": manual(t=-100)},
}
LEFT_ALONE = 65535
OVERRIDES = {
    "forward 1700": (LEFT_ALONE, LEFT_ALONE, LEFT_ALONE, LEFT_ALONE, 1700, LEFT_ALONE),
    "throttle 1900, yaw 1100": (LEFT_ALONE, LEFT_ALONE, 1900, 1100, 1500, LEFT_ALONE),
    "out of range": (900, 2500, 1500, 1500, 1500, 1500),
    "released by 0": (0,) * 6,
    "neutral": (1500,) * 6,
}


class Near(NamedTuple):
    """A number, and how far the other one's may be from it."""

    value: float
    tolerance: float


class Partner(Station):
    """A ground station and pilot, system 255: it goes on with heartbeats and sticks while it listens."""

    def __init__(self, vehicle: Any) -> None:
        super().__init__(vehicle, link=1)
        self.parser.robust_parsing = True
        self.heartbeats = True
        self.sticks: Any = None
        """What is sent 20 times a second."""
        self._beat_s = self._stick_s = vehicle.time_s

    def listen(self, seconds: float) -> Heard:
        """Let `seconds` pass; return what the vehicle said."""
        heard = Heard()
        until_s = self.rov.time_s + seconds - 1e-9
        while self.rov.time_s < until_s:
            now_s = self.rov.time_s
            if self.heartbeats and now_s >= self._beat_s:
                self._beat_s = now_s + 1.0
                self.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            if self.sticks is not None and now_s >= self._stick_s:
                self._stick_s = now_s + 0.05
                self.say(self.sticks)
            heard += [
                (t_s, m) for t_s, m in self.run() if m.get_type() != "BAD_DATA" and m.get_srcSystem() == 1
            ]
        return heard

    def ask(self, message: Any, seconds: float = 0.25) -> Heard:
        """Send and listen."""
        self.say(message)
        return self.listen(seconds)

    def order(self, number: int, *parameters: float, seconds: float = 0.25) -> Heard:
        """Send a COMMAND_LONG and listen."""
        self.command(number, *parameters)
        return self.listen(seconds)

    def sampled(self, seconds: float, what: Callable[[Any], float]) -> list[float]:
        """Return a quantity of the truth 20 times a second."""
        values = []
        for _ in range(round(seconds / 0.05)):
            self.listen(0.05)
            values.append(float(what(self.rov.truth())))
        return values


def result(heard: Heard, command: int) -> int | str:
    """Return the result that a COMMAND_ACK gave for a command."""
    results = [ack.result for ack in heard.of("COMMAND_ACK") if ack.command == command]
    return int(results[0]) if results else "no answer"


def texts(heard: Heard) -> tuple[str, ...]:
    """Return the texts that were said, with severity; chunks of one text are joined."""
    said: list[str] = []
    for message in heard.of("STATUSTEXT"):
        if message.id and message.chunk_seq and said:
            said[-1] += message.text
        else:
            said.append(f"{message.severity}: {message.text}")
    return tuple(said)


def streams(partner: Partner) -> Answers:
    """Rates with nobody asking."""
    for kind, number in sorted(Counter(m.get_type() for _, m in partner.listen(10.0)).items()):
        yield f"{kind}, Hz", Near(number / 10.0, 0.15)


def fields(partner: Partner) -> Answers:
    """Each field of each streamed message of a vehicle at rest, without the times."""
    seen: dict[str, list[Any]] = defaultdict(list)
    for _, message in partner.listen(6.0):
        kind = message.get_type()
        if kind == "NAMED_VALUE_FLOAT":
            seen[f"{kind}.{message.name}"].append(message.value)
        elif kind not in ("STATUSTEXT", "TIMESYNC"):
            for name in message.get_fieldnames():
                if not name.startswith("time_"):
                    seen[f"{kind}.{name}"].append(getattr(message, name))
    for name, values in sorted(seen.items()):
        if all(isinstance(value, int | float) for value in values):
            mean, spread = sum(values) / len(values), max(values) - min(values)
            yield name, Near(mean, max(spread, 0.1 * abs(mean)) if spread else 1e-6)
        else:
            yield name, values[-1]


def requests(partner: Partner) -> Answers:
    """REQUEST_MESSAGE and SET_MESSAGE_INTERVAL of what the stand-in tells, and of what nobody knows."""
    for number in (*sorted(STREAMED), UNKNOWN_MESSAGE):
        name = mavlink.mavlink_map[number].msgname if number in mavlink.mavlink_map else "an unknown one"
        heard = partner.order(REQUEST, number, seconds=0.08)
        yield f"{name}: asked once", (result(heard, REQUEST), bool(heard.of(name)))
        heard = partner.order(SET_INTERVAL, number, 500_000, seconds=0.05)
        yield f"{name}: at 2 Hz", (result(heard, SET_INTERVAL), texts(heard))
        partner.order(SET_INTERVAL, number, -1, seconds=0.02)
    attitude = mavlink.MAVLINK_MSG_ID_ATTITUDE
    for name, interval_us in (("too fast", 1000), ("default", 0), ("stopped", -1), ("below -1", -2)):
        heard = partner.order(SET_INTERVAL, attitude, interval_us)
        told = partner.order(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, attitude).of("MESSAGE_INTERVAL")
        yield f"ATTITUDE {name}", (result(heard, SET_INTERVAL), texts(heard), [m.interval_us for m in told])


CARRIED_OUT = (
    *("DO_SET_MODE", "NAV_LOITER_UNLIM", "NAV_LAND", "SET_MESSAGE_INTERVAL", "GET_MESSAGE_INTERVAL"),
    *("REQUEST_MESSAGE", "REQUEST_AUTOPILOT_CAPABILITIES", "DO_MOTOR_TEST", "DO_SEND_BANNER"),
    *("DO_FLIGHTTERMINATION", "PREFLIGHT_CALIBRATION"),
)
"""MAV_CMDs that the stand-in carries out, or refuses with words; to others it answers that it has none."""


def commands(partner: Partner) -> Answers:
    """Commands with parameters of zero, as COMMAND_LONG, while disarmed: result and texts."""
    for name in CARRIED_OUT:
        number = getattr(mavlink, f"MAV_CMD_{name}")
        heard = partner.order(number, seconds=0.1)
        yield f"MAV_CMD_{name}", (result(heard, number), texts(heard))
        if number == SET_MODE:
            partner.order(SET_MODE, 1, MANUAL)
    yield "an unknown command", result(partner.order(UNKNOWN_COMMAND), UNKNOWN_COMMAND)


def parameters(partner: Partner) -> Answers:
    """The whole table, then odd requests and settings."""
    heard = partner.ask(mavlink.MAVLink_param_request_list_message(1, 1), 12.0)
    for name, message in sorted({m.param_id: m for m in heard.of("PARAM_VALUE")}.items()):
        yield f"{name}: type", message.param_type
        yield f"{name}: value", Near(message.param_value, 1e-5 * abs(message.param_value) + 1e-9)
    for name, number in ((b"FS_PILOT_INPUT", -1), (b"", 3), (b"NO_SUCH_THING", -1), (b"", 9999)):
        heard = partner.ask(mavlink.MAVLink_param_request_read_message(1, 1, name, number))
        yield f"read {name.decode()} {number}", _values(heard)
    for name, value in (
        *((b"FS_PILOT_TIMEOUT", value) for value in (2.5, NAN, math.inf)),
        *((b"FS_PILOT_INPUT", 1.4), (b"JS_GAIN_STEPS", 300.0), (b"NO_SUCH_THING", 1.0)),
    ):
        heard = partner.ask(mavlink.MAVLink_param_set_message(1, 1, name, value, 9))
        yield f"set {name.decode()} to {value}", (_values(heard), texts(heard))


def _values(heard: Heard) -> list[tuple[str, float, int]]:
    """Return what was told; the count of the board's hours is told by itself."""
    told = (m for m in heard.of("PARAM_VALUE") if m.param_id != "STAT_RUNTIME")
    return [(m.param_id, round(m.param_value, 4), m.param_index) for m in told]


def arming(partner: Partner) -> Answers:
    """Arming, disarming, and each mode, disarmed and armed: results, texts and the heartbeat."""
    orders = ((1,), (1,), (0,), (0,), (2,), (1, 0, NAN, NAN, NAN, NAN, NAN), (0, 21196))
    for number, values in enumerate(orders):
        heard = partner.order(ARM, *values, seconds=1.2)
        beats = [(m.base_mode, m.system_status) for m in heard.of("HEARTBEAT")][-1:]
        yield f"{number}: arm with {values}", (result(heard, ARM), texts(heard), beats)
    for name, sticks in OFF_CENTRE.items():
        for force in (0, 2989):
            partner.sticks = manual()
            partner.order(ARM, 0, seconds=0.55)
            partner.sticks = sticks
            partner.listen(0.3)
            heard = partner.order(ARM, 1, force)
            yield f"arm with {name}{' by force' if force else ''}", (result(heard, ARM), texts(heard))
    partner.sticks = manual()
    partner.listen(0.3)
    partner.order(ARM, 0)
    partner.sticks = None
    for how in (0, 2, 4):
        heard = partner.order(REBOOT, how)
        yield f"reboot with {how}", (result(heard, REBOOT), texts(heard))
    for state in ("disarmed", "armed"):
        if state == "armed":
            partner.sticks = manual()
            partner.order(ARM, 1)
        for name, mode in MODES.items():
            heard = partner.order(SET_MODE, 1, mode)
            beats = [(m.base_mode, m.custom_mode) for m in heard.of("HEARTBEAT")][:1]
            yield f"{name}, {state}", (result(heard, SET_MODE), texts(heard), beats)
            partner.order(SET_MODE, 1, MANUAL)
    heard = partner.order(REBOOT, 1)
    yield "reboot while armed", (result(heard, REBOOT), texts(heard))


def steering(partner: Partner) -> Answers:
    """Sticks and overrides in MANUAL: the motors' PWM and the channels."""
    for number in (mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, mavlink.MAVLINK_MSG_ID_RC_CHANNELS):
        partner.order(SET_INTERVAL, number, 50_000)
    partner.sticks = manual()
    partner.order(ARM, 1)
    sticks = {f"MANUAL_CONTROL {name}": message for name, message in STICKS.items()} | {
        f"RC_CHANNELS_OVERRIDE {name}": mavlink.MAVLink_rc_channels_override_message(
            1, 1, *values, LEFT_ALONE, LEFT_ALONE
        )
        for name, values in OVERRIDES.items()
    }
    for name, message in sticks.items():
        partner.sticks = manual()
        partner.listen(0.3)
        partner.sticks = message
        heard = partner.listen(0.4)
        yield name, _outputs(heard)
        yield f"{name}: channels", heard.last("RC_CHANNELS").chancount
    partner.sticks = None
    for name, message, system, component in (
        ("from system 254", manual(x=500), 254, 190),
        ("from component 1", manual(x=500), 255, 1),
        ("for system 2", manual(x=500, target=2), 255, 190),
        ("for system 0", manual(x=500, target=0), 255, 190),
        (
            "override for system 2",
            mavlink.MAVLink_rc_channels_override_message(2, 1, 1500, 1500, 1500, 1500, 1600, 1500, 0, 0),
            *(255, 190),
        ),
    ):
        partner.ask(manual(), 0.2)
        partner.packer.srcSystem, partner.packer.srcComponent = system, component
        partner.say(message)
        partner.packer.srcSystem, partner.packer.srcComponent = 255, 190
        yield f"steering {name}", _outputs(partner.listen(0.3))


def _outputs(heard: Heard) -> tuple[Any, ...]:
    servos, channels = heard.last("SERVO_OUTPUT_RAW"), heard.last("RC_CHANNELS")
    return (
        [getattr(servos, f"servo{number}_raw") for number in range(1, 9)],
        [getattr(channels, f"chan{number}_raw") for number in range(1, 11)],
        channels.rssi,
    )


def failsafes(partner: Partner) -> Answers:
    """Texts, arming and mode after the pilot and the ground station fall silent, and come back."""

    def silent(name: str, seconds: float) -> tuple[str, Any]:
        heard = partner.listen(seconds)
        beats = [(m.base_mode, m.custom_mode, m.system_status) for m in heard.of("HEARTBEAT")][-1:]
        return name, (texts(heard), beats)

    partner.sticks = manual()
    partner.order(ARM, 1)
    partner.listen(1.0)
    partner.sticks = None
    yield silent("sticks are silent for 2 s", 2.0)
    yield silent("sticks are silent for 4 s", 2.0)
    partner.sticks = manual()
    yield silent("sticks are back", 2.0)
    partner.sticks, partner.heartbeats = None, False
    yield silent("ground station silent for 6 s, disarmed", 6.0)
    partner.heartbeats = True
    yield silent("ground station is back", 2.0)
    for action in (2, 3, 4):
        partner.ask(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", action, 9))
        partner.ask(mavlink.MAVLink_param_set_message(1, 1, b"FS_PILOT_INPUT", 1, 9))
        partner.sticks = manual()
        partner.listen(1.5)
        partner.order(ARM, 1)
        partner.listen(1.5)
        partner.sticks, partner.heartbeats = None, False
        yield silent(f"FS_GCS_ENABLE {action}, silent for 8 s, armed", 8.0)
        partner.heartbeats = True
        yield silent(f"FS_GCS_ENABLE {action}, back", 2.0)
        partner.order(ARM, 0)
        partner.order(SET_MODE, 1, MANUAL)


def routing(partner: Partner) -> Answers:
    """Who is heard, and what is answered for whom."""
    version = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    for target in ((1, 1), (1, 0), (0, 0), (2, 1), (1, 42)):
        message = mavlink.MAVLink_command_long_message(*target, REQUEST, 0, version, *[0.0] * 6)
        heard = partner.ask(message)
        yield f"command for {target}", (result(heard, REQUEST), bool(heard.of("AUTOPILOT_VERSION")))
    heard = partner.ask(
        mavlink.MAVLink_command_int_message(1, 1, 0, REQUEST, 0, 0, version, 0, 0, 0, 0, 0, 0)
    )
    yield "COMMAND_INT", result(heard, REQUEST)
    found = heard.last("AUTOPILOT_VERSION")
    yield "capabilities but for files", found.capabilities & ~mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    heard = partner.ask(mavlink.MAVLink_timesync_message(0, 123456789))
    yield "TIMESYNC", [m.ts1 for m in heard.of("TIMESYNC") if m.tc1]
    heard = partner.ask(mavlink.MAVLink_set_mode_message(1, 1, 0))
    beats = [m.custom_mode for m in heard.of("HEARTBEAT")][:1]
    yield "SET_MODE", (result(heard, mavlink.MAVLINK_MSG_ID_SET_MODE), beats)


def dynamics(partner: Partner) -> Answers:
    """Dive in STABILIZE, ALT_HOLD and SURFACE on the same plant."""
    partner.sticks = manual()
    partner.order(SET_MODE, 1, MODES["STABILIZE"])
    partner.order(ARM, 1)
    partner.listen(2.0)
    partner.sticks = manual(t=200)
    rolls = partner.sampled(4.0, lambda truth: truth.eta[3])
    yield "STABILIZE, roll stick 200: roll after 4 s, rad", Near(rolls[-1], 0.03)
    yield "its overshoot, rad", Near(max(map(abs, rolls)) - abs(rolls[-1]), 0.03)
    partner.sticks = manual()
    yield "roll 1 s after the release, rad", Near(partner.sampled(1.0, lambda t: t.eta[3])[-1], 0.04)
    partner.sticks = manual(r=300)
    yield "yaw rate with r = 300, rad/s", Near(partner.sampled(3.0, lambda truth: truth.nu[5])[-1], 0.06)
    partner.sticks = manual()
    yield "yaw rate 1 s after it, rad/s", Near(partner.sampled(1.0, lambda truth: truth.nu[5])[-1], 0.05)
    partner.listen(3.0)
    partner.order(SET_MODE, 1, MODES["ALT_HOLD"])
    partner.listen(6.0)
    for z in (0, 250, 420, 580, 750, 1000):
        partner.sticks = manual(z=z)
        partner.listen(2.0)
        sinks = partner.sampled(1.5, lambda truth: truth.nu[2])
        yield f"ALT_HOLD, z = {z}: sinks, m/s", Near(sum(sinks) / len(sinks), 0.04)
        partner.sticks = manual()
        partner.listen(3.0)
    partner.order(SET_MODE, 1, MODES["SURFACE"])
    partner.listen(1.0)
    yield "SURFACE: sinks, m/s", Near(min(partner.sampled(2.0, lambda truth: truth.nu[2])), 0.1)


def entering(partner: Partner) -> Answers:
    """Enter modes from MANUAL right after arming there, and after a turn in MANUAL."""
    partner.sticks = manual()
    partner.order(ARM, 1)
    partner.listen(1.0)
    depth = partner.rov.truth().eta[2]
    partner.order(SET_MODE, 1, MODES["ALT_HOLD"])
    dips = [z - depth for z in partner.sampled(8.0, lambda truth: truth.eta[2])]
    yield "ALT_HOLD after arming in MANUAL: dips, m", Near(max(dips), 0.15)
    yield "8 s later it is back, m", Near(dips[-1], 0.1)
    partner.order(SET_MODE, 1, MANUAL)
    partner.sticks = manual(r=1000)
    partner.listen(2.0)
    partner.sticks = manual()
    partner.listen(4.0)
    heading = partner.rov.truth().eta[5]
    partner.order(SET_MODE, 1, MODES["STABILIZE"])
    turned = partner.sampled(3.0, lambda truth: math.remainder(truth.eta[5] - heading, math.tau))
    yield "STABILIZE after a turn in MANUAL: turns by itself, rad", Near(max(turned, key=abs), 0.15)


QUESTIONS = {
    question.__name__: question
    for question in (
        *(streams, fields, requests, commands, parameters, arming, steering, failsafes),
        *(routing, dynamics, entering),
    )
}
