"""`holdfast bench grid`: vehicles of other gain, thruster lag, delay and hidden delay, in the full loop.

The gain of a degree of freedom is its force per command over its inertia, relative to the nominal one. A cell
of the grid is one vehicle and one link; a dive tells whether the loop oscillated by itself, whether the
supervisor gave up, and how well it held 60 s after engaging.

A limit cycle is demand faster than SLOWEST_HZ whose RMS exceeds a share of the largest force and what the sea
asks at these frequencies.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import pyplot as plt
from msgspec.structs import replace
from rich.table import Table

from companion import assembly
from companion.config import Config, load_config
from companion.control.allocation import T200_VOLTAGE_V, delivered
from companion.control.bounds import wrap
from companion.engine import Engine
from companion.records import Array, AxisCommand, Request, Setpoint, State
from lab import style
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep, Step
from lab.options import add_bench
from lab.studies.competitors import FIRST_SEED
from lab.study import Row, Study, by, known, ruled
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant

AXES = ("surge", "sway", "heave", "yaw", "all")
GAINS = (1 / 3, 1 / 2, math.sqrt(1 / 2), 1.0, math.sqrt(2), 2.0, 3.0)
LAGS_S = (0.0, 0.05, 0.15, 0.3)
DELAYS_MS = (0, 50, 150)
HIDDEN_MS = (0, 40)
WATERS = ("calm", "waves")
LATIN = 60
"""Cells of the Latin hypercube, which draws between the grid's values as well."""

SETTLED_S = 60.0
"""From engaging on: only then its errors are measured."""

DURATION_S = 90.0
"""From engaging on."""

ENGAGED_WITHIN_S = 10.0
DEPTH_M, START_M = 2.5, 0.5
PLACES = ("north", "east", "depth", "heading", "roll", "pitch")
"""Of the demands; the first four have an error, too: mm and degrees."""

SHARE = 0.12
SLOWEST_HZ = 0.4
WINDOW_S = 1.25
SEA_COUNTS = 1.5
TICK_S = 0.02
TRUE_PSI = 5
LONGEST_S = 3.0
"""A limit cycle that lasts longer has not been ended."""

SHOWN_S = 30.0
"""Where the colours of the picture end."""


class Cell(NamedTuple):
    """One vehicle and one link."""

    axis: str
    gain: float
    lag_s: float
    delay_ms: float
    hidden_ms: float
    water: str

    def __str__(self) -> str:
        """Return it in one line."""
        return (
            f"{self.axis} × {self.gain:.2f}, lag {self.lag_s:.2f} s, delay {self.delay_ms:.0f} + "
            f"{self.hidden_ms:.0f} ms hidden, {self.water}"
        )


def lines() -> list[Cell]:
    """Return every gain of every axis, with the nominal lag and no delay but the link's, in waves."""
    return [Cell(axis, gain, 0.15, 0, 0, "waves") for axis in AXES for gain in GAINS]


def corners() -> list[Cell]:
    """Return the corners of the grid for all axes together, in both waters."""
    ends = (GAINS[0], GAINS[-1]), (LAGS_S[0], LAGS_S[-1]), (DELAYS_MS[0], DELAYS_MS[-1]), HIDDEN_MS, WATERS
    return [Cell("all", *each) for each in product(*ends)]


def latin(count: int = LATIN, seed: int = 1) -> list[Cell]:
    """Return a Latin hypercube over the whole grid."""
    rng = np.random.default_rng(seed)
    unit = (np.array([rng.permutation(count) for _ in range(6)]) + rng.random((6, count))) / count
    return [
        Cell(
            AXES[int(len(AXES) * axis)],
            float(3.0 ** (2.0 * gain - 1.0)),
            round(0.3 * float(lag), 3),
            round(150.0 * float(delay)),
            HIDDEN_MS[int(2 * hidden)],
            WATERS[int(2 * water)],
        )
        for axis, gain, lag, delay, hidden, water in unit.T
    ]


