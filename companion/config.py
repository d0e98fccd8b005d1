"""TOML into validated, frozen records. Unknown keys, wrong types and values out of range stop the start.

Units stand in the key names. Every key has a default here, and its meaning; docs/configuration.md lists them.
The vehicle stands in a file of its own that `vehicle.preset` names: `config/vehicles/`.
"""

from collections.abc import Mapping, Sequence
from ipaddress import ip_network
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_type_hints

import msgspec

from companion import registry
from companion.endpoint import FORMS, Endpoint
from companion.records import AXES
from companion.telemetry import ranges
from companion.telemetry.fields import means, within
from holdfast import validation
from holdfast.command_line import located
from holdfast.validation import ConfigError as ConfigError

DEFAULT_FILE = Path(__file__).parent.parent / "config" / "companion.toml"
PRESETS = DEFAULT_FILE.parent / "vehicles"
PRESET_KEY = "vehicle.preset"

T = TypeVar("T", bound=msgspec.Struct)

SCALE = "for thrusters k times as strong as T200, divide masses, inertias and damping by k"
"""The nominal model counts in newtons of a T200. The lightest vehicle: 3 kg with 1.5 kg of water and T500,
three times as strong, counts as 1.5 kg; the heaviest: 5 t with as much water and 9 kN (assumed) in place of
the 130 N of four T200, 150 kg. Damping: up to 217 N·s²/m² (docs/ardusub.md, "Vehicles") and 31 N·s/m, three
times as much with a third of the thrust. Rotation by the same factors."""

Name = Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]{1,32}$")]
SystemId = Annotated[int, within(1, 255)]
Button = Annotated[int, within(-1, 15)]
Delay = Annotated[float, within(0.0, 1.0)]
LoopDelay = Annotated[float, within(0.01, 1.0)]
Timeout = Annotated[float, within(0.05, 10.0)]
Ramp = Annotated[float, within(0.1, 10.0)]
Patience = Annotated[float, within(0.0, 60.0)]
Distance = Annotated[float, within(0.01, 10.0)]
AngleDeg = Annotated[float, within(0.5, 180.0)]
Inertia = Annotated[float, within(0.02, 100.0, unit="kg·m²", remedy=SCALE)]
Moment = Annotated[float, within(0.1, 100.0, unit="N·m")]
Righting = Annotated[float, within(0.0, 300.0, unit="N·m/rad", beside_zero=0.01, remedy=SCALE)]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file: frozen, and no key beyond its own."""

    def __post_init__(self) -> None:
        validation.check_beside_zero(self)


class FrameModel(Section, frozen=True):
    """The vehicle's frame of thrusters."""

    frame: Annotated[
        Literal["vectored", "vectored_6dof"], means("FRAME_CONFIG 1, six thrusters; or 2, eight thrusters")
    ] = "vectored_6dof"
    coriolis_share: Annotated[float, within(0.0, 1.0, "what is there of the masses' Coriolis force")] = 1.0
    yaw_per_sway_ns: Annotated[float, within(-8.0, 8.0, "yaw moment by sway", "N·s", remedy=SCALE)] = 0.0


class VehicleSection(FrameModel, frozen=True):
    """Who is steered, and by which messages."""

    also_known: ClassVar = ("preset",)
    """Read before the rest, by `_layers`."""

    name: Annotated[Name, means("in the Zenoh keys: holdfast/{name}/...")] = "bluerov2"
    steering_mode: Annotated[
        Literal["manual", "stabilize"],
        means("manual: Holdfast controls yaw; stabilize: the firmware keeps roll, pitch and heading"),
    ] = "manual"
    thrust_path: Annotated[
        Literal["rc_override", "manual_control"], means("what steers; manual_control undoes the pilot gain")
    ] = "rc_override"
    depth_source: Annotated[
        Literal["relative_alt", "pressure"], means("relative_alt: the EKF's; pressure: SCALED_PRESSURE")
    ] = "relative_alt"
    adapts: Annotated[bool, means("uses the gain and lag that are found of each axis")] = True

    @property
    def holds_heading(self) -> bool:
        """Whether the heading is ours to hold; in STABILIZE it is the firmware's."""
        return self.steering_mode == "manual"


