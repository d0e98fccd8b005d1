"""`holdfast bench tank`, `reality`, `axes`, `light`: vehicles that are unlike the model, in the full loop.

| study   | vehicle                                                                                   |
|---------|-------------------------------------------------------------------------------------------|
| tank    | a real BlueROV2 Heavy as it was measured in a tank (config/sim-tank-heavy.toml)           |
| reality | drawn between the published models and that one, all four degrees of freedom held at once |
| axes    | a gain of its own on each axis, 1/3 to 3, other lags, and delays that no stamp shows      |
| light   | 0.4 of the inertia and thrusters without lag                                              |

Errors are true - reference, of the simulator's truth, from COUNTS_S on.
"""

import argparse
import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from msgspec.structs import replace
from rich.console import RenderableType

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, Z
from lab.loop.dive import survey
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep, Step
from lab.loop.scenarios import raised_cosine
from lab.options import add_bench
from lab.studies.courses import LINK, recorded
from lab.study import Row, Study, by, known, ruled
from lab.style import BLUE, ORANGE, SMALL, save
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant

TANK = DEFAULT_CONFIG.with_name("sim-tank-heavy.toml")
DEPTH_M = 2.0
COUNTS_S, ENDS_S = 25.0, 85.0
FIRST_SEED = 9001
TURNED_OVER_DEG = 90.0
HELD, GIVEN_UP, TURNED_OVER = "held", "given up", "turned over"
FIGURES = {
    "depth_sd_mm": "depth SD, mm",
    "place_rms_mm": "place RMS, mm",
    "believed_rms_mm": "place without the DVL's drift, mm",
    "heading_rms_deg": "heading RMS, °",
    "tilt_deg": "tilt, largest, °",
}


class RealDive(NamedTuple):
    """One dive: the companion's preset, the water, and how late the tank vehicle's motors start."""

    preset: str
    water: str
    start_s: float
    seed: int


@dataclass(frozen=True)
class Situation:
    """What is dived: the vehicle in its water, the link, and the setpoint over time."""

    plant: SimConfig
    link: LinkDelay = LINK
    target: Callable[[float], Setpoint] = lambda t_s: Setpoint((0.0, 0.0, DEPTH_M, 0.0))


def path(t_s: float) -> Setpoint:
    """Follow 0.25 (1 − cos 2πt/6) m below DEPTH_M; place and heading stay."""
    omega = 2.0 * math.pi / 6.0
    phase = omega * max(t_s - 12.0, 0.0)
    z_m, z_dot, z_ddot = raised_cosine(phase, 0.25, omega)
    ahead = (0.0, 0.0, z_ddot if phase else 0.0, 0.0)
    return Setpoint((0.0, 0.0, DEPTH_M + z_m, 0.0), (0.0, 0.0, z_dot, 0.0), ahead)


def water(
    base: SimConfig, *, dvl: bool, current_m_s: float = 0.0, direction_deg: float = 0.0,
    height_m: float = 0.0, period_s: float = 4.0, waves_deg: float = 0.0, tether_n: float = 0.0,
) -> SimConfig:  # fmt: skip
    """Return a vehicle in this water; the tether's pull on each axis is correlated over 0.7 s."""
    return replace(
        base,
        sensors=replace(base.sensors, dvl=dvl),
        current=replace(
            base.current, enabled=current_m_s > 0.0, speed_m_s=current_m_s, direction_deg=direction_deg
        ),
        waves=replace(
            base.waves,
            enabled=height_m > 0.0,
            height_m=height_m,
            period_s=period_s,
            direction_deg=waves_deg,
        ),
        tether=replace(base.tether, enabled=tether_n > 0.0, sigma_n=(tether_n,) * 3, tau_s=0.7),
        initial=replace(base.initial, eta=(0.0, 0.0, DEPTH_M, 0.0, 0.0, 0.0)),
    )


