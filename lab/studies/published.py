"""`holdfast bench published`: what others publish of a BlueROV2, and Holdfast in a port of their scenario.

| scene    | whence: facts and figures, no code                                                     |
|----------|----------------------------------------------------------------------------------------|
| path     | V. Mendes, vitorsmends/bluerov2_gym, 2026: figures at commit cde4d2e, path at a1f540d, |
|          | vehicle at 0eace85                                                                     |
| station  | the same: figures at commit 4e9967b, targets at 4058265, vehicle and storm at 6400446  |
| circle,  | HKPolyU-UAV/bluerov2, commit 371f35d (2025); its paper: J. Mar. Sci. Eng. 2024, 12, 94 |
| eight    |                                                                                        |
| swell    | K. L. Walker, kyleliamwalker/dswp_mpc, commit fba9da5 (2025); Walker, Jordan and       |
|          | Giorgio-Serchi, Int. J. Robotics Research 2024, doi 10.1177/02783649241286909          |
| thruster | J. González-García et al., Sensors 2022, 22, 4347: a real BlueROV2                     |

Of the papers, abstracts and captions could be read, not the tables; each scene says what is assumed. Mass,
damping, buoyancy, thrust, reference, disturbance and metric are theirs. The rest is ours: equations (theirs
differ in couplings), ArduSub's behaviour, MAVLink and its delays. Depth begins at 2 m, not at the surface.

Holdfast is the shipped configuration with the preset of the frame. Of the rows, `sensors` has the noise of
our simulator and a DVL that drifts; `no noise` has neither, as their simulations; `true model` also believes
the true mass and damping, as their predictive controllers do.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from msgspec.structs import asdict, replace
from rich.table import Table

from companion.config import load_config
from companion.control.bounds import wrap
from companion.engine import Engine
from companion.records import PSI, Array, Request, Setpoint, Vector, Z
from lab.loop.dive import survey
from lab.loop.lockstep import LinkDelay, Lockstep, Step
from lab.options import add_out, add_settings, positive
from lab.studies.courses import Track, recorded
from lab.studies.own_vehicle import nominal
from lab.study import Row, Study, by, known, ruled
from lab.style import BLACK, BLUE, GREEN, ORANGE, PRINTED, save
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import Hull, SensorConfig, SimConfig, Waves
from sim_bridge.config import load_config as load_plant
from sim_bridge.physics.body import STEP_S
from sim_bridge.physics.environment import Environment
from sim_bridge.physics.plant import Six as Flow
from sim_bridge.physics.plant import State, euler
from sim_bridge.physics.plant import Three as Force
from sim_bridge.physics.thrusters import CURVE_N, FULL_N
from sim_bridge.vehicle import Vehicle

START_S = 25.0
"""From boot: arming and settling; then reference and disturbance begin."""
DEPTH_M = 2.0
"""Of the references that begin at the surface."""
FIRST_SEED = 9001
SIX = DEFAULT_CONFIG.with_name("sim-bluerov2.toml")

SENSORS, NO_NOISE, TRUE_MODEL = "sensors", "no noise", "true model"
ROWS = {SENSORS: BLUE, NO_NOISE: ORANGE, TRUE_MODEL: GREEN}
"""Each with its colour."""

RMS, LATE, DEPTH = "rms_mm", "late_mm", "depth_rms_mm"
METRICS = {RMS: "3-D RMS", LATE: "3-D mean, last half", DEPTH: "depth RMS"}

Outside = Callable[[float, State], tuple[Force, tuple[float, float]]]
"""Of the time since START_S and the state: a force (N, NED) and the water's velocity north and east (m/s)."""
STILL: tuple[float, float] = (0.0, 0.0)
NO_FORCE: Force = (0.0, 0.0, 0.0)