class LinkSection(Section, frozen=True):
    """Where the vehicle is found and who we say we are."""

    endpoint: Annotated[str, means(FORMS)] = "udp-listen:127.0.0.1:14550"
    system: Annotated[SystemId, means("must equal MAV_GCS_SYSID: ArduSub obeys no other")] = 255
    component: Annotated[SystemId, means("of our messages; 25 is MAV_COMP_ID_USER1")] = 25
    vehicle_system: Annotated[SystemId, means("the autopilot's system")] = 1
    vehicle_component: Annotated[SystemId, means("the autopilot's component")] = 1
    signing_key_file: Annotated[str, means("of the key, docs/wiring.md; empty for none")] = ""
    signing_link_id: Annotated[int, within(0, 255, "in our signatures; each sender needs its own")] = 25
    allow: Annotated[tuple[str, ...], means("udp-listen: permitted senders, [] for any")] = ()


class GroundStation(Section, frozen=True):
    """The pilot's ground station, whose frames pass through us."""

    endpoint: Annotated[str, means("as link.endpoint; empty for none: docs/wiring.md")] = ""
    timeout_s: Annotated[float, within(0.5, 60.0, "without its heartbeat so long the pilot is lost")] = 3.0
    on_loss: Annotated[
        Literal["hold", "surface", "silence"],
        means("if the pilot is lost: surface: ramp down and hand over to SURFACE; silence; hold: go on"),
    ] = "surface"
    engage_button: Annotated[Button, means("clears a fault and engages; -1 for none")] = -1
    release_button: Annotated[Button, means("releases all axes; -1 for none")] = -1
    hold_button: Annotated[Button, means("stops, and holds this place; -1 for none")] = -1
    allow: Annotated[tuple[str, ...], means("as link.allow, for the ground station")] = ()


class LoopSection(Section, frozen=True):
    """The tick."""

    rate_hz: Annotated[float, within(10.0, 200.0, "ArduSub applies overrides at 50 Hz")] = 50.0


class AxisModel(Section, frozen=True):
    """What is believed of one axis, the nominal model: m, N and kg."""

    mass: Annotated[float, within(1.0, 1000.0, "with the water carried along", "kg", remedy=SCALE)] = 17.5
    linear_damping: Annotated[float, within(0.0, 300.0, "by speed v", "N·s/m", remedy=SCALE)] = 8.0
    quadratic_damping: Annotated[float, within(0.0, 1000.0, "by v abs(v)", "N·s²/m²", remedy=SCALE)] = 95.0
    max_force: Annotated[float, within(0.1, 500.0, "the law asks for no more", "N")] = 70.0


class YawModel(AxisModel, frozen=True):
    """The nominal model of yaw: rad, N·m and kg·m²."""

    mass: Inertia = 0.5
    linear_damping: Annotated[float, within(0.0, 30.0, unit="N·m·s/rad", remedy=SCALE)] = 0.1
    quadratic_damping: Annotated[float, within(0.0, 100.0, unit="N·m·s²/rad²", remedy=SCALE)] = 1.0
    max_force: Moment = 12.0


class AxisSection(AxisModel, frozen=True):
    """One axis: its nominal model, how stiffly it is held and who compensates. Defaults are those of surge.

    Noises are standard deviations of one sample.
    """

    lambda_per_s: ranges.Lambda = 2.0
    kappa_per_s: ranges.Kappa = 4.0
    max_rate: Annotated[float, within(0.01, 3.0, "of the setpoint", "m/s or rad/s")] = 0.4
    max_acceleration: Annotated[float, within(0.01, 5.0, "of the setpoint", "m/s² or rad/s²")] = 0.3
    law: Annotated[str, means("`lyapunov` is the paper's; or one of [laws]")] = "lyapunov"
    compensator: Annotated[
        str,
        means(
            "estimates the disturbance: `predictor` is the observer, whose disturbance a network predicts "
            "until the thrust acts; observer, alone; none; integrator, the paper's network, or one of "
            "[compensators], and these but the network also with +observer: docs/your-own-controller.md"
        ),
    ] = "predictor"
    learning_rate: ranges.LearningRate = 14.0
    hidden_learning_rate: ranges.HiddenLearningRate = 0.0
    leak_per_s: ranges.Leak = 0.002
    dead_zone: ranges.DeadZone = 0.002
    max_disturbance: ranges.MaxDisturbance = 50.0
    position_noise: ranges.PositionNoise = 0.005
    rate_noise: ranges.RateNoise = 0.005
    position_noise_slow: ranges.SlowPositionNoise = 0.01
    rate_noise_slow: ranges.SlowRateNoise = 0.005
    disturbance_noise: ranges.DisturbanceNoise = 3.0
    sensor_delay_s: Annotated[Delay, means("age of a position when the autopilot sends it")] = 0.03
    rate_delay_s: Annotated[Delay, means("age of its rate then")] = 0.03


