"""`holdfast lab bench rivals`: other laws on vehicles unlike the model, in depth and in place.

The vehicles are those of `bench reality`. Every rival has our estimator, delay compensation and thruster
curve, and the model that Holdfast has. `holdfast lab tune --reality` searches each as it does Holdfast:
first its depth, then with that its place, with equal budget and width of bounds. The dives are batches
without MAVLink bytes.
"""

import argparse
import math
import time  # noqa: TID251 - what a step costs
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from companion import assembly
from companion.config import Config, load_config
from companion.core.law import Motion
from companion.records import Z
from holdfast import RefusedError
from holdfast.arguments import removed_option
from lab.loop.scenarios import positioned
from lab.options import add_bench, seeds_of
from lab.studies.competitors import DEFAULT, Competitor, knobs_of, place_knobs_of, tuned
from lab.studies.dives import interval
from lab.studies.reality import rough
from lab.studies.unlike import COUNTS_S, ENDS_S, hold
from lab.studies.unlike import FIRST_SEED as FIRST
from lab.study import Row, Study, by, known

TUNED_FILE = Path(__file__).with_name("rivals.toml")
PLACE = ("surge", "sway")
STEPS, ROUNDS = 400, 5
"""Of a law's step, to measure what it costs."""

MOTION = Motion(0.01, -0.02, 0.02, 0.0, 28.5, 4.0, 3.0, 6.0, 9.0, 1.0, True)


@dataclass(frozen=True)
class Rival:
    """A law on heave, surge and sway; its own knobs start at `depth` on heave, at `place` on the others."""

    title: str
    module: str = ""
    """Of the law; empty for the paper's."""
    compensator: str = ""
    """Empty for the configuration's own."""
    gains: bool = True
    """Whether it uses λ and κ."""
    depth: Mapping[str, float] | None = None
    place: Mapping[str, float] | None = None


RIVALS: Mapping[str, Rival] = {
    "holdfast": Rival("searched anew"),
    "observer": Rival("law + observer", compensator="observer"),
    "pid": Rival(
        "P-PI", "ppi", "none", False,
        {"k_p": 4.0, "k_v": 8.0, "k_i": 4.0}, {"k_p": 1.5, "k_v": 4.0, "k_i": 2.0},
    ),
    "indi": Rival("INDI", "indi", "none", True, {"omega": 6.0}, {"omega": 3.0}),
    "mpc": Rival(
        "MPC + observer", "mpc", "observer", False,
        {"rate_s": 0.1, "change_mm_per_n": 0.3}, {"rate_s": 0.3, "change_mm_per_n": 1.0},
    ),
}  # fmt: skip


def competitor(name: str, config: Config, *, place: bool) -> Competitor:
    """Return what a search turns of a rival: of its surge and sway, or of its heave."""
    rival, axes, knobs = RIVALS[name], PLACE if place else ("heave",), {}
    law = f"{name}_{'place' if place else 'depth'}"
    settings = [f"laws.{law}.module='lab.rivals.{rival.module}'"] if rival.module else []
    for axis in axes:
        settings += [f"{axis}.law={law!r}"] if rival.module else []
        settings += [f"{axis}.compensator={rival.compensator!r}"] if rival.compensator else []
    for key, value in (place_knobs_of(config) if place else knobs_of(config)).items():
        if not (key.endswith(("lambda_per_s", "kappa_per_s")) and not rival.gains):
            knobs[key] = value
    if rival.compensator:
        knobs.pop("heave.learning_rate", None)
    for key, value in ((rival.place if place else rival.depth) or {}).items():
        knobs[f"laws.{law}.{key}"] = value
    return Competitor(name, rival.title, "companion", knobs, tuple(settings), place)


