"""`holdfast bench position`: places held and paths followed in a current, in the full loop, with a DVL.

The PID steers surge and sway in Holdfast's place, between the same estimator and the same allocation; ArduSub
itself holds a place in POSHOLD and follows a path in GUIDED. All dive the same vehicles, seas and noise. An
error is true − reference, at the same time; that of the position estimate (a DVL drifts) is part of it and is
told beside it. POSHOLD is told no place: its reference is the mean of where it was, which favours it.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from msgspec.structs import replace
from numpy.typing import NDArray
from rich.table import Table

from companion.config import Config, load_config
from companion.control.bounds import wrap
from companion.engine import Engine
from companion.guidance import course as guidance_course
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import PSI, Array, Request, Setpoint, State, X, Y, Z
from companion.telemetry.plan import Circle, Lemniscate, PathPlan
from lab.loop.dive import TRUE_PSI, survey, tilt_rad
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep, Step, SteppedVehicle
from lab.loop.scenarios import ensemble
from lab.options import add_bench, seeds_of
from lab.rivals import poshold
from lab.rivals.alt_hold import TICK_S
from lab.studies.competitors import DEFAULT, FIRST_SEED, Competitor, tuned, values_of
from lab.study import Row, Study, by, known, ruled
from lab.style import BLACK, BLUE, GREEN, ORANGE, PRINTED, SMALL, VERMILLION, save
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant
from sim_bridge.fault_kinds import Fault
from sim_bridge.physics.thrusters import HEALTHY, each_motor, static_thrust, thrusters_of, wrench
from sim_bridge.vehicle import Truth

TUNED_FILE = Path(__file__).with_name("courses.toml")
DEPTH_M = 2.0
START_S, LASTS_S = 25.0, 60.0
"""From boot: arming, and back to the place from which the current carried it; then the course."""

SETTLES_S = 10.0
"""After a thruster died its drift is not counted for so long, as in `lab.studies.motor_failures`."""

LINK = LinkDelay()
FULL_US = 399.0
"""A motor whose PWM is so far from neutral gives all it has."""

FIGURES = {
    "place_rms_mm": ("place RMS\nmm", ".0f"),
    "place_peak_mm": ("peak, most\nmm", ".0f"),
    "believed_rms_mm": ("as believed\nmm", ".0f"),
    "depth_rms_mm": ("depth RMS\nmm", ".1f"),
    "heading_rms_deg": ("heading RMS\n°", ".2f"),
    "tilt_deg": ("tilt, most\n°", ".1f"),
    "saturated_percent": ("saturated\n%", ".0f"),
    "chatter_n": ("chatter\nN/tick", ".2f"),
}
"""RMS and peak of the horizontal error; RMS of the error that the estimate knows of; of depth and heading;
largest tilt; share of the time; RMS change of the horizontal thrust in a tick. Each with its column."""

LOOKS = {
    DEFAULT: (BLUE, "-"),
    "pid": (VERMILLION, "-."),
    "poshold": (GREEN, "--"),
    "poshold_stock": (ORANGE, ":"),
}
SEEN_EVERY = 5


@dataclass(frozen=True)
class Course:
    """A place held or a path followed for LASTS_S in a current; `dead` is a motor that dies at START_S."""

    name: str
    title: str
    current_m_s: float
    plan: PathPlan | None = None
    turn_deg_s: float = 0.0
    rough: bool = False
    dead: int = 0

    def plant(self, base: SimConfig, seed: int) -> SimConfig:
        """Draw a Heavy of the bench's ensemble, with a DVL, in this course's water."""
        drawn = ensemble(base, seed)
        water = replace(
            base.current,
            enabled=True,
            speed_m_s=self.current_m_s,
            direction_deg=0.0,
            turn_deg_s=self.turn_deg_s,
        )
        return replace(
            drawn,
            sensors=replace(drawn.sensors, dvl=True),
            current=water,
            waves=replace(drawn.waves, enabled=self.rough),
            tether=replace(drawn.tether, enabled=self.rough),
            initial=replace(drawn.initial, eta=(0.0, 0.0, DEPTH_M, 0.0, 0.0, 0.0)),
        )


def _path(**keys: object) -> PathPlan:
    return PathPlan(laps=0, acceleration_mps2=0.2, **keys)  # type: ignore[arg-type]  # the keys of one shape


_EIGHT = _path(lemniscate=Lemniscate(length_m=4.0, width_m=2.0, depth_m=DEPTH_M), speed_mps=0.22)
_CIRCLE = _path(circle=Circle(radius_m=1.5, x_m=-1.5, depth_m=DEPTH_M), speed_mps=0.3)
COURSES = (
    Course("station", "place, 0.5 m/s turning by 180°, waves, tether", 0.5, turn_deg_s=3.0, rough=True),
    Course("lemniscate", "lemniscate 4 × 2 m in 60 s, 0.3 m/s", 0.3, _EIGHT),
    Course("circle", "circle of 1.5 m at 0.3 m/s, 0.3 m/s", 0.3, _CIRCLE),
    Course("thruster", "place, 0.3 m/s, motor 1 dies", 0.3, turn_deg_s=3.0, dead=1),
)

_AUTOPILOT = {"PSC_POSXY_P": 1.0, "PSC_VELXY_P": 2.0, "PSC_VELXY_I": 1.0, "PSC_VELXY_FLTE": 5.0}
_PID = {"laws.ppi.k_p": 1.5, "laws.ppi.k_v": 4.0, "laws.ppi.k_i": 2.0}
_PID_AXIS = ("law='ppi'", "compensator='none'", "disturbance_noise=5.0")
_PID_STEERS = (
    "laws.ppi.module='lab.rivals.ppi'",
    *(f"{axis}.{key}" for axis in ("surge", "sway") for key in _PID_AXIS),
)
ROWS = (
    Competitor(DEFAULT, "Holdfast", "companion", {}),
    Competitor("pid", "PID", "companion", _PID, _PID_STEERS),
    Competitor("poshold_stock", "ArduSub, stock", "autopilot", {}),
    Competitor("poshold", "ArduSub, tuned", "autopilot", _AUTOPILOT),
)
"""A P-PI is a PID with P = m (k_v k_p + k_i), I = m k_i k_p, D = m k_v."""


@dataclass(frozen=True)
class Track:
    """What was recorded of a course, a row each tick: s since boot, m, rad, N."""

    t_s: Array
    reference: Array
    truth: Array
    believed: Array
    tilt: Array
    force: Array
    saturated: NDArray[np.bool_]
    held: bool

    def within(self, begin_s: float, end_s: float) -> "Track":
        """Return the part between two times."""
        on = (self.t_s >= begin_s) & (self.t_s < end_s)
        return Track(
            self.t_s[on],
            self.reference[on],
            self.truth[on],
            self.believed[on],
            self.tilt[on],
            self.force[on],
            self.saturated[on],
            self.held,
        )

    @property
    def place_error_m(self) -> Array:
        """Return the horizontal distance from the reference."""
        north, east = (self.truth - self.reference)[:, :2].T
        return np.asarray(np.hypot(north, east))

    def seen(self) -> dict[str, list[list[float]]]:
        """Return the way from above, [north, east] in m, of the vehicle and of the reference."""
        lines = {"true": self.truth, "reference": self.reference}
        return {name: line[::SEEN_EVERY, :2].round(3).tolist() for name, line in lines.items()}

    def figures(self, since: int = 0) -> dict[str, float]:
        """Return FIGURES from tick `since` on."""
        e, believed = (self.truth - self.reference)[since:], (self.believed - self.reference[:, :2])[since:]
        place = self.place_error_m[since:]
        heading = np.array([*map(wrap, e[:, PSI].tolist())])
        figures = (
            1e3 * _rms(place),
            1e3 * float(place.max()),
            1e3 * _rms(np.hypot(*believed.T)),
            1e3 * _rms(e[:, Z]),
            math.degrees(_rms(heading)),
            math.degrees(float(self.tilt[since:].max())),
            100.0 * float(self.saturated[since:].mean()),
            _rms(np.linalg.norm(np.diff(self.force[since:], axis=0), axis=1)),
        )
        return dict(zip(FIGURES, figures, strict=True))


def sail(
    row: Competitor,
    course: Course,
    values: Mapping[str, float],
    base: SimConfig,
    seed: int,
    *,
    settings: Sequence[str] = (),
    lasts_s: float = LASTS_S,
    link: LinkDelay = LINK,
    firmware: Path | None = None,
) -> Track:
    """Dive a course: what steers is the companion's real engine, or the autopilot alone.

    The real `firmware` takes the place of our stand-in.
    """
    config = load_config(overrides=[*settings, *row.overrides(values)])
    alone = row.steers == "autopilot"
    plant = course.plant(base, seed)
    plant = replace(plant, parameters=plant.parameters | (dict(values) if alone else {}))
    with vehicle_of(plant, seed, firmware) as vehicle:
        if course.dead:
            vehicle.inject(Fault(kind="thruster", at_s=START_S, thruster=course.dead))
        survey(vehicle)
        if alone:
            return _by_autopilot(vehicle, course, config, plant, seed, lasts_s, link)
        return _by_companion(vehicle, course, config, seed, lasts_s, link)


def _by_companion(
    vehicle: SteppedVehicle, course: Course, config: Config, seed: int, lasts_s: float, link: LinkDelay
) -> Track:
    engine = Engine(config, Setpoint((0.0, 0.0, DEPTH_M, 0.0)), arm=True)
    loop = Lockstep(vehicle, engine, link, seed, config.loop.rate_hz)
    loop.requests = [Request.ENGAGE]
    for _ in loop.run(START_S):
        pass
    if course.plan is not None:
        engine.guide(build(course.plan, limits(config)))
    return recorded(list(loop.run(lasts_s)))


def _by_autopilot(
    vehicle: SteppedVehicle,
    course: Course,
    config: Config,
    plant: SimConfig,
    seed: int,
    lasts_s: float,
    link: LinkDelay,
) -> Track:
    path = None if course.plan is None else _timed(course.plan, config)
    found = list(poshold.truths(vehicle, link, seed, START_S + lasts_s, path))
    return by_autopilot(found, plant, START_S, path).within(START_S, math.inf)


def by_autopilot(
    found: Sequence[Truth], plant: SimConfig, since_s: float, path: Callable[[float], Setpoint] | None = None
) -> Track:
    """Make a track of the truths of an autopilot's dive.

    Its reference without a path is where it was on the mean from `since_s` on: nobody named POSHOLD's place.
    """
    eta = np.array([truth.eta for truth in found])
    t_s, truth = np.array([moment.t_s for moment in found]), eta[:, [X, Y, Z, TRUE_PSI]]
    if path is None:
        reference = np.tile(truth[t_s >= since_s].mean(0), (len(truth), 1))
    else:
        reference = np.array([path(moment.t_s).eta_d for moment in found])
    nominal = thrusters_of(plant.thrusters)
    pushes = [
        static_thrust(nominal, HEALTHY, each_motor(moment.motor_pwm), moment.voltage_v) for moment in found
    ]
    pwm = np.array([moment.motor_pwm for moment in found])
    counted = [moment for moment in found if moment.t_s >= since_s]
    return Track(
        t_s,
        reference,
        truth,
        np.full((len(truth), 2), math.nan),
        tilt_rad(eta),
        np.array([wrench(nominal, push)[:2] for push in pushes]),
        np.abs(pwm - 1500.0).max(1) > FULL_US,
        held=all(moment.armed and moment.mode == counted[0].mode for moment in counted),
    )


def _timed(plan: PathPlan, config: Config) -> Callable[[float], Setpoint]:
    """Return where a path at its full pace is at a time from boot; it begins at START_S."""
    start = (0.0, 0.0, DEPTH_M, 0.0)
    course = guidance_course.Course(
        limits(config), plan.speed_mps, plan.acceleration_mps2, path=build(plan, limits(config))
    )
    course.begin(start)
    passed = [Setpoint(start)]

    def at(t_s: float) -> Setpoint:
        ticks = max(round((t_s - START_S) / TICK_S), 0)
        while len(passed) <= ticks:
            passed.append(course.step(1.0, TICK_S))
        return passed[ticks]

    return at


def recorded(steps: Sequence[Step]) -> Track:
    """Make a track of its ticks."""
    eta = np.array([step.truth.eta for step in steps])
    return Track(
        t_s=np.array([step.t_s for step in steps]),
        reference=np.array([step.sample.eta_d for step in steps]),
        truth=eta[:, [X, Y, Z, TRUE_PSI]],
        believed=np.array([step.sample.state.eta[:2] for step in steps]),
        tilt=tilt_rad(eta),
        force=np.array([step.sample.delivered.tau[:2] for step in steps]),
        saturated=np.array([any(step.sample.dofs.saturated) for step in steps]),
        held=all(step.sample.verdict.state is State.ACTIVE for step in steps),
    )


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x * x)))


class CourseDive(NamedTuple):
    """One dive of one competitor."""

    row: str
    course: str
    seed: int


class Courses(Study[CourseDive]):
    """Every course with every competitor and vehicle."""

    command = "bench position"
    about = (
        "Holds a place and follows paths in a current, with a DVL, beside a PID and ArduSub's POSHOLD and "
        "GUIDED. "
        "Exit status 1 if the supervisor gave up a dive."
    )

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, "default pid", "station, lemniscate, circle, thruster")

    def __init__(self, arguments: argparse.Namespace) -> None:
        load_config(overrides=arguments.set)
        self._rows = {row.name: row for row in ROWS if not arguments.rows or row.name in arguments.rows}
        self._courses = {
            kind.name: kind for kind in COURSES if not arguments.scenarios or kind.name in arguments.scenarios
        }
        known(arguments.rows or (), [row.name for row in ROWS], "row")
        known(arguments.scenarios or (), [course.name for course in COURSES], "scenario")
        self._seeds = seeds_of(arguments)
        self._settings: list[str] = arguments.set
        self._firmware: Path | None = arguments.firmware
        self._base, self._tuned = load_plant(DEFAULT_CONFIG), tuned(TUNED_FILE)

    def cases(self) -> Sequence[CourseDive]:
        seeds = range(FIRST_SEED, FIRST_SEED + self._seeds)
        return [
            CourseDive(row, course, seed) for course, row, seed in product(self._courses, self._rows, seeds)
        ]

    def dive(self, cases: Sequence[CourseDive]) -> Iterator[Row]:
        """Dive courses; the first vehicle's way serves the picture."""
        for case in cases:
            row, course = self._rows[case.row], self._courses[case.course]
            values = values_of(row, self._tuned)
            track = sail(
                row, course, values, self._base, case.seed, settings=self._settings, firmware=self._firmware
            )
            since = round(SETTLES_S / TICK_S) if course.dead else 0
            trace = {"trace": track.seen()} if case.seed == FIRST_SEED else {}
            yield {"held": track.held} | track.figures(since) | trace

    def tables(self, rows: Sequence[Row]) -> Iterable[Table]:
        for (name,), dives in by(rows, "course").items():
            title = f"{self._courses[name].title}; {self._seeds} vehicles"
            table = ruled(title, "", *(column for column, _ in FIGURES.values()), padding=0)
            for (row,), mine in by(dives, "row").items():
                lost = sum(not dive["held"] for dive in mine)
                cells = []
                for key, (_, form) in FIGURES.items():
                    values = [dive[key] for dive in mine]
                    most = key in ("tilt_deg", "place_peak_mm")
                    cells.append(f"{max(values) if most else np.mean(values):{form}}")
                table.add_row(self._rows[row].title + (f" ({lost} lost)" if lost else ""), *cells)
            yield table

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the table for docs/results.md: the mean RMS of the place."""
        lines = [
            [self._rows[row].title]
            + [
                f"{np.mean([dive['place_rms_mm'] for dive in dives]):.0f}"
                + "†" * sum(not dive["held"] for dive in dives)
                for dives in by(mine, "course").values()
            ]
            for (row,), mine in by(rows, "row").items()
        ]
        return {"columns": ["place RMS, mm", *self._courses], "rows": lines}

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether the supervisor gave up a dive."""
        return not all(row["held"] for row in rows)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw the first vehicle of every course from above."""
        courses = by([row for row in rows if "trace" in row], "course")
        with mpl.rc_context(PRINTED):
            figure, panels = plt.subplots(1, len(courses), figsize=(3.3 * len(courses), 3.6), squeeze=False)
            for panel, ((name,), shown) in zip(panels[0], courses.items(), strict=True):
                for row in shown:
                    north, east = np.transpose(row["trace"]["true"])
                    colour, line = LOOKS[row["row"]]
                    title = self._rows[row["row"]].title
                    panel.plot(east, north, color=colour, linestyle=line, linewidth=1.0, label=title)
                north, east = np.transpose(shown[0]["trace"]["reference"])
                still = np.ptp(north) + np.ptp(east) < 0.1
                look: dict[str, Any] = {"linestyle": "none", "marker": "+"} if still else {"linestyle": ":"}
                until = 1 if still else len(east)
                panel.plot(east[:until], north[:until], color=BLACK, markersize=12, label="reference", **look)
                panel.set_aspect("equal", adjustable="datalim")
                panel.set_xlabel("east (m)")
                panel.set_title(self._courses[name].title.replace(", ", ",\n", 1), fontsize=SMALL)
            panels[0][0].set_ylabel("north (m)")
            handles, labels = panels[0][0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=False)
            return [save(figure, folder / "position.png")]
