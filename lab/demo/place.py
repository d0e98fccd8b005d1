"""The dives of `holdfast demo --dvl`: a place in a current by ArduSub's POSHOLD and by Holdfast, and a path.

Both dives are in virtual time, with the same vehicle, sea and noise of a DVL. POSHOLD is our simulator's copy
of it, with its default gains and the sticks at rest.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from companion.config import load_config
from companion.engine import Engine
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import Request, Setpoint, State
from companion.telemetry.plan import Lemniscate, PathPlan
from lab.loop.dive import survey
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.rivals import poshold
from lab.studies.courses import Track, by_autopilot, recorded
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

NAMES = {"poshold": "POSHOLD", "place": "Holdfast, place", "path": "Holdfast, path"}
ROWS = (
    ("place error, RMS", "mm", "place_rms_mm", 0),
    ("place error, largest", "mm", "place_peak_mm", 0),
    ("depth error, RMS", "mm", "depth_rms_mm", 1),
    ("heading error, RMS", "°", "heading_rms_deg", 2),
    ("tilt, largest", "°", "tilt_deg", 1),
)


@dataclass(frozen=True)
class PlaceStory:
    """What the vehicle is in for; times in s since boot. The same seed gives the same sea."""

    seed: int = 1
    depth_m: float = 3.0
    heading_deg: float = 30.0
    current_m_s: float = 0.35
    turn_deg_s: float = 2.0
    wave_height_m: float = 0.3
    wave_period_s: float = 5.0
    counts_s: float = 35.0
    """The place counts from here: POSHOLD takes half a minute to come to rest in a current."""
    path_s: float = 80.0
    end_s: float = 126.0

    @property
    def plan(self) -> PathPlan:
        """A lemniscate, once in the time that is left."""
        eight = Lemniscate(length_m=3.0, width_m=1.5, depth_m=self.depth_m, direction_deg=90.0)
        return PathPlan(lemniscate=eight, laps=1, speed_mps=0.3, acceleration_mps2=0.2)

    @property
    def sea(self) -> str:
        """In words."""
        return (
            f"{self.current_m_s:g} m/s of current that turns by {self.turn_deg_s:g}° a second, "
            f"{self.wave_height_m:g} m waves of {self.wave_period_s:g} s"
        )

    def plant(self) -> SimConfig:
        """Return the vehicle in this water."""
        heading = math.radians(self.heading_deg)
        settings: dict[str, object] = {
            "initial.eta": [0.0, 0.0, self.depth_m, 0.0, 0.0, heading],
            "sensors.dvl": "true",
            "current.speed_m_s": self.current_m_s,
            "current.direction_deg": 0.0,
            "current.turn_deg_s": self.turn_deg_s,
            "waves.enabled": "true",
            "waves.height_m": self.wave_height_m,
            "waves.period_s": self.wave_period_s,
        }
        return load_plant(DEFAULT_CONFIG, [f"{key}={value}" for key, value in settings.items()])

    def current_m_s_at(self, t_s: float) -> tuple[float, float]:
        """Return the mean current, north and east."""
        turned = math.radians(self.turn_deg_s * t_s)
        return self.current_m_s * math.cos(turned), self.current_m_s * math.sin(turned)


class PlaceFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What the table and demo-dvl.json say: true errors."""

    place_rms_mm: float
    place_peak_mm: float
    depth_rms_mm: float
    heading_rms_deg: float
    tilt_deg: float
    """The largest."""


def figures(part: Track) -> PlaceFigures:
    """Draw the figures of a part of a dive."""
    return msgspec.convert(part.figures(), PlaceFigures)


def sail(story: PlaceStory, tell: Callable[[float], None]) -> Track:
    """Hold the place 0, 0 with the companion's engine, then follow the path.

    Raises ValueError where the engine let go of the vehicle.
    """
    config, heading = load_config(), math.radians(story.heading_deg)
    engine = Engine(config, Setpoint((0.0, 0.0, story.depth_m, heading)), arm=True)
    loop = Lockstep(_surveyed(story), engine, LinkDelay(), story.seed, config.loop.rate_hz)
    loop.requests = [Request.ENGAGE]
    steps = []
    for lasts_s, plan in ((story.path_s, None), (story.end_s - story.path_s, story.plan)):
        if plan is not None:
            engine.guide(build(plan, limits(config)))
        for step in loop.run(lasts_s):
            steps.append(step)
            tell(step.t_s)
            if step.t_s > story.counts_s and step.sample.verdict.state is not State.ACTIVE:
                raise ValueError(f"the controller let go of the vehicle: {step.sample.verdict.reason}")
    return recorded(steps)


def rest(story: PlaceStory, tell: Callable[[float], None]) -> Track:
    """Arm, let POSHOLD hold where it is, and rest the sticks."""
    found = []
    for truth in poshold.truths(_surveyed(story), LinkDelay(), story.seed, story.path_s, None):
        found.append(truth)
        tell(truth.t_s)
    return by_autopilot(found, story.plant(), story.counts_s)


def _surveyed(story: PlaceStory) -> Vehicle:
    """Return a vehicle that knows where on earth it is: POSHOLD asks for it."""
    vehicle = Vehicle(story.plant(), story.seed)
    survey(vehicle)
    return vehicle
