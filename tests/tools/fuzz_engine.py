"""Semantic fuzzing of the engine: `python -m tests.tools.fuzz_engine --ticks 1000000`.

A stand-in vehicle dives with the engine in virtual time. Storms come upon its telemetry: every message type
that the companion decodes, any value in any field, NaN and extremes, any stamp, two clocks; what is lost,
late, repeated and out of order; streams that stutter, signals that stand still under fresh stamps; other
senders and a ground station; an operator who presses every button. Half of the vehicles dive in a drawn sea.
Between storms it is calm, and the engine is asked to engage again, so that storms meet it while it steers.
Every fifth dive has no vehicle: messages alone, wholly random. Every second has a configuration drawn from
the types' own ranges, their ends included. Commands are drawn from their types too: paths of every kind,
gains and noises, with absurd values and broken JSON among them; they go through the queue, as in the process.
What the process does beside the tick is done too: map, events, the pilot's display, log lines, raw ticks.

Held in every tick: nothing raises, no command leads to an error that nobody foresaw, and
`lab.studies.promises`. Held after a long calm: the estimator has found depth and heading again.

A dive's number is its seed: `--first N --dives 1` repeats it. `--jobs` dives go on at once.
"""

import argparse
import contextlib
import json
import math
import multiprocessing
import re
import signal
import struct
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any, get_args, get_origin, get_type_hints

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion import registry
from companion.config import AxisModel, Config, ConfigError, load_config
from companion.core.bounds import clamped
from companion.engine import Engine
from companion.guidance.drawing import drawing
from companion.io.command_queue import COST, CommandQueue, ReceivedCommand
from companion.mavlink.decode import Decoder
from companion.mavlink.link_maintenance import PARAMETERS
from companion.mavlink.relay import Relay
from companion.records import (
    AXES,
    PSI,
    ZERO,
    ControlSample,
    LinkCounters,
    LoopHealth,
    Request,
    Setpoint,
    State,
    Vector,
    Z,
    vector,
)
from companion.steps import Task
from companion.telemetry.event_log import EventLog
from companion.telemetry.operator_commands import COMMANDS, CommandResult
from companion.telemetry.plan import PathPlan
from companion.telemetry.schemas import Plan, Raw, Reply, to_json
from companion.telemetry.status_line import status_line
from holdfast import validation
from lab.loop.lockstep import START_S, LinkDelay, Lockstep
from lab.studies.promises import Promises, hold_telemetry, promise
from sim_bridge.sim_config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

CONFIG = Path(__file__).parents[2] / "config"
TICK_S = 0.02
DIVE_TICKS = 1500
STORM_TICKS = ((25, 200), (25, 200), (200, 900))
CALM_TICKS = 250
ORDER_TICKS = 100
PATH_TICKS = 20
RECOVERED_TICKS = 700
"""After so long a calm depth and heading have to be found again: the observer lets go of an error of half
a turn, which rates of 26 rad/s made, with a time constant of 2.6 s."""

NEAR_M, NEAR_RAD = 0.2, 0.1
PIECES = 20
"""Of what is done between two ticks."""
TOLD_DIVES = 50
"""After so many the number of ticks is told."""

VEHICLE, US, GROUND = (1, 1), (255, 25), (255, 190)

Inbox = list[tuple[int, bytes]]
HEAVY, SIX = "sim.toml", "sim-bluerov2.toml"
POSITIONED = ("sensors.dvl=true",)
VARIANTS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    (HEAVY, (), ()),
    (HEAVY, ("waves.enabled=true",), ()),
    (HEAVY, (), ('vehicle.thrust_path="manual_control"',)),
    (HEAVY, POSITIONED, ("supervisor.max_tilt_deg=80",)),
    (HEAVY, (), ('vehicle.steering_mode="stabilize"',)),
    (HEAVY, (), ('vehicle.depth_source="pressure"',)),
    (SIX, (), ('vehicle.frame="vectored"',)),
)
SEA_HEIGHTS_M, SEA_PERIODS_S = (0.1, 2.0), (2.0, 12.0)
WITH_GROUND = ('ground_station.endpoint="udp-listen:127.0.0.1:14551"', 'vehicle.thrust_path="manual_control"')


# --- Messages ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Kind:
    """A message type: the struct of its payload, and of each of its values field and format character."""

    id: int
    layout: struct.Struct
    crc_extra: int
    fields: tuple[str, ...]
    codes: tuple[str, ...]


