"""Logs of whatever kind as a `DiveLog`: told by their content, within limits of size and count.

Everything raises LogError, in one line, for a file that tells nothing of a dive, and OSError.
"""

import contextlib
import csv
import math
import os
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from companion.mavlink.ardusub import DIRECTIONS, from_pwm_us
from companion.mavlink.frames import MARKER, Frame, frame_at
from companion.mavlink.messages import is_known, message_name
from companion.telemetry.schemas import Raw
from dashboard.recording.mcap_file import MAGIC, Reader
from lab.logs import telemetry_log
from lab.logs.dive_log import (
    ABSURD,
    MAX_GAP_S,
    Array,
    DiveLog,
    LogError,
    Sample,
    Streams,
    check_length,
    no_progress,
)

Progress = Callable[[float], None]

STICKS: Final = ("surge", "sway", "heave", "yaw", "roll", "pitch")
POSES: Final = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad")
VELOCITIES: Final = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
MAX_ROWS: Final = 4_000_000
MAX_LINE: Final = 4096
DATAFLASH: Final = b"\xa3\x95"
EVERY: Final = 4096
"""So many samples between two reports of progress."""
HORIZONTAL_VELOCITY, HORIZONTAL_POSITION, CONSTANT_POSITION = 1 << 1, 1 << 3 | 1 << 4, 1 << 7
"""Bits of EKF_STATUS_REPORT.flags and XKF4.SS: velocity; position, relative or not; it is assumed to stay."""
FIRST_MOTOR_FUNCTION: Final = 33
"""SERVOn_FUNCTION of motor 1."""


def read(path: Path, frame: str, progress: Progress = no_progress) -> DiveLog:
    """Read a log of any kind; `frame` says which motors serve which axis."""
    if path.is_dir() or path.suffix in (".bag", ".db3"):
        return _bag(path, progress).log(str(path), frame)
    with path.open("rb") as file:
        head = file.read(4096)
    if not head:
        raise LogError("is empty")
    if head.startswith(MAGIC):
        streams = _mcap(path, progress)
    elif head.startswith(DATAFLASH):
        streams = _dataflash(path, progress)
    elif b"t_s" in head.partition(b"\n")[0]:
        return _csv(path, frame, progress)
    elif path.suffix == ".tlog" or (len(head) > 8 and head[8] in (0xFD, 0xFE)):
        streams = _tlog(path, progress)
    else:
        raise LogError("is no log that is known: .BIN, .tlog, .mcap, a ROS bag, or a CSV with a column t_s")
    return streams.log(str(path), frame)


# --- CSV --------------------------------------------------------------------------------------------------


def _csv(path: Path, frame: str, progress: Progress) -> DiveLog:
    """Read the columns of docs/identify.md; a row has commands or measurements, or both."""
    commands: list[list[float]] = []
    measured: list[list[float]] = []
    size = path.stat().st_size
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        lines = (line[:MAX_LINE] for line in iter(lambda: file.readline(MAX_LINE), ""))
        reader = csv.DictReader(lines)
        names = set(reader.fieldnames or ())
        if not names & set(STICKS) or not names & {*POSES, *VELOCITIES}:
            raise LogError(
                f"has no columns of commands ({', '.join(STICKS)}) or of measurements (z_m, u_mps, ...)"
            )
        try:
            for number, row in enumerate(reader):
                if number > MAX_ROWS:
                    raise LogError(f"has more than {MAX_ROWS} rows: cut it into parts")
                if number % EVERY == 0:
                    progress(min(number * 90 / size, 1.0))
                t_s = _number(row.get("t_s"))
                for wanted, rows in ((STICKS, commands), ((*POSES, *VELOCITIES), measured)):
                    values = [_number(row.get(name)) for name in wanted]
                    if math.isfinite(t_s) and any(map(math.isfinite, values)):
                        rows.append([t_s, *values])
        except csv.Error as error:
            raise LogError(f"row {number + 2} cannot be read: {error}") from error
    if not commands or not measured:
        raise LogError("has no row with a time and a command, or none with a measurement")
    given, moving = np.array(sorted(commands)), np.array(sorted(measured))
    if not np.isfinite(moving[:, 7:]).any():  # no speeds: from attitude and depth
        return _without_speeds(path, frame, given, moving)
    begin_s = max(given[0, 0], moving[0, 0])
    moving = moving[(moving[:, 0] >= begin_s) & (moving[:, 0] <= given[-1, 0] + MAX_GAP_S)]
    check_length(moving[-1, 0] - moving[0, 0] if len(moving) else 0.0)
    return DiveLog(
        str(path),
        given[:, 0] - begin_s,
        np.clip(np.nan_to_num(given[:, 1:]), -1.0, 1.0),
        np.full(len(given), 16.0),
        moving[:, 0] - begin_s,
        moving[:, 7:],
        moving[:, 4:7],
        moving[:, 3],
    )