def harmonic(size_m: float, rate_rad_s: float, phase_rad: float, t_s: float) -> tuple[float, float, float]:
    """Return size · sin(rate t + phase) and its first two derivatives."""
    sine, cosine = math.sin(rate_rad_s * t_s + phase_rad), math.cos(rate_rad_s * t_s + phase_rad)
    return size_m * sine, size_m * rate_rad_s * cosine, -size_m * rate_rad_s**2 * sine


def gym_path(t_s: float) -> Setpoint:
    """Follow sin 0.15 t, ½ sin 0.3 t, 0.5 m down in 10 s, the heading along the track."""
    x, u, du = harmonic(1.0, 0.15, 0.0, t_s)
    y, v, dv = harmonic(0.5, 0.3, 0.0, t_s)
    z, w = (0.05 * t_s, 0.05) if t_s < 10.0 else (0.5, 0.0)
    turn = (u * dv - v * du) / (u * u + v * v)
    return Setpoint((x, y, DEPTH_M + z, math.atan2(v, u)), (u, v, w, turn), (du, dv, 0.0, 0.0))


def gym_target(t_s: float) -> Setpoint:
    """Jump to the sixth of their six targets, the farthest."""
    return Setpoint((0.5, 0.5, DEPTH_M + 0.7, 0.0))


def circle(t_s: float) -> Setpoint:
    """Drive a circle of 2 m at 1.5 m/s, the heading along it."""
    rate = 0.75
    x, y = harmonic(2.0, rate, -0.5 * math.pi, t_s), harmonic(2.0, rate, math.pi, t_s)
    heading = rate * t_s - 0.5 * math.pi
    return Setpoint((x[0], y[0], DEPTH_M, heading), (x[1], y[1], 0.0, rate), (x[2], y[2], 0.0, 0.0))


def eight(t_s: float) -> Setpoint:
    """Drive 2 cos ½ t, sin t, the heading north."""
    x, y = harmonic(2.0, 0.5, 0.5 * math.pi, t_s), harmonic(1.0, 1.0, 0.0, t_s)
    return Setpoint((x[0], y[0], DEPTH_M, 0.0), (x[1], y[1], 0.0, 0.0), (x[2], y[2], 0.0, 0.0))


class GymSea(NamedTuple):
    """Their sea state; `follow` and `noise_follow` are the steps of their two first-order filters."""

    height_m: float
    period_s: float
    gamma: float
    factor: float
    cut_m_s: float
    follow: float
    noise_m_s: float
    noise_follow: float


GYM_STEP_S, GYM_WAVES, GYM_SEED = 0.1, 64, 42


def gym_current(sea: GymSea, lasts_s: float) -> Array:
    """Return the water's velocity (m/s, surge and sway of the vehicle: it turns with it), a row each 0.1 s.

    The sum of 64 waves along the diagonal is cut, has noise added and passes a first-order filter.
    """
    random = np.random.default_rng(GYM_SEED)
    peak = 2.0 * math.pi / sea.period_s
    step = 3.0 * peak / GYM_WAVES
    omega = step * np.arange(1, GYM_WAVES + 1)
    width = np.where(omega <= peak, 0.07, 0.09) * peak
    sharpened = sea.gamma ** np.exp(-((omega - peak) ** 2) / (2.0 * width**2))
    density = 0.076 * (sea.height_m * 9.81) ** 2 * omega**-5 * np.exp(-1.25 * (peak / omega) ** 4) * sharpened
    speed, phase = np.sqrt(2.0 * density * step) * omega, random.uniform(0.0, 2.0 * math.pi, GYM_WAVES)
    water, noise, rows = np.zeros(2), np.zeros(2), []
    for k in range(1, round(lasts_s / GYM_STEP_S) + 1):
        along = sea.factor * float((speed * np.cos(omega * k * GYM_STEP_S + phase)).sum())
        wave = math.sqrt(0.5) * min(max(along, -sea.cut_m_s), sea.cut_m_s)
        noise += sea.noise_follow * (sea.noise_m_s * random.standard_normal(3)[:2] - noise)
        water = water + sea.follow * (wave + noise - water)
        rows.append(water)
    return np.array(rows)


