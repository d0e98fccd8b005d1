"""TOML into frozen, validated records. Unknown keys are refused; errors name file, key, value and range."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from holdfast import validation
from holdfast.command_line import located
from holdfast.validation import ConfigError as ConfigError
from sim_bridge.fault_kinds import Fault

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Slope = Annotated[float, Meta(ge=-1, le=1)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
Vector3 = tuple[float, float, float]
Positive3 = tuple[Positive, Positive, Positive]
NonNegative3 = tuple[NonNegative, NonNegative, NonNegative]
NonNegative6 = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
Vector6 = tuple[float, float, float, float, float, float]


class _Record(Struct, frozen=True, forbid_unknown_fields=True):
    pass


class Hull(_Record, frozen=True):
    """The rigid body in water. Six-vectors are in the order surge, sway, heave, roll, pitch, yaw.

    Defaults: a BlueROV2 Heavy, von Benzon et al., J. Mar. Sci. Eng. 2022, 10, 1898.
    """

    mass_kg: Positive = 13.5
    inertia_kg_m2: Positive3 = (0.26, 0.23, 0.37)
    added_mass: NonNegative6 = (6.36, 7.12, 18.68, 0.189, 0.135, 0.222)
    """kg and kg·m²"""
    linear_damping: NonNegative6 = (13.7, 0.0, 33.0, 0.0, 0.8, 0.0)
    """N·s/m and N·m·s/rad"""
    quadratic_damping: NonNegative6 = (141.0, 217.0, 190.0, 1.19, 0.47, 1.5)
    """N·s²/m² and N·m·s²/rad²"""
    net_buoyancy_n: float = 2.3
    """Buoyancy minus weight: positive floats."""
    centre_of_buoyancy_up_m: float = 0.01
    """Height of the centre of buoyancy over the centre of gravity."""
    coriolis_share: tuple[Fraction, Fraction, Fraction] = (1.0, 1.0, 1.0)
    """How much there is of what r v does to surge, r u to sway and u v to yaw (the Munk moment)."""
    height_m: Positive = 0.25
    """Above the surface, buoyancy is lost over this height."""


class ThrusterConfig(_Record, frozen=True):
    """Where the thrusters sit and how they answer. Distances are magnitudes; signs follow from the frame."""

    frame: Literal["vectored", "vectored_6dof"] = "vectored_6dof"
    horizontal_m: NonNegative3 = (0.156, 0.111, 0.085)
    vertical_m: NonNegative3 = (0.12, 0.218, 0.0)
    curve: Literal["t200", "quadratic"] = "t200"
    """Thrust over PWM: as measured of a T200, or u|u| with the same full thrust ahead in both directions."""
    lag_s: NonNegative = 0.15
    start_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """A motor at rest, or one that must reverse, gives thrust so much later."""
    delay_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Delay from the autopilot's output to the motor; no message shows it."""
    dead_band_us: Annotated[float, Meta(ge=0, le=50)] = 28.0
    gain: Annotated[tuple[NonNegative, ...], Meta(min_length=1, max_length=8)] = (1.0,)
    """Thrust relative to that curve: one for all, or one for each thruster."""
    axis_gain: NonNegative6 = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    """What of the thrusters' force along and moment about each body axis acts: a hull that shades its
    thrusters, or levers other than believed."""
    free_speed_m_s: NonNegative = 0.0
    """Inflow at which a thruster that is driven in full pushes no more; 0: inflow takes nothing from them."""
    dry_height_m: NonNegative = 0.0
    """Height above the surface over which they lose their water; 0: they never do."""

    def __post_init__(self) -> None:
        count = 8 if self.frame == "vectored_6dof" else 6
        if len(self.gain) not in (1, count):
            raise ValueError(f"gain needs 1 or {count} values for frame {self.frame}")


class BatteryConfig(_Record, frozen=True):
    """An ideal source behind a resistance."""

    voltage_v: Annotated[float, Meta(ge=8, le=26)] = 16.0
    resistance_ohm: Annotated[float, Meta(ge=0, le=0.2)] = 0.0
    capacity_ah: Positive = 18.0