class YawSection(YawModel, AxisSection, frozen=True):
    """The yaw axis."""


class ThrusterLag(Section, frozen=True):
    """What is believed of the thrusters."""

    lag_s: ranges.Lag = 0.15
    start_s: Annotated[Delay, means("a motor at rest, or that reverses, pushes so much later")] = 0.0
    delay_s: Annotated[float, within(0.0, 0.1, "neither TIMESYNC nor the stamps show it; a first guess")] = (
        0.0
    )

    @property
    def from_rest_s(self) -> float:
        """Lag and start together: how late a push from rest is."""
        return self.lag_s + self.start_s


class ThrusterSection(ThrusterLag, frozen=True):
    """What is believed of the thrusters, and what is sent to them."""

    lead_s: Annotated[float, within(0.0, 0.3, "prediction beyond the delays, against the lag")] = 0.012
    max_axis: Annotated[float, within(0.05, 1.0, "largest demand that is sent")] = 1.0
    max_slew_per_s: Annotated[float, within(0.5, 100.0, "fastest change of a demand")] = 15.0


class TiltModel(Section, frozen=True):
    """What is believed of roll and pitch."""

    roll_inertia: Annotated[Inertia, means("with added mass: about 1.7 times the dry moment of inertia")] = (
        0.45
    )
    pitch_inertia: Annotated[Inertia, means("as roll_inertia")] = 0.37
    lever_m: Annotated[float, within(-1.0, 1.0, "horizontal thrusters below the centre of gravity")] = 0.085
    roll_righting_nm: Annotated[Righting, means("weight times metacentric height; 0: not known")] = 0.0
    pitch_righting_nm: Annotated[Righting, means("as roll_righting_nm")] = 0.0
    max_moment_nm: Annotated[Moment, means("largest moment for levelling")] = 12.0
    max_axis: Annotated[float, within(0.01, 0.49, "of roll and pitch; 0.5 capsizes a Heavy")] = 0.48


class LevellingSection(TiltModel, frozen=True):
    """How roll and pitch are held level in MANUAL; the frame with six thrusters has only roll."""

    frequency_radps: Annotated[float, within(0.2, 20.0, "bandwidth; less where delays exceed 36 ms")] = 5.0


class VehicleFile(Section, frozen=True):
    """A file of `config/vehicles/`: all that is the vehicle, and nothing else."""

    vehicle: FrameModel
    thrusters: ThrusterLag
    levelling: TiltModel
    surge: AxisModel
    sway: AxisModel
    heave: AxisModel
    yaw: YawModel


class Network(Section, frozen=True):
    """What the four networks share."""

    units: Annotated[int, within(1, 100, "logistic units in the hidden layer")] = 10
    seed: Annotated[int, within(0, 2**63 - 1, "of the hidden weights V ~ N(0, 1); W starts at zero")] = 1


class DelaySection(Section, frozen=True):
    """The delays that are assumed until they have been measured (TIMESYNC, SERVO_OUTPUT_RAW)."""

    telemetry_s: Annotated[Delay, means("of telemetry")] = 0.010
    command_s: Annotated[Delay, means("of commands, beside half of TIMESYNC's round trip")] = 0.012
    range_s: Annotated[float, within(0.0, 1.2, "age of a range when sent; a Ping behind BlueOS: 0.8 s")] = 0.3
    gains_bear_s: Annotated[LoopDelay, means("beyond, in all, the gains are reduced")] = 0.105
    slow_noise_s: Annotated[float, within(0.05, 60.0, "correlation of slow noise in depth and climb")] = 0.8


