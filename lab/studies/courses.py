"""The courses of `holdfast lab bench position`: places and paths in a current, in the full loop, with a DVL.

The P-PI (a PID with P = m (k_v k_p + k_i), I = m k_i k_p, D = m k_v) steers surge and sway with Holdfast's
estimator and allocation; ArduSub itself, with --firmware, holds a place in POSHOLD and follows a path in
GUIDED. An error is true − reference, at the same time, and includes that of the position estimate, as a DVL
drifts. POSHOLD is told no place: its reference is the mean of where it was, which favours it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from companion.config import Config, load_config
from companion.guidance.course import Course
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import Setpoint
from companion.telemetry.plan import Circle, Lemniscate, PathPlan
from lab.loop.dive import Dive, engaging, recorded, survey
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import ensemble, water
from lab.rivals import poshold
from lab.rivals.alt_hold import TICK_S
from lab.studies.competitors import COMPETITORS, DEFAULT, Competitor, tuned
from sim_bridge.fault_kinds import Fault
from sim_bridge.sim_config import SimConfig

DEPTH_M = 2.0
START_S, LASTS_S = 25.0, 60.0
"""Time from boot for arming and the way back from where the current carried it; then that of the course."""

SETTLES_S = 10.0
"""Time after a thruster died in which its drift does not count."""


@dataclass(frozen=True)
class CourseSpec:
    """A place held or a path followed for LASTS_S in a current; `dead` is a motor that dies at START_S."""

    title: str
    current_m_s: float
    plan: PathPlan | None = None
    turn_deg_s: float = 0.0
    rough: bool = False
    dead: int = 0

    def plant(self, base: SimConfig, seed: int) -> SimConfig:
        """Draw a Heavy of the bench's ensemble, with a DVL, in this course's water."""
        plant = water(
            ensemble(base, seed),
            depth_m=DEPTH_M,
            dvl=True,
            current_m_s=self.current_m_s,
            current_deg=0.0,
            turn_deg_s=self.turn_deg_s,
            waves_m=base.waves.height_m if self.rough else 0.0,
            tether_n=base.tether.sigma_n if self.rough else (0.0, 0.0, 0.0),
        )
        dies = Fault(kind="thruster", at_s=START_S, thruster=self.dead)
        return replace(plant, faults=(*plant.faults, dies)) if self.dead else plant


def _path(**keys: object) -> PathPlan:
    return PathPlan(laps=0, acceleration_mps2=0.2, **keys)  # type: ignore[arg-type]  # the keys of one shape


_EIGHT = _path(lemniscate=Lemniscate(length_m=4.0, width_m=2.0, depth_m=DEPTH_M), speed_mps=0.22)
_CIRCLE = _path(circle=Circle(radius_m=1.5, x_m=-1.5, depth_m=DEPTH_M), speed_mps=0.3)
COURSES = {
    "station": CourseSpec("place, 0.5 m/s turning by 180°, waves, tether", 0.5, turn_deg_s=3.0, rough=True),
    "lemniscate": CourseSpec("lemniscate 4 × 2 m in 60 s, 0.3 m/s", 0.3, _EIGHT),
    "circle": CourseSpec("circle of 1.5 m at 0.3 m/s, 0.3 m/s", 0.3, _CIRCLE),
    "thruster": CourseSpec("place, 0.3 m/s, motor 1 dies", 0.3, turn_deg_s=3.0, dead=1),
}
ROWS = {
    DEFAULT: COMPETITORS[DEFAULT],
    "ppi": COMPETITORS["ppi"],
    "poshold_stock": Competitor("ArduSub, stock", autopilot={}),
    "poshold": Competitor(
        "ArduSub, tuned",
        autopilot={
            **{"PSC_POSXY_P": 1.474, "PSC_VELXY_P": 0.7133, "PSC_VELXY_I": 2.185, "PSC_VELXY_FLTE": 3.555}
        },
    ),  # 60 evaluations on station and circle with the stand-in's POSHOLD of then: 348.8 to 175.9 mm
}


def sail(
    name: str,
    course: CourseSpec,
    base: SimConfig,
    seed: int,
    *,
    settings: Sequence[str] = (),
    lasts_s: float = LASTS_S,
    firmware: Path | None = None,
) -> Dive:
    """Dive a course: what steers is the companion's real engine, or the autopilot alone.

    The real `firmware` takes the place of our stand-in.
    """
    row, config, plant = ROWS[name], load_config(overrides=settings), course.plant(base, seed)
    if row.autopilot is None:
        found = row.overrides(config, tuned().get(name, {}), place=True)
        config = load_config(overrides=[*settings, *found])
        here = Setpoint((0.0, 0.0, DEPTH_M, 0.0))
        with engaging(config, plant, here, seed, firmware=firmware, surveyed=True) as loop:
            for _ in loop.run(START_S):
                pass
            if course.plan is not None:
                loop.engine.guide(build(course.plan, limits(config)))
            return recorded(list(loop.run(lasts_s)))
    plant = replace(plant, parameters=plant.parameters | dict(row.autopilot))
    path = None if course.plan is None else _timed(course.plan, config)
    with vehicle_of(plant, seed, firmware) as vehicle:
        survey(vehicle)
        truths = list(poshold.truths(vehicle, LinkDelay(), seed, START_S + lasts_s, path))
    dived = poshold.recorded(truths, plant, START_S, path)
    return dived.within(START_S, START_S + lasts_s + TICK_S)


def _timed(plan: PathPlan, config: Config) -> Callable[[float], Setpoint]:
    """Return where a path at its full pace is at a time from boot; it begins at START_S."""
    start, most = (0.0, 0.0, DEPTH_M, 0.0), limits(config)
    course = Course(most, plan.speed_mps, plan.acceleration_mps2, path=build(plan, most))
    course.begin(start)
    passed = [Setpoint(start)]

    def at(t_s: float) -> Setpoint:
        ticks = max(round((t_s - START_S) / TICK_S), 0)
        while len(passed) <= ticks:
            passed.append(course.step(1.0, TICK_S))
        return passed[ticks]

    return at
