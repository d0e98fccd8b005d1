"""What the companion publishes: the key space and its schemas. No Zenoh in here.

docs/telemetry.md lists every key, field, unit and rate, and is made from this file by `holdfast lab schema`.

One JSON object per key, with every field always present and the encoding `application/json;holdfast.Dof.v1`.
A version may gain fields; a changed meaning makes a new one.

Never a null: a number that is not finite, or beyond `MAX_NUMBER`, leaves as 0.0, and its field is named in
`absent`. What is stale is named there too: its source was silent for longer than the supervisor's timeout; it
keeps its last value, and its rate is zero. An age that is infinite (the signal never came) leaves as
`NEVER_S`. Every object has `t_s`, the companion's monotonic clock, and `boot_s`, the vehicle's, which lines
it up with anything else the vehicle stamped. `raw` alone is MessagePack.
"""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Annotated, Any, Literal

import msgspec

from companion.records import DOFS
from companion.telemetry.glossary import ENDPOINT as ENDPOINT
from companion.telemetry.glossary import STATES, Severity

Kind = Literal["state", "command", "autopilot", "condition", "recording"]
NEVER_S = 1e6
MAX_NUMBER = 2**53
"""The largest number that is published: JavaScript's integers have gaps beyond it."""
TRUTH_ENCODING = "application/json;holdfast.sim.Truth.v1"
CONFIG_ENCODING = "application/json;holdfast.Config.v1"
TICKS_PER_SAMPLE = "holdfast_ticks_per_sample"
"""Key in the metadata of a client's Zenoh configuration: its number N gives every Nth tick."""
BATCHES = {"real_time": 16, "data": 16}
"""Batches of 64 kB that may wait for each subscriber, by Zenoh's priority: its most. With its own 2, each
sample a batch of its own (express), a busy machine lost the third and later samples of a tick."""


def field(text: str, source: str | None = "") -> msgspec.Meta:
    """Describe a field, whose unit stands in its name.

    `source` is where `companion.telemetry.samples` finds its value in a `ControlSample`, such as
    "state.eta[z]", or "state.model.gain[i]" for degree of freedom i. By default it has the same name there;
    None: the place does not tell.
    """
    return msgspec.Meta(description=text, extra={"source": source})


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """What every schema has."""

    t_s: Annotated[float, field("the companion's monotonic clock", "state.t_s")]
    boot_s: Annotated[float, field("the vehicle's clock since its boot", "state.boot_s")]
    absent: Annotated[tuple[str, ...], field("unknown fields: 0.0, or the last value", None)] = ()


class State(Record, frozen=True, kw_only=True):
    """The estimated state and the reference, at present. NED; heading clockwise from north."""

    x_m: Annotated[float, field("north and east of the origin of the position source", "state.eta[x]")]
    y_m: Annotated[float, field("north and east of the origin of the position source", "state.eta[y]")]
    depth_m: Annotated[float, field("below the surface", "state.eta[z]")]
    heading_rad: Annotated[float, field("-pi..pi", "state.eta[psi]")]
    x_desired_m: Annotated[float, field("of the reference", "eta_d[x]")]
    y_desired_m: Annotated[float, field("of the reference", "eta_d[y]")]
    depth_desired_m: Annotated[float, field("of the reference", "eta_d[z]")]
    heading_desired_rad: Annotated[float, field("of the reference", "eta_d[psi]")]
    x_rate_mps: Annotated[float, field("rate of change", "state.eta_dot[x]")]
    y_rate_mps: Annotated[float, field("rate of change", "state.eta_dot[y]")]
    depth_rate_mps: Annotated[float, field("rate of change", "state.eta_dot[z]")]
    heading_rate_radps: Annotated[float, field("rate of change", "state.eta_dot[psi]")]
    roll_rad: Annotated[float, field("right side down, bow up", "state.roll")]
    pitch_rad: Annotated[float, field("right side down, bow up", "state.pitch")]
    roll_desired_rad: Annotated[float, field("the angle that is held", "angles_d.roll")] = 0.0
    pitch_desired_rad: Annotated[float, field("the angle that is held", "angles_d.pitch")] = 0.0
    roll_rate_radps: Annotated[float, field("rate in the body frame", "state.p")]
    pitch_rate_radps: Annotated[float, field("rate in the body frame", "state.q")]
    armed: Annotated[bool, field("from the vehicle's heartbeat")]
    mode: Annotated[int, field("ArduSub's custom_mode: 19 is MANUAL")]
    system_status: Annotated[int, field("MAV_STATE")]
    voltage_v: Annotated[float, field("battery voltage")]
    pilot_gain: Annotated[float, field("ArduSub's live stick gain, 0..1")]
    dead_motor: Annotated[int, field("number of the motor that gives no thrust; 0 for none")]
    reversed_motor: Annotated[int, field("number of the motor that pushes the other way; 0 for none")] = 0
    guidance: Annotated[str, field("hold, move, path, paused, waiting, refused", "guided.kind")] = ""
    path_number: Annotated[int, field("counts the paths and moves", "guided.number")] = 0
    path_progress_m: Annotated[float, field("along it, laps included", "guided.progress_m")] = 0.0
    path_length_m: Annotated[float, field("of one lap; 0 for a move", "guided.length_m")] = 0.0
    current_north_mps: Annotated[
        float, field("water's velocity and its doubt", "state.current.north_mps")
    ] = 0.0
    current_east_mps: Annotated[float, field("water's velocity and its doubt", "state.current.east_mps")] = (
        0.0
    )
    current_doubt_mps: Annotated[
        float, field("water's velocity and its doubt", "state.current.doubt_mps")
    ] = 0.0
    altitude_m: Annotated[float, field("over the ground; absent without an echo")] = 0.0
    depth_offset_m: Annotated[float, field("by how much the autopilot's depth is deeper")] = 0.0
    altitude_desired_m: Annotated[float, field("0 where a depth is held", "guided.altitude_m")] = 0.0
    path_speed_mps: Annotated[float, field("of the reference", "guided.speed_mps")] = 0.0
    path_left_m: Annotated[float, field("to the end; absent if it has none", "guided.left_m")] = 0.0
    path_left_s: Annotated[float, field("to the end; absent if it has none", "guided.left_s")] = 0.0
    pending: Annotated[str, field("what it does on engaging; empty: hold here", "guided.pending")] = ""