class SupervisorLimits(Section, frozen=True):
    """When to refuse and when to give up."""

    link_timeout_s: Annotated[
        Timeout, means("silence or lateness until it gives up; less only interrupts")
    ] = 1.0
    heartbeat_timeout_s: Annotated[Timeout, means("three heartbeats; only they report arming and mode")] = 3.5
    depth_timeout_s: Annotated[Timeout, means("largest age of the depth; then thrust is neutral")] = 0.5
    attitude_timeout_s: Annotated[Timeout, means("the same of the attitude")] = 0.5
    position_timeout_s: Annotated[Timeout, means("largest age of the position")] = 1.0
    late_tick_s: Annotated[Timeout, means("thrust is neutral after a later tick")] = 0.3
    ramp_up_s: Annotated[Ramp, means("from zero to full authority after engaging")] = 1.0
    ramp_down_s: Annotated[Ramp, means("and back after a release")] = 1.0
    max_pilot_timeout_s: Annotated[float, within(0.1, 3.0, "longest FS_PILOT_TIMEOUT to engage with")] = 3.0
    pilot_deflection: Annotated[float, within(0.02, 0.5, "another sender's stick that is a takeover")] = 0.1
    pilot_hold_s: Annotated[Ramp, means("it lasts this long after the last deflection")] = 1.0
    max_depth_m: Annotated[float, within(0.5, 1000.0, "deepest setpoint")] = 100.0
    min_altitude_m: Annotated[ranges.Altitude, means("lowest altitude over the ground to ask for")] = 0.5
    max_tilt_deg: Annotated[float, within(10.0, 89.0, "from the held angle; beyond, heave alone")] = 60.0
    depth_margin_m: Annotated[float, within(0.0, 20.0, "above the surface and below max_depth_m")] = 2.0
    max_depth_jump_m: Annotated[Distance, means("a depth further from the predicted one is rejected")] = 0.5
    max_ekf_variance: Annotated[float, within(0.05, 10.0, "largest of compass, velocity and depth")] = 0.8
    ekf_doubt_s: Annotated[Patience, means("for this time, as in the firmware's failsafe")] = 2.0
    min_voltage_v: Annotated[float, within(6.0, 30.0, "lower: warn, refuse (4S: 3.25 V a cell)")] = 13.0
    battery_low_s: Annotated[Patience, means("for this time")] = 5.0
    saturated_s: Annotated[Patience, means("an axis saturated for this long: warn, freeze learning")] = 5.0
    max_error_m: Annotated[Distance, means("a larger error: Holdfast hands over to ALT_HOLD")] = 1.0
    max_error_deg: Annotated[AngleDeg, means("the same of the heading")] = 45.0
    off_track_s: Annotated[Patience, means("for this time")] = 3.0
    max_delay_s: Annotated[LoopDelay, means("in all; Holdfast hands over beyond it")] = 0.3
    max_innovation_m: Annotated[Distance, means("largest mean of measured minus predicted")] = 0.1
    max_innovation_deg: Annotated[AngleDeg, means("the same of the heading")] = 10.0
    keep_alt_hold_s: Annotated[ranges.Hour, means("neutral frames after a hand-over")] = 60.0


class FenceSection(Section, frozen=True):
    """Where the vehicle may be; what it is told keeps 0.1 m from it."""

    enabled: Annotated[bool, means("whether setpoints and paths are kept inside")] = False
    north_m: Annotated[tuple[ranges.Metres, ranges.Metres], means("of the position's origin")] = (-20.0, 20.0)
    east_m: Annotated[tuple[ranges.Metres, ranges.Metres], means("of this origin")] = (-20.0, 20.0)
    depth_m: Annotated[tuple[ranges.Depth, ranges.Depth], means("below the surface")] = (0.5, 50.0)


class TelemetrySection(Section, frozen=True):
    """Where the controller's state is published, whether the raw ticks are, and who may command."""

    mode: Annotated[
        Literal["peer", "client", "file"],
        means(
            "peer: join the endpoint, else listen there (on loopback only); client: only join, as to "
            "BlueOS's router; file: docs/examples/zenoh"
        ),
    ] = "peer"
    endpoint: Annotated[str, means("of Zenoh; with file the path of its configuration")] = (
        "tcp/127.0.0.1:7447"
    )
    allow_control: Annotated[
        Literal["local", "always", "never"],
        means("commands of this machine, or always: also through a router, a network or with file"),
    ] = "local"
    raw: Annotated[bool, means("publish every datagram too, for `holdfast lab rerun`")] = False