class Unlike(Study[RealDive]):
    """What the four studies share: the dive, how it is judged, the table, the picture."""

    seeds: ClassVar[int]
    waters: ClassVar[tuple[str, ...]]
    presets: ClassVar[tuple[str, ...]] = ("heavy",)
    starts_s: ClassVar[tuple[float, ...]] = (0.0,)
    parts: ClassVar[tuple[float, ...]] = (50.0, 90.0, 100.0)
    """Percentiles of the table."""
    goals: ClassVar[Mapping[tuple[str, str], Mapping[str, tuple[float, ...]]]]
    """By preset and water, of each figure the goal at each of `parts`; NaN where there is none."""

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, " ".join(cls.presets), " ".join(cls.waters))
        parser.set_defaults(seeds=cls.seeds)

    def __init__(self, arguments: argparse.Namespace) -> None:
        known(arguments.rows or (), self.presets, "row")
        known(arguments.scenarios or (), self.waters, "scenario")
        self._presets = arguments.rows or self.presets
        self._waters = arguments.scenarios or self.waters
        self._seeds: int = arguments.seeds
        self._settings: list[str] = arguments.set
        self._firmware: Path | None = arguments.firmware
        self._configs = {
            preset: load_config(overrides=[*self.overrides(preset), *self._settings])
            for preset in self._presets
        }

    @abstractmethod
    def situation(self, case: RealDive) -> Situation:
        """Draw what a case dives."""

    def overrides(self, preset: str) -> list[str]:
        """Return what sets the companion apart in this row."""
        return [f'vehicle.preset="{preset}"']

    def cases(self) -> Sequence[RealDive]:
        return [
            RealDive(preset, water, start_s, seed)
            for preset in self._presets
            for water in self._waters
            for start_s in self.starts_s
            for seed in range(FIRST_SEED, FIRST_SEED + self._seeds)
        ]

    def ticks(self, case: RealDive, lasts_s: float = ENDS_S) -> list[Step]:
        """Dive a case."""
        config = self._configs[case.preset]
        situation = self.situation(case)
        with vehicle_of(situation.plant, case.seed, self._firmware) as vehicle:
            survey(vehicle)
            engine = Engine(config, situation.target(0.0), arm=True)
            loop = Lockstep(vehicle, engine, situation.link, case.seed, config.loop.rate_hz)
            loop.requests = [Request.ENGAGE]
            return list(loop.run(lasts_s, situation.target))

    def dive(self, cases: Sequence[RealDive]) -> Iterator[Row]:
        for case in cases:
            steps = self.ticks(case)
            turned_over = math.degrees(float(recorded(steps).tilt.max())) > TURNED_OVER_DEG
            counted = recorded([step for step in steps if step.t_s >= COUNTS_S])
            depth_m = (counted.truth - counted.reference)[:, Z]
            figures = counted.figures() | {"depth_sd_mm": 1e3 * float(depth_m.std())}
            if not self.situation(case).plant.sensors.dvl:
                figures["place_rms_mm"] = figures["believed_rms_mm"] = math.nan
            outcome = TURNED_OVER if turned_over else HELD if counted.held else GIVEN_UP
            yield {key: figures[key] for key in FIGURES} | {"outcome": outcome}

    @property
    def _part_names(self) -> list[str]:
        return ["most" if part == 100.0 else f"{part:g} %" for part in self.parts]

    def tables(self, rows: Sequence[Row]) -> Iterable[RenderableType]:
        parts = self._part_names
        table = ruled(f"True errors from {COUNTS_S:g} s on", "", "", *parts, "goal", left=2)
        for (preset, name, start_s), some in by(rows, "preset", "water", "start_s").items():
            held = sum(row["outcome"] == HELD for row in some)
            over = sum(row["outcome"] == TURNED_OVER for row in some)
            group = f"{preset}, {name}" + (f", start {start_s:g} s" if start_s else "")
            group += f": {held} of {len(some)} held" + (f", {over} turned over" if over else "")
            for key, title in FIGURES.items():
                values = np.percentile([row[key] for row in some], self.parts)
                if np.isfinite(values).all():
                    goals = self.goals.get((preset, name), {}).get(key, ())
                    wanted = (
                        f"{goal:g} ({part})"
                        for goal, part in zip(goals, parts, strict=False)
                        if not math.isnan(goal)
                    )
                    table.add_row(group, title, *(f"{value:.1f}" for value in values), ", ".join(wanted))
                    group = ""
        yield table

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the table for docs/results.md: a row for each preset, water and start."""
        keys = _measured(rows, FIGURES)
        parts = "/".join(self._part_names).replace("50 %", "median")
        lines = []
        for (preset, name, start_s), some in by(rows, "preset", "water", "start_s").items():
            held = sum(row["outcome"] == HELD for row in some)
            line = [
                f"{preset}, {name}" + (f", start {start_s:g} s" if start_s else ""),
                f"{held} of {len(some)}",
            ]
            for key in keys:
                values = np.percentile([row[key] for row in some], self.parts)
                goals = self.goals.get((preset, name), {}).get(key, ())
                line.append("/".join(_or_dash(value, ".1f") for value in values))
                if goals:
                    line[-1] += f" (goal {'/'.join(_or_dash(goal, 'g') for goal in goals)})"
            lines.append(line)
        return {"columns": [parts, "held", *(FIGURES[key] for key in keys)], "rows": lines}

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a vehicle was given up or turned over."""
        return any(row["outcome"] != HELD for row in rows)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw each figure's distribution, a line for each preset, water and start."""
        keys = _measured(rows, ("depth_sd_mm", "place_rms_mm", "tilt_deg"))
        groups = [*by(rows, "preset", "water", "start_s").items()]
        figure, panels = plt.subplots(
            1, len(keys), figsize=(11.0, 1.4 + 0.35 * len(groups)), sharey=True, layout="constrained"
        )
        for panel, key in zip(panels, keys, strict=True):
            for y, ((preset, name, _), some) in enumerate(groups):
                lost = [row["outcome"] != HELD for row in some]
                values = np.array([row[key] for row in some])
                panel.plot(values, np.full(len(some), y), "o", color=BLUE, markersize=4, alpha=0.6)
                panel.plot(values[lost], np.full(sum(lost), y), "x", color=ORANGE, markersize=8)
                for goal in self.goals.get((preset, name), {}).get(key, ())[-1:]:
                    panel.plot([goal, goal], [y - 0.35, y + 0.35], color="0.3", linewidth=2)
            panel.set_xscale("log")
            panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
            panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.set_xlabel(FIGURES[key])
            panel.grid(axis="x", alpha=0.3)
        panels[0].set_yticks(
            range(len(groups)), [f"{p}, {w}, start {s:g} s" for (p, w, s), _ in groups], fontsize=SMALL
        )
        panels[0].invert_yaxis()
        figure.suptitle("each dot a dive; cross: given up or turned over; grey line: goal", fontsize=10)
        return [save(figure, folder / f"{self.command.split()[-1]}.png", dpi=130)]


