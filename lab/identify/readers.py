"""Logs of whatever kind as the table of samples: told by their content, within limits of size and count.

A reader collects `Streams`. Everything raises NoDiveError, in one line, for a file that tells nothing of a
dive, and OSError; what a damaged one makes pymavlink stumble over, `holdfast.child` puts into words.
"""

import contextlib
import math
import operator
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from companion.arrays import Array
from companion.core.allocation import FACTORS
from companion.identify.sample_table import NoDiveError, Rows, Streams, Table
from companion.mavlink.ardusub import FRAMES, motor_outputs
from companion.mavlink.frames import frame_at
from companion.mavlink.messages import is_known, message_name
from companion.records import AXES, State
from companion.telemetry.schemas import Raw
from dashboard.recording.mcap_file import MAGIC, Reader
from lab.identify import spreadsheet
from lab.identify.steering import DIRECT, MANUAL, UNKNOWN
from lab.identify.telemetry import EXTENSIONS, USED, Telemetry, aided, motors_of, not_read

DATAFLASH: Final = b"\xa3\x95"
DATAFLASH_STREAMS: Final[dict[str, list[tuple[str, tuple[str, ...], Callable[[Any], float]]]]] = {
    "ATT": [("attitude", ("Roll", "Pitch", "Yaw"), math.radians)],
    "RATE": [("rates", ("R", "P", "Y"), math.radians)],
    "IMU": [("rates", ("GyrX", "GyrY", "GyrZ"), float)],
    "XKF1": [("level", ("VN", "VE"), float), ("down", ("VD",), float), ("depth", ("PD",), float)],
    "XKF4": [("aided", ("SS",), aided)],
    "BAT": [("voltage", ("Volt",), float)],
    "RCOU": [("outputs", tuple(f"C{number}" for number in range(1, 15)), float)],
}
"""What each message tells: of which stream, its fields, and how they become its units."""
DATAFLASH_USED: Final = [*DATAFLASH_STREAMS, "PARM", "ARM"]
INSTANCES: Final = ("I", "C", "Inst", "Instance")
"""Fields that count the sensor, the EKF's core or the battery."""
Key = tuple[str, str]
"""A message and the stream that it fills."""
USED_IDS: Final = {number for number in range(1 << 10) if is_known(number) and message_name(number) in USED}
STEERS: Final = {State.ACTIVE, State.RAMP_DOWN, State.HAND_OVER}
"""States of the supervisor in which Holdfast's commands are sent."""
PUBLISHED: Final = {
    "attitude": ("roll_rad", "pitch_rad", "heading_rad"),
    "rates": ("roll_rate_radps", "pitch_rate_radps", "heading_rate_radps"),
    "level": ("x_rate_mps", "y_rate_mps"),
    "down": ("depth_rate_mps",),
    "depth": ("depth_m",),
    "voltage": ("voltage_v",),
}
"""Fields of the published state by the stream that they fill."""
HELD_IN_WAVES: Final = "where Holdfast held it in waves, thrust that answers to them looks like inertia"
ESTIMATES: Final = "speeds are Holdfast's estimates; a recording with telemetry.raw = true has the sensors'"
MAX_TOPIC = 60
"""Characters of a topic that are quoted."""
MAX_SILENCE_S: Final = 10.0
"""A longer silence of a .tlog, or a jump of its UTC, is shortened to this."""
KINDS: Final = ".BIN, .tlog, .mcap, or a CSV with a column t_s"
ROS_MAGIC: Final = (b"#ROSBAG", b"SQLite format 3")
ROS: Final = "ROS bags are not read: docs/identify.md has a script that makes a CSV of one"


def kind_of(path: Path) -> str:
    """Return "MCAP", "dataflash", "CSV" or "telemetry" by a file's content, else raise NoDiveError."""
    head = b""
    if not path.is_dir():
        with path.open("rb") as file:
            head = file.read(4096)
    if path.is_dir() or path.suffix.lower() in (".bag", ".db3") or head.startswith(ROS_MAGIC):
        raise NoDiveError(ROS)
    if not head:
        raise NoDiveError("is empty")
    if head.startswith((MAGIC, DATAFLASH)):
        return "MCAP" if head.startswith(MAGIC) else "dataflash"
    if spreadsheet.header(head):
        return "CSV"
    if path.suffix.lower() == ".tlog" or (len(head) > 8 and head[8] in (0xFD, 0xFE)):
        return "telemetry"
    raise NoDiveError(f"is no log that is known: {KINDS}{spreadsheet.quoted(head)}")


def read(path: Path, frame: str) -> Table:
    """Read a log of any kind; `frame` says which motors serve which axis."""
    readers = {"MCAP": _mcap, "dataflash": _dataflash, "CSV": spreadsheet.read, "telemetry": _tlog}
    streams = readers[kind_of(path)](path)
    _refuse_contradicted(streams.parameters, frame)
    return streams.table(str(path), frame)