class Config(Section, frozen=True):
    """The whole file, with the vehicle's. The default vehicle is that of `config/vehicles/heavy.toml`."""

    vehicle: VehicleSection = VehicleSection()
    link: LinkSection = LinkSection()
    ground_station: GroundStation = GroundStation()
    loop: LoopSection = LoopSection()
    delays: DelaySection = DelaySection()
    thrusters: ThrusterSection = ThrusterSection()
    levelling: LevellingSection = LevellingSection()
    surge: AxisSection = AxisSection(kappa_per_s=8.0, max_disturbance=70.0)
    sway: AxisSection = AxisSection(
        mass=18.0, linear_damping=6.0, quadratic_damping=130.0, kappa_per_s=8.0, max_disturbance=70.0
    )
    heave: AxisSection = AxisSection(
        mass=28.5,
        linear_damping=19.0,
        quadratic_damping=113.0,
        max_force=100.0,
        lambda_per_s=7.5,
        kappa_per_s=10.0,
        max_rate=0.45,
        max_acceleration=0.4,
        learning_rate=60.0,
        dead_zone=0.001,
        max_disturbance=100.0,
        position_noise=0.0006,
        rate_noise=0.0008,
        position_noise_slow=0.003,
        rate_noise_slow=0.004,
        disturbance_noise=4.1,
        sensor_delay_s=0.012,
        rate_delay_s=0.003,
    )
    yaw: YawSection = YawSection(
        max_rate=0.8,
        max_acceleration=0.8,
        compensator="observer",
        learning_rate=0.9,
        max_disturbance=6.0,
        position_noise=0.002,
        rate_noise=0.003,
        position_noise_slow=0.005,
        rate_noise_slow=0.002,
        disturbance_noise=0.5,
        sensor_delay_s=0.005,
        rate_delay_s=0.005,
    )
    network: Network = Network()
    supervisor: SupervisorLimits = SupervisorLimits()
    fence: FenceSection = FenceSection()
    telemetry: TelemetrySection = TelemetrySection()
    compensators: dict[str, dict[str, Any]] = {}
    laws: dict[str, dict[str, Any]] = {}
    """Parameters of compensators and laws beyond the shipped ones, by their names."""

    @property
    def axes(self) -> tuple[AxisSection, AxisSection, AxisSection, AxisSection]:
        """Surge, sway, heave, yaw."""
        return (self.surge, self.sway, self.heave, self.yaw)

    @property
    def levels(self) -> bool:
        """Whether roll and pitch are ours to hold level; in STABILIZE they are the firmware's."""
        return self.vehicle.steering_mode == "manual"


def load_config(path: Path = DEFAULT_FILE, overrides: Sequence[str] = ()) -> Config:
    """Lay the vehicle's file, `path` and `section.key=value` overrides (TOML values) over the defaults.

    `vehicle.preset` names the vehicle's file. A key that is gone, or has other values now, is logged as a
    warning with what replaces it. Raises ConfigError naming file, key, value and the allowed range.
    """
    return load_with_origins(path, overrides)[0]


def load_with_origins(path: Path, overrides: Sequence[str] = ()) -> tuple[Config, dict[str, str]]:
    """Return as well where each key such as "heave.mass" has its value: a file, "--set", or "default"."""
    table: dict[str, Any] = {}
    origins: dict[str, str] = {}
    for source, layer in _layers(path, overrides):
        _lay(table, layer)
        for section, keys in layer.items():
            origins |= {f"{section}.{key}": source for key in (keys if isinstance(keys, dict) else ())}
    config = _converted(table, Config, path, overrides)
    try:
        _check_together(config)
        check_choices(config)
    except ConfigError as error:
        raise ConfigError(located(path, overrides, str(error))) from error
    return config, origins


def _layers(path: Path, overrides: Sequence[str]) -> list[tuple[str, dict[str, Any]]]:
    """Return the defaults, the vehicle's file, `path` and the overrides: each wins over those before."""
    file, chosen = validation.read(path), dict[str, Any]()
    for override in overrides:
        validation.override(chosen, override)
    layers = [("default", msgspec.to_builtins(Config())), (str(path), file), ("--set", chosen)]
    presets = [
        (vehicle.pop("preset"), folder)
        for table, folder in ((chosen, Path()), (file, path.parent))
        if isinstance(vehicle := table.get("vehicle"), dict) and "preset" in vehicle
    ]
    if presets:
        named = vehicle_file(path, *presets[0])
        layers.insert(1, (str(named), _vehicle_without(file, path, named)))
    return layers


