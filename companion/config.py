"""TOML into validated, frozen records. Unknown keys, wrong types and values out of range stop the start.

Units stand in the key names. Every key has a default here, and its meaning; docs/configuration.md lists them.
The vehicle stands in a file of its own that `vehicle.preset` names: `config/vehicles/`.
"""

import logging
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
from companion.telemetry.words import means
from holdfast import validation
from holdfast.arguments import located
from holdfast.validation import ConfigError as ConfigError

DEFAULT_FILE = Path(__file__).parent.parent / "config" / "companion.toml"
PRESETS = DEFAULT_FILE.parent / "vehicles"
PRESET_KEY = "vehicle.preset"

LOG = logging.getLogger("holdfast")

REPLACED: Mapping[str, tuple[str, str]] = {
    "supervisor.max_surprise_m": ("max_innovation_m", "its name is supervisor.max_innovation_m now"),
    "supervisor.max_surprise_deg": ("max_innovation_deg", "its name is supervisor.max_innovation_deg now"),
    "vehicle.rate_source": ("", "the depth rate is that of VFR_HUD.climb, which has the least noise"),
    "levelling.enabled": ("", "roll and pitch are held level where vehicle.steering_mode is 'manual'"),
}
"""Keys of older versions: the key of the same section that takes the value, if one does, and the warning."""
FORMER_VALUES: Mapping[str, Mapping[bool | str, str]] = {
    "telemetry.allow_control": {False: "never", True: "always"},
    "vehicle.depth_source": {"vfr_hud": "relative_alt", "ahrs2": "pressure"},
}
"""Values that keys had in older versions, and what takes their place."""

Name = Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]{1,32}$")]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file: frozen, and no key beyond its own."""

    def __post_init__(self) -> None:
        validation.check_beside_zero(self)


class Frame(Section, frozen=True):
    """The vehicle's frame of thrusters."""

    frame: Annotated[
        Literal["vectored", "vectored_6dof"],
        means("FRAME_CONFIG 1, six thrusters; or FRAME_CONFIG 2, eight thrusters"),
    ] = "vectored_6dof"
    coriolis_share: Annotated[
        ranges.PartOfWhole, means("of the Coriolis force of the axes' masses, how much is there")
    ] = 1.0
    yaw_per_sway_ns: Annotated[
        ranges.Coupling, means("N·m in yaw for each m/s to the right: its side is not even fore and aft")
    ] = 0.0


class Vehicle(Frame, frozen=True):
    """Who is steered, and by which messages."""

    name: Annotated[Name, means("in the Zenoh keys: holdfast/{name}/...")] = "bluerov2"
    steering_mode: Annotated[
        Literal["manual", "stabilize"],
        means("manual: Holdfast controls yaw; stabilize: the firmware keeps roll, pitch and heading"),
    ] = "manual"
    thrust_path: Annotated[
        Literal["rc_override", "manual_control"],
        means("the message that steers; manual_control compensates the reported pilot gain"),
    ] = "rc_override"
    depth_source: Annotated[
        Literal["relative_alt", "pressure"],
        means("relative_alt: the EKF's, in GLOBAL_POSITION_INT; pressure: the barometer's, SCALED_PRESSURE"),
    ] = "relative_alt"
    adapts: Annotated[
        bool, means("uses the gain and thruster lag that are found of each axis during the dive")
    ] = True

    @property
    def holds_heading(self) -> bool:
        """Whether the heading is ours to hold; in STABILIZE it is the firmware's."""
        return self.steering_mode == "manual"