def full() -> list[Cell]:
    """Return the whole grid: 1680 cells."""
    return [Cell(*each) for each in product(AXES, GAINS, LAGS_S, DELAYS_MS, HIDDEN_MS, WATERS)]


SUBSETS: dict[str, Callable[[], list[Cell]]] = {
    "lines": lines,
    "corners": corners,
    "latin": latin,
    "full": full,
}


def plant(base: SimConfig, cell: Cell, seed: int) -> SimConfig:
    """Return the vehicle of a cell: `base` with other thrusters, later sensors and its water.

    What delays the sensors stands in no stamp.
    """
    gains = [cell.gain if cell.axis in (axis, "all") else 1.0 for axis in AXES[:-1]]
    tilts = cell.gain if cell.axis == "all" else 1.0
    axis_gain = (gains[0], gains[1], gains[2], tilts, tilts, gains[3])
    draw, sensors, late_s = np.random.default_rng((seed, 2)).uniform, base.sensors, 1e-3 * cell.hidden_ms
    rough = cell.water == "waves"
    return replace(
        base,
        thrusters=replace(base.thrusters, axis_gain=axis_gain, lag_s=cell.lag_s),
        sensors=replace(
            sensors,
            dvl=True,
            depth_delay_s=sensors.depth_delay_s + late_s,
            climb_delay_s=sensors.climb_delay_s + late_s,
            attitude_delay_s=sensors.attitude_delay_s + late_s,
        ),
        current=replace(base.current, enabled=rough),
        waves=replace(
            base.waves,
            enabled=rough,
            height_m=draw(0.2, 0.4),
            period_s=draw(3.5, 5.0),
            direction_deg=draw(0.0, 360.0),
        ),
        initial=replace(base.initial, eta=(0.0, 0.0, START_M, 0.0, 0.0, 0.0)),
    )


