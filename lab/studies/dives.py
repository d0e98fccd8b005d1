"""`holdfast bench dives`: how well every competitor holds, over the same dives in the full loop.

A case is a scenario and a delay. Within a case all competitors dive with the same vehicles, seas, loads and
noise, so that differences are taken dive by dive. No search ever sees the seeds. The last row is computed,
not dived: the LQG floor of every single dive (`lab.studies.floor`).
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from statistics import NormalDist
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from rich.table import Table

from companion.config import load_config
from lab.loop.dive import FIGURES, dive
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import four
from lab.options import add_bench, seeds_of
from lab.rivals import alt_hold
from lab.studies.competitors import DEFAULT, FIRST_SEED, competitors, selected, tuned, values_of
from lab.studies.floor import CHATTER_N, floor
from lab.study import Row, Study, by, known, ruled
from lab.style import BLUE, VERMILLION, save
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

SCENARIOS = ("waves", "path", "load", "calm")
LINKS = {0: LinkDelay(), 80: LinkDelay(up_s=0.041, down_s=0.041)}
"""By the delay that is added, ms: half of it each way, from the start, and not configured anywhere."""

FLOOR = "floor"
HELD_FROM_S = 5.0
CONFIDENCE = 0.95

COLUMNS = {
    "depth_peak_mm": ("peak\nmm", ".1f"),
    "recovery_s": ("recov.\ns", ".1f"),
    "thrust_rms_n": ("thrust\nN", ".1f"),
    "chatter_n": ("chatter\nN/tick", ".2f"),
}
COLOURS = {0: BLUE, 80: VERMILLION}
MARKERS = {0: "o", 80: "D"}
SHIFT = 0.17


class BenchDive(NamedTuple):
    """One dive of one competitor."""

    row: str
    scenario: str
    delay_ms: int
    seed: int


class Dives(Study[BenchDive]):
    """Every scenario and delay with every competitor and vehicle."""

    command = "bench dives"
    about = (
        "Simulates four scenarios, without and with 80 ms more delay, with random vehicles, in virtual time "
        "and with real MAVLink bytes: the shipped default, other laws and compensators, ArduSub's depth "
        "hold, and the computed LQG floor. One dive takes 3 s on one core; all rows with 60 vehicles take 5 "
        "core-hours, with --seeds 10 one hour."
    )
    delays: tuple[int, ...] = tuple(LINKS)
    default_rows: tuple[str, ...] = ()
    """What dives when no row is named; empty for all."""

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, "default law ppi", ", ".join(SCENARIOS))

    def __init__(self, arguments: argparse.Namespace) -> None:
        config = load_config(overrides=arguments.set)
        every = self.default_rows or [row.name for row in competitors(config)]
        self._rows = {row.name: row for row in selected(arguments.rows or every, config)}
        known(arguments.scenarios or (), SCENARIOS, "scenario")
        self._scenarios = [name for name in SCENARIOS if name in (arguments.scenarios or SCENARIOS)]
        self._seeds = range(FIRST_SEED, FIRST_SEED + seeds_of(arguments))
        found = tuned()
        self._values = {name: values_of(row, found) for name, row in self._rows.items()}
        self._configs = {
            name: load_config(overrides=[*arguments.set, *row.overrides(self._values[name])])
            for name, row in self._rows.items()
        }
        self._firmware: Path | None = arguments.firmware
        self._plant = load_plant(DEFAULT_CONFIG)
        self.titles = {row.name: row.title for row in competitors(config)} | {FLOOR: "LQG floor"}

    def cases(self) -> Sequence[BenchDive]:
        """Return the dives, and behind them the floors."""
        same = [*product(self._scenarios, self.delays, self._seeds)]
        return [
            *(BenchDive(row, *case) for case in same for row in self._rows),
            *(BenchDive(FLOOR, *case) for case in same),
        ]

    def dive(self, cases: Sequence[BenchDive]) -> Iterator[Row]:
        return (
            self._floor(case) if case.row == FLOOR else self.dived(case, self._firmware) for case in cases
        )

    def dived(self, case: BenchDive, firmware: Path | None) -> Row:
        """Return the figures of a dive; `held` unless the supervisor gave up."""
        scenario, link = four(case.seed)[SCENARIOS.index(case.scenario)], LINKS[case.delay_ms]
        if self._rows[case.row].steers == "autopilot":
            found = alt_hold.dive(scenario, self._plant, link, self._values[case.row], firmware)
        else:
            found = dive(scenario, self._configs[case.row], self._plant, link, firmware)
        return {"held": bool(found.active[found.t_s > HELD_FROM_S].all())} | found.figures()

    def _floor(self, case: BenchDive) -> Row:
        reached = floor(four(case.seed)[SCENARIOS.index(case.scenario)], self._plant, LINKS[case.delay_ms])
        figures = {"depth_rms_mm": reached.depth_rms_mm, "chatter_n": reached.chatter_n}
        return {"held": True} | dict.fromkeys(FIGURES, math.nan) | figures

    def tables(self, rows: Sequence[Row]) -> Iterator[Table]:
        """Return a table for each case, and three of all cases."""
        cases = summaries(rows)
        for of_case in by(cases, "scenario", "delay_ms").values():
            yield self._case(of_case)
        title = f"depth RMS, mm; ! chatter above {CHATTER_N} N a tick"
        yield self._overview(
            cases, title, lambda row: f"{row['depth_rms_mm']:.1f}" + "!" * (row["chatter_n"] > CHATTER_N)
        )
        yield self._overview(
            cases, "depth RMS over that of the floor", lambda row: f"{row['floor_ratio']:.2f}"
        )
        yield self._overview(cases, "heading RMS, °", lambda row: _cell(row["heading_rms_deg"], ".2f"))

    def _case(self, cases: Sequence[Row]) -> Table:
        first = cases[0]
        shown = {
            key: column for key, column in COLUMNS.items() if any(not math.isnan(case[key]) for case in cases)
        }
        table = ruled(
            f"{first['scenario']}, {_delay(first['delay_ms'])}: mean of {first['seeds']} vehicles",
            "", "RMS\nmm", "×\nfloor", f"less default\nmm, {CONFIDENCE:.0%}",
            *(title for title, _ in shown.values()), padding=0,
        )  # fmt: skip
        for case in cases:
            name, difference = case["row"], ""
            if name not in (DEFAULT, FLOOR) and not math.isnan(case["difference_mm"]):
                difference = f"{case['difference_mm']:+.2f}"
                if case["seeds"] > 1:
                    difference += f" ± {case['high_mm'] - case['difference_mm']:.2f}"
            table.add_row(
                self.titles[name] + (f" ({case['gave_up']} lost)" if case["gave_up"] else ""),
                f"{case['depth_rms_mm']:.2f}",
                f"{case['floor_ratio']:.2f}",
                difference,
                *(_cell(case[key], form) for key, (_, form) in shown.items()),
                style="bold" if name == DEFAULT else "dim" if name == FLOOR else "",
            )
        return table

    def _overview(self, cases: Sequence[Row], title: str, cell: Callable[[Row], str]) -> Table:
        """Return one figure of every row in every case."""
        keys = sorted(by(cases, "delay_ms", "scenario"), key=lambda key: key[0])
        table = ruled(
            title, "", *(f"{scenario}\n{_delay(delay_ms)}" for delay_ms, scenario in keys), padding=0
        )
        for (name,), mine in by(cases, "row").items():
            cells = {(case["delay_ms"], case["scenario"]): cell(case) for case in mine}
            table.add_row(
                self.titles[name], *(cells[key] for key in keys), style="bold" if name == DEFAULT else ""
            )
        return table

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the table for docs/results.md: depth RMS at each delay, and less that of the default."""
        cases, ours, lines = summaries(rows), by_vehicle(rows, DEFAULT), []
        for (name,), mine in sorted(by(cases, "row").items(), key=lambda row: row[0] != (DEFAULT,)):
            cells = [
                "/".join(f"{case['depth_rms_mm']:.1f}" + "†" * case["gave_up"] for case in of_scenario)
                for of_scenario in by(mine, "scenario").values()
            ]
            difference = "–"
            if name != DEFAULT and len(ours):
                apart = by_vehicle(rows, name) - ours
                difference = f"{apart.mean():+.2f}"
                if len(apart) > 1:
                    difference += f"±{interval(apart)[1] - apart.mean():.2f}"
            chatter_n = np.mean([case["chatter_n"] for case in mine])
            lines.append([self.titles[name], *cells, difference, f"{chatter_n:.1f}"])
        delays = "/".join(_delay(delay_ms) for (delay_ms,) in by(cases, "delay_ms"))
        scenarios = [name for (name,) in by(cases, "scenario")]
        return {
            "columns": [f"depth RMS, mm ({delays})", *scenarios, "less Holdfast's, mm", "chatter, N"],
            "rows": lines,
        }

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw every scenario: depth error and chatter of each competitor."""
        return [self._picture(name, some, folder) for (name,), some in by(rows, "scenario").items()]

    def _picture(self, scenario: str, rows: Sequence[Row], folder: Path) -> Path:
        names = [name for (name,) in by(rows, "row") if name != FLOOR]
        figure, (left, right) = plt.subplots(
            1,
            2,
            figsize=(10.0, 1.6 + 0.38 * len(names)),
            sharey=True,
            width_ratios=(3, 2),
            layout="constrained",
        )
        for i, ((delay_ms,), some) in enumerate(by(rows, "delay_ms").items()):
            of_row = by(some, "row")
            for axes, key in ((left, "depth_rms_mm"), (right, "chatter_n")):
                _dots(axes, [np.array([row[key] for row in of_row[name,]]) for name in names], delay_ms, i)
            lowest = np.mean([row["depth_rms_mm"] for row in of_row[FLOOR,]])
            left.axvline(lowest, color=COLOURS[delay_ms], linestyle="--", linewidth=1.0, zorder=0)
        right.axvline(CHATTER_N, color="0.4", linestyle=":", linewidth=1.2, zorder=0)
        right.annotate(
            f"limit {CHATTER_N} N", (CHATTER_N, 1.0), xycoords=("data", "axes fraction"), xytext=(3, 3),
            textcoords="offset points", color="0.4", fontsize=8,
        )  # fmt: skip
        left.set_yticks(range(len(names)), [self.titles[name] for name in names])
        left.set_ylim(len(names) - 0.5, -0.5)
        right.tick_params(left=False)
        for axes, label in ((left, "depth error, RMS (mm)"), (right, "command's change, RMS (N a tick)")):
            axes.set_xscale("log")
            axes.set_xlabel(label)
            axes.xaxis.set_major_locator(mpl.ticker.LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
            axes.xaxis.set_major_formatter(mpl.ticker.StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_formatter(mpl.ticker.NullFormatter())
            axes.grid(axis="x", color="0.9")
            axes.spines[["top", "right"]].set_visible(False)
        title = f"{scenario}: {len(self._seeds)} vehicles; mean and 95 % interval, every dive a dot"
        figure.suptitle(title, fontsize=11)
        handles, labels = left.get_legend_handles_labels()
        handles.append(mpl.lines.Line2D([], [], color="0.3", linestyle="--", linewidth=1.0))
        figure.legend(handles, [*labels, "LQG floor"], loc="outside lower center", ncols=3, frameon=False)
        return save(figure, folder / f"{scenario}.png", dpi=130)


def summaries(rows: Sequence[Row]) -> list[Row]:
    """Return the mean figures of each row in each case, and its paired difference in depth RMS.

    The difference is that to the default; `low_mm` and `high_mm` are the ends of its interval.
    """
    result = []
    for (scenario, delay_ms), case in by(rows, "scenario", "delay_ms").items():
        of_row = {
            name: sorted(some, key=lambda row: row["seed"]) for (name,), some in by(case, "row").items()
        }
        rms = {name: np.array([row["depth_rms_mm"] for row in some]) for name, some in of_row.items()}
        for name, some in of_row.items():
            difference = rms[name] - rms.get(DEFAULT, np.full(len(some), np.nan))
            low_mm, high_mm = interval(difference)
            result.append(
                {
                    "row": name,
                    "scenario": scenario,
                    "delay_ms": delay_ms,
                    "seeds": len(some),
                    "gave_up": sum(not row["held"] for row in some),
                    "floor_ratio": float(rms[name].mean() / rms[FLOOR].mean()),
                    "difference_mm": float(difference.mean()),
                    "low_mm": low_mm,
                    "high_mm": high_mm,
                }
                | {key: float(np.mean([row[key] for row in some])) for key in FIGURES}
            )
    return result


def by_vehicle(rows: Sequence[Row], name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return a row's mean depth RMS with each vehicle."""
    mine = by([row for row in rows if row["row"] == name], "seed")
    return np.array([np.mean([dive["depth_rms_mm"] for dive in dives]) for dives in mine.values()])


