"""What leaves the companion: the key space and its schemas. No Zenoh in here.

| key                              | schema       | what                                                     |
|----------------------------------|--------------|----------------------------------------------------------|
| holdfast/{vehicle}/state         | State        | what the estimator believes                              |
| holdfast/{vehicle}/dof/{dof}     | Dof          | the law's inside for one of x, y, z, psi                 |
| holdfast/{vehicle}/command       | Command      | what is sent to the vehicle, and the wrench behind it    |
| holdfast/{vehicle}/supervisor    | Supervisor   | the permission, and why                                  |
| holdfast/{vehicle}/loop          | Loop         | rate, lateness, ages, delays, counters                   |
| holdfast/{vehicle}/alive         | (liveliness) | there as long as the companion lives                     |
| holdfast/{vehicle}/raw           | Raw          | all that a tick took and gave; only with `telemetry.raw` |
| holdfast/{vehicle}/recorder      | Recorder     | what `holdfast record` is doing, once a second           |

One JSON object per key and tick, with every field always present and the encoding
`application/json;holdfast.Dof.v1`. A version may gain fields; a changed meaning makes a new one.

Never a null: a number that is not finite leaves as 0.0, and its field is named in `absent`. An age that
is infinite (the signal never came) leaves as `NEVER_S`. Every object has `t_s`, the companion's monotonic
clock, and `boot_s`, the vehicle's, which lines it up with anything else the vehicle stamped. `raw` alone is
MessagePack.
"""

import math
from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from typing import Any

import msgspec

from companion.types import DOFS, Condition, ControlSample, DofSample

ENDPOINT = "tcp/127.0.0.1:7447"  # where Zenoh is looked for, and listened on where nobody does
NEVER_S = 1e6


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """What every schema has: companion's clock, vehicle's clock (s), and the fields that were not finite."""

    t_s: float
    boot_s: float
    absent: tuple[str, ...] = ()


class State(Record, frozen=True, kw_only=True):
    """What the estimator believes, and where the vehicle should be, now.

    NED; heading clockwise from north; `mode` is ArduSub's number, `system_status` MAVLink's.
    """

    x_m: float
    y_m: float
    depth_m: float
    heading_rad: float
    x_desired_m: float
    y_desired_m: float
    depth_desired_m: float
    heading_desired_rad: float
    x_rate_mps: float
    y_rate_mps: float
    depth_rate_mps: float
    heading_rate_radps: float
    roll_rad: float
    pitch_rad: float
    roll_rate_radps: float
    pitch_rate_radps: float
    armed: bool
    mode: int
    system_status: int
    voltage_v: float
    pilot_gain: float


class Dof(Record, frozen=True, kw_only=True):
    """The law's inside for one degree of freedom, `ahead_s` from now: when a command sent now acts.

    `x*` and `e` are in `unit`, their derivatives in `unit` per s and per s²; `eps`, the combined error, is in
    `unit` per s. `tau`, its parts (tau = feedforward + feedback + d_hat, before saturation) and the
    observer's disturbance `d_observer` are in `tau_unit`. `e` is measured minus desired. What has no unit:
    `weight_norm`, of the network's weights.
    """

    dof: str
    unit: str
    tau_unit: str
    ahead_s: float
    x_d: float
    x_d_dot: float
    x_d_ddot: float
    x: float
    x_dot: float
    e: float
    e_dot: float
    eps: float
    tau: float
    feedforward: float
    feedback: float
    d_hat: float
    d_observer: float
    weight_norm: float
    saturated: bool
    adapting: bool
    engaged: bool


class Command(Record, frozen=True, kw_only=True):
    """Normalised demands (-1..1: forward, right, down, clockwise), the wrench asked for and delivered."""

    surge: float
    sway: float
    heave: float
    yaw: float
    surge_requested_n: float
    sway_requested_n: float
    heave_requested_n: float
    yaw_requested_nm: float
    surge_delivered_n: float
    sway_delivered_n: float
    heave_delivered_n: float
    yaw_delivered_nm: float


class Supervisor(Record, frozen=True, kw_only=True):
    """State and conditions by name, authority 0..1 over the command, and the reason in words."""

    state: str
    conditions: tuple[str, ...]
    authority: float
    reason: str


