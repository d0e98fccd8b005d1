"""A manual dive of a made-up vehicle, and a writer of it for each kind of log. None of the lab's code."""

import json
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
from mcap.writer import Writer
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.telemetry.schemas import Raw
from dashboard.recording.mcap_file import Item, Recording

STEP_S = 0.05
MASS, LINEAR, QUADRATIC = (30.0, 34.0, 50.0, 0.9), (10.0, 14.0, 25.0, 0.6), (80.0, 120.0, 120.0, 1.5)
CORIOLIS, COUPLING, LAG_S, START_S = 0.6, 1.0, 0.05, 0.15
CURVE_US = (-400, -300, -200, -100, -60, -28, 28, 60, 100, 200, 300, 400)
CURVE_N = (-39.9, -26.6, -14.1, -4.7, -1.8, 0.0, 0.0, 2.2, 5.9, 17.9, 33.5, 51.5)
MIXER = np.array([(-1, 1, 0, 1), (-1, -1, 0, -1), (1, 1, 0, -1), (1, -1, 0, 1), *[(0, 0, 1, 0)] * 4], float)
ARMS = np.array((math.sqrt(0.5), math.sqrt(0.5), 1.0, math.sqrt(0.5) * 0.267))


@dataclass
class Dive:
    """Rows of STEP_S: time, sticks (surge, sway, heave, yaw), u v w r, north east down, heading."""

    t_s: np.ndarray
    sticks: np.ndarray
    velocity: np.ndarray
    place: np.ndarray
    heading: np.ndarray


def dive(
    length_s: float = 120.0,
    seed: int = 1,
    axes: tuple[int, ...] = (0, 1, 2, 3),
    force: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
) -> Dive:
    """Steer `axes` by turns and together, from rest and back, while a constant `force` acts."""
    rng = np.random.default_rng(seed)
    count, fine = round(length_s / STEP_S), 5
    sticks = np.zeros((count, 4))
    at = 0
    while at < count:
        lasts = round(float(rng.uniform(0.5, 3.0)) / STEP_S)
        for axis in axes:
            if rng.random() < 0.45:
                sticks[at : at + lasts, axis] = float(rng.choice((-0.5, -0.25, 0.25, 0.5)))
        at += lasts + round(float(rng.uniform(0.2, 2.0)) / STEP_S)
    nu, place, heading = np.zeros(4), np.array((0.0, 0.0, 3.0)), 0.3
    rests, turns, pushes = np.full(8, START_S), np.zeros(8), np.zeros(8)
    rows = []
    h = STEP_S / fine
    m, d1, d2 = (np.array(values) for values in (MASS, LINEAR, QUADRATIC))
    for k in range(count):
        rows.append((*nu, *place, heading))
        asked = np.interp(400.0 * (MIXER @ sticks[k]), CURVE_US, CURVE_N)
        for _ in range(fine):
            fresh = np.sign(asked) != turns
            turns = np.sign(asked)
            rests = np.where(fresh | (turns == 0.0), START_S, rests - h)
            given = np.where(rests <= 0.0, asked, 0.0)
            pushes = given + (pushes - given) * math.exp(-h / LAG_S)
            tau = (pushes @ MIXER) * ARMS + force
            u, v, _, r = nu
            tau += np.array((CORIOLIS * m[1] * r * v, -CORIOLIS * m[0] * r * u, 0.0, COUPLING * v))
            nu = nu + h * (tau - d1 * nu - d2 * np.abs(nu) * nu) / m
            c, s = math.cos(heading), math.sin(heading)
            place = place + h * np.array((c * nu[0] - s * nu[1], s * nu[0] + c * nu[1], nu[2]))
            heading += h * nu[3]
    table = np.array(rows)
    noise = rng.normal(0.0, 0.004, (count, 4))
    return Dive(np.arange(count) * STEP_S, sticks, table[:, :4] + noise, table[:, 4:7], table[:, 7])


def pwm_us(sticks: np.ndarray) -> list[int]:
    """Return the outputs of the eight motors."""
    return [round(1500 + 400 * float(demand)) for demand in np.clip(MIXER @ sticks, -1.0, 1.0)]


