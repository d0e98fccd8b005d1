"""`holdfast lab campaign --corners`: whether vehicles of a third and three times the nominal gain oscillate.

The corners of gain of all axes, thruster lag, delay, hidden delay and water, in the full loop. `limit_cycles`
says what oscillates.
"""

import argparse
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from rich.console import RenderableType

from companion.config import Config
from companion.config import load_config as load_companion
from companion.records import Setpoint, State
from lab.loop.dive import engaging, recorded
from lab.loop.lockstep import LinkDelay, Step
from lab.loop.scenarios import water
from lab.studies.competitors import FIRST_SEED
from lab.studies.limit_cycles import PLACES, TICK_S, WINDOW_S, found
from lab.studies.reality import later
from lab.study import Row, Study, ruled
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig, load_config

GAINS, LAGS_S, DELAYS_MS, HIDDEN_MS = (1 / 3, 3.0), (0.0, 0.3), (0, 150), (0, 40)
WATERS = ("calm", "waves")
SETTLED_S, DURATION_S, ENGAGED_WITHIN_S = 60.0, 90.0, 10.0
"""From engaging on: errors are measured, and the dive ends; it engages so soon."""

DEPTH_M, START_M = 2.5, 0.5
LONGEST_S = 3.0
"""A limit cycle that lasts longer has not been ended."""


class Cell(NamedTuple):
    """One vehicle and one link; the gain is that of all axes, or of heave alone."""

    gain: float
    lag_s: float
    delay_ms: float
    hidden_ms: float
    water: str
    heave_alone: bool = False


def corners() -> list[Cell]:
    """Return the corners of the grid, in both waters."""
    return [Cell(*each) for each in product(GAINS, LAGS_S, DELAYS_MS, HIDDEN_MS, WATERS)]


def plant(base: SimConfig, cell: Cell, seed: int) -> SimConfig:
    """Return the vehicle of a cell: `base` with other thrusters, later sensors and its water."""
    draw, rough, rest = np.random.default_rng((seed, 2)).uniform, cell.water == "waves", cell.gain
    if cell.heave_alone:
        rest = 1.0
    thrusters = replace(base.thrusters, axis_gain=(rest, rest, cell.gain, rest, rest, rest), lag_s=cell.lag_s)
    return water(
        later(replace(base, thrusters=thrusters), 1e-3 * cell.hidden_ms),
        depth_m=START_M,
        dvl=True,
        current_m_s=base.current.speed_m_s if rough else 0.0,
        waves_m=draw(0.2, 0.4) if rough else 0.0,
        period_s=draw(3.5, 5.0) if rough else None,
        waves_deg=draw(0.0, 360.0) if rough else None,
    )


def dive(cell: Cell, config: Config, base: SimConfig, seed: int, duration_s: float = DURATION_S) -> Row:
    """Dive one cell: down to DEPTH_M, and hold there.

    `gave_up` says why the supervisor ended it, `held` that it did not and no limit cycle lasted; of each of
    PLACES there is the longest limit cycle (s), and the RMS of the depth from SETTLED_S on.
    """
    half_s, target = 0.5e-3 * cell.delay_ms, Setpoint((0.0, 0.0, DEPTH_M, 0.0))
    link = LinkDelay(up_s=0.001 + half_s, down_s=0.001 + half_s)
    with engaging(config, plant(base, cell, seed), target, seed, link) as loop:
        steps, gave_up = _engaged(loop.run(ENGAGED_WITHIN_S + duration_s), duration_s)
    cycles, depth_rms_mm = [math.nan] * len(PLACES), math.nan
    if len(steps) < round(WINDOW_S / TICK_S):
        gave_up = gave_up or "too short"
    else:
        gains = np.array([1.0, 1.0, cell.gain, 1.0]) if cell.heave_alone else np.full(4, cell.gain)
        cycles = found(steps, config, gains)
        settled = steps[round(SETTLED_S / TICK_S) :]
        depth_rms_mm = recorded(settled).figures()["depth_rms_mm"] if settled else math.nan
    held = not gave_up and max(cycles) < LONGEST_S
    named = {f"cycle_{place}_s": cycle_s for place, cycle_s in zip(PLACES, cycles, strict=True)}
    return {"gave_up": gave_up, "held": held, "depth_rms_mm": depth_rms_mm} | named


def _engaged(dived: Iterator[Step], duration_s: float) -> tuple[list[Step], str]:
    """Return the steps while it is held, and why it was not held to the end."""
    steps: list[Step] = []
    for step in dived:
        if step.sample.verdict.state is State.ACTIVE:
            steps.append(step)
            if len(steps) * TICK_S >= duration_s:
                return steps, ""
        elif steps:
            return steps, step.sample.verdict.reason
    return steps, "engaged too late" if steps else "not engaged"


class Corners(Study[Cell]):
    """Every corner, one dive each."""

    command = "lab campaign corners"
    about = "Dives vehicles of a third and three times the nominal gain, and lists limit cycles."

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add none: `holdfast lab campaign` has them."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._config = load_companion(overrides=arguments.set)
        self._base = load_config(DEFAULT_CONFIG)

    def cases(self) -> Sequence[Cell]:
        return corners()

    def dive(self, cases: Sequence[Cell]) -> Iterable[Row]:
        return [dive(cell, self._config, self._base, FIRST_SEED) for cell in cases]

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return what was not held, and how many were."""
        table = ruled(
            f"Not held: a limit cycle of {LONGEST_S:g} s, or given up",
            "gain", "lag, s", "delay + hidden, ms", "water", "of", "given up", "cycle, s", left=4,
        )  # fmt: skip
        for row in (row for row in rows if not row["held"]):
            cycle_s, place = max((row[f"cycle_{place}_s"], place) for place in PLACES)
            delay = f"{row['delay_ms']:.0f} + {row['hidden_ms']:.0f}"
            vehicle = f"{row['gain']:.2f}", f"{row['lag_s']:g}", delay, row["water"]
            table.add_row(*vehicle, place, row["gave_up"], f"{cycle_s:.1f}")
        yield table
        yield f"{sum(row['held'] for row in rows)} of {len(rows)} held."

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a corner was not held."""
        return not all(row["held"] for row in rows)