def _measured(rows: Sequence[Row], keys: Iterable[str]) -> list[str]:
    """Return the keys of which any dive has a value."""
    return [key for key in keys if np.isfinite([row[key] for row in rows]).any()]


def _or_dash(value: float, how: str) -> str:
    return format(value, how) if math.isfinite(value) else "–"


NONE = math.nan


class Tank(Unlike):
    """The tank vehicle with the nominal preset, never identified, and with its own."""

    command = "bench tank"
    about = "Holds a real BlueROV2 Heavy as it was measured, without and with motors that start 0.16 s late."
    seeds = 10
    waters = ("calm", "waves", "path", "place")
    presets = ("heavy", "tank-heavy")
    starts_s = (0.0, 0.16)
    parts = (50.0, 100.0)
    goals: ClassVar = {
        (preset, name): {"depth_sd_mm": (NONE, depth_mm)}
        for preset in presets
        for name, depth_mm in (("calm", 4.5), ("waves", 4.5), ("path", 5.0))
    } | {
        ("heavy", "place"): {"place_rms_mm": (NONE, 40.0), "tilt_deg": (NONE, 10.0)},
        ("tank-heavy", "place"): {"place_rms_mm": (NONE, 25.0), "tilt_deg": (NONE, 8.0)},
    }

    def situation(self, case: RealDive) -> Situation:
        base = load_plant(TANK)
        base = replace(base, thrusters=replace(base.thrusters, start_s=case.start_s))
        draw = np.random.default_rng((case.seed, 31)).uniform
        height_m, period_s = draw(0.2, 0.4), draw(3.5, 5.0)
        if case.water == "place":
            return Situation(
                water(
                    base,
                    dvl=True,
                    current_m_s=0.3,
                    direction_deg=draw(0.0, 360.0),
                    height_m=height_m,
                    period_s=period_s,
                    waves_deg=draw(0.0, 360.0),
                    tether_n=2.0,
                )
            )
        rough = height_m if case.water == "waves" else 0.0
        here = water(base, dvl=False, height_m=rough, period_s=period_s)
        return Situation(here, target=path) if case.water == "path" else Situation(here)