class Initial(_Record, frozen=True):
    """State at boot."""

    eta: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """x, y, z (m, NED), phi, theta, psi (rad)"""


class CurrentConfig(_Record, frozen=True):
    """A horizontal current: constant, plus a slow Ornstein-Uhlenbeck variation of each component."""

    enabled: bool = False
    speed_m_s: Annotated[float, Meta(ge=0, le=3)] = 0.1
    direction_deg: float = 30.0
    """Where the water flows to, from north, clockwise."""
    turn_deg_s: Annotated[float, Meta(ge=-10, le=10)] = 0.0
    """How fast that direction turns, clockwise: a tide turns by 0.008 °/s."""
    profile: tuple[tuple[NonNegative, float], ...] = ()
    """Rows of depth (m) and the part of speed_m_s that flows there; straight between rows. Empty: 1."""
    sigma_m_s: Annotated[float, Meta(ge=0, le=1)] = 0.02
    tau_s: Positive = 30.0

    def __post_init__(self) -> None:
        depths = [depth for depth, _ in self.profile]
        if depths != sorted(set(depths)):
            raise ValueError("profile needs depths that rise from row to row")


class Waves(_Record, frozen=True):
    """Long-crested waves, over deep water unless there is a seabed."""

    enabled: bool = False
    spectrum: Literal["jonswap", "regular"] = "jonswap"
    """Irregular, or one wave of this height and period."""
    height_m: Annotated[float, Meta(ge=0, le=5)] = 0.3
    """Significant height Hs; of the regular wave from trough to crest."""
    period_s: Annotated[float, Meta(ge=1, le=20)] = 4.0
    """Peak period Tp."""
    direction_deg: float = 0.0
    gamma: Annotated[float, Meta(ge=1, le=10)] = 3.3
    components: Annotated[int, Meta(ge=1, le=200)] = 30


class Seabed(_Record, frozen=True):
    """The bottom: waves feel it, and the hull rests on it (spring, damper, friction; no moment)."""

    enabled: bool = False
    depth_m: Positive = 20.0
    """Depth where north and east are 0; the waves have this depth everywhere."""
    slope: tuple[Slope, Slope] = (0.0, 0.0)
    """Fall for each metre north, and east."""
    stiffness_n_per_m: Annotated[float, Meta(ge=0, le=20000)] = 2000.0
    damping_n_s_per_m: Annotated[float, Meta(ge=0, le=1000)] = 200.0
    friction: Annotated[float, Meta(ge=0, le=2)] = 0.5
    """Coulomb's coefficient."""

    def depth_at(self, north_m: float, east_m: float) -> float:
        """Return how deep the bottom lies at a place (m)."""
        return self.depth_m + self.slope[0] * north_m + self.slope[1] * east_m


class Tether(_Record, frozen=True):
    """A random pull in NED, and a constant one."""

    enabled: bool = False
    sigma_n: NonNegative3 = (0.0, 0.0, 2.0)
    tau_s: Positive = 2.0
    pull_n: Vector3 = (0.0, 0.0, 0.0)


class Cable(_Record, frozen=True):
    """The tether as a cable: its weight and drag pull at the vehicle. It adds to what `tether` does."""

    enabled: bool = False
    length_m: Annotated[float, Meta(ge=1)] = 30.0
    """Paid out."""
    anchor_m: Vector3 = (0.0, 0.0, 0.0)
    """Where the surface boat holds it: north, east, down."""
    diameter_m: Annotated[float, Meta(ge=0.001, le=0.1)] = 0.0076
    mass_kg_per_m: Positive = 0.043
    weight_n_per_m: float = -0.03
    """Weight in this water; negative floats."""
    drag_across: NonNegative = 1.2
    drag_along: NonNegative = 0.01
    segments: Annotated[int, Meta(ge=2, le=50)] = 8


class Load(_Record, frozen=True):
    """A weight (in water) hung on and dropped; times count from the first arming."""

    enabled: bool = False
    weight_n: float = 12.0
    on_s: NonNegative = 20.0
    off_s: NonNegative = 40.0