def gym_water(sea: GymSea, lasts_s: float) -> Outside:
    """Let the water move as theirs does."""
    rows = gym_current(sea, lasts_s).tolist()

    def outside(t_s: float, state: State) -> tuple[Force, tuple[float, float]]:
        surge, sway = rows[min(int(t_s / GYM_STEP_S), len(rows) - 1)]
        psi = euler(state)[2]
        cosine, sine = math.cos(psi), math.sin(psi)
        return NO_FORCE, (surge * cosine - sway * sine, surge * sine + sway * cosine)

    return outside


def periodic(t_s: float, state: State) -> tuple[Force, tuple[float, float]]:
    """Push with 3 to 6 N · sin 2.5 t on each axis, drawn anew each half period (their moment is left out)."""
    half = int(2.5 * t_s / math.pi)
    x, y, z = (math.sin(2.5 * t_s) * np.random.default_rng((half, 36)).uniform(3.0, 6.0, 3)).tolist()
    return (x, y, z), STILL


def constant(t_s: float, state: State) -> tuple[Force, tuple[float, float]]:
    """Push with 10 N on each axis."""
    return (10.0, 10.0, 10.0), STILL


SATURATION_N = -2.0 * CURVE_N[0]
"""Of the two vertical thrusters, upwards, at 16 V."""
EXTRA_LAG_S = 0.15


def extra_thruster(part: float, period_s: float = 0.0) -> Outside:
    """Push down with a part of SATURATION_N: on from 5 to 35 s with a thruster's lag, or as a sine."""

    def outside(t_s: float, state: State) -> tuple[Force, tuple[float, float]]:
        if period_s:
            on = math.sin(2.0 * math.pi * t_s / period_s)
        else:
            on = math.exp(-max(t_s - 35.0, 0.0) / EXTRA_LAG_S) - math.exp(-max(t_s - 5.0, 0.0) / EXTRA_LAG_S)
        return (0.0, 0.0, part * SATURATION_N * on), STILL

    return outside


class Pushed(Environment):
    """The simulator's environment and, from START_S on, what `outside` adds."""

    def __init__(self, plant: SimConfig, seed: int, outside: Outside) -> None:
        super().__init__(plant, STEP_S, np.random.default_rng(seed).spawn(1)[0])
        self._outside = outside

    def step(self, t_s: float, since_arming_s: float, state: State) -> tuple[Force, Flow]:
        """Force and flow for one step (`Environment.step`)."""
        force, flow = super().step(t_s, since_arming_s, state)
        if t_s < START_S:
            return force, flow
        (x, y, z), (north, east) = self._outside(t_s - START_S, state)
        return (force[0] + x, force[1] + y, force[2] + z), (flow[0] + north, flow[1] + east, *flow[2:])


@dataclass(frozen=True)
class Scene:
    """A scenario of theirs; reference, disturbance and `counts_s` are over the time since START_S."""

    name: str
    title: str
    plant: SimConfig
    preset: str
    lasts_s: float
    metric: str
    theirs: Mapping[str, float]
    """By method, mm; empty where no figure could be had."""
    compared: str
    """The row that knows as much as theirs does."""
    about: str
    """What is comparable, and what is not."""
    target: Callable[[float], Setpoint] | None = None
    """None: it stays where it rests."""
    rests: Vector = (0.0, 0.0, DEPTH_M, 0.0)
    """Where it waits for START_S."""
    outside: Outside | None = None
    counts_s: float = 0.0

    def aim(self, t_s: float) -> Setpoint:
        """Return the reference at a time from boot."""
        if self.target is None or t_s < START_S:
            return Setpoint(self.rests)
        return self.target(t_s - START_S)

    def figures(self, track: Track) -> dict[str, float]:
        """Return METRICS against their reference, and what tells why."""
        reference = np.array([self.aim(t_s).eta_d for t_s in track.t_s.tolist()])
        error = track.truth - reference
        error_mm, since_s = 1e3 * error[:, : Z + 1], START_S + self.counts_s
        on, late = track.t_s >= since_s, track.t_s >= START_S + 0.5 * self.lasts_s
        distance = np.linalg.norm(error_mm, axis=1)
        believed = track.believed - track.truth[:, :2]
        return {
            RMS: _rms(distance[on]),
            LATE: float(distance[late].mean()),
            DEPTH: _rms(error_mm[on, Z]),
            "peak_mm": float(distance[on].max()),
            "drift_mm": 1e3 * _rms(np.hypot(*believed[on].T)),
            "heading_rms_deg": math.degrees(_rms(np.array([*map(wrap, error[on, PSI].tolist())]))),
            "tilt_deg": math.degrees(float(track.tilt[on].max())),
            "saturated_percent": 100.0 * float(track.saturated[on].mean()),
        }


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x * x)))


