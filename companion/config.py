"""TOML into validated, frozen records. Unknown keys, wrong types and values out of range stop the start.

Units stand in the key names. The shipped file, `config/companion.toml`, explains every key but those of the
vehicle, which stand in a file of their own that it names: `config/vehicles/`. Merged, both make one `Config`.
"""

from collections.abc import Mapping, Sequence
from ipaddress import ip_network
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_type_hints

import msgspec

from companion import registry
from companion.endpoint import Endpoint
from companion.records import AXES
from companion.telemetry import ranges
from holdfast import RefusedError, files
from holdfast.arguments import source_of

DEFAULT_FILE = Path(__file__).parent.parent / "config" / "companion.toml"
PRESETS = DEFAULT_FILE.parent / "vehicles"
PRESET_KEY = "vehicle.preset"

Name = Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]{1,32}$")]


class ConfigError(RefusedError):
    """A configuration that cannot be used; says file, key, value and what is allowed."""


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file: frozen, and no key beyond its own."""


class Frame(Section, frozen=True):
    """The vehicle's frame of thrusters."""

    frame: Literal["vectored", "vectored_6dof"]


class Vehicle(Frame, frozen=True):
    """Who is steered, and by which messages."""

    name: Name
    steering_mode: Literal["manual", "stabilize"]
    thrust_path: Literal["rc_override", "manual_control"]
    depth_source: Literal["relative_alt", "vfr_hud", "ahrs2", "pressure"]
    rate_source: Literal["climb", "vz"]
    adapts: bool

    @property
    def holds_heading(self) -> bool:
        """Whether the heading is ours to hold; in STABILIZE it is the firmware's."""
        return self.steering_mode == "manual"


class LinkSection(Section, frozen=True):
    """Where the vehicle is found and who we say we are."""

    endpoint: str
    system: ranges.SystemId
    component: ranges.SystemId
    vehicle_system: ranges.SystemId
    vehicle_component: ranges.SystemId
    signing_key_file: str
    signing_link_id: ranges.LinkId
    allow: tuple[str, ...]


class GroundStation(Section, frozen=True):
    """The pilot's ground station, whose frames pass through us."""

    endpoint: str
    timeout_s: ranges.PilotTimeout
    on_loss: Literal["hold", "surface", "silence"]
    full_deflection: ranges.FullDeflection
    full_deflection_s: ranges.Patience
    engage_button: ranges.Button
    release_button: ranges.Button
    allow: tuple[str, ...]


class LoopSection(Section, frozen=True):
    """The tick."""

    rate_hz: ranges.TickRate


class AxisModel(Section, frozen=True):
    """What is believed of one axis, the nominal model: m, N and kg."""

    mass: ranges.Mass
    linear_damping: ranges.LinearDamping
    quadratic_damping: ranges.QuadraticDamping
    max_force: ranges.Force


class YawModel(AxisModel, frozen=True):
    """The same of yaw: rad, N·m and kg·m²."""

    mass: ranges.Inertia
    linear_damping: ranges.LinearTurnDamping
    quadratic_damping: ranges.QuadraticTurnDamping
    max_force: ranges.Moment


class Axis(AxisModel, frozen=True):
    """One axis: its nominal model, how stiffly it is held and who compensates."""

    lambda_per_s: ranges.Lambda
    kappa_per_s: ranges.Kappa
    max_rate: ranges.MaxRate
    max_acceleration: ranges.MaxAcceleration
    law: str
    compensator: str
    learning_rate: ranges.LearningRate
    hidden_learning_rate: ranges.HiddenLearningRate
    leak_per_s: ranges.Leak
    dead_zone: ranges.DeadZone
    max_disturbance: ranges.Force
    position_noise: ranges.Noise
    rate_noise: ranges.Noise
    position_noise_slow: ranges.SlowNoise
    rate_noise_slow: ranges.SlowNoise
    disturbance_noise: ranges.DisturbanceNoise
    sensor_delay_s: ranges.Delay


class YawAxis(YawModel, Axis, frozen=True):
    """The yaw axis."""


class ThrusterLag(Section, frozen=True):
    """What is believed of the thrusters."""

    lag_s: ranges.Lag


class Thrusters(ThrusterLag, frozen=True):
    """What is believed of the thrusters, and what is sent to them."""

    lead_s: ranges.Lead
    max_axis: ranges.Share
    max_slew_per_s: ranges.Slew


class Tilting(Section, frozen=True):
    """What is believed of roll and pitch."""

    roll_inertia: ranges.Inertia
    pitch_inertia: ranges.Inertia
    lever_m: ranges.Lever
    max_moment_nm: ranges.Moment
    max_axis: ranges.TiltShare


class Levelling(Tilting, frozen=True):
    """How roll and pitch are held level in MANUAL."""

    frequency_radps: ranges.LevellingFrequency


class VehicleFile(Section, frozen=True):
    """A file of `config/vehicles/`: all that is the vehicle, and nothing else."""

    vehicle: Frame
    thrusters: ThrusterLag
    levelling: Tilting
    surge: AxisModel
    sway: AxisModel
    heave: AxisModel
    yaw: YawModel