def interval(
    differences: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]],
) -> tuple[float, float]:
    """Return the confidence interval of the mean of paired differences, Student's; NaN for fewer than two."""
    n = len(differences)
    if n < 2:
        return math.nan, math.nan
    half = student(n - 1) * float(np.std(differences, ddof=1)) / math.sqrt(n)
    return float(np.mean(differences)) - half, float(np.mean(differences)) + half


def student(freedom: int, confidence: float = CONFIDENCE) -> float:
    """Return Student's two-sided quantile: exact for 1 and 2 degrees of freedom, else Cornish-Fisher, 0.5 %.

    (Abramowitz and Stegun, 26.7.5.)
    """
    p = 0.5 + 0.5 * confidence
    if freedom == 1:
        return math.tan(math.pi * (p - 0.5))
    if freedom == 2:
        return (2.0 * p - 1.0) * math.sqrt(2.0 / (4.0 * p * (1.0 - p)))
    z, n = NormalDist().inv_cdf(p), float(freedom)
    terms = (
        (z**3 + z) / 4.0,
        (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0,
        (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0,
        (79.0 * z**9 + 776.0 * z**7 + 1482.0 * z**5 - 1920.0 * z**3 - 945.0 * z) / 92160.0,
    )
    return z + sum(term / n**i for i, term in enumerate(terms, 1))


def _dots(axes: Axes, values_by_row: Iterable[np.ndarray[Any, Any]], delay_ms: int, i: int) -> None:
    """Draw one figure of every row at one delay: the dives faint, their mean with its interval."""
    colour, face = COLOURS[delay_ms], COLOURS[delay_ms] if delay_ms == 0 else "white"
    for y, values in enumerate(values_by_row):
        height = y + SHIFT * (2 * i - 1)
        axes.plot(
            values, np.full(len(values), height + SHIFT / 2), ".", color=colour, alpha=0.4, markersize=3
        )
        low, high = interval(values)
        if len(values) > 1:
            axes.plot([max(low, 0.5 * values.min()), high], [height, height], color=colour, linewidth=2.0)
        label = (f"+{delay_ms} ms" if delay_ms else "delay as is") if y == 0 else None
        axes.plot(
            values.mean(), height, marker=MARKERS[delay_ms], label=label, color=colour, markerfacecolor=face,
            markersize=5.0, linestyle="none",
        )  # fmt: skip


def _delay(delay_ms: int) -> str:
    return f"+{delay_ms} ms" if delay_ms else "as is"


def _cell(value: float, form: str) -> str:
    return "" if math.isnan(value) else f"{value:{form}}"