def rough(seed: int) -> SimConfig:
    """Draw a vehicle between the published models and the tank's, in current, waves and a jerking tether."""
    base, draw = load_plant(DEFAULT_CONFIG), np.random.default_rng((seed, 32)).uniform
    hull, thrusters = base.hull, base.thrusters
    share = float(np.exp(draw(math.log(0.4), math.log(1.1))))
    damping = np.exp(draw(math.log(0.6), math.log(1.2), 6))
    drawn = replace(
        base,
        hull=replace(
            hull,
            added_mass=tuple(np.multiply(hull.added_mass, draw(0.7, 1.2, 6)).tolist()),
            linear_damping=tuple(
                np.multiply((8.0, 6.0, 19.0, 0.1, 0.8, 0.1), share * damping * draw(0.5, 2.0, 6)).tolist()
            ),
            quadratic_damping=tuple(
                np.multiply((95.0, 130.0, 113.0, 1.2, 0.5, 1.0), share * damping).tolist()
            ),
            net_buoyancy_n=draw(0.0, 4.0),
            coriolis_share=(draw(0.3, 1.0), draw(0.3, 1.0), draw(0.0, 1.0)),
        ),
        thrusters=replace(
            thrusters,
            gain=(share,),
            lag_s=draw(0.05, 0.2),
            start_s=draw(0.0, 0.25),
            horizontal_m=(*thrusters.horizontal_m[:2], draw(0.0, 0.1)),
        ),
    )
    return water(
        drawn,
        dvl=True,
        current_m_s=draw(0.05, 0.3),
        direction_deg=draw(0.0, 360.0),
        height_m=draw(0.1, 0.4),
        period_s=draw(3.5, 6.0),
        waves_deg=draw(0.0, 360.0),
        tether_n=draw(0.0, 6.0) * share,
    )


class Reality(Unlike):
    """Vehicles between the published models and the tank's, in current, waves and a jerking tether."""

    command = "bench reality"
    about = "Holds vehicles between the published models and a real one, in four degrees of freedom at once."
    seeds = 60
    waters = ("rough",)
    goals: ClassVar = {
        ("heavy", "rough"): {
            "depth_sd_mm": (NONE, 5.0, NONE),
            "place_rms_mm": (NONE, 40.0, NONE),
            "tilt_deg": (NONE, 12.0, NONE),
        }
    }

    def situation(self, case: RealDive) -> Situation:
        return Situation(rough(case.seed))


class Axes(Unlike):
    """Vehicles that answer differently on each axis."""

    command = "bench axes"
    about = "Holds vehicles with a gain of its own on each axis, other lags, and delays that no stamp shows."
    seeds = 40
    waters = ("quiet",)
    goals: ClassVar = {
        ("heavy", "quiet"): {"depth_sd_mm": (4.0, 6.0, 9.0), "heading_rms_deg": (0.1, 0.5, 1.5)}
    }

    def situation(self, case: RealDive) -> Situation:
        base, draw = load_plant(DEFAULT_CONFIG), np.random.default_rng((case.seed, 33)).uniform
        surge, sway, heave, yaw = (3.0 ** draw(-1.0, 1.0) for _ in range(4))
        hidden_s, half_s = draw(0.0, 0.04), 0.5 * draw(0.0, 0.15)
        sensors = base.sensors
        drawn = replace(
            base,
            thrusters=replace(
                base.thrusters, axis_gain=(surge, sway, heave, 1.0, 1.0, yaw), lag_s=draw(0.0, 0.3)
            ),
            sensors=replace(
                sensors,
                depth_delay_s=sensors.depth_delay_s + hidden_s,
                climb_delay_s=sensors.climb_delay_s + hidden_s,
                attitude_delay_s=sensors.attitude_delay_s + hidden_s,
            ),
        )
        return Situation(water(drawn, dvl=True), LinkDelay(up_s=0.001 + half_s, down_s=0.001 + half_s))


class Light(Unlike):
    """A vehicle with 0.4 of the inertia, and thrusters without lag."""

    command = "bench light"
    about = "Holds a light vehicle whose thrusters answer at once; its depth alone, in waves and on a path."
    seeds = 10
    waters = ("waves", "path")
    parts = (50.0, 100.0)
    goals: ClassVar = {("heavy", name): {"depth_sd_mm": (7.0, NONE)} for name in waters}

    def situation(self, case: RealDive) -> Situation:
        base, draw = load_plant(DEFAULT_CONFIG), np.random.default_rng((case.seed, 34)).uniform
        hull = base.hull
        drawn = replace(
            base,
            hull=replace(
                hull,
                mass_kg=0.4 * hull.mass_kg,
                inertia_kg_m2=tuple(0.4 * inertia for inertia in hull.inertia_kg_m2),
                added_mass=tuple(0.4 * added for added in hull.added_mass),
                centre_of_buoyancy_up_m=hull.centre_of_buoyancy_up_m / 0.4,
            ),
            thrusters=replace(base.thrusters, lag_s=0.0),
        )
        height_m = draw(0.2, 0.4) if case.water == "waves" else 0.0
        here = water(drawn, dvl=False, height_m=height_m, period_s=draw(3.5, 5.0))
        return Situation(here, target=path) if case.water == "path" else Situation(here)