class Loop(Record, frozen=True, kw_only=True):
    """How the process does. Ages are at most `NEVER_S`; a delay not `known` is only a start value."""

    tick: int
    rate_hz: float
    lateness_ms: float
    compute_us: float
    late_ticks: int
    samples_dropped: int
    link_age_s: float
    heartbeat_age_s: float
    depth_age_s: float
    attitude_age_s: float
    position_age_s: float
    telemetry_delay_s: float
    telemetry_delay_known: bool
    command_delay_s: float
    command_delay_known: bool
    datagrams: int
    messages: int
    garbage: int
    foreign: int
    implausible: int


class Recorder(Record, frozen=True, kw_only=True):
    """What the recorder is doing. `dropped` messages came faster than the disk took them."""

    recording: bool
    file: str
    size_bytes: int
    messages: int
    dropped: int
    free_bytes: int
    said: str


class Start(msgspec.Struct, frozen=True, kw_only=True):
    """What an engine is built from: configuration as a table, setpoint (4,) with NaN where none is set."""

    config: dict[str, Any]
    setpoint: tuple[float, float, float, float]
    arm: bool
    version: str


class Raw(msgspec.Struct, frozen=True, kw_only=True):
    """All that one tick took and gave, so that `holdfast rerun` can repeat it; MessagePack, no JSON.

    `heard`, in the bytes "in": arrival in monotonic ns and the datagram. `requests` by name. The first tick
    has the `start`.
    """

    tick: int
    now_s: float
    heard: Sequence[tuple[int, bytes]] = msgspec.field(name="in")
    out: Sequence[bytes]
    requests: Sequence[str] = ()
    start: Start | None = None


Schema = State | Dof | Command | Supervisor | Loop | Recorder

_TAILS: dict[str, type[Schema]] = {
    "state": State,
    **{f"dof/{dof}": Dof for dof in DOFS},
    "command": Command,
    "supervisor": Supervisor,
    "loop": Loop,
}
_UNITS = (("m", "N"), ("m", "N"), ("m", "N"), ("rad", "N·m"))
_DOF_COLUMNS = tuple(field.name for field in fields(DofSample))
_encoder = msgspec.json.Encoder(enc_hook=lambda scalar: scalar.item())
_DECODED: dict[str, type[Schema]] = {**_TAILS, "recorder": Recorder}
_decoders = {schema: msgspec.json.Decoder(schema) for schema in set(_DECODED.values())}


@cache
def keys(vehicle: str) -> dict[str, str]:
    """Every key of a vehicle with its encoding, in the order of `encode`.

    Raises ValueError when the name cannot be one chunk of a Zenoh key.
    """
    root = _root(vehicle)
    return {
        f"{root}/{tail}": f"application/json;holdfast.{kind.__name__}.v1" for tail, kind in _TAILS.items()
    }


def alive_key(vehicle: str) -> str:
    """Return the key of the vehicle's liveliness token."""
    return f"{_root(vehicle)}/alive"


def raw_key(vehicle: str) -> tuple[str, str]:
    """Return key and encoding of the vehicle's `Raw`."""
    return f"{_root(vehicle)}/raw", "application/msgpack;holdfast.Raw.v1"


def recorder_key(vehicle: str) -> tuple[str, str]:
    """Return key and encoding of the vehicle's `Recorder`."""
    return f"{_root(vehicle)}/recorder", "application/json;holdfast.Recorder.v1"


def encode(sample: ControlSample, vehicle: str) -> list[tuple[str, str, bytes]]:
    """One tick as (key, encoding, JSON) for each of `keys(vehicle)`."""
    return [
        (key, encoding, _to_json(record))
        for (key, encoding), record in zip(keys(vehicle).items(), records(sample), strict=True)
    ]