GYM = Hull(
    mass_kg=15.22,
    inertia_kg_m2=(5.2539, 7.942, 6.9123),
    added_mass=(5.5, 12.7, 14.57, 0.12, 0.12, 0.12),
    linear_damping=(25.15, 7.364, 17.955, 10.888, 20.761, 3.744),
    quadratic_damping=(33.8, 54.26875, 73.37135, 40.0, 40.0, 40.0),
    net_buoyancy_n=4.52,
    centre_of_buoyancy_up_m=0.087,
)
GYM_BEFORE = Hull(
    mass_kg=11.5,
    inertia_kg_m2=(0.16, 0.16, 0.16),
    added_mass=(5.5, 12.7, 14.57, 0.12, 0.12, 0.12),
    linear_damping=(4.03, 6.22, 5.18, 0.07, 0.07, 0.07),
    quadratic_damping=(18.18, 21.66, 36.99, 1.55, 1.55, 1.55),
    net_buoyancy_n=-1.51,
    centre_of_buoyancy_up_m=0.01,
    coriolis_share=(0.0, 0.0, 0.0),
)
HONG_KONG = Hull(
    mass_kg=11.2,
    inertia_kg_m2=(0.304, 0.626, 0.577),
    added_mass=(1.7182, 0.0, 5.468, 0.0, 1.2481, 0.4006),
    linear_damping=(11.7391, 20.0, 31.8678, 25.0, 44.9085, 5.0),
    quadratic_damping=(0.0,) * 6,
    net_buoyancy_n=1.6,
    centre_of_buoyancy_up_m=0.3872,
)
EDINBURGH = Hull(
    mass_kg=11.5,
    inertia_kg_m2=(0.207, 0.253, 0.377),
    added_mass=(10.565, 7.12, 18.68, 0.189, 0.65, 0.222),
    linear_damping=(13.7, 0.0, 33.0, 0.0, 0.8, 0.0),
    quadratic_damping=(141.0, 217.0, 190.0, 1.19, 0.47, 1.5),
    net_buoyancy_n=0.0,
    centre_of_buoyancy_up_m=0.028,
)


def _rebuilt(base: SimConfig, hull: Hull, **thrusters: Any) -> SimConfig:
    return replace(base, hull=hull, thrusters=replace(base.thrusters, **thrusters))