class LinkSection(Section, frozen=True):
    """Where the vehicle is found and who we say we are."""

    endpoint: Annotated[
        str, means("udp-listen:HOST:PORT, udp-connect:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD")
    ] = "udp-listen:127.0.0.1:14550"
    system: Annotated[
        ranges.SystemId, means("must equal MAV_GCS_SYSID: ArduSub ignores steering of other systems")
    ] = 255
    component: Annotated[ranges.SystemId, means("of our messages; 25 is MAV_COMP_ID_USER1")] = 25
    vehicle_system: Annotated[ranges.SystemId, means("the autopilot's system")] = 1
    vehicle_component: Annotated[ranges.SystemId, means("the autopilot's component")] = 1
    signing_key_file: Annotated[
        str, means("32 raw bytes, 64 hex digits or a passphrase; empty for none: docs/wiring.md")
    ] = ""
    signing_link_id: Annotated[
        ranges.LinkId, means("in Holdfast's signatures; each sender with the same key needs its own")
    ] = 25
    allow: Annotated[
        tuple[str, ...],
        means("udp-listen: permitted senders, such as 192.168.2.0/24; an empty list permits any"),
    ] = ()


class GroundStation(Section, frozen=True):
    """The pilot's ground station, whose frames pass through us."""

    endpoint: Annotated[str, means("as link.endpoint; empty for none: docs/wiring.md")] = ""
    timeout_s: Annotated[
        ranges.PilotTimeout, means("without its heartbeat for this time the pilot is lost")
    ] = 3.0
    on_loss: Annotated[
        Literal["hold", "surface", "silence"],
        means("if the pilot is lost: surface: ramp down and hand over to SURFACE; silence; hold: go on"),
    ] = "surface"
    full_deflection: Annotated[
        ranges.FullDeflection, means("stick deflection that overrides its axis; less moves the setpoint")
    ] = 0.95
    full_deflection_s: Annotated[ranges.Patience, means("when the deflection lasts this long")] = 0.3
    engage_button: Annotated[
        ranges.Button, means("joystick button that clears a fault and engages; -1 for none")
    ] = -1
    release_button: Annotated[
        ranges.Button, means("joystick button that releases all axes; -1 for none")
    ] = -1
    hold_button: Annotated[
        ranges.Button, means("joystick button that stops, and holds this place; -1 for none")
    ] = -1
    allow: Annotated[tuple[str, ...], means("as link.allow, for the ground station")] = ()


class LoopSection(Section, frozen=True):
    """The tick."""

    rate_hz: Annotated[
        ranges.TickRate, means("ArduSub applies overrides at 50 Hz; a higher rate has no effect")
    ] = 50.0


class AxisModel(Section, frozen=True):
    """What is believed of one axis, the nominal model: m, N and kg."""

    mass: Annotated[ranges.Mass, means("with the water carried along")] = 17.5
    linear_damping: Annotated[
        ranges.LinearDamping, means("force at speed v: linear_damping v + quadratic_damping v abs(v)")
    ] = 8.0
    quadratic_damping: Annotated[
        ranges.QuadraticDamping, means("half of 1000 kg/m³, times drag coefficient, times frontal area")
    ] = 95.0
    max_force: Annotated[ranges.Force, means("the law asks for no more; less than the thrusters give")] = 70.0


class YawModel(AxisModel, frozen=True):
    """The same of yaw: rad, N·m and kg·m²."""

    mass: ranges.Inertia = 0.5
    linear_damping: ranges.LinearTurnDamping = 0.1
    quadratic_damping: ranges.QuadraticTurnDamping = 1.0
    max_force: ranges.Moment = 12.0


