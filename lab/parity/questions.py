"""What both are asked. A scenario takes a partner that has just booted and gives named answers.

An answer is compared with the other one's as it is; a `Near` with its tolerance. A float says how well it has
to agree, because a float is never exact.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from lab.parity.answers import TIMES, Answers, Near
from lab.parity.partner import Message, Partner, of_type, result, texts
from lab.parity.places import guided, poshold
from lab.parity.transfers import files, mission_items, missions, parameters

Scenario = Callable[[Partner], Answers]

MOTORS = tuple(f"servo{number}_raw" for number in range(1, 9))
MODES = {
    "STABILIZE": 0,
    "ACRO": 1,
    "ALT_HOLD": 2,
    "AUTO": 3,
    "GUIDED": 4,
    "unknown mode 5": 5,
    "CIRCLE": 7,
    "SURFACE": 9,
    "POSHOLD": 16,
    "MANUAL": 19,
    "MOTOR_DETECT": 20,
    "SURFTRAK": 21,
    "unknown mode 99": 99,
}
DISRUPTIVE = {mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, mavlink.MAV_CMD_COMPONENT_ARM_DISARM}
"""Commands that have a scenario of their own."""
UNSENT = {
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
    mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
    *range(mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST, mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END + 1),
}
"""Messages that have a scenario of their own; those of logs crash a firmware that keeps none."""


def streams(partner: Partner) -> Answers:
    """Rates with nobody asking."""
    heard = partner.listen(10.0)
    for kind, number in sorted(Counter(message.get_type() for message in heard).items()):
        yield f"{kind}, Hz", Near(number / 10.0, 0.15)


def fields(partner: Partner) -> Answers:
    """Each field of each streamed message of a vehicle at rest, without the times."""
    seen: dict[str, list[Any]] = defaultdict(list)
    for message in partner.listen(6.0):
        kind = message.get_type()
        if kind == "NAMED_VALUE_FLOAT":
            seen[f"{kind}.{message.name}"].append(message.value)
            continue
        if kind == "STATUSTEXT":
            continue
        for name in message.get_fieldnames():
            if name not in TIMES:
                seen[f"{kind}.{name}"].append(getattr(message, name))
    for name, values in sorted(seen.items()):
        if all(isinstance(value, int | float) for value in values):
            mean = sum(values) / len(values)
            spread = max(values) - min(values)
            yield name, Near(mean, max(spread, 0.1 * abs(mean)) if spread else 1e-6)
        else:
            yield name, values[-1]


def requests(partner: Partner) -> Answers:
    """REQUEST_MESSAGE of every message of the dialect: the result, and whether the message came."""
    for number in sorted(mavlink.mavlink_map):
        heard = partner.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number, seconds=0.08)
        name = mavlink.mavlink_map[number].msgname
        came = "and it" if of_type(name, heard) else "without it"
        yield name, f"{result(heard, mavlink.MAV_CMD_REQUEST_MESSAGE)}, {came}"


def intervals(partner: Partner) -> Answers:
    """SET_MESSAGE_INTERVAL of every message of the dialect to 2 Hz, too fast, back to the default."""
    command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    for number in sorted(mavlink.mavlink_map):
        heard = partner.command(command, number, 500_000, seconds=0.05)
        yield mavlink.mavlink_map[number].msgname, (result(heard, command), *texts(heard))
        partner.command(command, number, -1, seconds=0.02)
    for name, interval_us in (("too fast", 1000), ("default", 0), ("stopped", -1), ("below -1", -2)):
        heard = partner.command(command, mavlink.MAVLINK_MSG_ID_ATTITUDE, interval_us)
        yield f"ATTITUDE {name}", (result(heard, command), *texts(heard))
        heard = partner.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE)
        yield (
            f"interval when {name}",
            [answer.interval_us for answer in of_type("MESSAGE_INTERVAL", heard)],
        )


def commands(partner: Partner) -> Answers:
    """Every MAV_CMD with parameters of zero, as COMMAND_LONG, while disarmed: result and texts."""
    for number, entry in sorted(mavlink.enums["MAV_CMD"].items()):
        if number in DISRUPTIVE or entry.name.endswith("ENUM_END"):
            continue
        heard = partner.command(number, seconds=0.1)
        yield entry.name, (result(heard, number), *texts(heard))
        if number == mavlink.MAV_CMD_DO_SET_MODE:
            partner.set_mode(19)
    yield "unknown command 59999", result(partner.command(59999), 59999)


OFF_CENTRE = {
    "x 500": (500, 0, 500, 0, 0, 0),
    "y 500": (0, 500, 500, 0, 0, 0),
    "z 700": (0, 0, 700, 0, 0, 0),
    "z 300": (0, 0, 300, 0, 0, 0),
    "z 530": (0, 0, 530, 0, 0, 0),
    "r 500": (0, 0, 500, 500, 0, 0),
    "r 100": (0, 0, 500, 100, 0, 0),
    "s 25": (0, 0, 500, 0, 25, 0),
    "s 100": (0, 0, 500, 0, 100, 0),
    "t -100": (0, 0, 500, 0, 0, -100),
    "r, s, t and z": (0, 0, 900, 500, 100, 100),
}


def arming(partner: Partner) -> Answers:
    """Arming, disarming, and each mode, disarmed and armed: results, texts and the heartbeat."""
    command = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    nan = float("nan")
    for name, values in (
        ("arm", (1,)),
        ("arm again", (1,)),
        ("disarm", (0,)),
        ("disarm again", (0,)),
        ("arm with 2", (2,)),
        ("arm with NaN in the others", (1, 0, nan, nan, nan, nan, nan)),
        ("disarm by force", (0, 21196)),
    ):
        heard = partner.command(command, *values, seconds=1.2)
        beats = of_type("HEARTBEAT", heard)
        yield (
            name,
            (
                result(heard, command),
                texts(heard),
                (beats[-1].base_mode, beats[-1].system_status) if beats else (),
            ),
        )
    for name, stick in OFF_CENTRE.items():
        x, y, z, r, pitch, roll = stick
        message = mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0, 0, 3, pitch, roll)
        for force in (0, 2989):
            partner.streaming = _neutral
            partner.disarm()
            partner.listen(0.3)
            partner.streaming = lambda message=message: message
            partner.listen(0.3)
            heard = partner.command(command, 1, force)
            yield f"arm with {name}{' by force' if force else ''}", (result(heard, command), texts(heard))
    partner.streaming = _neutral
    partner.listen(0.3)
    partner.disarm()
    partner.streaming = None
    for how in (0, 2, 4):
        heard = partner.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, how)
        yield f"reboot with {how}", (result(heard, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN), texts(heard))
    for armed in (False, True):
        if armed:
            partner.streaming = _neutral
            partner.arm()
        for name, mode in MODES.items():
            heard = partner.set_mode(mode)
            beats = [(beat.base_mode, beat.custom_mode) for beat in of_type("HEARTBEAT", heard)][:1]
            yield (
                f"{name}, {'armed' if armed else 'disarmed'}",
                (result(heard, mavlink.MAV_CMD_DO_SET_MODE), texts(heard), beats),
            )
            partner.set_mode(19)
    heard = partner.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    yield (
        "reboot while armed",
        (result(heard, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN), texts(heard)),
    )


def _neutral() -> Message:
    return mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0)


STICKS = {
    "x 1000": (1000, 0, 500, 0),
    "x -1000": (-1000, 0, 500, 0),
    "y 500": (0, 500, 500, 0),
    "z 0": (0, 0, 0, 0),
    "z 1000": (0, 0, 1000, 0),
    "z 520": (0, 0, 520, 0),
    "r 1000": (0, 0, 500, 1000),
    "r -300": (0, 0, 500, -300),
    "all 1000": (1000, 1000, 1000, 1000),
    "x, y, z, r beyond": (32767, 32767, 32767, 32767),
    "x far below": (-32768, 0, 500, 0),
}


def steering(partner: Partner) -> Answers:
    """Sticks and overrides in MANUAL: the motors' PWM and the channels."""
    for number in (mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, mavlink.MAVLINK_MSG_ID_RC_CHANNELS):
        partner.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 50_000)
    partner.streaming = _neutral
    partner.arm()
    for name, (x, y, z, r) in STICKS.items():
        yield (
            f"MANUAL_CONTROL {name}",
            _outputs(partner, mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0)),
        )
    for name, s, t in (("s 100", 100, 0), ("t -100", 0, -100)):
        yield (
            f"MANUAL_CONTROL {name}",
            _outputs(
                partner,
                mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0, 0, 3, s, t),
            ),
        )
    for name, values in (
        ("forward 1700", (65535, 65535, 65535, 65535, 1700, 65535)),
        ("throttle 1900, yaw 1100", (65535, 65535, 1900, 1100, 1500, 65535)),
        ("out of range", (900, 2500, 1500, 1500, 1500, 1500)),
        ("released by 0", (0, 0, 0, 0, 0, 0)),
        ("neutral", (1500, 1500, 1500, 1500, 1500, 1500)),
    ):
        yield (
            f"RC_CHANNELS_OVERRIDE {name}",
            _outputs(
                partner,
                mavlink.MAVLink_rc_channels_override_message(1, 1, *values, 65535, 65535),
            ),
        )
    partner.streaming = None
    for name, message, system, component in (
        ("from system 254", mavlink.MAVLink_manual_control_message(1, 500, 0, 500, 0, 0), 254, 190),
        ("from component 1", mavlink.MAVLink_manual_control_message(1, 500, 0, 500, 0, 0), 255, 1),
        ("for system 2", mavlink.MAVLink_manual_control_message(2, 500, 0, 500, 0, 0), 255, 190),
        ("for system 0", mavlink.MAVLink_manual_control_message(0, 500, 0, 500, 0, 0), 255, 190),
        (
            "override for system 2",
            mavlink.MAVLink_rc_channels_override_message(2, 1, 1500, 1500, 1500, 1500, 1600, 1500, 0, 0),
            255,
            190,
        ),
    ):
        partner.ask(_neutral(), 0.2)
        partner.send(message, system, component)
        yield f"steering {name}", _last_outputs(partner.listen(0.3))