class Dof(Record, frozen=True, kw_only=True):
    """The law's signals of one degree of freedom, predicted `ahead_s` from now, when the command acts.

    tau = feedforward + feedback + d_hat, before saturation. `model_gain` is 1 for the nominal vehicle. A
    doubt is a standard deviation, of a gain that of its natural logarithm.
    """

    dof: Annotated[str, field("x, y, z or psi", None)]
    unit: Annotated[str, field("of x, x_d and e: m or rad; rates are per s and s²", None)]
    tau_unit: Annotated[str, field("of tau, its parts and the disturbances: N or N·m", None)]
    ahead_s: Annotated[float, field("prediction horizon of this record", "state.ahead_s")]
    x_d: Annotated[float, field("reference, its rate and acceleration")]
    x_d_dot: Annotated[float, field("reference, its rate and acceleration")]
    x_d_ddot: Annotated[float, field("reference, its rate and acceleration")]
    x: Annotated[float, field("estimate and its rate")]
    x_dot: Annotated[float, field("estimate and its rate")]
    e: Annotated[float, field("error, measured minus desired, and its rate")]
    e_dot: Annotated[float, field("error, measured minus desired, and its rate")]
    eps: Annotated[float, field("combined error e_dot + lambda e")]
    tau: Annotated[float, field("demand of the law, NED")]
    feedforward: Annotated[float, field("parts of tau from model and reference, and from the error")]
    feedback: Annotated[float, field("parts of tau from model and reference, and from the error")]
    d_hat: Annotated[float, field("part of tau that compensates the disturbance")]
    d_observer: Annotated[float, field("disturbance estimated by the observer")]
    weight_norm: Annotated[float, field("Euclidean norm of the learnt weights")]
    saturated: Annotated[bool, field("the thrusters cannot deliver tau")]
    adapting: Annotated[bool, field("the compensator learnt in this tick")]
    engaged: Annotated[bool, field("Holdfast controls this degree of freedom")]
    model_gain: Annotated[float, field("force per command over inertia", "state.model.gain[i]")] = 1.0
    model_gain_found: Annotated[
        float, field("force per command over inertia", "state.model.found_gain[i]")
    ] = 1.0
    model_gain_doubt: Annotated[
        float, field("force per command over inertia", "state.model.log_gain_doubt[i]")
    ] = 0.0
    model_lag_s: Annotated[float, field("in use, found, its doubt", "state.model.lag_s[i]")] = 0.0
    model_lag_found_s: Annotated[float, field("in use, found, its doubt", "state.model.found_lag_s[i]")] = 0.0
    model_lag_doubt_s: Annotated[float, field("in use, found, its doubt", "state.model.lag_doubt_s[i]")] = 0.0


