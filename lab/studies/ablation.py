"""`holdfast bench ablation`: the shipped controller less each part; the network where models are wrong.

Batches of dives without MAVLink bytes (`lab.batch`), on vehicles that no search ever sees, with a DVL that
does not drift. Two questions:

- take one part away: what does it cost, as the vehicle is, with 80 ms that are measured, and with 40 ms that
  the autopilot's filter hides?
- is the network worth more than an observer alone where the nominal model is far off: damping three times as
  large, a dead thruster, a tether that pulls with depth, a path flown again and again?

With the real firmware only the variants of the first question that are configuration alone, in the full loop.
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
from rich.console import RenderableType
from rich.table import Table

from companion.config import Config, load_config
from companion.records import Setpoint
from lab import style
from lab.batch.stand_in import Links
from lab.loop.dive import dive
from lab.loop.scenarios import DEPTH_M, SETTLE_S, Scenario, ensemble, four, hold, positioned
from lab.options import add_bench, seeds_of
from lab.studies.competitors import FIRST_SEED, competitors, tuned, values_of
from lab.studies.dives import HELD_FROM_S, LINKS, SCENARIOS, interval
from lab.studies.floor import CHATTER_N
from lab.study import Row, Study, by, ruled
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant

BENCH_LINKS = {"as is": LINKS[0], "+80 ms measured": LINKS[80]}
DELAYS: Mapping[str, Links] = {
    "as is": Links(),
    "+80 ms measured": Links(up_s=0.041, down_s=0.041),
    "40 ms hidden": Links(up_s=0.041, untold_up_s=0.04),
}
PERIOD_S, PATH_M = 6.0, 0.25
DEAD = 4
"""Index of the thruster that is dead: one of the four vertical ones."""

FIGURES = ("depth_rms_mm", "place_rms_mm", "chatter_n", "lost_s")

EARNED = 0.20
"""The share by which the network has to beat the observer alone, to earn its place there."""


@dataclass(frozen=True)
class Part:
    """A variant of the shipped controller: what its configuration overrides, and what is switched off."""

    name: str
    overrides: tuple[str, ...] = ()
    finds_hidden: bool = True
    damps: bool = True


def _compensated(by: str) -> tuple[str, ...]:
    return tuple(f"{axis}.compensator={by!r}" for axis in ("surge", "sway", "heave"))


WHOLE = Part("shipped default")
PARTS = (
    WHOLE,
    Part("no network", _compensated("observer")),
    Part("observer's d not fed back", _compensated("network")),
    Part("no compensator", _compensated("none")),
    Part("integrator for both", _compensated("integrator")),
    Part("thrusters' lag not undone", ("thrusters.lead_s=0.0",)),
    Part("gains not drawn back", ("delays.gains_bear_s=1.0",)),
    Part("hidden delay not looked for", finds_hidden=False),
    Part("oscillation not damped", damps=False),
    Part("neither of the two", ("delays.gains_bear_s=1.0",), finds_hidden=False),
)
HEADLINES = tuple(part for part in PARTS if part.finds_hidden and part.damps)
"""What `--firmware` dives."""


def repeated(t_s: float) -> Setpoint:
    """Follow 0.25 (1 − cos 2πt/6) below DEPTH_M, again and again."""
    omega = 2.0 * math.pi / PERIOD_S
    phase = omega * max(t_s - SETTLE_S, 0.0)
    moving = float(t_s >= SETTLE_S)
    return Setpoint(
        (math.nan, math.nan, DEPTH_M + PATH_M * (1.0 - math.cos(phase)), 0.0),
        (0.0, 0.0, PATH_M * omega * math.sin(phase), 0.0),
        (0.0, 0.0, moving * PATH_M * omega**2 * math.cos(phase), 0.0),
    )


def _draggy(plant: SimConfig) -> SimConfig:
    hull = plant.hull
    linear, quadratic = list(hull.linear_damping), list(hull.quadratic_damping)
    linear[2], quadratic[2] = 3.0 * linear[2], 3.0 * quadratic[2]
    changed = replace(hull, linear_damping=tuple(linear), quadratic_damping=tuple(quadratic))
    return replace(plant, hull=changed)


def _dead(plant: SimConfig) -> SimConfig:
    gain = [plant.thrusters.gain[0]] * 8
    gain[DEAD] = 0.0
    return replace(plant, thrusters=replace(plant.thrusters, gain=tuple(gain)))


def _tethered(plant: SimConfig) -> SimConfig:
    return replace(
        plant, tether=replace(plant.tether, enabled=True, heave_n_per_m=-8.0, sigma_n=(0.0, 0.0, 0.0))
    )


def _wavy(plant: SimConfig) -> SimConfig:
    return replace(plant, waves=replace(plant.waves, enabled=True, height_m=0.3, period_s=4.0))


Change = Callable[[SimConfig], SimConfig]
WRONG: Mapping[str, tuple[Change, Callable[[float], Setpoint]]] = {
    "damping × 3, path": (_draggy, repeated),
    "damping × 3, waves": (lambda plant: _wavy(_draggy(plant)), hold()),
    "dead thruster, waves": (lambda plant: _wavy(_dead(plant)), hold()),
    "tether pulls 8 N a metre, path": (_tethered, repeated),
    "repeated path": (lambda plant: plant, repeated),
}
"""The cases in which the nominal model is far from the vehicle, or the task repeats."""


class AblationDive(NamedTuple):
    """One dive of one variant; `case` is one of DELAYS or WRONG."""

    variant: str
    case: str
    scenario: str
    seed: int


class Ablation(Study[AblationDive]):
    """Both questions, or with the firmware a part of the first."""

    command = "bench ablation"
    about = "Removes one part of the controller at a time, and compares the network with the observer."

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser)

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._firmware: Path | None = arguments.firmware
        self._count = seeds_of(arguments)
        self._base, found = load_plant(DEFAULT_CONFIG), tuned()

        def config(overrides: Sequence[str]) -> Config:
            return load_config(overrides=[*arguments.set, *overrides])

        self._parts = {part.name: (config(part.overrides), part) for part in PARTS}
        self._rows = {
            row.name: (config(row.overrides(values_of(row, found))), WHOLE)
            for row in competitors(config(()))
            if row.compensates
        }

    def cases(self) -> Sequence[AblationDive]:
        seeds = range(FIRST_SEED, FIRST_SEED + self._count)
        if self._firmware:
            parts = [part.name for part in HEADLINES]
            return [AblationDive(*case) for case in product(parts, BENCH_LINKS, SCENARIOS, seeds)]
        less = [AblationDive(*case) for case in product(self._parts, DELAYS, SCENARIOS, seeds)]
        return less + [
            AblationDive(row, case, case, seed) for case, row, seed in product(WRONG, self._rows, seeds)
        ]

    def groups(self, cases: Sequence[AblationDive]) -> Sequence[Sequence[AblationDive]]:
        """Dive the vehicles of one scenario together; with the firmware each alone."""
        if self._firmware:
            return super().groups(cases)
        groups: dict[tuple[str, ...], list[AblationDive]] = {}
        for case in cases:
            groups.setdefault(case[:3], []).append(case)
        return [*groups.values()]

    def dive(self, cases: Sequence[AblationDive]) -> Iterable[Row]:
        """Dive one variant in one scenario; `lost_s` is NaN where the supervisor did not give up."""
        from lab.batch.simulate import simulate  # needs numba, which the command's help does not

        first = cases[0]
        config, part = (self._parts if first.case in DELAYS else self._rows)[first.variant]
        scenarios = [_scenario(case) for case in cases]
        if self._firmware:
            return [self._with_firmware(config, scenarios[0], first.case)]
        found = simulate(
            config,
            [positioned(scenario.plant(self._base, scenario.seed)) for scenario in scenarios],
            scenarios[0].target,
            scenarios[0].duration_s,
            [scenario.seed for scenario in scenarios],
            DELAYS.get(first.case, Links()),
            finds_hidden=part.finds_hidden,
            damps=part.damps,
        )
        return [{key: float(found[key][i]) for key in FIGURES} for i in range(len(cases))]

    def _with_firmware(self, config: Config, scenario: Scenario, case: str) -> Row:
        dived = dive(scenario, config, self._base, BENCH_LINKS[case], self._firmware)
        figures = dived.figures()
        given_up = ~dived.active & (dived.t_s > HELD_FROM_S)
        lost_s = float(dived.t_s[np.argmax(given_up)]) if given_up.any() else math.nan
        return {key: figures[key] for key in FIGURES[:-1]} | {"lost_s": lost_s}

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return a table for each question, and what the network earned."""
        less, wrong = _questions(rows)
        if self._firmware:
            yield _table(f"The real firmware: mean of four scenarios × {self._count} vehicles, mm", less)
            return
        title = f"One part less: mean RMS of four scenarios × {self._count} vehicles, depth / place, mm"
        yield _table(title, less)
        yield _table(f"Where the model is wrong: mean of {self._count} vehicles, depth / place, mm", wrong)
        yield from verdicts(wrong)

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        return {"seeds": self._count, "first_seed": FIRST_SEED, "ablation": summaries(rows)}

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw depth RMS of every variant, a panel a question; nothing with the firmware."""
        if self._firmware:
            return ()
        figure, panels = plt.subplots(1, 2, figsize=(13.0, 4.8), layout="constrained")
        looks = zip((style.BLUE, style.VERMILLION, style.GREEN, style.SKY, style.BLACK), "oDs^v", strict=True)
        looks_of = [*looks]
        titles = ("shipped default, one part less", "wrong models: which compensator")
        for panel, some, title in zip(panels, map(summaries, _questions(rows)), titles, strict=True):
            names = [name for (name,) in by(some, "variant")]
            for (colour, marker), ((case,), of_case) in zip(looks_of, by(some, "case").items(), strict=False):
                rms = [min(row["rms_mm"], 1000.0) for row in of_case]
                panel.plot(
                    rms, np.arange(len(names)), marker, color=colour, label=case, markerfacecolor="none"
                )
            panel.set_yticks(range(len(names)), names)
            panel.invert_yaxis()
            panel.set_xscale("log")
            panel.set_xlabel("depth error, RMS (mm)")
            panel.xaxis.set_major_formatter(mpl.ticker.StrMethodFormatter("{x:g}"))
            panel.xaxis.set_minor_formatter(mpl.ticker.StrMethodFormatter("{x:g}"))
            panel.legend(fontsize=style.SMALL, frameon=False)
            panel.set_title(title, loc="left", fontweight="bold", fontsize=11)
            style.plain(panel)
        return [style.save(figure, folder / "ablation.png", dpi=130)]


def summaries(rows: Sequence[Row]) -> list[Row]:
    """Return mean RMS (mm) of depth and place, chatter (N a tick) and lost dives of each variant and case."""
    return [
        {
            "variant": variant,
            "case": case,
            "rms_mm": float(np.mean([row["depth_rms_mm"] for row in some])),
            "place_mm": float(np.mean([row["place_rms_mm"] for row in some])),
            "chatter_n": float(np.nanmean([row["chatter_n"] for row in some])),
            "lost": sum(not math.isnan(row["lost_s"]) for row in some),
        }
        for (variant, case), some in by(rows, "variant", "case").items()
    ]


def verdicts(rows: Sequence[Row]) -> Iterator[str]:
    """Say of each case whether the network earned EARNED over the observer alone, with the interval."""
    for (case,), some in by(rows, "case").items():
        of = {
            name: np.array([row["depth_rms_mm"] for row in mine])
            for (name,), mine in by(some, "variant").items()
        }
        best: str = min(
            ("network", "network+observer"), key=lambda compensator: float(of[compensator].mean())
        )
        share = 1.0 - of[best] / of["observer"]
        low, high = interval(share)
        said = "earns its place" if low >= EARNED else "does not earn 20 %"
        between = "" if share.size < 2 else f" ({low:+.0%}..{high:+.0%})"
        yield f"{case}: {best} against observer {share.mean():+.0%}{between}: {said}"


def _questions(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    return [row for row in rows if row["case"] in DELAYS], [row for row in rows if row["case"] in WRONG]


def _scenario(case: AblationDive) -> Scenario:
    if case.case in DELAYS:
        return four(case.seed)[SCENARIOS.index(case.scenario)]
    change, target = WRONG[case.case]
    return Scenario("", lambda base, seed: change(ensemble(base, seed)), target, SETTLE_S + 72.0, case.seed)


def _table(title: str, rows: Sequence[Row]) -> Table:
    found = summaries(rows)
    caption = f"! chatter above {CHATTER_N} N a tick"
    table = ruled(title, "", *(case for (case,) in by(found, "case")), caption=caption)
    for (variant,), mine in by(found, "variant").items():
        table.add_row(variant, *map(_cell, mine))
    return table


def _cell(row: Row) -> str:
    lost = f" ({row['lost']} lost)" if row["lost"] else ""
    place = "" if math.isnan(row["place_mm"]) else f" / {row['place_mm']:.1f}"
    return f"{row['rms_mm']:.2f}{place}" + "!" * bool(row["chatter_n"] > CHATTER_N) + lost
