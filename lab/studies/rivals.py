"""`holdfast bench rivals`: other laws on vehicles unlike the model, in depth and in place.

The vehicles are those of `bench reality`. Every rival has our estimator, delay compensation and thruster
curve, and the model that Holdfast has. `holdfast tune --reality` searches each as it does Holdfast itself:
first its depth, then with that its place, with equal budget and width of bounds. The dives are batches
without MAVLink bytes; with --messages the full loop.
"""

import argparse
import json
import math
import time  # noqa: TID251 - what a step costs
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from matplotlib import pyplot as plt
from rich.console import RenderableType

from companion import assembly
from companion.config import Config, load_config
from companion.control.law import Motion
from companion.records import Setpoint, Z
from holdfast import RefusedError
from lab.loop.scenarios import Scenario, positioned
from lab.options import add_bench, seeds_of
from lab.studies.competitors import DEFAULT, WIDTH, Competitor, knobs_of, place_knobs_of, tuned
from lab.studies.dives import interval
from lab.studies.reality import COUNTS_S, DEPTH_M, ENDS_S, Reality, rough
from lab.studies.reality import FIRST_SEED as FIRST
from lab.studies.search import CASES, TRAINING_S, Found, TrainingCase, search
from lab.studies.tune import Search, values_table
from lab.study import Row, Study, by, known, ruled
from lab.style import BLUE, ORANGE, save
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

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


def training(vehicles: int) -> list[tuple[Scenario, TrainingCase]]:
    """Return the dives of a score, on vehicles that no bench dives."""
    return [
        (Scenario("rough", lambda base, seed: rough(seed), _hold, COUNTS_S + TRAINING_S, seed), CASES[0])
        for seed in range(vehicles)
    ]


def _hold(t_s: float) -> Setpoint:
    return Setpoint((0.0, 0.0, DEPTH_M, 0.0))


class Searches(Study[Search]):
    """`holdfast tune --reality`: the depth of each row, and with what it found its place."""

    command = "tune"
    about = "Searches the rows of `holdfast bench rivals`."
    unit = "searches"
    recipe = ("set", "evaluations", "seeds")

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add none: `holdfast tune` has them."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._rows: list[str] = list(RIVALS) if arguments.rows in ([], ["all"]) else arguments.rows
        known(self._rows, list(RIVALS), "row")
        self._settings: list[str] = arguments.set
        self._vehicles: int = arguments.seeds
        self._evaluations: int = arguments.evaluations
        self._command: str = arguments.command
        self._out: Path | None = arguments.out
        self.steps = 2 * self._evaluations

    def journal(self, out: Path | None) -> Path:
        return (out.parent if out else Path("out/tune")) / "tune-reality.jsonl"

    def cases(self) -> Sequence[Search]:
        return [Search(row) for row in self._rows]

    def dive(self, cases: Sequence[Search]) -> Iterator[Row]:
        for (row,) in cases:
            depth = self._found(row, place=False, fixed=())
            heave = competitor(row, load_config(overrides=self._settings), place=False)
            place = self._found(row, place=True, fixed=heave.overrides(depth.values))
            yield {
                "values": depth.values | place.values,
                "scores": [depth.start_score, depth.score, place.start_score, place.score],
                "evaluations": depth.evaluations,
            }

    def _found(self, row: str, *, place: bool, fixed: Sequence[str]) -> Found:
        return search(
            competitor(row, load_config(overrides=self._settings), place=place),
            lambda overrides: load_config(overrides=[*self._settings, *fixed, *overrides]),
            load_plant(DEFAULT_CONFIG),
            training(self._vehicles),
            evaluations=self._evaluations,
            done=self.advance,
        )

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return the scores before and after."""
        title = "Scores: mean RMS in mm, chatter priced in"
        table = ruled(title, "", "depth\nbefore", "depth", "place\nbefore", "place")
        for row in rows:
            table.add_row(RIVALS[row["row"]].title, *(f"{score:.2f}" for score in row["scores"]))
        yield table

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Write the values, with what produced them."""
        out = self._out or folder / TUNED_FILE.name
        lines = [
            "# Gains of the rows of `holdfast bench rivals`: one search for all. Not by hand.",
            "",
            "[search]",
            f"command = {json.dumps(self._command)}",
            f"evaluations_of_depth_and_of_place = {max(row['evaluations'] for row in rows)}",
            f'training_seeds = "0..{self._vehicles - 1}"',
            f"seconds_a_dive = {TRAINING_S}",
            f"bounds_factor = {WIDTH}",
            "",
            "[score]  # mean RMS in mm, chatter priced in: depth before and after, place before and after",
            *(f"{row['row']} = {[round(score, 3) for score in row['scores']]}" for row in rows),
        ]
        for row in rows:
            lines += ["", *values_table(row)]
        out.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return [out]