class Axis(AxisModel, frozen=True):
    """One axis: its nominal model, how stiffly it is held and who compensates. Defaults are those of surge.

    Noises are standard deviations of one sample.
    """

    lambda_per_s: Annotated[
        ranges.Lambda, means("1/lambda + 1/kappa must exceed the delay and the thrusters' lag")
    ] = 2.0
    kappa_per_s: Annotated[ranges.Kappa, means("how hard the law pulls to the decay by lambda")] = 4.0
    max_rate: Annotated[ranges.MaxRate, means("of the setpoint", unit="m/s or rad/s")] = 0.4
    max_acceleration: Annotated[ranges.MaxAcceleration, means("of the setpoint", unit="m/s² or rad/s²")] = 0.3
    law: Annotated[str, means("`lyapunov` is the paper's; or one of [laws]: docs/your-own-controller.md")] = (
        "lyapunov"
    )
    compensator: Annotated[
        str,
        means(
            "estimates the disturbance: none, integrator, regressor, network, observer (feeds back the "
            "observer's d), one of [compensators], or several joined by +"
        ),
    ] = "network+observer"
    learning_rate: Annotated[ranges.LearningRate, means("of the chosen compensator")] = 14.0
    hidden_learning_rate: Annotated[
        ranges.HiddenLearningRate, means("of the network's hidden layer; 0: it stays as drawn")
    ] = 0.0
    leak_per_s: Annotated[ranges.Leak, means("rate at which the compensator forgets")] = 0.002
    dead_zone: Annotated[
        ranges.DeadZone, means("combined error below which it learns nothing", unit="m/s or rad/s")
    ] = 0.002
    max_disturbance: Annotated[
        ranges.Force,
        means("0.5 m/s of current is 42 N from ahead, 54 N from the side; more pitches it", unit="N or N·m"),
    ] = 50.0
    position_noise: Annotated[
        ranges.Noise, means("of the position, white; depth and heading may show more", unit="m or rad")
    ] = 0.005
    rate_noise: Annotated[ranges.Noise, means("of the rate, from sample to sample", unit="m/s or rad/s")] = (
        0.005
    )
    position_noise_slow: Annotated[
        ranges.SlowNoise, means("of the position, correlated over delays.slow_noise_s", unit="m or rad")
    ] = 0.01
    rate_noise_slow: Annotated[
        ranges.SlowNoise, means("of the rate, correlated over delays.slow_noise_s", unit="m/s or rad/s")
    ] = 0.005
    disturbance_noise: Annotated[
        ranges.DisturbanceNoise, means("how fast the disturbance changes", unit="N/√s or N·m/√s")
    ] = 2.0
    sensor_delay_s: Annotated[ranges.Delay, means("age of a sample when the autopilot sends it")] = 0.03


class YawAxis(YawModel, Axis, frozen=True):
    """The yaw axis."""


class ThrusterLag(Section, frozen=True):
    """What is believed of the thrusters."""

    lag_s: Annotated[
        ranges.Lag, means("first-order lag from a motor's command to its thrust; T200: 0.1 to 0.2 s")
    ] = 0.15
    start_s: Annotated[
        ranges.Delay, means("a motor at rest, or that reverses, gives thrust so much later")
    ] = 0.0
    delay_s: Annotated[
        ranges.HiddenDelay,
        means("delay that neither TIMESYNC nor the stamps show; what a dive shows is found from here on"),
    ] = 0.0

    @property
    def from_rest_s(self) -> float:
        """Lag and start together: how late a push from rest is."""
        return self.lag_s + self.start_s


class Thrusters(ThrusterLag, frozen=True):
    """What is believed of the thrusters, and what is sent to them."""

    lead_s: Annotated[
        ranges.Lead, means("prediction beyond the delays: compensates a part of the thrusters' lag")
    ] = 0.012
    max_axis: Annotated[ranges.Share, means("largest demand that is sent")] = 1.0
    max_slew_per_s: Annotated[ranges.Slew, means("fastest change of a demand")] = 15.0


class Tilting(Section, frozen=True):
    """What is believed of roll and pitch."""

    roll_inertia: Annotated[
        ranges.Inertia, means("with added mass: about 1.7 times the dry moment of inertia")
    ] = 0.45
    pitch_inertia: Annotated[ranges.Inertia, means("as roll_inertia")] = 0.37
    lever_m: Annotated[
        ranges.Lever, means("horizontal thrusters below the centre of gravity; negative above it")
    ] = 0.085
    roll_righting_nm: Annotated[
        ranges.Righting, means("weight times the height of the centre of buoyancy; 0: not known")
    ] = 0.0
    pitch_righting_nm: Annotated[ranges.Righting, means("as roll_righting_nm")] = 0.0
    max_moment_nm: Annotated[ranges.Moment, means("largest moment for levelling")] = 12.0
    max_axis: Annotated[
        ranges.TiltShare, means("largest roll or pitch demand; 0.5 (200 us) and more capsizes a Heavy")
    ] = 0.48