def _outputs(partner: Partner, message: Message) -> tuple[Any, ...]:
    """Return motors and channels while `message` is streamed; neutral before and after."""
    partner.streaming = _neutral
    partner.listen(0.3)
    partner.streaming = lambda: message
    seen = _last_outputs(partner.listen(0.4))
    partner.streaming = _neutral
    return seen


def _last_outputs(heard: list[Message]) -> tuple[Any, ...]:
    servos, channels = of_type("SERVO_OUTPUT_RAW", heard)[-1], of_type("RC_CHANNELS", heard)[-1]
    return (
        tuple(getattr(servos, motor) for motor in MOTORS),
        tuple(getattr(channels, f"chan{number}_raw") for number in range(1, 11)),
        channels.chancount,
        channels.rssi,
    )


def failsafes(partner: Partner) -> Answers:
    """Texts, arming and mode after the pilot and the ground station fall silent, and come back."""
    partner.streaming = _neutral
    partner.arm()
    partner.listen(1.0)
    partner.streaming = None
    yield "sticks are silent for 2 s", _condition(partner.listen(2.0))
    yield "sticks are silent for 4 s", _condition(partner.listen(2.0))
    partner.streaming = _neutral
    yield "sticks are back", _condition(partner.listen(2.0))
    partner.streaming, partner.heartbeats = None, False
    yield "ground station silent for 6 s, disarmed", _condition(partner.listen(6.0))
    partner.heartbeats = True
    yield "ground station is back", _condition(partner.listen(2.0))
    for action in (2, 3, 4):
        partner.ask(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", action, 9))
        partner.ask(mavlink.MAVLink_param_set_message(1, 1, b"FS_PILOT_INPUT", 1, 9))
        partner.streaming = _neutral
        partner.listen(1.5)
        partner.arm()
        partner.listen(1.5)
        partner.streaming, partner.heartbeats = None, False
        yield f"FS_GCS_ENABLE {action}, silent for 8 s, armed", _condition(partner.listen(8.0))
        partner.heartbeats = True
        yield f"FS_GCS_ENABLE {action}, back", _condition(partner.listen(2.0))
        partner.disarm()
        partner.set_mode(19)


def _condition(heard: list[Message]) -> tuple[Any, ...]:
    beats = of_type("HEARTBEAT", heard)
    last = (beats[-1].base_mode, beats[-1].custom_mode, beats[-1].system_status) if beats else ()
    return (texts(heard), last)


def routing(partner: Partner) -> Answers:
    """Who is heard, and what is answered for whom."""
    command = mavlink.MAV_CMD_REQUEST_MESSAGE
    version = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    for target, component in ((1, 1), (1, 0), (0, 0), (2, 1), (1, 42)):
        message = mavlink.MAVLink_command_long_message(target, component, command, 0, version, *[0.0] * 6)
        heard = partner.ask(message)
        yield (
            f"command for {target}/{component}",
            (result(heard, command), bool(of_type("AUTOPILOT_VERSION", heard))),
        )
    message = mavlink.MAVLink_command_int_message(1, 1, 0, command, 0, 0, version, 0, 0, 0, 0, 0, 0)
    heard = partner.ask(message)
    yield "COMMAND_INT", (result(heard, command), bool(of_type("AUTOPILOT_VERSION", heard)))
    yield (
        "AUTOPILOT_VERSION",
        [
            (message.capabilities, message.flight_sw_version >> 16)
            for message in of_type("AUTOPILOT_VERSION", heard)
        ],
    )
    heard = partner.ask(mavlink.MAVLink_timesync_message(0, 123456789))
    yield "TIMESYNC", [message.ts1 for message in of_type("TIMESYNC", heard) if message.tc1]
    heard = partner.ask(mavlink.MAVLink_ping_message(1, 7, 0, 0))
    yield "PING", [(message.seq, message.target_system) for message in of_type("PING", heard)]
    heard = partner.ask(mavlink.MAVLink_set_mode_message(1, 1, 0))
    yield (
        "SET_MODE",
        (
            result(heard, mavlink.MAVLINK_MSG_ID_SET_MODE),
            [beat.custom_mode for beat in of_type("HEARTBEAT", heard)][:1],
        ),
    )
    for name, group, rate, start in (("all stopped", 0, 0, 0), ("position at 5 Hz", 6, 5, 1)):
        partner.ask(mavlink.MAVLink_request_data_stream_message(1, 1, group, rate, start))
        partner.listen(1.0)
        counts = Counter(message.get_type() for message in partner.listen(4.0))
        yield (
            f"REQUEST_DATA_STREAM {name}",
            {kind: round(number / 4.0) for kind, number in sorted(counts.items()) if kind != "TIMESYNC"},
        )


def anything(partner: Partner) -> Answers:
    """Every message of the dialect, all zero but for its target: what it says that it does not stream."""
    streamed = {message.get_type() for message in partner.listen(5.0)} - {"STATUSTEXT"} | {"TIMESYNC"}
    for number, kind in sorted(mavlink.mavlink_map.items()):
        if number in UNSENT:
            continue
        partner.set_mode(19)
        heard = partner.ask(_zero(kind), 0.12)
        said = {message.get_type() for message in heard} - streamed
        yield kind.msgname, (sorted(said), texts(heard))


def _zero(kind: Any) -> Message:
    """Build a message for the vehicle with all other fields zero."""
    fields = zip(kind.fieldnames, kind.fieldtypes, kind.orders, strict=True)
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return kind(*(_field(name, sort, lengths[name]) for name, sort, _ in fields))


def _field(name: str, sort: str, length: int) -> Any:
    if sort == "char":
        return b""
    if name in ("target_system", "target_component", "target"):
        return 1
    return [0] * length if length else 0


def reboot(partner: Partner) -> Answers:
    """Reboot: the answer, and what the vehicle says in its first 20 s."""
    number = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    heard = partner.command(number, 1, seconds=0.5)
    yield "answer", result(heard, number)
    said = set(texts(heard))  # our stand-in is up again at once
    statuses: list[int] = []
    for _ in range(20):
        heard = partner.listen(1.0)
        said.update(texts(heard))
        statuses += [beat.system_status for beat in of_type("HEARTBEAT", heard)]
    for text in sorted(said):
        yield f"says {text}", True
    yield "first status", statuses[:1]
    yield "status after 20 s", statuses[-1:]


def dynamics(partner: Partner) -> Answers:
    """Dive in STABILIZE, ALT_HOLD and SURFACE on the same plant."""
    stick = [0, 0, 500, 0, 0, 0]

    def sticks() -> Message:
        x, y, z, r, s, t = stick
        return mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0, 0, 3, s, t)

    partner.streaming = sticks
    partner.set_mode(0)
    partner.arm()
    partner.listen(2.0)
    stick[5] = 200
    rolls = _sampled(partner, 4.0, lambda truth: truth.eta[3])
    yield "STABILIZE, roll stick 200: roll after 4 s, rad", Near(rolls[-1], 0.03)
    yield "its overshoot, rad", Near(max(map(abs, rolls)) - abs(rolls[-1]), 0.03)
    stick[5] = 0
    yield "roll 1 s after the release, rad", Near(_sampled(partner, 1.0, lambda t: t.eta[3])[-1], 0.04)
    stick[3] = 300
    yield (
        "yaw rate with r = 300, rad/s",
        Near(_sampled(partner, 3.0, lambda truth: truth.nu[5])[-1], 0.06),
    )
    stick[3] = 0
    yield (
        "yaw rate 1 s after the release, rad/s",
        Near(_sampled(partner, 1.0, lambda truth: truth.nu[5])[-1], 0.05),
    )
    partner.listen(3.0)
    partner.set_mode(2)
    partner.listen(6.0)
    for z in (0, 250, 420, 580, 750, 1000):
        stick[2] = z
        partner.listen(2.0)
        sinks = _sampled(partner, 1.5, lambda truth: truth.nu[2])
        yield f"ALT_HOLD, z = {z}: sinks, m/s", Near(sum(sinks) / len(sinks), 0.04)
        stick[2] = 500
        partner.listen(3.0)
    partner.set_mode(19)
    partner.listen(2.0)
    depth = partner.vehicle.truth().eta[2]
    partner.set_mode(2)
    dips = [z - depth for z in _sampled(partner, 4.0, lambda truth: truth.eta[2])]
    yield "ALT_HOLD from MANUAL: dips, m", Near(max(dips), 0.15)
    partner.set_mode(9)
    partner.listen(1.0)
    yield (
        "SURFACE: sinks, m/s",
        Near(min(_sampled(partner, 2.0, lambda truth: truth.nu[2])), 0.1),
    )