def _without_speeds(path: Path, frame: str, given: Array, moving: Array) -> DiveLog:
    streams = Streams(sticks=[Sample(row[0], tuple(np.nan_to_num(row[1:]))) for row in given.tolist()])
    streams.attitude = [Sample(row[0], tuple(row[4:7])) for row in moving.tolist()]
    streams.depth = [Sample(row[0], (row[3],)) for row in moving.tolist()]
    return streams.log(str(path), frame)


def _number(text: object) -> float:
    try:
        value = float(text) if isinstance(text, str) and text.strip() else math.nan
    except ValueError:
        return math.nan
    return value if abs(value) < ABSURD * 100.0 else math.nan


# --- MAVLink: .tlog, our MCAP, BlueOS' MCAP ---------------------------------------------------------------


class Telemetry:
    """Collects what MAVLink messages say, whoever decoded them."""

    def __init__(self) -> None:
        self.streams = Streams()
        self._parameters: dict[str, float] = {}
        self._outputs: list[tuple[float, list[int]]] = []
        self._ned: list[Sample] = []
        self._shift_s: float | None = None
        self._boot_s = 0.0
        self._vehicle: int | None = None

    def take(self, t_s: float, system: int, name: str, get: Callable[[str], Any]) -> None:
        """Take a message that arrived at `t_s`; `get` gives its fields."""
        if name in FROM_PILOT:
            self._sticks(t_s, name, get)
            return
        if name == "ATTITUDE" and self._vehicle is None:
            self._vehicle = system
        if system != self._vehicle:
            return
        streams = self.streams
        if name == "ATTITUDE":
            t_s = self._stamp(t_s, get("time_boot_ms") / 1e3)
            streams.attitude.append(Sample(t_s, (get("roll"), get("pitch"), get("yaw"))))
            streams.rates.append(Sample(t_s, (get("rollspeed"), get("pitchspeed"), get("yawspeed"))))
        elif name == "LOCAL_POSITION_NED":
            t_s = self._stamp(t_s, get("time_boot_ms") / 1e3)
            streams.ned.append(Sample(t_s, (get("vx"), get("vy"), get("vz"))))
        elif name == "GLOBAL_POSITION_INT":
            t_s = self._stamp(t_s, get("time_boot_ms") / 1e3)
            streams.depth.append(Sample(t_s, (-get("relative_alt") / 1e3,)))
            self._ned.append(Sample(t_s, (get("vx") / 100.0, get("vy") / 100.0, get("vz") / 100.0)))
        elif name == "EKF_STATUS_REPORT":
            streams.aided.append(Sample(t_s, (aided(_bits(get("flags"))),)))
        elif name == "SERVO_OUTPUT_RAW" and not get("port"):
            t_s = self._stamp(t_s, get("time_usec") / 1e6)
            self._outputs.append((t_s, [get(f"servo{n}_raw") for n in range(1, 9)]))
        elif name == "SYS_STATUS":
            streams.voltage.append(Sample(t_s, (get("voltage_battery") / 1e3,)))
        elif name == "PARAM_VALUE":
            self._parameters[_text(get("param_id"))] = float(get("param_value"))

    def collected(self) -> Streams:
        """Return what came; the outputs become motors by the parameters that the log has."""
        outputs = [(t_s, dict(enumerate(pwm_us, 1))) for t_s, pwm_us in self._outputs]
        self.streams.motors = motors_of(outputs, self._parameters)
        self.streams.ned = self.streams.ned or self._ned
        aid = self.streams.aided
        if aid:  # it comes once a second or less often
            ends = [later.t_s for later in aid[1:]] + [aid[-1].t_s + 2.0]
            self.streams.aided = [
                Sample(t_s, sample.values)
                for sample, end_s in zip(aid, ends, strict=True)
                for t_s in np.arange(sample.t_s, min(end_s, sample.t_s + 10.0), 0.5).tolist()
            ]
        return self.streams

    def _stamp(self, t_s: float, boot_s: float) -> float:
        """Return the vehicle's stamp on the clock of the arrivals, which the first message ties together."""
        if self._shift_s is None or boot_s < self._boot_s - 1.0 or abs(t_s - boot_s - self._shift_s) > 30.0:
            self._shift_s = t_s - boot_s
        self._boot_s = boot_s
        return boot_s + self._shift_s

    def _sticks(self, t_s: float, name: str, get: Callable[[str], Any]) -> None:
        if name == "MANUAL_CONTROL":
            x, y, z, r = (get(key) for key in "xyzr")
            sticks = (x / 1e3, y / 1e3, (500.0 - z) / 500.0, r / 1e3, 0.0, 0.0)
        else:
            pitch, roll, up, yaw, surge, sway = (_channel(get(f"chan{n}_raw")) for n in range(1, 7))
            sticks = (surge, sway, -up, yaw, roll, pitch)
        self.streams.sticks.append(Sample(t_s, sticks))