def north_east_down(one: Dive, k: int) -> tuple[float, float, float]:
    """Return the velocity of row k."""
    u, v, w, _ = one.velocity[k].tolist()
    c, s = math.cos(one.heading[k]), math.sin(one.heading[k])
    return c * u - s * v, s * u + c * v, w


def write_csv(one: Dive, path: Path, *, speeds: bool = True, late_s: float = 0.0) -> Path:
    """Write the documented columns, commands `late_s` late; without `speeds` depth and attitude alone."""
    names = "t_s,surge,sway,heave,yaw,roll,pitch,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad"
    lines = [names + (",u_mps,v_mps,w_mps,p_radps,q_radps,r_radps" if speeds else "")]
    for k, t_s in enumerate(one.t_s):
        sent = one.sticks[max(k - round(late_s / STEP_S), 0)]
        sticks = ",".join(f"{x:.3f}" for x in (*sent, 0.0, 0.0))
        pose = ",".join(f"{x:.5f}" for x in (*one.place[k], 0.0, 0.0, one.heading[k]))
        u, v, w, r = one.velocity[k]
        lines.append(
            f"{t_s:.3f},{sticks},{pose}" + (f",{u:.4f},{v:.4f},{w:.4f},0,0,{r:.4f}" if speeds else "")
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def frames(
    one: Dive, k: int, *, speeds: bool = True, source: tuple[int, int] = (1, 1), boot_s: float = 5.0
) -> list[bytes]:
    """Return the vehicle's MAVLink frames of row k."""
    link = mavlink.MAVLink(None, *source)
    boot_ms = round(1e3 * (boot_s + float(one.t_s[k])))
    r = float(one.velocity[k, 3])
    heading = math.remainder(float(one.heading[k]), 2.0 * math.pi)
    messages = [
        mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, heading, 0.0, 0.0, r),
        mavlink.MAVLink_local_position_ned_message(boot_ms, *one.place[k].tolist(), *north_east_down(one, k)),
        mavlink.MAVLink_global_position_int_message(
            boot_ms, 0, 0, 0, round(-1e3 * float(one.place[k, 2])), 0, 0, 0, 0
        ),
        mavlink.MAVLink_servo_output_raw_message((1000 * boot_ms) % (1 << 32), 0, *pwm_us(one.sticks[k])),
    ]
    if k % 20 == 0:
        flags = 0b0011_1111 if speeds else 0b1010_0111
        messages += [
            mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.1),
            mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 16000, 0, 0, 0, 0, 0, 0, 0, 0),
        ]
    return [bytes(message.pack(link)) for message in messages]


def write_tlog(one: Dive, path: Path, *, speeds: bool = True) -> Path:
    """Write a ground station's log."""
    with path.open("wb") as file:
        for k, t_s in enumerate(one.t_s):
            for frame in frames(one, k, speeds=speeds):
                file.write(struct.pack(">Q", round(1.7e15 + 1e6 * float(t_s))) + frame)
    return path


SERVO_OUTPUT_RAW = 36
ACTS: dict[str, Any] = {
    "armed": True,
    "mode": 19,
    "gain": 0.5,
    "sender": 255,
    "target": 1,
    "named": (),
    "override": False,
}


def steering(one: Dive, k: int, *, throttle_gain: float = 1.0, **changed: Any) -> list[bytes]:
    """Return what steers the vehicle in row k, and what it says of its own arming, mode and gains."""
    how = ACTS | changed
    vehicle, station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, how["sender"], 190)
    sent = []
    if k % 10 == 0:
        mode = 0x51 | (0x80 if how["armed"] else 0)
        named = ([] if how["gain"] is None else [("PilotGain", how["gain"])]) + [*how["named"]]
        sent = [
            mavlink.MAVLink_heartbeat_message(12, 3, mode, how["mode"], 4, 3),
            mavlink.MAVLink_param_value_message(b"JS_THR_GAIN", throttle_gain, 9, 1, 0),
            *(mavlink.MAVLink_named_value_float_message(0, key.encode(), value) for key, value in named),
        ]
    u, v, w, r = one.sticks[k].tolist()
    if how["override"]:
        us = [round(1500 + 400 * x) for x in (0.0, 0.0, -w, r, u, v)]
        steers = mavlink.MAVLink_rc_channels_override_message(how["target"], 1, *us, 65535, 65535)
    else:
        gain = how["gain"] or 1.0
        x, y, z, turn = np.clip(np.array((u, v, w / throttle_gain, r)) / gain, -1.0, 1.0).tolist()
        steers = mavlink.MAVLink_manual_control_message(
            how["target"], round(1e3 * x), round(1e3 * y), round(500 - 500 * z), round(1e3 * turn), 0
        )
    return [*(bytes(one.pack(vehicle)) for one in sent), bytes(steers.pack(station))]


