"""`holdfast lab bench corners`: whether vehicles of a third and three times the nominal gain oscillate.

The corners of gain of all axes, thruster lag, delay, hidden delay and water, in the full loop. A limit cycle
is demand faster than SLOWEST_HZ whose RMS exceeds a share of the largest force and what the sea asks at these
frequencies.
"""

import argparse
import math
from collections.abc import Iterable, Sequence
from itertools import product, takewhile
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from companion import assembly
from companion.arrays import Array
from companion.config import Config
from companion.config import load_config as load_companion
from companion.core.allocation import T200_VOLTAGE_V, delivered
from companion.records import AxisCommand, Setpoint, State
from lab.loop.dive import engaging, recorded
from lab.loop.lockstep import LinkDelay, Step
from lab.loop.scenarios import water
from lab.options import add_out, add_settings
from lab.studies.competitors import FIRST_SEED
from lab.studies.trials import later
from lab.study import Row, Study
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import SimConfig, load_config

GAINS, LAGS_S, DELAYS_MS, HIDDEN_MS = (1 / 3, 3.0), (0.0, 0.3), (0, 150), (0, 40)
WATERS = ("calm", "waves")
SETTLED_S, DURATION_S, ENGAGED_WITHIN_S = 60.0, 90.0, 10.0
"""Times after engaging when errors begin to count and the dive ends; longest time to engage."""

DEPTH_M, START_M = 2.5, 0.5
LONGEST_S = 3.0
"""A limit cycle that lasts longer has not been ended."""
PLACES = ("north", "east", "depth", "heading", "roll", "pitch")
"""The axes of the demands."""
SHARE, SLOWEST_HZ, WINDOW_S, SEA_COUNTS, TICK_S = 0.12, 0.4, 1.25, 1.5, 0.02


class Cell(NamedTuple):
    """One vehicle and one link; the gain is that of all axes."""

    gain: float
    lag_s: float
    delay_ms: float
    hidden_ms: float
    water: str


def corners() -> list[Cell]:
    """Return the corners of the grid, in both waters."""
    return [Cell(*each) for each in product(GAINS, LAGS_S, DELAYS_MS, HIDDEN_MS, WATERS)]


def plant(base: SimConfig, cell: Cell, seed: int) -> SimConfig:
    """Return the vehicle of a cell: `base` with other thrusters, later sensors and its water."""
    draw, rough = np.random.default_rng((seed, 2)).uniform, cell.water == "waves"
    thrusters = replace(base.thrusters, axis_gain=(cell.gain,) * 6, lag_s=cell.lag_s)
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
        whole = list(loop.run(ENGAGED_WITHIN_S + duration_s))
    active = [step.sample.verdict.state is State.ACTIVE for step in whole]
    begun = active.index(True) if any(active) else len(whole)
    steps = [*takewhile(lambda step: step.sample.verdict.state is State.ACTIVE, whole[begun:])]
    ended, wanted = begun + len(steps), round(duration_s / TICK_S)
    gave_up = "" if len(steps) >= wanted else whole[min(ended, len(whole) - 1)].sample.verdict.reason
    steps, cycles, depth_rms_mm = steps[:wanted], [math.nan] * len(PLACES), math.nan
    if len(steps) >= round(WINDOW_S / TICK_S):
        cycles = limit_cycles(steps, config, cell)
        settled = steps[round(SETTLED_S / TICK_S) :]
        depth_rms_mm = recorded(settled).figures()["depth_rms_mm"] if settled else math.nan
    held = not gave_up and max(cycles) < LONGEST_S
    named = {f"cycle_{place}_s": cycle_s for place, cycle_s in zip(PLACES, cycles, strict=True)}
    return {"gave_up": gave_up, "held": held, "depth_rms_mm": depth_rms_mm} | named


def limit_cycles(steps: Sequence[Step], config: Config, cell: Cell) -> list[float]:
    """Return the longest limit cycle of each of PLACES, s."""
    thrusters, most = assembly.thrusters(config), config.levelling.max_axis
    tilts = delivered(thrusters, AxisCommand(roll=most, pitch=most), T200_VOLTAGE_V)[4:]
    largest = np.array([axis.max_force for axis in config.axes] + [*tilts])
    samples = [step.sample for step in steps]
    demand = np.array(
        [(*now.dofs.tau, *delivered(thrusters, now.command, now.state.voltage_v)[4:]) for now in samples]
    )
    sea = np.array([step.truth.disturbance for step in steps])[:, [0, 1, 2, 5]] / cell.gain
    sea = np.hstack([sea, np.zeros((len(steps), 2))])
    longest: list[float] = cycles_s(np.clip(demand, -largest, largest), largest, sea).tolist()
    return longest


def cycles_s(demand: Array, largest: Array, sea: Array) -> Array:
    """Return the longest limit cycle (s) of each column of `demand` (ticks, n), N or N·m.

    `sea` (ticks, n) is what the water's doings ask for.
    """
    beyond = _moving_rms(demand) > SHARE * largest + SEA_COUNTS * _moving_rms(sea)
    longest = []
    for column in beyond.T:
        edges = np.flatnonzero(np.diff(np.concatenate(([0], column.astype(int), [0]))))
        longest.append(TICK_S * max(edges[1::2] - edges[::2], default=0))
    return np.array(longest)


def _moving_rms(signal: Array) -> Array:
    """Return the RMS over WINDOW_S of what of each column is faster than SLOWEST_HZ."""
    hz = np.fft.rfftfreq(len(signal), TICK_S)
    keep = np.clip((hz / SLOWEST_HZ - 0.9) / 0.2, 0.0, 1.0)
    fast = np.fft.irfft(keep[:, None] * np.fft.rfft(signal, axis=0), len(signal), axis=0)
    window = np.full(round(WINDOW_S / TICK_S), TICK_S / WINDOW_S)
    power: Array = np.array([np.convolve(column, window, "valid") for column in (fast**2).T]).T
    return np.sqrt(power)


class Corners(Study[Cell]):
    """Every corner, one dive each."""

    command = "lab bench corners"
    about = (
        "Dives 32 vehicles of a third and three times the nominal gain, with lags and delays, in the full "
        "loop, and lists limit cycles. Exit status 1 if one oscillates for 3 s or is given up."
    )

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_settings(parser)
        add_out(parser, "out/bench")

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._config, self._base = load_companion(overrides=arguments.set), load_config(DEFAULT_CONFIG)

    def cases(self) -> Sequence[Cell]:
        return corners()

    def dive(self, cases: Sequence[Cell]) -> Iterable[Row]:
        return [dive(cell, self._config, self._base, FIRST_SEED) for cell in cases]

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        lines = []
        for row in (row for row in rows if not row["held"]):
            cycle_s, place = max((row[f"cycle_{place}_s"], place) for place in PLACES)
            delays = f"{row['delay_ms']:.0f} + {row['hidden_ms']:.0f}"
            vehicle = f"{row['gain']:.2f}", f"{row['lag_s']:g}", delays, row["water"]
            lines.append([*vehicle, place, row["gave_up"], f"{cycle_s:.1f}"])
        columns = ["gain", "lag, s", "delay + hidden, ms", "water", "of", "given up", "cycle, s"]
        return {
            "columns": [f"{len(lines)} of {len(rows)} not held: {columns[0]}", *columns[1:]],
            "rows": lines,
        }

    def failed(self, rows: Sequence[Row]) -> bool:
        return not all(row["held"] for row in rows)