@cache
def scenes() -> dict[str, Scene]:
    """Return every scene by name."""
    six, heavy = (
        replace(plant, current=replace(plant.current, enabled=False))
        for plant in (load_plant(SIX), load_plant(DEFAULT_CONFIG))
    )
    levers = {"horizontal_m": (0.1355, 0.1, 0.0725), "vertical_m": (0.0, 0.1105, 0.0)}
    hong_kong = _rebuilt(six, HONG_KONG, lag_s=0.2, **levers)
    edinburgh = _rebuilt(heavy, EDINBURGH, gain=(35.0 / FULL_N,), lag_s=0.1, horizontal_m=(0.113, 0.113, 0.0))
    found = [
        Scene(
            name="path",
            title="gym, path of 100 s",
            plant=_rebuilt(six, GYM, gain=(40.0 / FULL_N,), lag_s=0.0, **levers),
            preset="bluerov2",
            lasts_s=100.0,
            metric=RMS,
            theirs={"NMPC": 16.8, "PPO": 56.4, "SMC": 275.2, "PID": 734.1},
            compared=TRUE_MODEL,
            about="comparable; their NMPC knows the vehicle and the state, and acts without delay",
            target=gym_path,
            outside=gym_water(GymSea(2.0, 12.0, 3.3, 0.5, 0.7, 0.02, 0.01, 0.3), 100.0),
        ),
        Scene(
            name="station",
            title="gym, jump of 0.99 m in a storm",
            plant=_rebuilt(heavy, GYM_BEFORE, lag_s=0.0),
            preset="heavy",
            lasts_s=40.0,
            metric=LATE,
            theirs={"PPO": 70.9, "MPC": 76.6, "PID": 175.3},
            compared=NO_NOISE,
            about="in part; assumed: the storm, late is the last half, eight thrusters give their wrench",
            target=gym_target,
            outside=gym_water(GymSea(5.5, 11.0, 4.5, 2.0, 1.2, 0.03, 0.05, 0.5), 40.0),
        ),
        Scene(
            name="circle",
            title="HKPolyU, circle at 1.5 m/s, 10 N",
            plant=hong_kong,
            preset="bluerov2",
            lasts_s=60.0,
            metric=RMS,
            theirs={},
            compared=TRUE_MODEL,
            about="no figure could be had; from 30 s on, when horizontal thrust is no more limited",
            target=circle,
            rests=circle(0.0).eta_d,
            outside=constant,
            counts_s=30.0,
        ),
        Scene(
            name="eight",
            title="HKPolyU, eight, 3 to 6 N periodic",
            plant=hong_kong,
            preset="bluerov2",
            lasts_s=60.0,
            metric=RMS,
            theirs={},
            compared=TRUE_MODEL,
            about="no figure could be had; from 30 s on; their periodic moment is left out",
            target=eight,
            rests=eight(0.0).eta_d,
            outside=periodic,
            counts_s=30.0,
        ),
        Scene(
            name="swell",
            title="Walker, 5 m deep, Hs 2.78 m, Tp 7.1 s",
            plant=replace(edinburgh, waves=Waves(enabled=True, height_m=2.78, period_s=7.1)),
            preset="heavy",
            lasts_s=100.0,
            metric=RMS,
            theirs={},
            compared=TRUE_MODEL,
            about="no figure could be had; JONSWAP of their height and period; their MPC previews the waves",
            rests=(0.0, 0.0, 5.0, 0.0),
        ),
    ]
    for part, period_s, how in (
        (0.3, 0.0, "30 % for 30 s"),
        (0.6, 0.0, "60 % for 30 s"),
        (0.9, 0.0, "90 % for 30 s"),
        (0.9, 10.0, "90 %, sine of 10 s"),
    ):
        found.append(
            Scene(
                name=f"thruster-{100 * part:.0f}{'-sine' * bool(period_s)}",
                title=f"González-García, {how}",
                plant=six,
                preset="bluerov2",
                lasts_s=60.0,
                metric=DEPTH,
                theirs={"least": 10.0, "most": 40.0},
                compared=SENSORS,
                about="in part; a real vehicle, whose weight and lag we assume, and when the force acts",
                outside=extra_thruster(part, period_s),
            )
        )
    return {scene.name: scene for scene in found}


SLOW = ("_slow_m", "_slow_m_s", "_slow_rad")


def sensed(scene: Scene, row: str) -> SensorConfig:
    """Return the sensors of a row: a DVL where a place counts; without any error unless they are ours."""
    sensors = replace(scene.plant.sensors, dvl=scene.metric != DEPTH)
    if row == SENSORS:
        return sensors
    exact = {key: 0.0 for key in asdict(sensors) if "_white_" in key or key.endswith(("drift_m", *SLOW))}
    return replace(sensors, **exact)