def dive(
    cell: Cell,
    config: Config,
    base: SimConfig,
    seed: int,
    firmware: Path | None = None,
    duration_s: float = DURATION_S,
) -> Row:
    """Dive one cell in the full loop: down to DEPTH_M, and hold there. Return what `judged` returns."""
    target = Setpoint((0.0, 0.0, DEPTH_M, 0.0))
    half_s = 0.5e-3 * cell.delay_ms
    link = LinkDelay(up_s=0.001 + half_s, down_s=0.001 + half_s)
    with vehicle_of(plant(base, cell, seed), seed, firmware) as vehicle:
        loop = Lockstep(vehicle, Engine(config, target, arm=True), link, seed, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        steps, gave_up = _engaged(loop.run(ENGAGED_WITHIN_S + duration_s), duration_s)
    return judged(cell, seed, steps, gave_up, config)


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


def judged(cell: Cell, seed: int, steps: Sequence[Step], gave_up: str, config: Config) -> Row:
    """Return the results of the steps from engaging on; NaN where there are none.

    `gave_up` says why the supervisor ended it, `held` that it did not and no limit cycle lasted; `chatter_n`
    is the RMS of the change in heave's demand in a tick. Of each of PLACES there is the longest limit cycle
    (s), and of the first four the RMS error from SETTLED_S on.
    """
    cycles, rms, chatter_n = [math.nan] * len(PLACES), [math.nan] * 4, math.nan
    if len(steps) < round(WINDOW_S / TICK_S):
        gave_up = gave_up or "too short"
    else:
        cycles, rms, chatter_n = _measured(cell, steps, config)
    result: Row = {
        "seed": seed,
        "gave_up": gave_up,
        "held": not gave_up and max(cycles) < LONGEST_S,
        "chatter_n": chatter_n,
    }
    result |= {f"cycle_{place}_s": cycle_s for place, cycle_s in zip(PLACES, cycles, strict=True)}
    return result | {f"rms_{place}": error for place, error in zip(PLACES, rms, strict=False)}


def _measured(cell: Cell, steps: Sequence[Step], config: Config) -> tuple[list[float], list[float], float]:
    """Return the limit cycles of PLACES, the errors and the chatter."""
    since = round(SETTLED_S / TICK_S)
    thrusters, most = assembly.thrusters(config), config.levelling.max_axis
    largest = np.array(
        [axis.max_force for axis in config.axes]
        + [*delivered(thrusters, AxisCommand(roll=most, pitch=most), T200_VOLTAGE_V)[4:]]
    )
    demand = np.array(
        [
            (
                *step.sample.dofs.tau,
                *delivered(thrusters, step.sample.command, step.sample.state.voltage_v)[4:],
            )
            for step in steps
        ]
    )
    disturbance = np.array([step.truth.disturbance for step in steps])[:, [0, 1, 2, 5]]
    gain = cell.gain if cell.axis == "all" else 1.0
    gains = np.array([cell.gain if axis == cell.axis else gain for axis in AXES[:-1]])
    sea = np.hstack([disturbance / gains, np.zeros((len(steps), 2))])
    eta = np.array([step.truth.eta for step in steps])[since:]
    error = eta[:, [0, 1, 2, TRUE_PSI]] - (0.0, 0.0, DEPTH_M, 0.0)
    error[:, 3] = np.degrees([wrap(angle) for angle in error[:, 3].tolist()])
    error[:, :3] *= 1e3
    change = np.diff(demand[since:, 2])
    return (
        cycles_s(np.clip(demand, -largest, largest), largest, sea).tolist(),
        np.sqrt(np.mean(error**2, axis=0)).tolist() if len(error) else [math.nan] * 4,
        float(np.sqrt(np.mean(change**2))) if len(change) else math.nan,
    )


def cycles_s(demand: Array, largest: Array, sea: Array) -> Array:
    """Return the longest limit cycle (s) of each column of `demand` (ticks, n), N or N·m.

    `sea` (ticks, n) is what the water's doings ask for.
    """
    fast, of_sea = _rms(_fast(demand)), _rms(_fast(sea))
    beyond = fast > SHARE * largest + SEA_COUNTS * of_sea
    longest = []
    for column in beyond.T:
        edges = np.flatnonzero(np.diff(np.concatenate(([0], column.astype(int), [0]))))
        longest.append(TICK_S * max(edges[1::2] - edges[::2], default=0))
    return np.array(longest)


def _fast(signal: Array) -> Array:
    """Return what of each column is faster than SLOWEST_HZ."""
    hz = np.fft.rfftfreq(len(signal), TICK_S)
    keep = np.clip((hz / SLOWEST_HZ - 0.9) / 0.2, 0.0, 1.0)
    fast: Array = np.fft.irfft(keep[:, None] * np.fft.rfft(signal, axis=0), len(signal), axis=0)
    return fast


def _rms(signal: Array) -> Array:
    """Return the RMS of each column over WINDOW_S."""
    window = np.full(round(WINDOW_S / TICK_S), TICK_S / WINDOW_S)
    power: Array = np.array([np.convolve(column, window, "valid") for column in (signal**2).T]).T
    rms: Array = np.sqrt(power)
    return rms


class Grid(Study[Cell]):
    """The cells that were asked for, one dive each."""

    command = "bench grid"
    about = (
        "Dives vehicles of a third to three times the nominal gain, with other lags and delays, and lists "
        "limit cycles. Exit status 1 if one was not held."
    )

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser)
        parser.add_argument(
            "--cells",
            nargs="+",
            metavar="SET",
            default=["lines", "corners", "latin"],
            help="lines, corners, latin, full (1680 dives); default the first three",
        )

    def __init__(self, arguments: argparse.Namespace) -> None:
        known(arguments.cells, SUBSETS, "set of cells")
        self._config = load_config(overrides=arguments.set)
        self._base = load_plant(DEFAULT_CONFIG)
        self._sets: list[str] = arguments.cells
        self._firmware: Path | None = arguments.firmware

    def cases(self) -> Sequence[Cell]:
        return [*dict.fromkeys(cell for name in self._sets for cell in SUBSETS[name]())]

    def dive(self, cases: Sequence[Cell]) -> Iterable[Row]:
        return [dive(cell, self._config, self._base, FIRST_SEED, self._firmware) for cell in cases]

    def tables(self, rows: Sequence[Row]) -> Iterator[Table]:
        """Return what was not held, and a summary by axis."""
        lost = ruled(
            f"Not held: a limit cycle of {LONGEST_S:g} s, or given up",
            "vehicle and link", "of", "given up", "cycle, s", left=3,
        )  # fmt: skip
        for row in rows:
            if not row["held"]:
                longest = longest_s(row)
                where = (
                    "" if math.isnan(longest) else next(p for p in PLACES if row[f"cycle_{p}_s"] == longest)
                )
                cell = Cell(*(row[key] for key in Cell._fields))
                lost.add_row(str(cell), where, row["gave_up"], f"{longest:.1f}")
        yield lost
        errors = [f"{place}, {'°' if place == 'heading' else 'mm'}" for place in PLACES[:4]]
        table = ruled(
            "By axis: dives, what was held, and errors after 60 s (median, worst of what was held)",
            "axis", "dives", "held", "given up", "worst cycle, s", *errors,
        )  # fmt: skip
        for (axis,), some in sorted(by(rows, "axis").items(), key=lambda item: AXES.index(item[0][0])):
            steered = [row for row in some if not row["gave_up"]]
            rms = np.array([[row[f"rms_{place}"] for row in steered] for place in PLACES[:4]])
            table.add_row(
                axis,
                str(len(some)),
                str(sum(row["held"] for row in some)),
                str(len(some) - len(steered)),
                f"{max(map(longest_s, some)):.1f}",
                *(f"{np.median(error):.1f}, {error.max():.1f}" if steered else "" for error in rms),
            )
        yield table

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a cell was not held."""
        return not all(row["held"] for row in rows)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw the longest limit cycle over gain and lag, a panel an axis."""
        figure, panels = plt.subplots(1, len(AXES), figsize=(15.0, 3.6), sharey=True, layout="constrained")
        for panel, axis in zip(panels, AXES, strict=True):
            worst = np.full((len(LAGS_S), len(GAINS)), np.nan)
            ended, dives = np.zeros(worst.shape, int), np.zeros(worst.shape, int)
            for row in by(rows, "axis").get((axis,), []):
                i = int(np.argmin([abs(row["lag_s"] - lag_s) for lag_s in LAGS_S]))
                j = int(np.argmin([abs(math.log(row["gain"] / gain)) for gain in GAINS]))
                worst[i, j] = np.nanmax([worst[i, j], longest_s(row), 0.0])
                ended[i, j] += bool(row["gave_up"])
                dives[i, j] += 1
            image = panel.imshow(worst, cmap="cividis", vmin=0.0, vmax=SHOWN_S, origin="lower", aspect="auto")
            for i, j in np.ndindex(*worst.shape):
                if dives[i, j]:
                    text = f"{worst[i, j]:.0f}" + (f"\n{ended[i, j]}/{dives[i, j]}" if ended[i, j] else "")
                    colour = "w" if worst[i, j] < 0.5 * SHOWN_S else "k"
                    panel.text(j, i, text, ha="center", va="center", fontsize=7, color=colour)
            panel.set_xticks(range(len(GAINS)), [f"{gain:.2g}" for gain in GAINS])
            panel.set_yticks(range(len(LAGS_S)), [f"{lag_s:g}" for lag_s in LAGS_S])
            panel.set_xlabel("gain over nominal")
            panel.set_title(axis, loc="left", fontweight="bold", fontsize=11)
            panel.tick_params(labelsize=style.SMALL)
        panels[0].set_ylabel("thruster lag (s)")
        figure.colorbar(image, ax=panels, label="longest limit cycle (s)")
        figure.suptitle("worst of all delays and waters; below it, dives given up / dives", fontsize=10)
        return [style.save(figure, folder / "grid.png", dpi=130)]


def longest_s(row: Row) -> float:
    """Return the longest limit cycle of a dive, s."""
    return float(max(row[f"cycle_{place}_s"] for place in PLACES))