FROM_PILOT: Final = ("RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL")
USED: Final = {
    *FROM_PILOT,
    *("ATTITUDE", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "EKF_STATUS_REPORT", "SERVO_OUTPUT_RAW"),
    *("SYS_STATUS", "PARAM_VALUE"),
}
USED_IDS: Final = {number for number in range(1 << 10) if is_known(number) and message_name(number) in USED}


def aided(flags: int) -> float:
    """Return 1 if the EKF's horizontal velocity is measured by these status bits, else 0."""
    measured = flags & HORIZONTAL_VELOCITY and flags & HORIZONTAL_POSITION
    return 1.0 if measured and not flags & CONSTANT_POSITION else 0.0


def motors_of(
    outputs: Sequence[tuple[float, Mapping[int, int]]], values: Mapping[str, float]
) -> list[Sample]:
    """Return the demand on each motor from servo outputs (µs by number): SERVOn_FUNCTION, MOT_n_DIRECTION."""
    servo = {motor: motor for motor in range(1, 9)}
    for number in range(1, 17):
        motor = round(values.get(f"SERVO{number}_FUNCTION", 0.0)) - FIRST_MOTOR_FUNCTION + 1
        if motor in servo:
            servo[motor] = number
    signs = [-1.0 if values.get(name, 1.0) < 0.0 else 1.0 for name in DIRECTIONS]
    return [
        Sample(
            t_s, tuple(sign * from_pwm_us(pwm_us.get(servo[n], 0) or 1500) for n, sign in enumerate(signs, 1))
        )
        for t_s, pwm_us in outputs
    ]


def _channel(pwm_us: int) -> float:
    return from_pwm_us(pwm_us) if 800 <= pwm_us <= 2200 else 0.0


def _bits(flags: Any) -> int:
    return int(flags.get("bits", 0)) if isinstance(flags, dict) else int(flags)


def _text(name: Any) -> str:
    return "".join(name).rstrip("\0") if isinstance(name, list) else str(name)


def _tlog(path: Path, progress: Progress) -> Streams:
    telemetry = Telemetry()
    size, done = path.stat().st_size, 0
    for number, record in enumerate(telemetry_log.read(path)):
        done += len(record.data) + 8
        if number % EVERY == 0:
            progress(done / size)
        if _message_id(record.data) in USED_IDS:
            _take_frame(telemetry, record.t_s, frame_at(record.data, 0)[1])
    return telemetry.collected()


def _message_id(data: bytes) -> int:
    """Return the id that a frame's header claims, -1 where it is cut."""
    if len(data) < 10:
        return -1
    return int.from_bytes(data[7:10], "little") if data[0] == MARKER else data[5]


def _take_frame(telemetry: Telemetry, t_s: float, frame: Frame | None) -> None:
    if frame is not None and frame.id in USED_IDS:
        message = frame.message()
        telemetry.take(t_s, frame.system, message_name(frame.id), lambda key: getattr(message, key))