class Levelling(Tilting, frozen=True):
    """How roll and pitch are held level in MANUAL; the frame with six thrusters has only roll."""

    frequency_radps: Annotated[
        ranges.LevellingFrequency, means("bandwidth; reduced if the delays are longer than 36 ms")
    ] = 5.0


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

    units: Annotated[ranges.Units, means("logistic units in the hidden layer")] = 10
    seed: Annotated[ranges.Seed, means("of the hidden weights V ~ N(0, 1); W starts at zero")] = 1
    start_delay_s: Annotated[ranges.Patience, means("learning starts this long after engaging")] = 2.0


class Delays(Section, frozen=True):
    """What the loop's delays are taken for until they have been measured (TIMESYNC, SERVO_OUTPUT_RAW)."""

    telemetry_s: Annotated[ranges.Delay, means("of telemetry")] = 0.010
    command_s: Annotated[
        ranges.Delay, means("of commands without the link; half of TIMESYNC's round trip is added")
    ] = 0.012
    range_s: Annotated[
        ranges.RangeDelay,
        means("age of a range to the ground when it is sent; a Ping behind BlueOS: up to 0.8 s"),
    ] = 0.3
    gains_bear_s: Annotated[
        ranges.BorneDelay, means("if the sum of both delays is longer, the gains are reduced")
    ] = 0.105
    slow_noise_s: Annotated[
        ranges.Correlation, means("correlation time of the slow noise in depth and climb rate")
    ] = 0.8


class SupervisorLimits(Section, frozen=True):
    """When to refuse and when to give up."""

    link_timeout_s: Annotated[
        ranges.Timeout, means("silence, or a tick's lateness, until Holdfast gives up; shorter is ridden out")
    ] = 1.0
    heartbeat_timeout_s: Annotated[
        ranges.Timeout, means("three lost heartbeats; only they report arming and mode")
    ] = 3.5
    depth_timeout_s: Annotated[ranges.Timeout, means("largest age of the depth; then thrust is neutral")] = (
        0.5
    )
    attitude_timeout_s: Annotated[
        ranges.Timeout, means("largest age of the attitude; then thrust is neutral")
    ] = 0.5
    position_timeout_s: Annotated[ranges.Timeout, means("largest age of the position")] = 1.0
    late_tick_s: Annotated[
        ranges.Timeout, means("thrust is neutral after a tick that is later than this")
    ] = 0.3
    ramp_up_s: Annotated[ranges.Ramp, means("from zero to full authority after engaging")] = 1.0
    ramp_down_s: Annotated[ranges.Ramp, means("and back after a release")] = 1.0
    max_pilot_timeout_s: Annotated[
        ranges.FailsafeTimeout,
        means("engaging is refused if FS_PILOT_TIMEOUT is longer or FS_PILOT_INPUT is 0"),
    ] = 3.0
    pilot_deflection: Annotated[
        ranges.PilotDeflection, means("deflection of another sender's stick that counts as takeover")
    ] = 0.1
    pilot_hold_s: Annotated[ranges.Ramp, means("a takeover lasts this long after the last deflection")] = 1.0
    max_depth_m: Annotated[ranges.MaxDepth, means("deepest setpoint")] = 100.0
    min_altitude_m: Annotated[
        ranges.Altitude, means("least altitude over the ground that can be asked for")
    ] = 0.5
    max_tilt_deg: Annotated[
        ranges.TiltDeg, means("of roll or pitch from its held angle; beyond, only heave and levelling remain")
    ] = 60.0
    depth_margin_m: Annotated[
        ranges.DepthMargin,
        means("a depth this far above the surface or below max_depth_m is out of bounds"),
    ] = 2.0
    max_depth_jump_m: Annotated[
        ranges.Distance, means("a depth is rejected if it differs more from the predicted one")
    ] = 0.5
    max_ekf_variance: Annotated[
        ranges.EkfVariance,
        means("of EKF_STATUS_REPORT (compass, velocity, depth): Holdfast gives up if one is larger"),
    ] = 0.8
    ekf_doubt_s: Annotated[ranges.Patience, means("for this time, as in the firmware's failsafe")] = 2.0
    min_voltage_v: Annotated[
        ranges.Voltage, means("lower for battery_low_s: warn, refuse to engage (4S: 3.25 V a cell)")
    ] = 13.0
    battery_low_s: Annotated[ranges.Patience, means("with min_voltage_v")] = 5.0
    saturated_s: Annotated[
        ranges.Patience, means("an axis saturated for this long: warn, freeze learning")
    ] = 5.0
    max_error_m: Annotated[
        ranges.Distance, means("a larger error for off_track_s: Holdfast hands over to ALT_HOLD")
    ] = 1.0
    max_error_deg: Annotated[ranges.AngleDeg, means("the same of the heading")] = 45.0
    off_track_s: Annotated[ranges.Patience, means("with max_error_m and max_error_deg")] = 3.0
    max_delay_s: Annotated[
        ranges.BorneDelay, means("of telemetry and commands together: Holdfast hands over beyond it")
    ] = 0.3
    max_innovation_m: Annotated[
        ranges.Distance, means("largest mean innovation (measured minus predicted)")
    ] = 0.1
    max_innovation_deg: Annotated[ranges.AngleDeg, means("the same of the heading")] = 10.0
    keep_alt_hold_s: Annotated[
        ranges.Hour, means("neutral frames after a hand-over, against FS_PILOT_INPUT")
    ] = 60.0