class Defects(_Record, frozen=True):
    """What an instrument adds to its reading, in the reading's unit; nothing unless set."""

    walk_per_sqrt_s: NonNegative = 0.0
    """A bias that walks: its standard deviation after one second. It has no bound."""
    step: NonNegative = 0.0
    """Readings come in multiples of this."""
    jitter_s: Annotated[float, Meta(ge=0, le=0.1)] = 0.0
    """Each reading is older than its delay by up to so much."""
    outage_every_s: NonNegative = 0.0
    """Mean time from the end of an outage to the next one; 0 for none."""
    outage_s: Annotated[float, Meta(ge=0.02)] = 1.0
    """Mean length of an outage."""


class DvlReports(_Record, frozen=True):
    """Single reports of a DVL, as one was recorded (`physics.dvl`): some late, some invalid."""

    enabled: bool = False
    invalid_passed: Fraction = 0.0
    """Share of invalid reports that somebody passes on as valid. The BlueOS extension drops all."""
    unaided_m_s: NonNegative = 0.005
    """As `SensorConfig.unaided_m_s`, between reports. Assumed: five times the white noise of an ICM-20602."""


class Usbl(_Record, frozen=True):
    """Acoustic fixes of the position, which the EKF blends in."""

    enabled: bool = False
    period_s: Annotated[float, Meta(ge=0.1)] = 2.0
    sigma_m: NonNegative = 0.5
    missed: Fraction = 0.1
    """Part of the fixes that never arrive."""


class Steel(_Record, frozen=True):
    """A steel structure that turns the compass: a magnetic dipole (field in µT at 1 m, falling with r³)."""

    enabled: bool = False
    place_m: Vector3 = (3.0, 0.0, 5.0)
    """North, east, down."""
    moment_ut_m3: Vector3 = (0.0, 100.0, 0.0)


class SensorConfig(_Record, frozen=True):
    """What the firmware's EKF reports: of each signal its delay and the standard deviations of its noises."""

    depth_scale: Annotated[float, Meta(ge=0.9, le=1.1)] = 1.0
    """Water density over 1000 kg/m³: 1.025 makes BARO_SPEC_GRAV = 1 read 2.5 % deep."""
    depth_delay_s: Annotated[float, Meta(ge=0, le=0.5)] = 0.003
    depth_slow_m: NonNegative = 0.003
    depth_white_m: NonNegative = 0.0005
    climb_delay_s: Annotated[float, Meta(ge=0, le=0.5)] = 0.003
    climb_slow_m_s: NonNegative = 0.004
    climb_white_m_s: NonNegative = 0.0008
    barometer_late_s: Annotated[float, Meta(ge=0, le=0.5)] = 0.016
    """By how much the pressure is older than the EKF allows for; it draws depth and climb rate with it."""
    slow_tau_s: Positive = 0.8
    drift_m: NonNegative = 0.001
    drift_tau_s: Positive = 60.0
    offset_m: NonNegative = 0.0
    """Spread of the constant offsets between depth fields; that of relative_alt moves on arming."""
    attitude_delay_s: Annotated[float, Meta(ge=0, le=0.5)] = 0.01
    attitude_slow_rad: NonNegative = 0.002
    attitude_white_rad: NonNegative = 0.0003
    gyro_white_rad_s: NonNegative = 0.002
    pressure_white_m: NonNegative = 0.003
    barometer_without_home: bool = False
    """As in ArduSub 4.5, relative_alt is the pressure's until there is a home; here the origin brings it."""
    wave_pressure: bool = False
    """Whether the depth sensor feels the pressure of the waves themselves."""
    dvl: bool = False
    """A position source: LOCAL_POSITION_NED exists and position modes are accepted."""
    dvl_delay_s: Annotated[float, Meta(ge=0, le=0.5)] = 0.03
    """Delay of LOCAL_POSITION_NED's place and velocity."""
    dvl_by_mavlink: bool = False
    """A position source that speaks VISION_POSITION_DELTA, as a DVL's BlueOS extension does."""
    dvl_knows_north: bool = False
    """The position source has its own north, as GPS has; a DVL is turned by the heading."""
    dvl_drift_m: NonNegative = 0.02
    dvl_white_m: NonNegative = 0.003
    dvl_min_altitude_m: NonNegative = 0.0
    dvl_max_altitude_m: Positive = 1e6
    """Over a seabed, a DVL measures within these altitudes only."""
    unaided_m_s: NonNegative = 0.02
    """Growth of the velocity's error while the DVL is out: standard deviation after one second."""
    depth_defects: Defects = Defects()
    """m. While it is out, depth and climb keep their last values."""
    attitude_defects: Defects = Defects()
    """rad; the bias is the heading's. While it is out, angles and rates keep their last values."""
    dvl_defects: Defects = Defects()
    """The walk is that of the position (m), the step that of the velocity (m/s)."""
    dvl_reports: DvlReports = DvlReports()
    usbl: Usbl = Usbl()
    rangefinder: bool = False
    """A sonar that looks down, as a Ping or a DVL has it: DISTANCE_SENSOR and RANGEFINDER, over a seabed."""
    range_delay_s: Annotated[float, Meta(ge=0, le=2)] = 0.0
    """Age of a range when it is told, in whole periods: a Ping behind BlueOS has up to 0.8 s."""

    @property
    def positioned(self) -> bool:
        """Whether there is a position source."""
        return self.dvl or self.dvl_by_mavlink or self.usbl.enabled


