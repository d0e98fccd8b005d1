"""TOML into validated, frozen records. Unknown keys, wrong types and values out of range stop the start.

Units stand in the key names. The shipped file, `config/companion.toml`, explains every key.
"""

import re
import tomllib
from collections.abc import Sequence
from ipaddress import ip_network
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

import msgspec

from companion.endpoint import Endpoint

DEFAULT_FILE = Path(__file__).parent.parent / "config" / "companion.toml"

Fraction = Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=60.0)]
Name = Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]{1,32}$")]
SystemId = Annotated[int, msgspec.Meta(ge=1, le=255)]
Compensator = Literal["none", "integrator", "regressor", "network", "observer", "network+observer"]


class ConfigError(Exception):
    """A configuration that cannot be used; says file, key, value and what is allowed."""


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file: frozen, and no key beyond its own."""


class Vehicle(Section, frozen=True):
    """Who is steered, and by which messages."""

    name: Name
    frame: Literal["vectored", "vectored_6dof"]
    steering_mode: Literal["manual", "stabilize"]
    thrust_path: Literal["rc_override", "manual_control"]
    depth_source: Literal["relative_alt", "vfr_hud", "ahrs2", "pressure"]
    rate_source: Literal["climb", "vz"]

    @property
    def holds_heading(self) -> bool:
        """Whether the heading is ours to hold; in STABILIZE it is the firmware's."""
        return self.steering_mode == "manual"


class Link(Section, frozen=True):
    """Where the vehicle is found and who we say we are."""

    endpoint: str
    system: SystemId
    component: SystemId
    vehicle_system: SystemId
    vehicle_component: SystemId
    signing_key_file: str
    signing_link_id: Annotated[int, msgspec.Meta(ge=0, le=255)]
    allow: tuple[str, ...]


class GroundStation(Section, frozen=True):
    """The pilot's ground station, whose frames pass through us."""

    endpoint: str
    timeout_s: Positive
    on_loss: Literal["hold", "surface", "silence"]
    full_deflection: Fraction
    full_deflection_s: Seconds
    engage_button: Annotated[int, msgspec.Meta(ge=-1, le=15)]
    release_button: Annotated[int, msgspec.Meta(ge=-1, le=15)]
    allow: tuple[str, ...]


class Loop(Section, frozen=True):
    """The tick."""

    rate_hz: Annotated[float, msgspec.Meta(ge=10.0, le=200.0)]


class Axis(Section, frozen=True):
    """One axis: what is believed of it (nominal model), how stiffly it is held and who compensates.

    Units are m, N and kg; on the yaw axis rad, N·m and kg·m².
    """

    mass: Positive
    linear_damping: NonNegative
    quadratic_damping: NonNegative
    max_force: Positive
    lambda_per_s: Positive
    kappa_per_s: Positive
    max_rate: Positive
    max_acceleration: Positive
    compensator: Compensator
    learning_rate: NonNegative
    hidden_learning_rate: NonNegative
    leak_per_s: NonNegative
    dead_zone: NonNegative
    max_disturbance: Positive
    position_noise: Positive
    rate_noise: Positive
    position_noise_slow: NonNegative
    rate_noise_slow: NonNegative
    disturbance_noise: Positive
    sensor_delay_s: Seconds


class Thrusters(Section, frozen=True):
    """What is believed of the thrusters."""

    lag_s: Positive
    lead_s: Seconds
    max_axis: Fraction
    max_slew_per_s: Positive


class Levelling(Section, frozen=True):
    """What is believed of roll and pitch, which are held level in MANUAL."""

    frequency_radps: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)]
    roll_inertia: Positive
    pitch_inertia: Positive
    lever_m: Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
    max_moment_nm: Positive
    max_axis: Annotated[float, msgspec.Meta(gt=0.0, le=0.49)]


class Network(Section, frozen=True):
    """What the four networks share."""

    units: Annotated[int, msgspec.Meta(ge=1, le=100)]
    seed: Annotated[int, msgspec.Meta(ge=0)]
    start_delay_s: Seconds


class Delays(Section, frozen=True):
    """What the loop's delays are taken for until they have been measured."""

    telemetry_s: Seconds
    command_s: Seconds
    gains_bear_s: Positive
    slow_noise_s: Positive