class FenceSection(Section, frozen=True):
    """Where the vehicle may be; what it is told keeps 0.1 m from it."""

    enabled: Annotated[bool, means("whether setpoints and paths are kept inside")] = False
    north_m: Annotated[tuple[ranges.Metres, ranges.Metres], means("of the origin of the position source")] = (
        -20.0,
        20.0,
    )
    east_m: Annotated[tuple[ranges.Metres, ranges.Metres], means("of this origin")] = (-20.0, 20.0)
    depth_m: Annotated[tuple[ranges.Depth, ranges.Depth], means("below the surface")] = (0.5, 50.0)


class Telemetry(Section, frozen=True):
    """Where the controller's state is published, whether the raw ticks are, and who may command."""

    mode: Annotated[
        Literal["peer", "client", "file"],
        means(
            "peer: connect to the endpoint, else listen there (on loopback only); client: only connect, as "
            "to BlueOS's router; file: docs/examples/zenoh"
        ),
    ] = "peer"
    endpoint: Annotated[str, means("of Zenoh; with file the path of a Zenoh configuration")] = (
        "tcp/127.0.0.1:7447"
    )
    allow_control: Annotated[
        Literal["local", "always", "never"],
        means(
            "accept commands (`holdfast tell`) of this machine; always: also through a router, a network or "
            "with file (run --allow-control)"
        ),
    ] = "local"
    raw: Annotated[bool, means("publish every datagram too, for `holdfast lab rerun`")] = False