def _mcap(path: Path, progress: Progress) -> Streams:
    """Read our recorder's file, with raw ticks or without, or that of BlueOS."""
    telemetry, samples = Telemetry(), Streams()
    decode = msgspec.msgpack.Decoder(Raw).decode
    json = msgspec.json.Decoder().decode
    reader = Reader(path)
    size, raws, cdr = path.stat().st_size, 0, False
    for number, item in enumerate(reader):
        if number % EVERY == 0:
            progress(min(reader.unpacked_bytes / 6 / size, 1.0))
        cdr = cdr or item.encoding.startswith("application/cdr")
        parts = item.key.split("/")
        t_s = item.log_ns / 1e9
        try:
            if parts[0] == "holdfast" and parts[-1] == "raw":
                raw = decode(item.payload)
                raws += 1
                for t_ns, data in raw.heard:
                    _take_datagram(telemetry, t_ns / 1e9, data)
                for data in raw.out:
                    _take_datagram(telemetry, raw.now_s, data)
            elif parts[0] == "holdfast" and parts[-1] in ("state", "command"):
                _take_sample(samples, parts[-1], json(item.payload))
            elif parts[0] == "mavlink" and "json" in item.encoding:
                _take_json(telemetry, t_s, parts, json(item.payload))
        except (ValueError, KeyError, TypeError, AttributeError, struct.error, RecursionError):
            continue
    (telemetry.streams if raws else samples).notes.append(
        "where Holdfast held it in waves, thrust that answers to them looks like inertia"
    )
    if raws or telemetry.streams.attitude:
        return telemetry.collected()
    if not samples.attitude:
        raise LogError(
            "is of ROS 2: give its folder, with metadata.yaml"
            if cdr
            else "holds no dive: neither holdfast/.../state nor mavlink/.../ATTITUDE"
        )
    samples.notes.append(
        "speeds are Holdfast's estimates; a recording with telemetry.raw = true has the sensors'"
    )
    return samples


def _take_datagram(telemetry: Telemetry, t_s: float, data: bytes) -> None:
    at = 0
    while at < len(data):
        size, frame = frame_at(data, at)
        _take_frame(telemetry, t_s, frame)
        at += size or 1


def _take_sample(samples: Streams, kind: str, record: Mapping[str, Any]) -> None:
    t_s, absent = record["t_s"], record.get("absent", ())
    if kind == "command":
        samples.sticks.append(
            Sample(t_s, (record["surge"], record["sway"], record["heave"], record["yaw"], 0.0, 0.0))
        )
        return
    samples.attitude.append(Sample(t_s, (record["roll_rad"], record["pitch_rad"], record["heading_rad"])))
    samples.rates.append(
        Sample(t_s, (record["roll_rate_radps"], record["pitch_rate_radps"], record["heading_rate_radps"]))
    )
    samples.ned.append(Sample(t_s, (record["x_rate_mps"], record["y_rate_mps"], record["depth_rate_mps"])))
    samples.depth.append(Sample(t_s, (record["depth_m"],)))
    samples.aided.append(Sample(t_s, (0.0 if "x_m" in absent or "x_rate_mps" in absent else 1.0,)))
    samples.voltage.append(Sample(t_s, (record["voltage_v"],)))


def _take_json(telemetry: Telemetry, t_s: float, parts: Sequence[str], record: Mapping[str, Any]) -> None:
    """Take a message as mavlink-server publishes it: mavlink/SYSTEM/COMPONENT/NAME."""
    message = record.get("message", record)
    name = str(message.get("type", parts[-1]))
    header = record.get("header", {})
    if name in USED:
        telemetry.take(t_s, int(header.get("system_id", parts[1])), name, lambda key: message.get(key, 0))


# --- Dataflash --------------------------------------------------------------------------------------------


def _dataflash(path: Path, progress: Progress) -> Streams:
    """Read a .BIN by pymavlink's reader: RCOU, ATT, RATE or IMU, XKF1, XKF4, BAT, PARM."""
    from pymavlink.DFReader import DFReader_binary

    reader = DFReader_binary.__new__(DFReader_binary)
    with (
        Path(os.devnull).open("w") as nowhere,
        contextlib.redirect_stderr(nowhere),
    ):  # it prints each bad byte
        return _dataflash_by(reader, path, progress)


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Let nothing that C prints to stderr through."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _dataflash_by(reader: Any, path: Path, progress: Progress) -> Streams:
    streams = Streams()
    outputs: list[tuple[float, Mapping[int, int]]] = []
    values: dict[str, float] = {}
    gyro: list[Sample] = []
    try:
        with _silent():
            reader.__init__(str(path), zero_time_base=True)
        wanted = ["ATT", "RATE", "IMU", "XKF1", "XKF4", "RCOU", "BAT", "PARM"]
        number = 0
        while (message := reader.recv_match(type=wanted)) is not None:
            number += 1
            if number % EVERY == 0:
                progress(reader.percent / 100.0)
            kind = message.get_type()
            if kind == "PARM":
                values[str(message.Name)] = float(message.Value)
                continue
            t_s = message.TimeUS / 1e6
            if kind == "ATT":
                streams.attitude.append(
                    Sample(t_s, tuple(map(math.radians, (message.Roll, message.Pitch, message.Yaw))))
                )
            elif kind == "RATE":
                streams.rates.append(Sample(t_s, tuple(map(math.radians, (message.R, message.P, message.Y)))))
            elif kind == "IMU" and not getattr(message, "I", 0):
                gyro.append(Sample(t_s, (message.GyrX, message.GyrY, message.GyrZ)))
            elif kind == "XKF1" and not getattr(message, "C", 0):
                streams.ned.append(Sample(t_s, (message.VN, message.VE, message.VD)))
                streams.depth.append(Sample(t_s, (message.PD,)))
            elif kind == "XKF4" and not getattr(message, "C", 0):
                streams.aided.append(Sample(t_s, (aided(int(message.SS)),)))
            elif kind == "BAT" and not getattr(message, "Inst", getattr(message, "Instance", 0)):
                streams.voltage.append(Sample(t_s, (message.Volt,)))
            elif kind == "RCOU":
                outputs.append((t_s, {n: int(getattr(message, f"C{n}", 0)) for n in range(1, 15)}))
    except OSError:
        raise
    except Exception as error:  # pymavlink's reader raises whatever a broken file makes it stumble over
        raise LogError(f"cannot be read as a dataflash log: {type(error).__name__}: {error}") from error
    finally:
        for opened in (getattr(reader, "data_map", None), getattr(reader, "filehandle", None)):
            if opened is not None:
                opened.close()
    streams.rates = gyro or streams.rates
    streams.motors = motors_of(outputs, values)
    return streams