class Supervisor(Section, frozen=True):
    """When to refuse and when to give up."""

    link_timeout_s: Positive
    heartbeat_timeout_s: Positive
    depth_timeout_s: Positive
    attitude_timeout_s: Positive
    position_timeout_s: Positive
    late_tick_s: Positive
    ramp_down_s: Positive
    max_pilot_timeout_s: Annotated[float, msgspec.Meta(ge=0.1, le=3.0)]
    pilot_deflection: Fraction
    pilot_hold_s: Positive
    max_depth_m: Positive
    ramp_up_s: Positive
    depth_margin_m: NonNegative
    max_depth_jump_m: Positive
    max_ekf_variance: Positive
    ekf_doubt_s: Seconds
    min_voltage_v: Positive
    battery_low_s: Seconds
    saturated_s: Seconds
    max_error_m: Positive
    max_error_deg: Annotated[float, msgspec.Meta(gt=0.0, le=180.0)]
    off_track_s: Seconds
    max_delay_s: Positive
    max_surprise_m: Positive
    max_surprise_deg: Positive
    keep_alt_hold_s: Annotated[float, msgspec.Meta(ge=0.0, le=3600.0)]
    max_tilt_deg: Annotated[float, msgspec.Meta(gt=0.0, lt=90.0)]


class Telemetry(Section, frozen=True):
    """Where the controller's state is published, whether the raw ticks are, and who may command."""

    mode: Literal["peer", "client", "file"]
    endpoint: str
    raw: bool
    allow_control: Literal["local", "always", "never"]


class Config(Section, frozen=True):
    """The whole file."""

    vehicle: Vehicle
    link: Link
    ground_station: GroundStation
    loop: Loop
    delays: Delays
    thrusters: Thrusters
    levelling: Levelling
    surge: Axis
    sway: Axis
    heave: Axis
    yaw: Axis
    network: Network
    supervisor: Supervisor
    telemetry: Telemetry

    @property
    def axes(self) -> tuple[Axis, Axis, Axis, Axis]:
        """Surge, sway, heave, yaw."""
        return (self.surge, self.sway, self.heave, self.yaw)

    @property
    def levels(self) -> bool:
        """Whether roll and pitch are ours to hold level; in STABILIZE they are the firmware's."""
        return self.vehicle.steering_mode == "manual"


def load_config(path: Path = DEFAULT_FILE, overrides: Sequence[str] = ()) -> Config:
    """Read `path`, apply `section.key=value` overrides (TOML values) and validate.

    Raises ConfigError naming file, key, value and the allowed range.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not TOML: {error}") from error
    for override in overrides:
        _apply(table, override)
    try:
        config = msgspec.convert(table, Config)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {_explained(table, str(error))}") from error
    for key, endpoint in (
        ("link.endpoint", config.link.endpoint),
        ("ground_station.endpoint", config.ground_station.endpoint),
    ):
        try:
            if endpoint or key == "link.endpoint":
                Endpoint.parse(endpoint)
        except ValueError as error:
            raise ConfigError(f"{path}: {key} = {endpoint!r}: {error}") from error
    ground = config.ground_station
    if ground.engage_button == ground.release_button != -1:
        raise ConfigError(
            f"{path}: ground_station.engage_button = {ground.engage_button}: release_button is the same; "
            "want two different ones, or -1 for none"
        )
    for key, allow in (
        ("link.allow", config.link.allow),
        ("ground_station.allow", config.ground_station.allow),
    ):
        try:
            for text in allow:
                ip_network(text)
        except ValueError as error:
            raise ConfigError(
                f'{path}: {key}: {error}; list addresses and networks, such as "192.168.2.0/24"'
            ) from error
    if config.ground_station.endpoint and config.vehicle.thrust_path != "manual_control":
        raise ConfigError(
            f"{path}: vehicle.thrust_path = {config.vehicle.thrust_path!r}: must be 'manual_control' with a "
            "ground_station.endpoint: overrides would wipe out the pilot's MANUAL_CONTROL"
        )
    return config


def _apply(table: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals:
        raise ConfigError(f"--set {override}: write it as section.key=value")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *sections, last = key.strip().split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"--set {override}: {section} is a value, not a section")
    table[last] = value


def _explained(table: dict[str, Any], error: str) -> str:
    """Turn msgspec's "Expected … - at `$.heave.mass`" into key, value and what is allowed."""
    message, _, where = error.partition(" - at `$")
    parts = [part for part in where.strip("`").split(".") if part]
    if field := re.search(r"(unknown|required) field `(.+)`", message):
        name = ".".join([*parts, field[2]])
        known = ", ".join(getattr(_section(parts), "__struct_fields__", ()))
        return f"{name}: unknown key; known here: {known}" if field[1] == "unknown" else f"{name}: missing"
    value: Any = table
    for part in parts:
        value = value.get(part) if isinstance(value, dict) else None
    choices = get_args(_section(parts)) if "enum" in message else ()
    said = "must be one of " + ", ".join(choices) if choices else message[0].lower() + message[1:]
    return f"{'.'.join(parts) or 'the file'} = {value!r}: {said}"


def _section(parts: list[str]) -> Any:
    section: Any = Config
    for part in parts:
        section = get_type_hints(section).get(part)
    return section