class RivalDive(NamedTuple):
    """One dive of one row."""

    row: str
    seed: int


FIGURES = ("depth_rms_mm", "place_rms_mm", "chatter_n", "place_chatter_n", "thrust_rms_n")
COLUMNS = (
    "depth\nmm",
    "less,\n%",
    "place\nmm",
    "less,\n%",
    "tilt\n°",
    "chatter, N\nheave",
    "\nplace",
    "thrust\nN",
    "step\nµs",
)
"""Means of all vehicles, less that of the default; of the tilt the largest; chatter of the command."""


class Rivals(Study[RivalDive]):
    """Every row with every vehicle."""

    command = "bench rivals"
    about = (
        "Holds the vehicles of `bench reality` with other laws, in depth and in place: compiled dives "
        "without MAVLink bytes, the DVL without drift. The rows were tuned on other such vehicles "
        "(holdfast tune --reality)."
    )

    variants: ClassVar = {"messages": "lab.studies.rivals:WithMessages"}

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, "default indi mpc")
        parser.add_argument(
            "--messages",
            action="store_true",
            help="the full loop, with MAVLink bytes; the DVL drifts",
        )

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
        figures = simulate(self._configs[cases[0].row], plants, _hold, ENDS_S, seeds, since_s=COUNTS_S)
        for i in range(len(cases)):
            yield {key: float(values[i]) for key, values in figures.items()}

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        table = ruled(f"{self._seeds} vehicles of `bench reality`; ±: 95 %", "", *COLUMNS, padding=0)
        for line in self._lines(rows):
            table.add_row(*line)
        yield table

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

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw depth and place of each row, every dive a dot."""
        of_row = {name: some for (name,), some in by(rows, "row").items()}
        figure, panels = plt.subplots(
            1, 2, figsize=(10.0, 1.4 + 0.4 * len(of_row)), sharey=True, layout="constrained"
        )
        for panel, key, label in zip(
            panels, ("depth_rms_mm", "place_rms_mm"), ("depth RMS (mm)", "place RMS (mm)"), strict=True
        ):
            for y, some in enumerate(of_row.values()):
                values = np.array([row[key] for row in some])
                panel.plot(values, np.full(len(values), y), ".", color=BLUE, alpha=0.4)
                panel.plot(values.mean(), y, "D", color=ORANGE, markeredgecolor="black")
            panel.set_xscale("log")
            panel.set_xlabel(label)
            panel.grid(axis="x", which="both", alpha=0.3)
        panels[0].set_yticks(range(len(of_row)), [title_of(name) for name in of_row])
        panels[0].invert_yaxis()
        figure.suptitle("each dot a vehicle, diamond: mean", fontsize=10)
        return [save(figure, folder / "rivals.png", dpi=130)]


class WithMessages(Reality):
    """`bench rivals --messages`: the same rows in the full loop."""

    command = "bench rivals"
    presets = (DEFAULT, *RIVALS)
    goals: ClassVar = {}

    def __init__(self, arguments: argparse.Namespace) -> None:
        arguments.seeds, arguments.scenarios = seeds_of(arguments), None
        super().__init__(arguments)

    def overrides(self, preset: str) -> list[str]:
        return overrides(preset, load_config(), tuned(TUNED_FILE))


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