class Command(Record, frozen=True, kw_only=True):
    """Demands and wrench in the body frame: forward, to the right, downward and clockwise."""

    surge: Annotated[float, field("demand, -1..1")]
    sway: Annotated[float, field("demand, -1..1")]
    heave: Annotated[float, field("demand, -1..1")]
    yaw: Annotated[float, field("demand, -1..1")]
    surge_requested_n: Annotated[float, field("requested by the law", "requested[surge]")]
    sway_requested_n: Annotated[float, field("requested by the law", "requested[sway]")]
    heave_requested_n: Annotated[float, field("requested by the law", "requested[heave]")]
    yaw_requested_nm: Annotated[float, field("requested by the law", "requested[yaw]")]
    surge_delivered_n: Annotated[float, field("delivered, by the thruster model", "delivered[surge]")]
    sway_delivered_n: Annotated[float, field("delivered, by the thruster model", "delivered[sway]")]
    heave_delivered_n: Annotated[float, field("delivered, by the thruster model", "delivered[heave]")]
    yaw_delivered_nm: Annotated[float, field("delivered, by the thruster model", "delivered[yaw]")]


class Supervisor(Record, frozen=True, kw_only=True):
    """State, authority and reason of the supervisor."""

    state: Annotated[str, field(f"one of {', '.join(STATES)}")]
    conditions: Annotated[tuple[str, ...], field("names of the conditions that hold")]
    authority: Annotated[float, field("permitted share of the thrust, 0..1")]
    reason: Annotated[str, field("why this state was entered, or what engaging waits for")]
    warnings: Annotated[tuple[str, ...], field("conditions that are only warnings")] = ()
    freeze: Annotated[bool, field("learning is frozen")] = False
    remedy: Annotated[str, field("the operator's next step")] = ""
    disarms_in_s: Annotated[float, field("until the autopilot disarms by itself, or 0", "disarms_in_s")] = 0.0


class Loop(Record, frozen=True, kw_only=True):
    """Health of the process. An age of 1e6 s: no signal yet. An unknown delay is a start value."""

    tick: Annotated[int, field("number of this tick")]
    rate_hz: Annotated[float, field("ticks per second since the start")]
    lateness_ms: Annotated[float, field("delay of this tick's start")]
    compute_us: Annotated[float, field("duration of the previous tick")]
    late_ticks: Annotated[int, field("ticks skipped since the start")]
    samples_dropped: Annotated[int, field("samples dropped before Zenoh")]
    link_age_s: Annotated[float, field("since the last message of the vehicle", "state.ages.link_s")]
    heartbeat_age_s: Annotated[float, field("since it last arrived", "state.ages.heartbeat_s")]
    depth_age_s: Annotated[float, field("since it last arrived", "state.ages.depth_s")]
    attitude_age_s: Annotated[float, field("since it last arrived", "state.ages.attitude_s")]
    position_age_s: Annotated[float, field("since it last arrived", "state.ages.position_s")]
    telemetry_delay_s: Annotated[float, field("from the stamp to arrival", "state.delays.telemetry_s")]
    telemetry_delay_known: Annotated[bool, field("it was measured", "state.delays.telemetry_known")]
    command_delay_s: Annotated[float, field("from sending to the motors", "state.delays.command_s")]
    command_delay_known: Annotated[bool, field("it was measured", "state.delays.command_known")]
    hidden_delay_s: Annotated[float, field("delay visible in no stamp, estimated", "state.delays.hidden_s")]
    datagrams: Annotated[int, field("received", "counters.datagrams")]
    messages: Annotated[int, field("decoded MAVLink messages", "counters.messages")]
    garbage: Annotated[int, field("bytes that are not MAVLink", "counters.garbage")]
    foreign: Annotated[int, field("messages of other systems, datagrams of others than the peer", "foreign")]
    implausible: Annotated[int, field("messages with impossible numbers", "counters.implausible")]
    pilot_age_s: Annotated[float, field("of the ground station's heartbeat", "state.ages.pilot_s")] = NEVER_S
    left_out_bytes: Annotated[int, field("bytes dropped in a flood")] = 0
    errors: Annotated[int, field("errors beside the tick; the log has them")] = 0
    refused: Annotated[int, field("frames without a right, new signature", "counters.refused")] = 0
    deepest_m: Annotated[float, field("while armed, since the start", "loop.dive.deepest_m")] = 0.0
    dive_s: Annotated[float, field("armed and under 0.5 m, since the start", "loop.dive.dive_s")] = 0.0
    version: Annotated[str, field("of Holdfast, with its commit", None)] = ""