def believable(plant: SimConfig) -> SimConfig:
    """Return the vehicle with T200s that moves as this one: weak thrust is believed to be weight."""
    hull, gain = plant.hull, plant.thrusters.gain[0]
    return replace(
        plant,
        hull=replace(
            hull,
            mass_kg=hull.mass_kg / gain,
            **{
                key: tuple(value / gain for value in getattr(hull, key))
                for key in ("inertia_kg_m2", "added_mass", "linear_damping", "quadratic_damping")
            },
        ),
    )


class PublishedDive(NamedTuple):
    """One dive."""

    scene: str
    row: str
    seed: int


class Published(Study[PublishedDive]):
    """Every scene with each row."""

    command = "bench published"
    about = "Dives the scenarios of published figures of a BlueROV2, and sets Holdfast's figure beside each."
    recipe = ("set",)

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--seeds", type=positive, default=2, metavar="N", help="dives of each; default 2")
        parser.add_argument("--rows", nargs="+", metavar="ROW", help=f"only these of: {', '.join(ROWS)}")
        parser.add_argument(
            "--scenarios", nargs="+", metavar="NAME", help=f"only these: {' '.join(scenes())}"
        )
        add_settings(parser)
        add_out(parser, "out/bench")

    def __init__(self, arguments: argparse.Namespace) -> None:
        load_config(overrides=arguments.set)
        known(arguments.rows or (), ROWS, "row")
        known(arguments.scenarios or (), scenes(), "scenario")
        self._rows = arguments.rows or [*ROWS]
        self._names = arguments.scenarios or [*scenes()]
        self._seeds: int = arguments.seeds
        self._settings: list[str] = arguments.set

    def cases(self) -> Sequence[PublishedDive]:
        return [
            PublishedDive(name, row, seed)
            for name in self._names
            for row in self._rows
            for seed in range(FIRST_SEED, FIRST_SEED + self._seeds)
        ]

    def ticks(self, case: PublishedDive, lasts_s: float) -> list[Step]:
        """Dive a case until so long after START_S."""
        scene = scenes()[case.scene]
        x, y, z, psi = scene.rests
        plant = replace(
            scene.plant,
            sensors=sensed(scene, case.row),
            initial=replace(scene.plant.initial, eta=(x, y, z, 0.0, 0.0, psi)),
        )
        believed = nominal(believable(plant)) | {"vehicle.coriolis_share": plant.hull.coriolis_share[2]}
        overrides = [f"{key}={value!r}" for key, value in believed.items()] * (case.row == TRUE_MODEL)
        config = load_config(overrides=[f'vehicle.preset="{scene.preset}"', *overrides, *self._settings])
        vehicle = Vehicle(plant, case.seed)
        if scene.outside is not None:
            vehicle.physics.environment = Pushed(plant, case.seed, scene.outside)
        survey(vehicle)
        engine = Engine(config, scene.aim(0.0), arm=True)
        loop = Lockstep(vehicle, engine, LinkDelay(), case.seed, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        return list(loop.run(START_S + lasts_s, scene.aim))

    def dive(self, cases: Sequence[PublishedDive]) -> Iterator[Row]:
        for case in cases:
            scene = scenes()[case.scene]
            steps = [step for step in self.ticks(case, scene.lasts_s) if step.t_s >= START_S]
            accused = any(step.sample.state.dead_motor for step in steps)
            track = recorded(steps)
            yield scene.figures(track) | {"accused": accused, "held": track.held}

    def tables(self, rows: Sequence[Row]) -> Iterable[Table]:
        title = (
            "mm, mean of the dives; ours / theirs: with the star; †: the supervisor handed over to ALT_HOLD; "
            "‡: a healthy motor was taken for a dead one"
        )
        table = ruled(title, "", "theirs", "metric", *ROWS, "ours / theirs", left=3, padding=0)
        for (name,), some in by(rows, "scene").items():
            scene = scenes()[name]
            cells = [cell + "*" * (row == scene.compared) for row, cell in _cells(some).items()]
            table.add_row(scene.title, _figures(scene), METRICS[scene.metric], *cells, _ratios(scene, some))
        yield table

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the table for docs/results.md: a row for each scene; the compared figure is bold."""
        lines = []
        for (name,), some in by(rows, "scene").items():
            scene = scenes()[name]
            cells = [f"**{cell}**" if row == scene.compared else cell for row, cell in _cells(some).items()]
            lines.append(
                [
                    f"{scene.title}; {METRICS[scene.metric]}",
                    _figures(scene),
                    *cells,
                    _ratios(scene, some),
                ]
            )
        comparable = {scenes()[name].title: scenes()[name].about for name in self._names}
        columns = ["scenario, mm", "theirs", *ROWS, "ours / theirs"]
        return {"columns": columns, "rows": lines, "comparable": comparable}

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether the supervisor gave up a dive."""
        return not all(row["held"] for row in rows)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw theirs beside ours: a line for each scene, each of our dives a dot."""
        groups = [(scenes()[name], some) for (name,), some in by(rows, "scene").items()]
        with mpl.rc_context(PRINTED):
            figure, panel = plt.subplots(figsize=(8.0, 1.2 + 0.45 * len(groups)))
            for y, (scene, some) in enumerate(groups):
                for i, (method, theirs_mm) in enumerate(scene.theirs.items()):
                    at = (0, 6 + 9 * (i % 2))
                    panel.plot(theirs_mm, y, "D", color=BLACK, markerfacecolor="none", zorder=3)
                    panel.annotate(method, (theirs_mm, y), at, textcoords="offset points", ha="center")
                for i, (row, colour) in enumerate(ROWS.items()):
                    values = [dive[scene.metric] for dive in some if dive["row"] == row]
                    panel.plot(values, [y + 0.12 * i] * len(values), "o", color=colour, markersize=5)
            marks = [("D", "theirs", BLACK), *(("o", f"Holdfast, {row}", ROWS[row]) for row in ROWS)]
            for mark, label, colour in marks:
                face = "none" if mark == "D" else colour
                panel.plot([], [], mark, color=colour, markerfacecolor=face, label=label)
            panel.set_xscale("log")
            panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.set_xlabel("error, mm")
            panel.set_yticks(range(len(groups)), [f"{s.title}\n{METRICS[s.metric]}" for s, _ in groups])
            panel.set_ylim(len(groups) - 0.4, -0.7)
            figure.legend(loc="outside lower center", ncols=len(marks), frameon=False)
            return [save(figure, folder / "published.png")]


def _cells(rows: Sequence[Row]) -> dict[str, str]:
    """Return the mean of a scene's metric for each row, marked if a motor was accused or a dive given up."""
    metric, cells = scenes()[rows[0]["scene"]].metric, dict.fromkeys(ROWS, "–")
    for (row,), some in by(rows, "row").items():
        mark = " †" * (not all(dive["held"] for dive in some)) + " ‡" * any(dive["accused"] for dive in some)
        mean_mm = float(np.mean([dive[metric] for dive in some]))
        cells[row] = f"{mean_mm:.{3 if mean_mm < 1000.0 else 4}g}{mark}"
    return cells


def _figures(scene: Scene) -> str:
    return ", ".join(f"{method} {theirs_mm:g}" for method, theirs_mm in scene.theirs.items()) or "–"


def _ratios(scene: Scene, rows: Sequence[Row]) -> str:
    ours = [row[scene.metric] for row in rows if row["row"] == scene.compared]
    if not ours:
        return "–"
    return ", ".join(f"{np.mean(ours) / theirs_mm:.2f}" for theirs_mm in scene.theirs.values()) or "–"