def _converted(table: dict[str, Any], kind: type[T], path: Path, overrides: Sequence[str] = ()) -> T:
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        said = validation.explained(table, str(error), kind)
        raise ConfigError(located(path, overrides, said)) from error


def _check_together(config: Config) -> None:
    """Raise ConfigError for values that are within their ranges and cannot be used, or not together."""
    for key in ("north_m", "east_m", "depth_m"):
        low, high = getattr(config.fence, key)
        if not low < high:
            raise ConfigError(f"fence.{key} = [{low:g}, {high:g}]: the first must be less")
    ground, path = config.ground_station, config.vehicle.thrust_path
    for name, link in (("link", config.link), ("ground_station", ground)):
        try:
            if link.endpoint or link is config.link:
                Endpoint.parse(link.endpoint)
        except ValueError as error:
            raise ConfigError(f"{name}.endpoint = {link.endpoint!r}: {error}") from error
        try:
            list(map(ip_network, link.allow))
        except ValueError as error:
            words = 'list addresses and networks, such as "192.168.2.0/24"'
            raise ConfigError(f"{name}.allow: {error}; {words}") from error
    if ground.engage_button == ground.release_button != -1:
        raise ConfigError(
            f"ground_station.engage_button = {ground.engage_button}: release_button is the same; "
            "want two different ones, or -1 for none"
        )
    if ground.endpoint and path != "manual_control":
        raise ConfigError(
            f"vehicle.thrust_path = {path!r}: must be 'manual_control' with a ground_station.endpoint: "
            "overrides would wipe out the pilot's MANUAL_CONTROL"
        )


def check_choices(config: Config) -> None:
    """Raise ConfigError for a compensator or a law that there is not, or that cannot be used."""
    where = ""
    try:
        compensators, laws = registry.compensators(config.compensators), registry.laws(config.laws)
        for name, axis in zip(AXES, config.axes, strict=True):
            where = f"{name}.compensator = {axis.compensator!r:.80}: "
            registry.learner(axis.compensator, compensators)
            if axis.law not in laws:
                raise ConfigError(f"{name}.law = {axis.law!r:.80}: must be one of {', '.join(laws)}")
    except registry.UnusableError as error:
        raise ConfigError(f"{where}{error}") from error


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
    known, table = msgspec.to_builtins(vehicle_of(Config())), validation.read(path)
    parts = (
        isinstance(keys, dict) and keys.keys() <= known.get(section, {}).keys()
        for section, keys in table.items()
    )
    return all(parts) and "frame" in table.get("vehicle", {})


def load_vehicle(path: Path) -> VehicleFile:
    """Read and validate a vehicle's file; raises ConfigError naming file, key, value and range."""
    whole: dict[str, Any] = msgspec.to_builtins(vehicle_of(Config()))
    _lay(whole, validation.read(path))
    return _converted(whole, VehicleFile, path)


def vehicle_text(
    vehicle: VehicleFile, about: Sequence[str], notes: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return a vehicle's file as text: comment lines on top, and `notes` behind keys such as "heave.mass"."""
    lines = [f"# {line}".rstrip() for line in about]
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


def _vehicle_without(table: dict[str, Any], path: Path, file: Path) -> dict[str, Any]:
    """Return the vehicle's file as a table; raise ConfigError for a key that stands in `table` too."""
    load_vehicle(file)
    vehicle = validation.read(file)
    for section, values in vehicle.items():
        keys = table.get(section)
        for key in values.keys() & keys.keys() if isinstance(keys, dict) else ():
            raise ConfigError(
                f"{path}: {section}.{key} = {table[section][key]!r:.80}: is the vehicle's, and {file} says "
                f"{values[key]!r}: delete it here, or set it for one run by --set {section}.{key}="
            )
    return vehicle


def _lay(table: dict[str, Any], layer: Mapping[str, Any]) -> None:
    """Put the values of `layer` over those of `table`."""
    for key, value in layer.items():
        there = table.get(key)
        if isinstance(there, dict) and isinstance(value, dict):
            _lay(there, value)
        else:
            table[key] = value