class SimConfig(_Record, frozen=True):
    """Everything about a simulated vehicle except its seed."""

    hull: Hull = Hull()
    thrusters: ThrusterConfig = ThrusterConfig()
    battery: BatteryConfig = BatteryConfig()
    initial: Initial = Initial()
    current: CurrentConfig = CurrentConfig()
    waves: Waves = Waves()
    seabed: Seabed = Seabed()
    steel: Steel = Steel()
    tether: Tether = Tether()
    cable: Cable = Cable()
    load: Load = Load()
    sensors: SensorConfig = SensorConfig()
    rc_receiver: bool = False
    """An RC receiver on the vehicle: the pilot failsafe never fires, overrides end after RC_OVERRIDE_TIME."""
    signing_passphrase: str = ""
    """Every link signs with its SHA-256 and refuses who does not; empty for none."""
    parameters: dict[str, float] = {}
    """Values of autopilot parameters that differ from the firmware's defaults."""
    faults: tuple[Fault, ...] = ()


def load_config(path: Path | str, overrides: Sequence[str] = ()) -> SimConfig:
    """Read a TOML file, then apply overrides such as `waves.enabled=true` (the value is TOML).

    Raises ConfigError naming the file, the key, its value and what is allowed.
    """
    path = Path(path)
    data = validation.read(path)
    for override in overrides:
        validation.override(data, override)
    try:
        _refuse_non_finite(data, "")
        return msgspec.convert(data, SimConfig)
    except msgspec.ValidationError as error:
        said = validation.explained(data, str(error), SimConfig)
        raise ConfigError(located(path, overrides, said)) from error
    except ConfigError as error:
        raise ConfigError(located(path, overrides, str(error))) from error


def fault_of(text: str) -> Fault:
    """Read a fault as the command line has it: `leak`, or `thruster,thruster=3,value=0.2,at_s=20`.

    Raises ConfigError naming what is wrong.
    """
    kind, *parts = (part.strip() for part in text.split(","))
    data: dict[str, Any] = {"kind": kind}
    for part in parts:
        if "=" not in part:
            raise ConfigError(f"fault '{text}': expected KIND,key=value,... at '{part}'")
        validation.override(data, part)
    try:
        return msgspec.convert(data, Fault)
    except msgspec.ValidationError as error:
        raise ConfigError(f"fault '{text}': {error}") from error


def _refuse_non_finite(value: object, key: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{key} = {value}: must be a finite number")
    if isinstance(value, dict):
        for name, item in value.items():
            _refuse_non_finite(item, f"{key}.{name}" if key else name)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _refuse_non_finite(item, f"{key}[{index}]")