def entering(partner: Partner) -> Answers:
    """Enter modes from MANUAL right after arming there, and after a turn in MANUAL."""
    turn = [0]
    partner.streaming = lambda: mavlink.MAVLink_manual_control_message(1, 0, 0, 500, turn[0], 0)
    partner.arm()
    partner.listen(1.0)
    depth = partner.vehicle.truth().eta[2]
    partner.set_mode(2)
    dips = [z - depth for z in _sampled(partner, 8.0, lambda truth: truth.eta[2])]
    yield "ALT_HOLD after arming in MANUAL: dips, m", Near(max(dips), 0.15)
    yield "8 s later it is back, m", Near(dips[-1], 0.1)
    partner.set_mode(19)
    turn[0] = 1000
    partner.listen(2.0)
    turn[0] = 0
    partner.listen(4.0)
    at_first = partner.vehicle.truth().eta[5]
    partner.set_mode(0)
    turned = [yaw - at_first for yaw in _sampled(partner, 3.0, lambda truth: truth.eta[5])]
    turned = [(angle + math.pi) % (2.0 * math.pi) - math.pi for angle in turned]
    yield "STABILIZE after a turn in MANUAL: turns by itself, rad", Near(max(turned, key=abs), 0.15)


def _sampled(partner: Partner, seconds: float, what: Callable[[Any], float]) -> list[float]:
    """Return a quantity of the truth 20 times a second."""
    values = []
    for _ in range(round(seconds / 0.05)):
        partner.listen(0.05)
        values.append(float(what(partner.vehicle.truth())))
    return values


SCENARIOS: dict[str, Scenario] = {
    scenario.__name__: scenario
    for scenario in (
        streams,
        fields,
        requests,
        intervals,
        commands,
        parameters,
        missions,
        mission_items,
        files,
        arming,
        steering,
        failsafes,
        routing,
        anything,
        reboot,
        dynamics,
        entering,
        poshold,
        guided,
    )
}
POSITIONED = (poshold.__name__, guided.__name__)
"""Those whose vehicle has a DVL."""