class Network(Section, frozen=True):
    """What the four networks share."""

    units: ranges.Units
    seed: ranges.Seed
    start_delay_s: ranges.Patience


class Delays(Section, frozen=True):
    """What the loop's delays are taken for until they have been measured."""

    telemetry_s: ranges.Delay
    command_s: ranges.Delay
    gains_bear_s: ranges.BorneDelay
    slow_noise_s: ranges.Correlation


class SupervisorLimits(Section, frozen=True):
    """When to refuse and when to give up."""

    link_timeout_s: ranges.Timeout
    heartbeat_timeout_s: ranges.Timeout
    depth_timeout_s: ranges.Timeout
    attitude_timeout_s: ranges.Timeout
    position_timeout_s: ranges.Timeout
    late_tick_s: ranges.Timeout
    ramp_down_s: ranges.Ramp
    max_pilot_timeout_s: ranges.FailsafeTimeout
    pilot_deflection: ranges.PilotDeflection
    pilot_hold_s: ranges.Ramp
    max_depth_m: ranges.MaxDepth
    min_altitude_m: ranges.Altitude
    ramp_up_s: ranges.Ramp
    depth_margin_m: ranges.DepthMargin
    max_depth_jump_m: ranges.Distance
    max_ekf_variance: ranges.EkfVariance
    ekf_doubt_s: ranges.Patience
    min_voltage_v: ranges.Voltage
    battery_low_s: ranges.Patience
    saturated_s: ranges.Patience
    max_error_m: ranges.Distance
    max_error_deg: ranges.AngleDeg
    off_track_s: ranges.Patience
    max_delay_s: ranges.BorneDelay
    max_innovation_m: ranges.Distance
    max_innovation_deg: ranges.AngleDeg
    keep_alt_hold_s: ranges.Hour
    max_tilt_deg: ranges.TiltDeg


class FenceSection(Section, frozen=True):
    """Where the vehicle may be; what it is told keeps 0.1 m from it."""

    enabled: bool
    north_m: tuple[ranges.Metres, ranges.Metres]
    east_m: tuple[ranges.Metres, ranges.Metres]
    depth_m: tuple[ranges.Depth, ranges.Depth]


class Telemetry(Section, frozen=True):
    """Where the controller's state is published, whether the raw ticks are, and who may command."""

    mode: Literal["peer", "client", "file"]
    endpoint: str
    raw: bool
    allow_control: Literal["local", "always", "never"]


class Config(Section, frozen=True):
    """The whole file, with the vehicle's."""

    vehicle: Vehicle
    link: LinkSection
    ground_station: GroundStation
    loop: LoopSection
    delays: Delays
    thrusters: Thrusters
    levelling: Levelling
    surge: Axis
    sway: Axis
    heave: Axis
    yaw: YawAxis
    network: Network
    supervisor: SupervisorLimits
    fence: FenceSection
    telemetry: Telemetry
    compensators: dict[str, dict[str, Any]] = {}
    laws: dict[str, dict[str, Any]] = {}
    """Parameters of compensators and laws beyond the shipped ones, by their names."""

    @property
    def axes(self) -> tuple[Axis, Axis, Axis, Axis]:
        """Surge, sway, heave, yaw."""
        return (self.surge, self.sway, self.heave, self.yaw)

    @property
    def levels(self) -> bool:
        """Whether roll and pitch are ours to hold level; in STABILIZE they are the firmware's."""
        return self.vehicle.steering_mode == "manual"


def load_config(path: Path = DEFAULT_FILE, overrides: Sequence[str] = ()) -> Config:
    """Read `path` and the vehicle's file, apply `section.key=value` overrides (TOML values) and validate.

    `vehicle.preset` names the vehicle's file; without it `path` has to hold the vehicle's keys too.
    Raises ConfigError naming file, key, value and the allowed range.
    """
    table = _read(path)
    choice = [override for override in overrides if _key(override) == PRESET_KEY]
    folder = Path() if choice else path.parent
    for override in choice:
        _apply(table, override)
    vehicle = table.get("vehicle")
    if isinstance(vehicle, dict) and (preset := vehicle.pop("preset", None)) is not None:
        _merge(table, path, vehicle_file(path, preset, folder))
    for override in overrides:
        if override not in choice:
            _apply(table, override)
    try:
        config = msgspec.convert(table, Config)
        _check_together(config)
        check_choices(config)
    except msgspec.ValidationError as error:
        said = ranges.explained(table, str(error), Config)
        raise ConfigError(f"{source_of(path, overrides, said)}: {said}") from error
    except ConfigError as error:
        raise ConfigError(f"{source_of(path, overrides, str(error))}: {error}") from error
    return config