class Recorder(Record, frozen=True, kw_only=True):
    """State of the recorder."""

    recording: Annotated[bool, field("a file is being written")]
    file: Annotated[str, field("its path on the recorder's machine")]
    size_bytes: Annotated[int, field("present size of the file")]
    messages: Annotated[int, field("messages written to the file")]
    dropped: Annotated[int, field("messages left out, as the disk was too slow")]
    free_bytes: Annotated[int, field("free space on the disk")]
    said: Annotated[str, field("status text")]
    lost: Annotated[int, field("samples missing, by the tick numbers")] = 0
    left_out: Annotated[int, field("samples too large, nested, or of a wrong time")] = 0


class Plan(Record, frozen=True, kw_only=True):
    """What a map shows beside the vehicle: the path and the fence, NED, m."""

    number: Annotated[int, field("which path; `State.path_number`")]
    name: Annotated[str, field("of the path")]
    x_m: Annotated[tuple[float, ...], field("of each point of the path; none without a path")]
    y_m: Annotated[tuple[float, ...], field("of each point of the path; none without a path")]
    depth_m: Annotated[tuple[float, ...], field("of each point of the path; none without a path")]
    fenced: Annotated[bool, field("the fence is in force")]
    fence_north_m: Annotated[tuple[float, ...], field("least and largest")]
    fence_east_m: Annotated[tuple[float, ...], field("least and largest")]
    fence_depth_m: Annotated[tuple[float, ...], field("least and largest")]


class Start(msgspec.Struct, frozen=True, kw_only=True):
    """What an engine is built from."""

    config: Annotated[dict[str, Any], field("the configuration as a table")]
    setpoint: Annotated[tuple[float, float, float, float], field("x, y, depth (m), heading (rad); NaN: none")]
    arm: Annotated[bool, field("it may arm the vehicle")]
    version: Annotated[str, field("of Holdfast, with its commit")]


class Raw(msgspec.Struct, frozen=True, kw_only=True):
    """All inputs and outputs of one tick, for `holdfast lab rerun`; MessagePack instead of JSON."""

    tick: Annotated[int, field("number of this tick")]
    now_s: Annotated[float, field("the companion's monotonic clock")]
    heard: Annotated[Sequence[tuple[int, bytes]], field("arrival in monotonic ns and datagram")] = (
        msgspec.field(name="in")
    )
    ground: Annotated[Sequence[tuple[int, bytes]], field("of the ground station: as `in`")] = ()
    out: Annotated[Sequence[bytes], field("datagrams sent")]
    requests: Annotated[Sequence[str], field("names of the operator's requests")] = ()
    order: Annotated[tuple[str, bytes] | None, field("what it was sent to: command and payload")] = None
    config: Annotated[dict[str, Any] | None, field("the whole configuration, if retuned")] = None
    start: Annotated[Start | None, field("what the engine was built from, in the first tick")] = None


Six = Annotated[tuple[float, ...], msgspec.Meta(min_length=6, max_length=6)]


class Truth(msgspec.Struct, frozen=True, kw_only=True):
    """What really happens to a simulated vehicle; no companion reads it.

    NED, body x forward, y right, z down; forces in N, moments in N·m, angles in rad.
    """

    t_s: Annotated[float, field("the vehicle's clock since the simulator's start")]
    eta: Annotated[Six, field("x, y, z in m, and roll, pitch, yaw")]
    nu: Annotated[Six, field("velocities in the body frame, m/s and rad/s")]
    nu_dot: Annotated[Six, field("their rates")]
    thrust_n: Annotated[tuple[float, ...], field("of each thruster, along its direction")]
    tau: Annotated[Six, field("wrench of the thrusters, in the body frame")]
    disturbance: Annotated[Six, field("all other forces in NED, and moments in the body frame")]
    motor_pwm: Annotated[tuple[int, ...], field("what each motor gets, µs")]
    armed: Annotated[bool, field("the motors may turn")]
    mode: Annotated[int, field("ArduSub's custom_mode")]
    load_on: Annotated[bool, field("the load of the dive's file hangs on the vehicle")]
    voltage_v: Annotated[float, field("of the battery")]


_WORD = msgspec.Meta(extra_json_schema={"type": "string"})