def write_sticks(one: Dive, path: Path, late: Sequence[float] = (0.0,), **how: Any) -> Path:
    """Write a ground station's log with outputs at 2 Hz; the vehicle's messages are `late` by turns, s."""
    rows = []
    for k, t_s in enumerate(one.t_s.tolist()):
        rows += [(t_s, frame) for frame in steering(one, k, **how)]
        told = [frame for frame in frames(one, k) if frame[7] != SERVO_OUTPUT_RAW or k % 10 == 0]
        rows += [(t_s + late[k % len(late)], frame) for frame in told]
    rows.sort(key=lambda row: row[0])
    path.write_bytes(b"".join(struct.pack(">Q", round(1.7e15 + 1e6 * t_s)) + frame for t_s, frame in rows))
    return path


def write_raw_mcap(one: Dive, path: Path) -> Path:
    """Write our recorder's file with raw ticks."""
    recording = Recording(path)
    for k, t_s in enumerate(one.t_s.tolist()):
        heard = [(round(1e9 * (50.0 + t_s)), frame) for frame in frames(one, k)]
        raw = Raw(tick=k + 1, now_s=50.0 + t_s, heard=heard, out=[])
        time_ns = round(1e9 * (1.7e9 + t_s))
        recording.add(
            Item("holdfast/kelp/raw", "application/msgpack", msgspec.msgpack.encode(raw), time_ns, time_ns)
        )
    recording.close()
    return path


def write_sample_mcap(one: Dive, path: Path, *, armed_at: float = 0.0, engaged_at: float = 0.0) -> Path:
    """Write our recorder's file without raw ticks."""
    recording = Recording(path)
    for k, t_s in enumerate(one.t_s.tolist()):
        north, east, down = north_east_down(one, k)
        state = {"t_s": t_s, "roll_rad": 0.0, "pitch_rad": 0.0, "heading_rad": float(one.heading[k])}
        state |= {
            "roll_rate_radps": 0.0,
            "pitch_rate_radps": 0.0,
            "heading_rate_radps": float(one.velocity[k, 3]),
        }
        state |= {"x_rate_mps": north, "y_rate_mps": east, "depth_rate_mps": down, "voltage_v": 16.0}
        state |= {"armed": t_s >= armed_at, "mode": 19, "depth_m": float(one.place[k, 2])}
        command = {
            "t_s": t_s,
            **dict(zip(("surge", "sway", "heave", "yaw"), one.sticks[k].tolist(), strict=True)),
        }
        time_ns = round(1e9 * (1.7e9 + t_s))
        supervisor = {"state": "ACTIVE" if t_s >= engaged_at else "READY"}
        for key, record in (("state", state), ("supervisor", supervisor), ("command", command)):
            payload = json.dumps(record).encode()
            recording.add(Item(f"holdfast/kelp/{key}", "application/json", payload, time_ns, time_ns))
    recording.close()
    return path


def write_blueos_mcap(
    one: Dive, path: Path, write: Callable[[dict[str, Any]], dict[str, Any]] = dict, *, whole: bool = True
) -> Path:
    """Write what BlueOS' recorder makes of mavlink-server's JSON: each message, in `whole` also its fields.

    `write` is how it writes a message's fields.
    """
    with path.open("wb") as file:
        writer, channels = Writer(file, chunk_size=50_000), {}
        writer.start()

        def put(topic: str, record: object, t_s: float) -> None:
            if topic not in channels:
                schema = writer.register_schema(topic, "jsonschema", b'{"type": "object"}')
                channels[topic] = writer.register_channel(topic, "json", schema)
            time_ns = round(1e9 * (1.7e9 + t_s))
            writer.add_message(channels[topic], time_ns, json.dumps(record).encode(), time_ns)

        if whole:
            put("services/autopilot-manager/log", {"level": "INFO", "message": "armed"}, 0.0)
        for k, t_s in enumerate(one.t_s.tolist()):
            for frame in frames(one, k):
                message = mavlink.MAVLink(None).parse_buffer(frame)[0]
                name = message.get_type()
                fields = write(
                    {key: value for key, value in message.to_dict().items() if key != "mavpackettype"}
                )
                header = {"system_id": 1, "component_id": 1, "sequence": 0}
                record = {"header": header, "message": {"type": name, **fields}}
                if whole:
                    put("mavlink/out", record, t_s)
                    for key, value in fields.items():
                        put(f"mavlink/1/1/{name}/{key}", value, t_s)
                put(f"mavlink/1/1/{name}", record, t_s)
        writer.finish()
    return path