def _check_together(config: Config) -> None:
    """Raise ConfigError for values that are within their ranges and cannot be used, or not together."""
    for key in ("north_m", "east_m", "depth_m"):
        low, high = getattr(config.fence, key)
        if not low < high:
            raise ConfigError(f"fence.{key} = [{low:g}, {high:g}]: the first must be less")
    for key, endpoint in (
        ("link.endpoint", config.link.endpoint),
        ("ground_station.endpoint", config.ground_station.endpoint),
    ):
        try:
            if endpoint or key == "link.endpoint":
                Endpoint.parse(endpoint)
        except ValueError as error:
            raise ConfigError(f"{key} = {endpoint!r}: {error}") from error
    ground = config.ground_station
    if ground.engage_button == ground.release_button != -1:
        raise ConfigError(
            f"ground_station.engage_button = {ground.engage_button}: release_button is the same; "
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
                f'{key}: {error}; list addresses and networks, such as "192.168.2.0/24"'
            ) from error
    if config.ground_station.endpoint and config.vehicle.thrust_path != "manual_control":
        raise ConfigError(
            f"vehicle.thrust_path = {config.vehicle.thrust_path!r}: must be 'manual_control' with a "
            "ground_station.endpoint: overrides would wipe out the pilot's MANUAL_CONTROL"
        )


def check_choices(config: Config) -> None:
    """Raise ConfigError for a compensator or a law that there is not, or that cannot be used."""
    try:
        compensators, laws = registry.compensators(config.compensators), registry.laws(config.laws)
    except registry.UnusableError as error:
        raise ConfigError(str(error)) from error
    for name, axis in zip(AXES, config.axes, strict=True):
        try:
            registry.learners(axis.compensator, compensators)
        except registry.UnusableError as error:
            raise ConfigError(f"{name}.compensator = {axis.compensator!r:.80}: {error}") from error
        if axis.law not in laws:
            raise ConfigError(f"{name}.law = {axis.law!r:.80}: must be one of {', '.join(laws)}")


def presets() -> list[str]:
    """Return the names of the shipped vehicles."""
    return sorted(path.stem for path in PRESETS.glob("*.toml"))


def vehicle_file(path: Path, preset: Any, folder: Path) -> Path:
    """Return the vehicle's file that `preset` names: shipped, or a path from `folder`.

    `path` is the configuration that asks for it. Raises ConfigError for a name that there is not.
    """
    if preset in presets():
        return PRESETS / f"{preset}.toml"
    if not (isinstance(preset, str) and preset.endswith(".toml")):
        raise ConfigError(
            f"{path}: {PRESET_KEY} = {preset!r:.80}: must be one of {', '.join(presets())}, "
            'or the path of a file, such as "vehicle.toml"'
        )
    return folder / preset


def holds_a_vehicle_alone(path: Path) -> bool:
    """Tell whether a file is a vehicle's, and no configuration; raise ConfigError where it is no TOML."""
    return _read(path).keys() == set(get_type_hints(VehicleFile))


def load_vehicle(path: Path) -> VehicleFile:
    """Read and validate a vehicle's file; raises ConfigError naming file, key, value and range."""
    return _vehicle_of(path, _read(path))


def vehicle_text(
    vehicle: VehicleFile, about: Sequence[str], notes: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return a vehicle's file as text: comment lines on top, and `notes` behind keys such as "heave.mass"."""
    lines = [*(f"# {line}".rstrip() for line in about)]
    for section, values in msgspec.to_builtins(vehicle).items():
        lines += ["", f"[{section}]"]
        for key, value in values.items():
            line = f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value!r}"
            note = notes.get(f"{section}.{key}")
            lines.append(f"{line:32} # {note}" if note else line)
    return "\n".join(lines) + "\n"


def vehicle_of(config: Config) -> VehicleFile:
    """Return what of a configuration is the vehicle."""
    every = msgspec.to_builtins(config)
    kinds = get_type_hints(VehicleFile)
    return msgspec.convert(
        {name: {key: every[name][key] for key in kind.__struct_fields__} for name, kind in kinds.items()},
        VehicleFile,
    )


def _vehicle_of(path: Path, table: dict[str, Any]) -> VehicleFile:
    try:
        return msgspec.convert(table, VehicleFile)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {ranges.explained(table, str(error), VehicleFile)}") from error


def _merge(table: dict[str, Any], path: Path, file: Path) -> None:
    """Put the vehicle's keys into the table; raise ConfigError for one that stands in both files."""
    vehicle = _read(file)
    _vehicle_of(file, vehicle)
    for section, values in vehicle.items():
        keys = table.setdefault(section, {})
        if not isinstance(keys, dict):
            continue  # the validation of the whole says so
        for key, value in values.items():
            if key in keys:
                raise ConfigError(
                    f"{path}: {section}.{key} = {keys[key]!r:.80}: is the vehicle's, and {file} says "
                    f"{value!r}: delete it here, or set it for one run by --set {section}.{key}="
                )
            keys[key] = value


def _read(path: Path) -> dict[str, Any]:
    try:
        return files.toml(files.text(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from error


def _key(override: str) -> str:
    return override.partition("=")[0].strip()


def _apply(table: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals:
        raise ConfigError(f"--set {override}: write it as section.key=value")
    try:
        value = files.toml(f"value = {text}")["value"]
    except ValueError:
        value = text
    *sections, last = key.strip().split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"--set {override}: {section} is a value, not a section")
    table[last] = value