class Event(Record, frozen=True, kw_only=True):
    """Something that happened."""

    severity: Annotated[Severity, _WORD, field("how bad it is")]
    kind: Annotated[Kind, _WORD, field("state or condition, an operator's command, the autopilot's words")]
    text: Annotated[str, field("what, in words")]


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to a command."""

    done: Annotated[bool, field("it is in force now; otherwise nothing was changed")]
    said: Annotated[str, field("what happened, or why not, in words")]
    value: Annotated[dict[str, Any], field("what is now in force, read back")] = {}


class Choices(msgspec.Struct, frozen=True, kw_only=True):
    """Which names a companion knows, for keys of its configuration that take a name."""

    compensator: Annotated[tuple[str, ...], field("what an axis's `compensator` can be")]


Schema = State | Dof | Command | Supervisor | Loop | Event | Recorder | Plan

EVERY_TICK: dict[str, type[Schema]] = {
    "state": State,
    **{f"dof/{dof}": Dof for dof in DOFS},
    "command": Command,
    "supervisor": Supervisor,
    "loop": Loop,
}
NOW_AND_THEN: dict[str, type[Schema]] = {
    "event": Event,
    "recorder": Recorder,
    "plan": Plan,
}
_DECODED = EVERY_TICK | NOW_AND_THEN
_encoder = msgspec.json.Encoder(enc_hook=lambda scalar: scalar.item())
_decoders = {schema: msgspec.json.Decoder(schema) for schema in set(_DECODED.values())}


def key(vehicle: str, *rest: str) -> str:
    """Return a key of a vehicle's; raise ValueError when its name cannot be one chunk of a Zenoh key.

    Beside what is published: "command" and a command's name, "alive" and the instance of a companion, or *;
    "config", "choices" and "check" (as `holdfast check --json`) answer queries.
    """
    if not vehicle or set(vehicle) & set("/*$?#"):
        raise ValueError(f"vehicle name '{vehicle}': want one or more characters, none of / * $ ? #")
    return "/".join(("holdfast", vehicle, *rest))


def encoding(schema: type[msgspec.Struct]) -> str:
    """Return the encoding under which a schema is published."""
    return f"application/json;holdfast.{schema.__name__}.v1"


ENCODINGS = {tail: encoding(schema) for tail, schema in _DECODED.items()} | {
    "raw": "application/msgpack;holdfast.Raw.v1"
}
"""Every published schema, by what follows the vehicle in its key."""


def published(vehicle: str, tail: str) -> tuple[str, str]:
    """Return key and encoding of what is published."""
    return key(vehicle, tail), ENCODINGS[tail]


@cache
def keys(vehicle: str) -> dict[str, str]:
    """Every key that a vehicle publishes once a tick with its encoding, in the order of `encode`."""
    return dict(published(vehicle, tail) for tail in EVERY_TICK)


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
        if isinstance(record, Dof) and tail != f"dof/{record.dof}":
            raise ValueError(f"it is of the degree of freedom '{record.dof}'")
        check_numbers(record)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise ValueError(
            f"{key} does not hold a holdfast.{_DECODED[tail].__name__}.v1: {error}. "
            "Does another version of Holdfast, or somebody else, publish under this key?"
        ) from error
    return record


def check_numbers(record: msgspec.Struct) -> None:
    """Raise ValueError for a number beyond `MAX_NUMBER`: a computation with it could overflow."""
    if not _in_range(msgspec.structs.astuple(record)):
        raise ValueError("a number in it is too large")


def _in_range(values: Iterable[object]) -> bool:
    return all(
        _in_range(value) if isinstance(value, tuple) else -MAX_NUMBER <= value <= MAX_NUMBER
        for value in values
        if isinstance(value, float | int | tuple)
    )


def printable(text: str) -> str:
    """Return a foreign text with its control characters escaped, for a log line or a terminal.

    Raw, a line feed forges a line of the log, and an escape sequence writes over what a terminal shows.
    """
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape", "replace").decode() for char in text
    )


def to_json(record: Schema) -> bytes:
    """Return the record as JSON without a null."""
    payload = _encoder.encode(record)
    if b":null" not in payload and _in_range(msgspec.structs.astuple(record)):
        return payload
    return _encoder.encode(_without_nulls(record))


def _without_nulls(record: Schema) -> Schema:
    broken = [
        name
        for name in record.__struct_fields__
        if isinstance(value := getattr(record, name), float) and not abs(value) <= MAX_NUMBER
    ]
    absent = tuple(dict.fromkeys((*record.absent, *broken)))
    return msgspec.structs.replace(record, absent=absent, **dict.fromkeys(broken, 0.0))