class Config(Section, frozen=True):
    """The whole file, with the vehicle's. The default vehicle is that of `config/vehicles/heavy.toml`."""

    vehicle: Vehicle = Vehicle()
    link: LinkSection = LinkSection()
    ground_station: GroundStation = GroundStation()
    loop: LoopSection = LoopSection()
    delays: Delays = Delays()
    thrusters: Thrusters = Thrusters()
    levelling: Levelling = Levelling()
    surge: Axis = Axis(kappa_per_s=8.0)
    sway: Axis = Axis(
        mass=18.0, linear_damping=6.0, quadratic_damping=130.0, kappa_per_s=8.0, max_disturbance=70.0
    )
    heave: Axis = Axis(
        mass=28.5,
        linear_damping=19.0,
        quadratic_damping=113.0,
        max_force=100.0,
        lambda_per_s=7.0,
        kappa_per_s=10.0,
        max_rate=0.45,
        max_acceleration=0.4,
        learning_rate=60.0,
        dead_zone=0.001,
        max_disturbance=60.0,
        position_noise=0.0006,
        rate_noise=0.0008,
        position_noise_slow=0.003,
        rate_noise_slow=0.004,
        disturbance_noise=4.9,
        sensor_delay_s=0.012,
    )
    yaw: YawAxis = YawAxis(
        max_rate=0.8,
        max_acceleration=0.8,
        learning_rate=0.9,
        max_disturbance=6.0,
        position_noise=0.002,
        rate_noise=0.003,
        position_noise_slow=0.005,
        rate_noise_slow=0.002,
        disturbance_noise=0.5,
        sensor_delay_s=0.005,
    )
    network: Network = Network()
    supervisor: SupervisorLimits = SupervisorLimits()
    fence: FenceSection = FenceSection()
    telemetry: Telemetry = Telemetry()
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
    try:
        config = msgspec.convert(table, Config)
        _check_together(config)
        check_choices(config)
    except msgspec.ValidationError as error:
        said = validation.explained(table, str(error), Config)
        raise ConfigError(located(path, overrides, said)) from error
    except ConfigError as error:
        raise ConfigError(located(path, overrides, str(error))) from error
    return config, origins


def _layers(path: Path, overrides: Sequence[str]) -> list[tuple[str, dict[str, Any]]]:
    """Return the defaults, the vehicle's file, `path` and the overrides: each wins over those before."""
    file, chosen = validation.read(path), dict[str, Any]()
    for override in overrides:
        validation.override(chosen, override)
    layers = [(str(path), file), ("--set", chosen)]
    for source, table in layers:
        _follow(source, table)
    for table, folder in ((chosen, Path()), (file, path.parent)):
        vehicle = table.get("vehicle")
        if isinstance(vehicle, dict) and (preset := vehicle.pop("preset", None)) is not None:
            named = vehicle_file(path, preset, folder)
            layers[:0] = [(str(named), _vehicle_beside(file, path, named))]
            break
    if isinstance(file.get("vehicle"), dict):
        file["vehicle"].pop("preset", None)
    return [("default", msgspec.to_builtins(Config())), *layers]


def _follow(source: str, table: dict[str, Any]) -> None:
    """Put in place of keys and values of older versions what replaces them, with a warning."""
    for section, keys in table.items():
        for key, value in list(keys.items()) if isinstance(keys, dict) else []:
            name = f"{section}.{key}"
            if name in REPLACED:
                del keys[key]
                new, words = REPLACED[name]
                if new:
                    keys.setdefault(new, value)
            elif isinstance(value, bool | str) and value in FORMER_VALUES.get(name, ()):
                keys[key] = FORMER_VALUES[name][value]
                words = f"it is {keys[key]!r} now"
            else:
                continue
            LOG.warning("%s: %s = %r is of an older version: %s", source, name, value, words)


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
    known = msgspec.to_builtins(vehicle_of(Config()))
    keys = {
        (section, key)
        for section, keys in validation.read(path).items()
        for key in (keys if isinstance(keys, dict) else [None])
    }
    return ("vehicle", "frame") in keys and all(key in known.get(section, ()) for section, key in keys)


def load_vehicle(path: Path) -> VehicleFile:
    """Read and validate a vehicle's file; raises ConfigError naming file, key, value and range."""
    return _vehicle_of(path, validation.read(path))


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
    whole: dict[str, Any] = msgspec.to_builtins(vehicle_of(Config()))
    _lay(whole, table)
    try:
        return msgspec.convert(whole, VehicleFile)
    except msgspec.ValidationError as error:
        said = validation.explained(table, str(error), VehicleFile)
        raise ConfigError(located(path, (), said)) from error


def _vehicle_beside(table: dict[str, Any], path: Path, file: Path) -> dict[str, Any]:
    """Return the vehicle's file as a table; raise ConfigError for a key that stands in `table` too."""
    vehicle = validation.read(file)
    _vehicle_of(file, vehicle)
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