def overrides(name: str, config: Config, found: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return the settings of a row with what the search found; none for the shipped default."""
    if name == DEFAULT:
        return []
    both = [competitor(name, config, place=place) for place in (False, True)]
    return [text for half in both for text in half.overrides({key: found[name][key] for key in half.knobs})]


class RivalDive(NamedTuple):
    """One dive of one row."""

    row: str
    seed: int


FIGURES = ("depth_rms_mm", "place_rms_mm", "chatter_n", "place_chatter_n", "thrust_rms_n")


class Rivals(Study[RivalDive]):
    """Every row with every vehicle."""

    command = "lab bench rivals"
    about = (
        "Holds the vehicles of `bench reality` with other laws, in depth and in place: compiled dives "
        "without MAVLink bytes, the DVL without drift. The rows were tuned on other such vehicles "
        "(holdfast lab tune --reality)."
    )

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, "default indi mpc")
        instead = "`holdfast lab bench reality --set KEY=VALUE` dives any law in the full loop"
        removed_option(parser, "--messages", instead)

    def __init__(self, arguments: argparse.Namespace) -> None:
        if arguments.firmware is not None:
            raise RefusedError("bench rivals dives without MAVLink bytes: leave --firmware out")
        self._rows: list[str] = arguments.rows or [DEFAULT, *RIVALS]
        known(self._rows, [DEFAULT, *RIVALS], "row")
        self._seeds, config, found = seeds_of(arguments), load_config(), tuned(TUNED_FILE)
        self._configs = {
            row: load_config(overrides=[*overrides(row, config, found), *arguments.set]) for row in self._rows
        }

    def cases(self) -> Sequence[RivalDive]:
        return [RivalDive(row, seed) for row in self._rows for seed in range(FIRST, FIRST + self._seeds)]

    def groups(self, cases: Sequence[RivalDive]) -> Sequence[Sequence[RivalDive]]:
        of_row: dict[str, list[RivalDive]] = {}
        for case in cases:
            of_row.setdefault(case.row, []).append(case)
        return [*of_row.values()]

    def dive(self, cases: Sequence[RivalDive]) -> Iterator[Row]:
        from lab.batch.simulate import simulate

        seeds = [case.seed for case in cases]
        plants = [positioned(rough(seed)) for seed in seeds]
        figures = simulate(self._configs[cases[0].row], plants, hold, ENDS_S, seeds, since_s=COUNTS_S)
        for i in range(len(cases)):
            yield {key: float(values[i]) for key, values in figures.items()}

    def _lines(self, rows: Sequence[Row]) -> Iterator[list[str]]:
        of_row = {name: some for (name,), some in by(rows, "row").items()}
        shipped = of_row.get(DEFAULT)
        for name, some in of_row.items():
            lost = sum(not math.isnan(row["lost_s"]) for row in some)
            mean = {key: float(np.mean([row[key] for row in some])) for key in FIGURES}
            less = {
                key: "" if name == DEFAULT or not shipped else _less(some, shipped, key) for key in FIGURES
            }
            yield [
                title_of(name) + (f" ({lost} lost)" if lost else ""),
                f"{mean['depth_rms_mm']:.2f}",
                less["depth_rms_mm"],
                f"{mean['place_rms_mm']:.1f}",
                less["place_rms_mm"],
                f"{max(row['tilt_deg'] for row in some):.0f}",
                f"{mean['chatter_n']:.1f}",
                f"{mean['place_chatter_n']:.1f}",
                f"{mean['thrust_rms_n']:.1f}",
                f"{step_us(self._configs[name]):.0f}",
            ]

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the table for docs/results.md."""
        columns = (
            *("depth, mm", "depth less, %", "place, mm", "place less, %", "tilt, °"),
            *("chatter in depth, N", "chatter in place, N", "thrust, N", "step, µs"),
        )
        return {"columns": ["", *columns], "rows": [*self._lines(rows)]}


def title_of(name: str) -> str:
    """Return the row's title."""
    return "Holdfast" if name == DEFAULT else RIVALS[name].title


def _less(some: Sequence[Row], shipped: Sequence[Row], key: str) -> str:
    less = np.array([row[key] for row in some]) - np.array([row[key] for row in shipped])
    mean = float(np.mean([row[key] for row in shipped]))
    low, high = interval(less)
    return f"{100.0 * less.mean() / mean:+.0f} ± {50.0 * (high - low) / mean:.0f}"


def step_us(config: Config) -> float:
    """Return what a step of heave's law costs in Python, as on the vehicle: the least mean of ROUNDS, µs."""
    law = assembly.parameters(config).control.axes[Z].law
    least = math.inf
    for _ in range(ROUNDS):
        state, began_s = law.initial(law.parameters), time.perf_counter()
        for _ in range(STEPS):
            state, _terms = law.step(law.parameters, state, MOTION, 0.02)
        least = min(least, (time.perf_counter() - began_s) / STEPS)
    return 1e6 * least