def _kind(message_id: int) -> Kind:
    known = mavlink.mavlink_map[message_id]
    fields, codes = [], []
    parts = re.findall(r"(\d*)([a-zA-Z])", known.unpacker.format)
    for name, length, (count, code) in zip(known.ordered_fieldnames, known.lengths, parts, strict=True):
        fields += [name] * length
        codes += [count + code] if code == "s" else [code] * length
    return Kind(message_id, known.unpacker, known.crc_extra, tuple(fields), tuple(codes))


KINDS = {
    message_id: _kind(message_id)
    for message_id in sorted(Decoder(LinkCounters(), depth_source="pressure").ids)
}
STEERING = (mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE)
TIMESYNC = mavlink.MAVLINK_MSG_ID_TIMESYNC
STAMPS = {"time_boot_ms": 1e3, "time_usec": 1e6, "tc1": 1e9}
NAMES = [name.encode() for name in (*PARAMETERS, "InputHold", "RollPitch", "PilotGain", "Leak detected!")]
RANGES = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "q": 64, "Q": 64}
FLOATS = (
    math.nan,
    math.inf,
    -math.inf,
    0.0,
    -0.0,
    1e30,
    -1e30,
    1e-30,
    3.4e38,
    -3.4e38,
    1e-45,
    1.0,
    -1.0,
    100.0,
    -1000.0,
    math.pi,
    -6.3,
    49.0,
)


def frame(kind: Kind, values: Sequence[Any], sender: tuple[int, int]) -> bytes:
    """Return a sound MAVLink 2 frame."""
    payload = kind.layout.pack(*values).rstrip(b"\0") or b"\0"
    head = bytes((len(payload), 0, 0, 7, *sender)) + kind.id.to_bytes(3, "little")
    checksum: int = mavlink.x25crc(head + payload + bytes((kind.crc_extra,))).crc
    return b"\xfd" + head + payload + checksum.to_bytes(2, "little")


def opened(data: bytes) -> tuple[Kind, list[Any]] | None:
    """Return type and values of a datagram that is one frame of a type we know."""
    kind = KINDS.get(data[7] | data[8] << 8 | data[9] << 16) if len(data) >= 12 else None
    if kind is None or data[0] != 0xFD or len(data) != 12 + data[1]:
        return None
    return kind, list(kind.layout.unpack(data[10:-2].ljust(kind.layout.size, b"\0")[: kind.layout.size]))