def _refuse_contradicted(parameters: Mapping[str, float], frame: str) -> None:
    """Raise NoDiveError where a log's parameters tell of another frame than the vehicle's file."""
    value = parameters.get("FRAME_CONFIG")
    has = FRAMES.get(value, "another frame") if value is not None else frame
    if has != frame:
        raise NoDiveError(
            f'FRAME_CONFIG is {value:g}, {has}, but --vehicle has frame = "{frame}": choose one of that frame'
        )
    outputs = motor_outputs(parameters)[: len(FACTORS[frame])]
    if not all(outputs):
        raise NoDiveError(f'no SERVOn_FUNCTION is motor {outputs.index(0) + 1} of frame "{frame}"')


def _dataflash(path: Path) -> Streams:
    from pymavlink.DFReader import DFReader_binary

    reader = DFReader_binary(str(path), zero_time_base=True)
    try:
        return _dataflash_streams(reader)
    finally:
        reader.data_map.close()
        reader.filehandle.close()


def _dataflash_streams(reader: Any) -> Streams:
    found = defaultdict[Key, list[tuple[float, ...]]](list)
    armed, primary = list[tuple[float, float]](), list[tuple[float, float]]()
    parameters: dict[str, float] = {}
    while (message := reader.recv_match(type=DATAFLASH_USED)) is not None:
        kind = message.get_type()
        if kind == "PARM":
            parameters[str(message.Name)] = float(message.Value)
        elif kind == "ARM":
            state = float(message.ArmState)
            armed = armed or [(-math.inf, 1.0 - state)]
            armed.append((message.TimeUS / 1e6, state))
        else:
            t_s, core = message.TimeUS / 1e6, getattr(message, "PI", None)
            primary += [(t_s, core)] if core is not None else []
            instance = next((i for name in INSTANCES if (i := getattr(message, name, None)) is not None), 0)
            absent = (0,) if kind == "RCOU" else ()  # some log fewer outputs
            for stream, names, convert in DATAFLASH_STREAMS[kind]:
                values = (convert(getattr(message, name, *absent)) for name in names)
                found[kind, stream].append((instance, t_s, *values))
    if ("RCOU", "outputs") not in found:
        has = ", ".join(dict.fromkeys(kind for kind, _ in found))
        raise NoDiveError(f"holds no RCOU, the outputs of the motors; it has {has or 'nothing of a dive'}")
    used = _in_use(found, primary, parameters)
    outputs = used.pop(("RCOU", "outputs"))
    if ("IMU", "rates") in used:
        used.pop(("RATE", "rates"), None)
    told = dict.fromkeys(kind for kind, stream in used if stream not in ("voltage", "aided"))
    times_s, states = np.array(armed or [(-math.inf, math.nan)]).T
    is_armed = states[np.searchsorted(times_s, outputs[:, 0], side="right") - 1]
    whole = sum(count * reader.formats[kind].len for kind, count in enumerate(reader.counts) if count)
    about = f"commands: RCOU; motion: {', '.join(told)}, of the instances in use"
    notes = (about, *not_read({"bytes": max(reader.data_len - whole, 0)}))
    motors = motors_of(outputs, parameters, is_armed)
    streams: dict[str, Any] = {stream: rows for (_, stream), rows in used.items()}
    return Streams(**streams, motors=motors, notes=notes, parameters=parameters)


def _in_use(found: Mapping[Key, Rows], primary: Rows, parameters: Mapping[str, float]) -> dict[Key, Array]:
    """Return the rows of the instances in use: the EKF's primary core, its IMU, and the first battery."""
    mask = int(parameters.get("EK3_IMU_MASK", 3.0))
    imu_of: dict[float, float] = dict(enumerate(bit for bit in range(8) if mask >> bit & 1))
    cores = primary or [(0.0, parameters.get("EK3_PRIMARY", 0.0))]
    imus = [(t_s, imu_of.get(core, core)) for t_s, core in cores]
    if parameters.get("AHRS_EKF_TYPE", 3.0) != 3.0:  # another EKF than that of XKF1 steered
        cores = [(0.0, -1.0)]
    used = dict[Key, Array]()
    for key, given in found.items():
        table = np.array(given)
        of = {"XKF": cores, "IMU": imus}.get(key[0][:3]) or [(0.0, table[:, 0].min())]
        times_s, instances = np.array(of).T
        at = np.clip(np.searchsorted(times_s, table[:, 1], side="right") - 1, 0, None)
        used[key] = table[instances[at] == table[:, 0], 1:]
    return {key: rows for key, rows in used.items() if len(rows)}


