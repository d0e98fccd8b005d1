"""The dives of `holdfast demo --dvl`: a place in a current by ArduSub's POSHOLD and by Holdfast, and a path.

Both dives are in virtual time, with the same vehicle, sea and noise of a DVL. POSHOLD is our simulator's copy
of it, with its default gains and the sticks at rest.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config import load_config
from companion.engine import Engine
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import Request, Setpoint, State
from companion.telemetry.plan import Lemniscate, PathPlan
from lab.loop.dive import send_origin, tilt_rad
from lab.loop.lockstep import COMPANION_LINK, LinkDelay, Lockstep
from lab.rivals.alt_hold import TICK_S, GroundStation
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant
from sim_bridge.firmware.modes import POSHOLD
from sim_bridge.vehicle import Truth, Vehicle

Array = NDArray[np.float64]

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


@dataclass(frozen=True)
class PlaceDive:
    """A dive, a row for each tick: times in s since boot; x, y, z and heading in m and rad."""

    t_s: Array
    truth: Array
    reference: Array
    tilt: Array

    def within(self, begin_s: float, end_s: float) -> "PlaceDive":
        """Return the part between two times."""
        on = (self.t_s >= begin_s) & (self.t_s < end_s)
        return PlaceDive(self.t_s[on], self.truth[on], self.reference[on], self.tilt[on])

    @property
    def place_error_m(self) -> Array:
        """Return the horizontal distance from the reference."""
        north, east = (self.truth - self.reference)[:, :2].T
        return np.asarray(np.hypot(north, east))


class PlaceFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What the table and demo-dvl.json say: true errors."""

    place_rms_mm: float
    place_peak_mm: float
    depth_rms_mm: float
    heading_rms_deg: float
    tilt_deg: float
    """The largest."""


def figures(dive: PlaceDive) -> PlaceFigures:
    """Draw the figures of a part of a dive."""
    error = dive.truth - dive.reference
    heading = np.arctan2(np.sin(error[:, 3]), np.cos(error[:, 3]))
    return PlaceFigures(
        place_rms_mm=1e3 * _rms(dive.place_error_m),
        place_peak_mm=1e3 * float(dive.place_error_m.max()),
        depth_rms_mm=1e3 * _rms(error[:, 2]),
        heading_rms_deg=math.degrees(_rms(heading)),
        tilt_deg=math.degrees(float(dive.tilt.max())),
    )


# --- The dives --------------------------------------------------------------------------------------------


def sail(story: PlaceStory, tell: Callable[[float], None]) -> PlaceDive:
    """Hold the place 0, 0 with the companion's engine, then follow the path.

    Raises ValueError where the engine let go of the vehicle.
    """
    config, heading = load_config(), math.radians(story.heading_deg)
    engine = Engine(config, Setpoint((0.0, 0.0, story.depth_m, heading)), arm=True)
    loop = Lockstep(_surveyed(story), engine, LinkDelay(), story.seed, config.loop.rate_hz)
    loop.requests = [Request.ENGAGE]
    rows = []
    for lasts_s, plan in ((story.path_s, None), (story.end_s - story.path_s, story.plan)):
        if plan is not None:
            engine.guide(build(plan, limits(config)))
        for step in loop.run(lasts_s):
            rows.append((step.t_s, step.truth, step.sample.eta_d))
            tell(step.t_s)
            if step.t_s > story.counts_s and step.sample.verdict.state is not State.ACTIVE:
                raise ValueError(f"the controller let go of the vehicle: {step.sample.verdict.reason}")
    return _arranged([row[:2] for row in rows], [row[2] for row in rows])


def poshold_truths(story: PlaceStory, tell: Callable[[float], None]) -> Iterator[tuple[float, Truth]]:
    """Arm, let POSHOLD hold where it is, and rest the sticks; give time and truth of each tick."""
    vehicle, station = _surveyed(story), GroundStation(hold=POSHOLD)
    vehicle.open_link(COMPANION_LINK)
    for tick in range(round(story.path_s / TICK_S)):
        inbox = [(COMPANION_LINK, data) for data in station.step(tick, story.depth_m)]
        for _ in range(round(TICK_S / vehicle.step_s)):
            vehicle.step(inbox)
            inbox = []
        tell(vehicle.time_s)
        yield vehicle.time_s, vehicle.truth()


def rest(truths: list[tuple[float, Truth]], story: PlaceStory) -> PlaceDive:
    """Arrange a dive whose place, depth and heading are where it was on the mean while it counted.

    So a constant error is not held against POSHOLD, whose target nobody names.
    """
    dive = _arranged(truths, [(0.0, 0.0, story.depth_m, math.radians(story.heading_deg))] * len(truths))
    mean = dive.within(story.counts_s, story.path_s).truth.mean(axis=0)
    return PlaceDive(dive.t_s, dive.truth, np.tile(mean, (len(truths), 1)), dive.tilt)


def _surveyed(story: PlaceStory) -> Vehicle:
    """Return a vehicle that knows where on earth it is: POSHOLD asks for it."""
    vehicle = Vehicle(story.plant(), story.seed)
    send_origin(vehicle, COMPANION_LINK)
    return vehicle


def _arranged(truths: list[tuple[float, Truth]], reference: list[tuple[float, ...]]) -> PlaceDive:
    eta = np.array([truth.eta for _, truth in truths])
    return PlaceDive(
        t_s=np.array([t_s for t_s, _ in truths]),
        truth=eta[:, [0, 1, 2, 5]],
        reference=np.array(reference),
        tilt=tilt_rad(eta),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