DATAFLASH = {
    "PARM": (200, "QNf", "TimeUS,Name,Value"),
    "ATT": (201, "Qfff", "TimeUS,Roll,Pitch,Yaw"),
    "RATE": (202, "Qfff", "TimeUS,R,P,Y"),
    "XKF1": (203, "QBffff", "TimeUS,C,VN,VE,VD,PD"),
    "XKF4": (204, "QBIb", "TimeUS,C,SS,PI"),
    "RCOU": (205, "QHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8"),
    "BAT": (206, "QBf", "TimeUS,Inst,Volt"),
    "ARM": (207, "QB", "TimeUS,ArmState"),
    "IMU": (208, "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
}
PACKED = {"Q": "Q", "f": "f", "B": "B", "b": "b", "I": "I", "H": "H", "N": "16s"}


def write_dataflash(
    one: Dive,
    path: Path,
    *,
    speeds: bool = True,
    armed_at: float = 0.0,
    primary: int = 0,
    without: str = "",
    parameters: Mapping[str, float] = MappingProxyType({}),
) -> Path:
    """Write a .BIN in which motor 1 is output 3 and the other way round, and motor 2 is reversed.

    Of the EKF's two cores and IMUs the one that is not `primary` is wrong.
    """
    head = b"\xa3\x95"
    with path.open("wb") as file:

        def describe(number: int, size: int, name: str, kinds: str, columns: str) -> None:
            fields = (number, size, name.encode(), kinds.encode(), columns.encode())
            file.write(head + bytes((128,)) + struct.pack("<BB4s16s64s", *fields))

        def put(name: str, *values: object) -> None:
            number, kinds, _ = DATAFLASH[name]
            if name == without:
                return
            file.write(
                head + bytes((number,)) + struct.pack("<" + "".join(PACKED[x] for x in kinds), *values)
            )

        describe(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
        for name, (number, kinds, columns) in DATAFLASH.items():
            describe(
                number, 3 + struct.calcsize("<" + "".join(PACKED[x] for x in kinds)), name, kinds, columns
            )
        written = {"SERVO1_FUNCTION": 35.0, "SERVO3_FUNCTION": 33.0, "MOT_2_DIRECTION": -1.0, **parameters}
        for key, value in written.items():
            put("PARM", 1, key.encode(), value)
        for k, t_s in enumerate(one.t_s.tolist()):
            t_us = round(1e6 * (2.0 + t_s))
            outputs = pwm_us(one.sticks[k])
            outputs[0], outputs[1], outputs[2] = outputs[2], 3000 - outputs[1], outputs[0]
            if abs(t_s - armed_at) < STEP_S / 2:
                put("ARM", t_us, 1)
            put("ATT", t_us, 0.0, 0.0, math.degrees(float(one.heading[k])) % 360.0)
            put("RATE", t_us, 0.0, 0.0, math.degrees(float(one.velocity[k, 3])))
            for core in (0, 1):
                wrong = 1.0 if core == primary else -2.0
                north, east, down = north_east_down(one, k)
                put("IMU", t_us, core, 0.0, 0.0, wrong * float(one.velocity[k, 3]))
                solution = wrong * north, wrong * east, wrong * down, wrong * float(one.place[k, 2])
                put("XKF1", t_us, core, *solution)
                put("XKF4", t_us, core, 0b0011_1111 if speeds and core == primary else 0b1010_0111, primary)
            put("RCOU", t_us, *outputs)
            put("BAT", t_us, 0, 16.0)
    return path