def absurd(rng: Random, code: str, value: Any) -> Any:
    """Return anything that fits the format, now and then near `value`."""
    if code.endswith("s"):
        size = int(code[:-1])
        text = rng.choice(NAMES) if rng.random() < 0.7 else rng.randbytes(rng.randrange(size + 1))
        return text[:size]
    if code in "fd":
        draw = rng.random()
        if draw < 0.5:
            return rng.choice(FLOATS)
        number = value if math.isfinite(value) else 0.0
        if draw < 0.7:
            return _float32(number + rng.gauss(0.0, 10.0 ** rng.uniform(-3.0, 3.0)))
        return _float32(rng.uniform(-1.0, 1.0) * 10.0 ** rng.uniform(-38.0, 38.0))
    bits = RANGES[code]
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if code.islower() else (0, (1 << bits) - 1)
    draw = rng.random()
    if draw < 0.4:
        return rng.choice((low, high, 0, 1, high - 1, high // 2, low // 2))
    if draw < 0.7:
        return min(max(int(value) + rng.randint(-1, 1) * 10 ** rng.randrange(1 + bits // 4), low), high)
    return rng.randint(low, high)


def _float32(value: float) -> float:
    return value if abs(value) < 3.4e38 else math.inf


def anything(rng: Random, now_s: float, known: dict[int, list[Any]]) -> tuple[Kind, list[Any]]:
    """Return a message of any type: like the last of its type or not at all, its stamp near or not."""
    kind = KINDS[rng.choice(tuple(KINDS))]
    like = known.get(kind.id)
    share = rng.choice((0.1, 0.3, 1.0)) if like else 1.0
    values = like or [b"" if code.endswith("s") else 0 for code in kind.codes]
    values = [
        absurd(rng, code, value) if rng.random() < share else value
        for code, value in zip(kind.codes, values, strict=True)
    ]
    if rng.random() < 0.7:
        for i, name in enumerate(kind.fields):
            if name in STAMPS:
                values[i] = round((now_s - START_S + rng.choice((0.0, 0.0, 0.3, -0.3, 5.0))) * STAMPS[name])
                values[i] = max(values[i], 0) % (1 << 32 if name != "tc1" else 1 << 62)
    if kind.id == TIMESYNC and rng.random() < 0.8:
        values[1] = round((now_s - rng.choice((0.0, 0.004, 0.15, 0.9, 3.0))) * 1e9)
    return kind, values


# --- What a type allows -----------------------------------------------------------------------------------

ABSURD: tuple[Any, ...] = (
    math.nan,
    math.inf,
    -math.inf,
    1e308,
    -1e308,
    10**400,
    0,
    -1,
    1e-320,
    "",
    "0",
    None,
    True,
    [],
    {},
)
POINTS = (1, 2, 2, 3, 4, 8, 30, 300, 900, 4000)
STRANGE_NAMES = ("", "a\nforged line", "\x1b[2J", "{0}%s", "\u202eltr")
SHAPES = {"waypoint", "circle", "lemniscate", "lawn_mower"}
TICK_RATES_HZ = (10.0, 20.0, 50.0, 100.0)
"""Of which the vehicle's step is a whole part."""

SECTIONS = ("vehicle", "loop", "delays", "thrusters", "levelling", *AXES, "network", "supervisor", "fence")
"""Of the configuration: the others say who is connected."""

SETTABLE = {
    f"{section}.{key}": hint
    for section in SECTIONS
    for key, hint in get_type_hints(get_type_hints(Config)[section], include_extras=True).items()
    if key not in ("name", "frame", "law")
}
MODELS = [f"{axis}.{key}" for axis in AXES for key in AxisModel.__struct_fields__]
UNLEARNT = [f"{axis}.learning_rate=0" for axis in AXES]
"""Where these are not drawn too: else most vehicles would be refused for gains that are too fast for them."""


def number(rng: Random, least: float, most: float) -> float:
    """Return a number of a range: an end of it, any, any by its size, or nearly 0."""
    draw = rng.random()
    if draw > 0.97 and least <= 0.0:
        return math.pow(10.0, rng.uniform(-323.0, -7.0))
    if draw < 0.25:
        return rng.choice((least, most))
    if draw < 0.5:
        return rng.uniform(least, most)
    size = most * 10.0 ** rng.uniform(-6.0, 0.0)
    sign = rng.choice((-1.0, 1.0)) if least < 0.0 else 1.0
    return clamped(sign * size, least, most)


def drawn(rng: Random, hint: Any, strange: float = 0.0) -> Any:
    """Return what a type allows, as JSON has it; a share of it, `strange` (0..1), is anything else."""
    if rng.random() < strange:
        return rng.choice(ABSURD)
    parts = (hint, *get_args(hint))
    if get_origin(hint) is tuple:
        each = parts[1:2] * rng.choice(POINTS) if ... in parts else parts[1:]
        return [drawn(rng, one, strange) for one in each]
    if words := validation.choices(hint):
        return rng.choice(words)
    for part in parts:
        if isinstance(part, type) and issubclass(part, msgspec.Struct):
            return _table(rng, part, strange)
    if found := validation.bounds(hint):
        return min(round(number(rng, *found)), found[1]) if int in parts else number(rng, *found)
    return rng.random() < 0.5 if bool in parts else rng.choice((*registry.choices({}), *STRANGE_NAMES))


def _table(rng: Random, kind: type[msgspec.Struct], strange: float) -> dict[str, Any]:
    """Return the fields that have to be there and some of the others; of shapes mostly one."""
    wanted = {one.name for one in msgspec.structs.fields(kind) if one.required or rng.random() < 0.5}
    if kind is PathPlan and rng.random() < 0.95:
        wanted = wanted - SHAPES | {rng.choice(sorted(SHAPES))}
    hints = get_type_hints(kind, include_extras=True)
    table = {name: drawn(rng, hint, strange) for name, hint in hints.items() if name in wanted}
    return _buildable(rng, table) if kind is PathPlan and rng.random() < 0.9 else table


def _buildable(rng: Random, plan: dict[str, Any]) -> dict[str, Any]:
    """Take from a plan what its types allow and `building` mostly refuses: depths here and there, angles.

    Half of them are as small as a pool, or as a mistake in the unit makes them.
    """
    for key in ("roll_deg", "pitch_deg", "altitude_m"):
        if rng.random() < 0.9:
            plan.pop(key, None)
    deep = rng.random() < 0.5 and "altitude_m" not in plan
    scale = rng.choice((1.0, 10.0 ** rng.uniform(-7.0, -2.0)))
    waypoints = plan.get("waypoint")
    for table in (*(waypoints if isinstance(waypoints, list) else ()), *plan.values()):
        if isinstance(table, dict):
            table.pop("depth_m", None)
            table |= {"depth_m": rng.uniform(0.3, 3.0)} if deep else {}
            for key in table.keys() & {"x_m", "y_m"}:
                if isinstance(table[key], float):
                    table[key] *= scale
    return plan


TUNINGS = ("gains", "compensator")


def order(rng: Random, names: Sequence[str] = (*COMMANDS, "follow", "follow", "goto")) -> tuple[str, bytes]:
    """Return a command's name and payload, mostly one that is permitted."""
    name = rng.choice(names)
    text = json.dumps(drawn(rng, COMMANDS[name], rng.choice((0.0, 0.0, 0.02))))
    if rng.random() < 0.05:
        cut = rng.randrange(len(text))
        text = text[:cut] + rng.choice(("", "[" * 2000, '{"path":', "9" * 400)) + text[cut + 1 :]
    return name, text.encode()


def configuration(rng: Random, fixed: Sequence[str]) -> Config:
    """Return a configuration of which many keys are any that their types allow, and that is not refused."""
    while True:
        keys = rng.choice((MODELS, rng.sample(sorted(SETTABLE), rng.choice((1, 3, 10, 30)))))
        values = {key: drawn(rng, SETTABLE[key]) for key in keys}
        for key, value in values.items():
            if key == "loop.rate_hz":
                values[key] = rng.choice(TICK_RATES_HZ)
            elif isinstance(value, list):
                value.sort()
        texts = [f"{key}={json.dumps(value)}" for key, value in values.items()]
        with contextlib.suppress(ConfigError):
            config = load_config(overrides=(*rng.choice((UNLEARNT, [])), *texts, *fixed))
            Engine(config, Setpoint((math.nan,) * 4))
            return config


# --- Storms -----------------------------------------------------------------------------------------------

Spoil = Callable[[float, Inbox], Inbox]


def altered(change: Callable[[Kind, list[Any]], None], *, beside: bool = False) -> Spoil:
    """Return a spoil that changes the values of each message we know, or sends such a one `beside` it."""

    def spoil(now_s: float, inbox: Inbox) -> Inbox:
        out = []
        for t_ns, data in inbox:
            known = opened(data) if data[5:7] == bytes(VEHICLE) else None
            if known is None or beside:
                out.append((t_ns, data))
            if known is not None:
                change(*known)
                out.append((t_ns, frame(*known, VEHICLE)))
        return out

    return spoil


def one_field(rng: Random, _: "Fuzzed") -> Spoil:
    """One field of one type goes mad: to one value, to ever another, or now and then."""
    kind = KINDS[rng.choice(tuple(KINDS))]
    at, often, fixed = rng.randrange(len(kind.codes)), rng.choice((1.0, 1.0, 0.3, 0.03)), rng.random() < 0.5
    kept: list[Any] = []

    def change(found: Kind, values: list[Any]) -> None:
        if found is kind and rng.random() < often:
            value = kept[0] if fixed and kept else absurd(rng, kind.codes[at], values[at])
            kept[:] = [value]
            values[at] = value

    return altered(change)


def clocks(rng: Random, _: "Fuzzed") -> Spoil:
    """Stamps and answers to TIMESYNC are off, stand still or run at another pace."""
    which = rng.choice((set(STAMPS), {"tc1"}, {"time_boot_ms", "time_usec"}, {"time_usec"}, {"ts1"}))
    off_s = rng.choice((-1.0, 1.0)) * 10.0 ** rng.uniform(-2.0, 10.0)
    pace, since = rng.choice((0.0, 0.0, 1e-3, -1.0, 1.0)), [math.nan]

    def change(kind: Kind, values: list[Any]) -> None:
        for i, name in enumerate(kind.fields):
            if name in which:
                scale = STAMPS.get(name, 1e9)
                if math.isnan(since[0]):
                    since[0] = values[i] / scale
                late_s = off_s + pace * (values[i] / scale - since[0])
                values[i] = _stamp(values[i] + late_s * scale, kind.codes[i])

    return altered(change)


SIGNALS = (
    ("z", "alt", "relative_alt", "altitude"),
    ("vz", "climb"),
    ("press_abs",),
    ("roll", "pitch", "yaw", "hdg", "heading"),
    ("rollspeed", "pitchspeed", "yawspeed"),
    ("x", "y", "lat", "lon", "vx", "vy"),
    ("current_distance",),
    tuple(f"servo{n}_raw" for n in range(1, 9)),
)
"""What one sensor or filter gives, by the names of its fields in all messages."""

STREAMS = tuple(
    KINDS[number]
    for number in (
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2,
        mavlink.MAVLINK_MSG_ID_VFR_HUD,
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
    )
)


def frozen(rng: Random, _: "Fuzzed") -> Spoil:
    """Signals that stand still, are 0, have the wrong sign or coarse steps, under fresh stamps."""
    wrong = {name for signal in rng.sample(SIGNALS, rng.choice((1, 1, 1, 2, 3))) for name in signal}
    how = rng.choice(("still", "still", "still", "zero", "turned", "coarse"))
    step, kinds = 10.0 ** rng.uniform(-2.0, 3.0), rng.choice((tuple(KINDS.values()), STREAMS, STREAMS[:3]))
    kept: dict[tuple[int, int], Any] = {}

    def change(kind: Kind, values: list[Any]) -> None:
        for i, (name, code) in enumerate(zip(kind.fields, kind.codes, strict=True)):
            if kind not in kinds or name not in wrong or not math.isfinite(values[i]):
                continue
            now, first = values[i], kept.setdefault((kind.id, i), values[i])
            if how == "coarse":
                now = first + step * round((now - first) / step)
            new = {"still": first, "zero": 0, "turned": -now}.get(how, now)
            values[i] = _float32(new) if code == "f" else _within(code, new)

    return altered(change)


def stutters(rng: Random, _: "Fuzzed") -> Spoil:
    """Streams fall silent and come again, one, some or all of them, by turns or together, evenly or not."""
    some = [frozenset(rng.sample(STREAMS, rng.randint(1, 3))) for _ in range(rng.choice((1, 1, 2, 3)))]
    turns = rng.choice((some, some, [frozenset(KINDS.values())]))
    silent_s, heard_s = 10.0 ** rng.uniform(-1.0, 0.5), 10.0 ** rng.uniform(-2.0, 0.5)
    uneven, until_s, turn = rng.choice((0.0, 0.0, 0.5)), 0.0, 0

    def spoil(now_s: float, inbox: Inbox) -> Inbox:
        nonlocal until_s, turn
        if now_s >= until_s:
            turn += 1
            until_s = now_s + (silent_s if turn % 2 else heard_s) * (1.0 + rng.uniform(-uneven, uneven))
        silent = turns[turn // 2 % len(turns)] if turn % 2 else frozenset()
        return [(t_ns, data) for t_ns, data in inbox if not (known := opened(data)) or known[0] not in silent]

    return spoil


def twin(rng: Random, _: "Fuzzed") -> Spoil:
    """A second autopilot with the same system id and another clock, elsewhere."""
    off_s, off = rng.choice((-1.0, 1.0)) * 10.0 ** rng.uniform(-2.0, 6.0), rng.gauss(0.0, 2.0)

    def change(kind: Kind, values: list[Any]) -> None:
        for i, (name, code) in enumerate(zip(kind.fields, kind.codes, strict=True)):
            if name in STAMPS:
                values[i] = _stamp(values[i] + off_s * STAMPS[name], code)
            elif code == "f":
                values[i] = values[i] + off

    return altered(change, beside=True)


def _within(code: str, value: float) -> int:
    bits = RANGES[code]
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if code.islower() else (0, (1 << bits) - 1)
    return min(max(round(value), low), high)


def _stamp(value: float, code: str) -> int:
    return min(max(round(value), 0), (1 << (32 if code == "I" else 63)) - 1)


def carried(rng: Random, _: "Fuzzed") -> Spoil:
    """A bad link: datagrams are lost, late, repeated and overtake each other."""
    lost, again, late = (rng.choice((0.0, 0.1, 0.5, 0.95)) for _ in range(3))
    late_s = 10.0 ** rng.uniform(-2.0, 0.7)
    waiting: list[tuple[float, bytes]] = []

    def spoil(now_s: float, inbox: Inbox) -> Inbox:
        out = []
        for t_ns, data in inbox:
            for _ in range(1 + (rng.random() < again)):
                if rng.random() < lost:
                    continue
                if rng.random() < late:
                    waiting.append((now_s + rng.uniform(0.0, late_s), data))
                else:
                    out.append((t_ns, data))
        out += [(round(now_s * 1e9), data) for at_s, data in waiting if at_s <= now_s]
        waiting[:] = [(at_s, data) for at_s, data in waiting if at_s > now_s]
        rng.shuffle(out)
        return out

    return spoil


def insertion(rng: Random, dive: "Fuzzed") -> Spoil:
    """Messages of any type beside the true ones, of the vehicle or of somebody else."""
    often = rng.choice((0.05, 0.5, 3.0))
    senders = rng.choice(((VEHICLE,), ((254, 190), GROUND, (1, 0), (2, 1), US)))

    def spoil(now_s: float, inbox: Inbox) -> Inbox:
        out = list(inbox)
        for _ in range(_count(rng, often)):
            said = anything(rng, now_s, dive.heard)
            out.append((round(now_s * 1e9), frame(*said, rng.choice(senders))))
        rng.shuffle(out)
        return out

    return spoil


def ground_station(rng: Random, dive: "Fuzzed") -> Spoil:
    """A ground station that says anything, and sticks above all."""
    often = rng.choice((0.2, 1.0, 3.0))

    def spoil(now_s: float, inbox: Inbox) -> Inbox:
        for _ in range(_count(rng, often)):
            kind, values = anything(rng, now_s, dive.heard)
            if rng.random() < 0.5:
                kind = KINDS[rng.choice((mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, 0))]
                values = [absurd(rng, code, 0) for code in kind.codes]
                if kind.id and rng.random() < 0.8:
                    values[kind.fields.index("target")] = 1
            sender = GROUND if rng.random() < 0.9 else (rng.randrange(256), rng.randrange(256))
            dive.ground.append((round(now_s * 1e9), frame(kind, values, sender)))
        return inbox

    return spoil


def buttons(rng: Random, dive: "Fuzzed") -> Spoil:
    """An operator who presses every button, orders what there is and gives any setpoint."""

    def spoil(now_s: float, inbox: Inbox) -> Inbox:
        if rng.random() < 0.1:
            dive.presses.append(rng.choice(tuple(Request)))
        if rng.random() < 0.05:
            dive.order(order(rng))
        if rng.random() < 0.1:
            draw = [rng.choice((math.nan, 0.0, rng.gauss(0.0, 1.0), rng.gauss(0.0, 1e3))) for _ in range(4)]
            rates = [rng.choice((0.0, 0.0, rng.gauss(0.0, 1.0), 1e30)) for _ in range(8)]
            with contextlib.suppress(ValueError):
                dive.engine.aim(Setpoint(vector(draw), vector(rates[:4]), vector(rates[4:])))
        return inbox

    return spoil


def stalls(rng: Random, dive: "Fuzzed") -> Spoil:
    """The process does not run for a while, and finds all that came meanwhile."""

    def spoil(now_s: float, inbox: Inbox) -> Inbox:
        if rng.random() < 0.02:
            dive.asleep_ticks = rng.choice((1, 2, 10, 60))
        return inbox

    return spoil


STORMS = (
    one_field,
    one_field,
    one_field,
    frozen,
    frozen,
    stutters,
    stutters,
    clocks,
    clocks,
    twin,
    carried,
    insertion,
    insertion,
    buttons,
    buttons,
    stalls,
    ground_station,
)


def _count(rng: Random, mean: float) -> int:
    return int(mean) + (rng.random() < mean % 1.0)


# --- Dives ------------------------------------------------------------------------------------------------


class Fuzzed:
    """Stands where the engine is: spoils what comes, holds every tick to account."""

    def __init__(self, rng: Random, config: Config, tally: "Tally") -> None:
        ground = bool(config.ground_station.endpoint)
        depth_m = math.nan if config.fence.enabled else min(1.0, config.supervisor.max_depth_m)
        self.engine = Engine(config, Setpoint((math.nan, math.nan, depth_m, 0.3)), arm=True)
        self._queue = CommandQueue(config)
        self._guided: tuple[int, str] | None = None
        self._drawing: Task[Plan]
        self._tally = tally
        self.spoils: list[Spoil] = []
        self.heard: dict[int, list[Any]] = {}
        self.ground: Inbox = []
        self.presses: list[Request] = []
        self.asleep_ticks = 0
        self.by_pressure = config.vehicle.depth_source == "pressure"
        """Then a forged parameter moves the zero of depth for good."""
        self._relay = Relay(config) if ground else None
        self._rng = rng
        self._kept: Inbox = []
        self._sample: ControlSample | None = None
        self._event_log = EventLog()
        self._promises = Promises(config, pilot=ground)

    def step(
        self,
        now_s: float,
        datagrams: Inbox,
        loop: LoopHealth,
        requests: Sequence[Request] = (),
        excitation: Vector = ZERO,
    ) -> tuple[list[bytes], ControlSample]:
        """Advance one tick, unless asleep; raise PromiseBrokenError."""
        inbox = list(datagrams)
        if not self.spoils:
            self.heard |= {known[0].id: known[1] for _, data in inbox if (known := opened(data))}
        for spoil in self.spoils:
            inbox = spoil(now_s, inbox)
        self._kept += inbox
        if self.asleep_ticks and self._sample is not None:
            self.asleep_ticks -= 1
            return [], self._sample
        inbox, self._kept = self._kept, []
        presses, self.presses = [*requests, *self.presses], []
        pilot, passed = self._heard_from_ground()
        given = self._queue.before_tick(self.engine, now_s)
        asked = (*presses, *given.requests)
        out, sample = self.engine.step(now_s, inbox, loop, asked, pilot, excitation)
        results = self._queue.after_tick(self.engine, sample, now_s)
        self._between_ticks(sample)
        if self._relay is not None:
            self._relay.withhold = self.engine.steering
        self._tally.states[sample.verdict.state] += 1
        self._promises.hold(now_s, out, sample, asked, steers=self.engine.steering)
        hold_telemetry(sample)
        self._tally.paths += given.order is not None and given.order[0] == "follow"
        self._tell(sample, results)
        tick = Raw(tick=loop.tick, now_s=now_s, heard=inbox, ground=pilot, out=out, order=given.order)
        msgspec.msgpack.encode(tick)
        self._sample = sample
        return [*passed, *out], sample

    def _tell(self, sample: ControlSample, results: Sequence[CommandResult]) -> None:
        """Do what the process does beside the tick: events, the pilot's display, the log's line."""
        events = self._event_log.step(sample, results)
        for event in events:
            to_json(event)
            promise(event.text.isprintable(), f"a line of the log that is none: {event.text!r}")
        promise("cannot be followed" not in sample.guided.name, sample.guided.name)
        self.engine.displayed(sample, events)
        promise(status_line(sample).isprintable(), "a status line that is none")

    def order(self, asked: tuple[str, bytes]) -> None:
        """Put a command into the queue, as a session of this machine does."""
        self._queue.put(ReceivedCommand(*asked, self._answered, local=True))

    def _between_ticks(self, sample: ControlSample) -> None:
        """Do what the process does until the next tick."""
        guided = (sample.guided.number, sample.guided.kind)
        if guided != self._guided:
            self._guided = guided
            self._drawing = Task(drawing(self.engine.path, guided[0], self.engine.config, sample.state))
        for _ in range(PIECES):
            more = self._queue.prepare() | (not self._drawing.advance(COST))
            if not more:
                break

    def _answered(self, reply: Reply) -> None:
        promise("leads to an error" not in reply.said, reply.said)
        self._tally.answers["done" if reply.done else "refused"] += 1

    def _heard_from_ground(self) -> tuple[Inbox, list[bytes]]:
        said, self.ground = self.ground, []
        if self._relay is None:
            return [], []
        passed = [data for t_ns, frame in said for data in self._relay.to_vehicle(t_ns, frame)]
        return self._relay.take(), passed


@dataclass
class Tally:
    """What came of all dives so far."""

    recovered: int = 0
    ticks: int = 0
    paths: int = 0
    answers: Counter[str] = field(default_factory=Counter)
    states: Counter[State] = field(default_factory=Counter)

    def add(self, other: "Tally") -> None:
        """Take what came of others."""
        self.recovered += other.recovered
        self.ticks += other.ticks
        self.paths += other.paths
        self.answers += other.answers
        self.states += other.states


def storm(rng: Random, dive: Fuzzed) -> list[Spoil]:
    """Return one to three things that go wrong at once."""
    return [rng.choice(STORMS)(rng, dive) for _ in range(rng.choice((1, 1, 1, 2, 3)))]


def fuzz(number: int, tally: Tally) -> None:
    """Dive number `number`; raises whatever goes wrong."""
    rng = Random(number)
    plant, sea, companion = VARIANTS[rng.randrange(len(VARIANTS))]
    if rng.random() < 0.3 and not companion:
        companion = WITH_GROUND
    ours = rng.random() < 0.5
    config = load_config(overrides=companion) if ours else configuration(rng, companion)
    fuzzed = Fuzzed(rng, config, tally)
    if rng.random() < 0.2:
        _messages_alone(rng, fuzzed, tally)
    else:
        sea = ("current.enabled=false", *sea, *rng.choice(((), POSITIONED)), *rng.choice(((), _sea(rng))))
        vehicle = Vehicle(load_plant(CONFIG / plant, sea), number)
        loop = Lockstep(vehicle, fuzzed, LinkDelay(), number, config.loop.rate_hz)  # type: ignore[arg-type]
        _dive(rng, fuzzed, loop, tally, config if ours else None)


def _sea(rng: Random) -> tuple[str, ...]:
    return (
        "waves.enabled=true",
        f"waves.spectrum={rng.choice(('jonswap', 'regular'))}",
        f"waves.height_m={rng.uniform(*SEA_HEIGHTS_M)}",
        f"waves.period_s={rng.uniform(*SEA_PERIODS_S)}",
        f"waves.direction_deg={rng.uniform(0.0, 360.0)}",
    )


def _messages_alone(rng: Random, fuzzed: Fuzzed, tally: Tally) -> None:
    """No vehicle: any messages at any time, an operator too."""
    fuzzed.spoils = [
        insertion(rng, fuzzed),
        insertion(rng, fuzzed),
        *storm(rng, fuzzed),
        buttons(rng, fuzzed),
    ]
    now_s = START_S
    for tick in range(DIVE_TICKS):
        now_s += rng.choice((TICK_S,) * 20 + (0.0, 1e-6, 0.3, 10.0))
        fuzzed.step(now_s, [], LoopHealth(tick, 50.0, 0.0, 0.0, 0, 0))
        tally.ticks += 1


def _dive(rng: Random, fuzzed: Fuzzed, loop: Lockstep, tally: Tally, sound: Config | None) -> None:
    """Storms and calms in turn; as long as the configuration is `sound` it recovers from a storm."""
    calm, left = 0, CALM_TICKS
    for _ in range(DIVE_TICKS):
        if left == 0 and not fuzzed.spoils:
            fuzzed.spoils, left = storm(rng, fuzzed), rng.randint(*rng.choice(STORM_TICKS))
        elif left == 0:
            fuzzed.spoils, left = [], rng.choice((CALM_TICKS, CALM_TICKS, RECOVERED_TICKS + 10))
        left -= 1
        calm = 0 if fuzzed.spoils or fuzzed.asleep_ticks else calm + 1
        if calm % 50 == 20 and fuzzed.engine.verdict.state is not State.ACTIVE:
            loop.requests.append(rng.choice((Request.CLEAR_FAULT, Request.ENGAGE)))
        step = loop.tick()
        tally.ticks += 1
        if calm % ORDER_TICKS == 1:
            fuzzed.order(order(rng))
        elif calm % PATH_TICKS == 1:
            fuzzed.order(order(rng, ("follow", "follow", "goto", "path", "velocity")))
        if calm == RECOVERED_TICKS and fuzzed.engine.config == sound and not fuzzed.by_pressure:
            believed, true = step.sample.state.eta, step.truth.eta
            tally.recovered += 1
            missed_rad = abs(math.remainder(believed[PSI] - true[5], math.tau))
            for missed, near in ((abs(believed[Z] - true[2]), NEAR_M), (missed_rad, NEAR_RAD)):
                promise(bool(missed <= near), f"{believed} where it is {true}, long after the storm")


def told(number: int) -> tuple[Tally, str]:
    """Return what came of a dive, and what it broke; empty if nothing."""
    tally = Tally()
    try:
        fuzz(number, tally)
    except Exception:  # the finding is told, and the next dive begins
        return tally, f"dive {number}, tick {tally.ticks}: {traceback.format_exc(-1)}"
    return tally, ""


def main() -> int:
    """Fuzz until so many ticks are done; say what came of it, also where it is interrupted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--dives", type=int, default=sys.maxsize)
    parser.add_argument("--jobs", type=int, default=1)
    chosen = parser.parse_args()
    tally, dives, broken = Tally(), 0, 0
    alone = signal.signal, (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is this process's
    with multiprocessing.Pool(chosen.jobs, *alone) as pool, contextlib.suppress(KeyboardInterrupt):
        for done, finding in pool.imap(told, range(chosen.first, chosen.first + chosen.dives)):
            tally.add(done)
            dives, broken = dives + 1, broken + bool(finding)
            sys.stdout.write(finding)
            if tally.ticks >= chosen.ticks:
                break
            if dives % TOLD_DIVES == 0:
                sys.stdout.write(f"{tally.ticks} ticks so far\n")
            sys.stdout.flush()
    sys.stdout.write(f"{tally.ticks} ticks in {dives} dives, {broken} break a promise; {tally}\n")
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())