def records(sample: ControlSample) -> list[Schema]:
    """One tick as schema records, in the order of `keys`; here numbers may still be other than finite."""
    state, verdict, loop, counters = sample.state, sample.verdict, sample.loop, sample.counters
    t_s, boot_s = state.t_s, state.boot_s
    x, y, z, psi = state.eta.tolist()
    x_d, y_d, z_d, psi_d = sample.eta_d.tolist()
    x_rate, y_rate, z_rate, psi_rate = state.eta_dot.tolist()
    surge, sway, heave, yaw = sample.requested.tau.tolist()
    surge_out, sway_out, heave_out, yaw_out = sample.delivered.tau.tolist()
    return [
        State(
            t_s=t_s,
            boot_s=boot_s,
            x_m=x,
            y_m=y,
            depth_m=z,
            heading_rad=psi,
            x_desired_m=x_d,
            y_desired_m=y_d,
            depth_desired_m=z_d,
            heading_desired_rad=psi_d,
            x_rate_mps=x_rate,
            y_rate_mps=y_rate,
            depth_rate_mps=z_rate,
            heading_rate_radps=psi_rate,
            roll_rad=state.roll,
            pitch_rad=state.pitch,
            roll_rate_radps=state.p,
            pitch_rate_radps=state.q,
            armed=state.armed,
            mode=state.mode,
            system_status=state.system_status,
            voltage_v=state.voltage_v,
            pilot_gain=state.pilot_gain,
        ),
        *_dofs(sample),
        Command(
            t_s=t_s,
            boot_s=boot_s,
            surge=sample.command.surge,
            sway=sample.command.sway,
            heave=sample.command.heave,
            yaw=sample.command.yaw,
            surge_requested_n=surge,
            sway_requested_n=sway,
            heave_requested_n=heave,
            yaw_requested_nm=yaw,
            surge_delivered_n=surge_out,
            sway_delivered_n=sway_out,
            heave_delivered_n=heave_out,
            yaw_delivered_nm=yaw_out,
        ),
        Supervisor(
            t_s=t_s,
            boot_s=boot_s,
            state=verdict.state.value,
            conditions=_names(verdict.conditions),
            authority=verdict.authority,
            reason=verdict.reason,
        ),
        Loop(
            t_s=t_s,
            boot_s=boot_s,
            tick=loop.tick,
            rate_hz=loop.rate_hz,
            lateness_ms=loop.lateness_ms,
            compute_us=loop.compute_us,
            late_ticks=loop.late_ticks,
            samples_dropped=loop.samples_dropped,
            link_age_s=min(state.ages.link_s, NEVER_S),
            heartbeat_age_s=min(state.ages.heartbeat_s, NEVER_S),
            depth_age_s=min(state.ages.depth_s, NEVER_S),
            attitude_age_s=min(state.ages.attitude_s, NEVER_S),
            position_age_s=min(state.ages.position_s, NEVER_S),
            telemetry_delay_s=state.delays.telemetry_s,
            telemetry_delay_known=state.delays.telemetry_known,
            command_delay_s=state.delays.command_s,
            command_delay_known=state.delays.command_known,
            datagrams=counters.datagrams,
            messages=counters.messages,
            garbage=counters.garbage,
            foreign=counters.foreign,
            implausible=counters.implausible,
        ),
    ]


def decode(key: str, payload: bytes) -> Schema:
    """Return the record that came under a key of any vehicle.

    Raises ValueError for another key or another shape.
    """
    tail = key.split("/", 2)[2] if key.startswith("holdfast/") and key.count("/") > 1 else ""
    if tail not in _DECODED:
        raise ValueError(
            f"'{key}' is no key of holdfast. Those are holdfast/{{vehicle}}/ and {', '.join(_DECODED)}"
        )
    try:
        record: Schema = _decoders[_DECODED[tail]].decode(payload)
    except msgspec.MsgspecError as error:
        raise ValueError(
            f"{key} does not hold a holdfast.{_DECODED[tail].__name__}.v1: {error}. "
            "Does another version of Holdfast, or somebody else, publish under this key?"
        ) from error
    return record


def _root(vehicle: str) -> str:
    if not vehicle or set(vehicle) & set("/*$?#"):
        raise ValueError(f"vehicle name '{vehicle}': want one or more characters, none of / * $ ? #")
    return f"holdfast/{vehicle}"


def _dofs(sample: ControlSample) -> list[Dof]:
    columns: list[list[Any]] = [getattr(sample.dofs, name).tolist() for name in _DOF_COLUMNS]
    return [
        Dof(
            t_s=sample.state.t_s,
            boot_s=sample.state.boot_s,
            dof=dof,
            unit=unit,
            tau_unit=tau_unit,
            ahead_s=sample.state.ahead_s,
            **dict(zip(_DOF_COLUMNS, row, strict=True)),
        )
        for dof, (unit, tau_unit), *row in zip(DOFS, _UNITS, *columns, strict=True)
    ]


@cache
def _names(conditions: Condition) -> tuple[str, ...]:
    return tuple(condition.name or "" for condition in conditions)


def _to_json(record: Schema) -> bytes:
    payload = _encoder.encode(record)
    return payload if b":null" not in payload else _encoder.encode(_without_nulls(record))


def _without_nulls(record: Schema) -> Schema:
    absent = tuple(
        name
        for name in record.__struct_fields__
        if isinstance(value := getattr(record, name), float) and not math.isfinite(value)
    )
    return msgspec.structs.replace(record, absent=absent, **dict.fromkeys(absent, 0.0))