def _tlog(path: Path) -> Streams:
    from pymavlink import mavutil

    telemetry = Telemetry()
    t_s, last_s = 0.0, None
    with contextlib.closing(mavutil.mavlogfile(str(path))) as file:
        while (message := file.recv_msg()) is not None:
            if message.get_type() == "BAD_DATA":
                telemetry.unread["pieces of broken data"] += 1
            elif message.get_type() in USED:
                stamp_s = message._timestamp  # noqa: SLF001  # pymavlink's name for it
                t_s += min(max(stamp_s - (stamp_s if last_s is None else last_s), 0.0), MAX_SILENCE_S)
                last_s = stamp_s
                source = message.get_srcSystem(), message.get_srcComponent()
                telemetry.take(t_s, source, message.get_seq(), message.get_type(), partial(getattr, message))
    return telemetry.collected()


def _mcap(path: Path) -> Streams:
    """Read our recorder's file, with raw ticks or without, or that of BlueOS.

    BlueOS keeps each message under its own name and again as mavlink/out: the first counts where it is there.
    """
    topics, out, samples = Telemetry(), Telemetry(), _Samples()
    decode, json = msgspec.msgpack.Decoder(Raw).decode, msgspec.json.Decoder().decode
    ours, unread = False, Counter[str]()
    for item in Reader(path):
        parts = item.key.split("/")
        try:
            if parts[0] == "holdfast" and parts[-1] == "raw":
                raw, ours = decode(item.payload), True
                heard = [(t_ns / 1e9, data) for t_ns, data in raw.heard]
                for t_s, data in [*heard, *((raw.now_s, data) for data in raw.out)]:
                    _take_datagram(topics, t_s, data)
            elif parts[0] == "holdfast" and parts[-1] in ("state", "command", "supervisor"):
                ours = True
                samples.take(parts[-1], json(item.payload))
            elif parts[0] == "mavlink" and parts[-1] in USED and len(parts) == 4:
                _take_json(topics, item.log_ns / 1e9, json(item.payload), parts[-1])
            elif item.key == "mavlink/out":
                _take_json(out, item.log_ns / 1e9, json(item.payload), "")
        except (ValueError, KeyError, TypeError, AttributeError, struct.error, RecursionError):
            unread[item.key[:MAX_TOPIC]] += 1
    telemetry = topics if topics.heard else out
    streams = telemetry.collected() if telemetry.heard else samples.streams()
    if not len(streams.attitude):
        raise NoDiveError(f"holds no dive: neither holdfast/.../state nor mavlink/.../ATTITUDE; {ROS}")
    warned = (HELD_IN_WAVES,) * ours + (ESTIMATES,) * (not telemetry.heard)
    return streams._replace(notes=(*streams.notes, *not_read(unread), *warned))


def _take_datagram(telemetry: Telemetry, t_s: float, data: bytes) -> None:
    at = 0
    while at < len(data):
        size, frame = frame_at(data, at)
        if frame is not None and frame.id in USED_IDS:
            get = partial(getattr, frame.message())
            source, sequence = (frame.system, frame.component), data[at + 2 * frame.version]
            telemetry.take(t_s, source, sequence, message_name(frame.id), get)
        at += size or 1


def _take_json(telemetry: Telemetry, t_s: float, record: Mapping[str, Any], topic: str) -> None:
    """Take a message as mavlink-server publishes it; `topic` names one that does not name itself."""
    message, header = record["message"], record["header"]
    name = str(message.get("type", topic))
    if name in USED:
        fields = {**message, "type": message.get("mavtype", 0)}
        telemetry.take(
            t_s,
            (int(header["system_id"]), int(header["component_id"])),
            header.get("sequence", 0),
            name,
            lambda key: fields.get(key, 0) if key in EXTENSIONS else fields[key],
        )


class _Samples:
    """What Holdfast published: its commands count while it steers an armed vehicle in MANUAL or STABILIZE."""

    def __init__(self) -> None:
        self._rows = defaultdict[str, Any](list)
        self._acts, self._steers = DIRECT[MANUAL], True

    def streams(self) -> Streams:
        """Return what it took."""
        return Streams(**self._rows)

    def take(self, kind: str, record: Mapping[str, Any]) -> None:
        """Take a record."""
        rows = self._rows
        if kind == "supervisor":
            self._steers = record["state"] in STEERS
        elif kind == "command":
            acts = self._acts if self._steers else UNKNOWN
            demands = (*(record[axis] for axis in AXES), 0.0, 0.0)
            rows["sticks"].append((record["t_s"], *map(operator.mul, demands, acts)))
        else:
            self._acts = DIRECT.get(record["mode"], UNKNOWN) if record["armed"] else UNKNOWN
            for stream, names in PUBLISHED.items():
                rows[stream].append((record["t_s"], *(record[name] for name in names)))
            absent = {"x_m", "x_rate_mps"} & {*record.get("absent", ())}
            rows["aided"].append((record["t_s"], 0.0 if absent else 1.0))