# --- ROS bags ---------------------------------------------------------------------------------------------

MAVROS: Final = {
    "mavros_msgs/msg/RCOut": "std_msgs/Header header\nuint16[] channels\n",
    "mavros_msgs/msg/OverrideRCIn": "uint16[18] channels\n",
}


def _bag(path: Path, progress: Progress) -> Streams:
    """Read a ROS 2 bag's folder or a ROS 1 bag: Odometry or twist, Imu, and mavros' RCOut or OverrideRCIn."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in MAVROS.items():
        store.register(get_types_from_msg(text, name))
    streams = Streams()
    outputs: list[tuple[float, Mapping[int, int]]] = []
    folder = path.parent if path.suffix == ".db3" else path
    try:
        with AnyReader([folder], default_typestore=store) as bag:
            kinds = ("nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", *MAVROS)
            chosen = [one for one in bag.connections if one.msgtype in kinds]
            span_ns = max(bag.duration, 1)
            for number, (connection, t_ns, data) in enumerate(
                bag.messages(connections=chosen) if chosen else ()
            ):
                if number % EVERY == 0:
                    progress((t_ns - bag.start_time) / span_ns)
                _take_ros(
                    streams,
                    outputs,
                    t_ns / 1e9,
                    connection.msgtype,
                    bag.deserialize(data, connection.msgtype),
                )
    except (OSError, LogError):
        raise
    except Exception as error:  # rosbags raises whatever a broken bag makes it stumble over
        raise LogError(f"cannot be read as a ROS bag: {' '.join(str(error).split())[:200]}") from error
    streams.motors = motors_of(outputs, {})
    return streams


def _take_ros(
    streams: Streams, outputs: list[tuple[float, Mapping[int, int]]], t_s: float, kind: str, message: Any
) -> None:
    if kind.endswith("RCOut"):
        outputs.append((t_s, {n: int(pwm_us) for n, pwm_us in enumerate(message.channels, 1)}))
    elif kind.endswith("OverrideRCIn"):
        pitch, roll, up, yaw, surge, sway = (_channel(int(pwm_us)) for pwm_us in message.channels[:6])
        streams.sticks.append(Sample(t_s, (surge, sway, -up, yaw, roll, pitch)))
    elif kind.endswith("Imu"):
        rate = message.angular_velocity
        streams.attitude.append(Sample(t_s, _attitude(message.orientation)))
        streams.rates.append(Sample(t_s, (rate.x, -rate.y, -rate.z)))
    else:
        speed = message.twist.twist.linear
        streams.body.append(Sample(t_s, (speed.x, -speed.y, -speed.z)))
        streams.depth.append(Sample(t_s, (-message.pose.pose.position.z,)))


def _attitude(q: Any) -> tuple[float, float, float]:
    """Return roll, pitch, heading (NED, FRD) of ROS' orientation (ENU, FLU)."""
    roll = math.atan2(2.0 * (q.w * q.x + q.y * q.z), 1.0 - 2.0 * (q.x * q.x + q.y * q.y))
    pitch = math.asin(min(max(2.0 * (q.w * q.y - q.z * q.x), -1.0), 1.0))
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return roll, -pitch, 0.5 * math.pi - yaw
