"""`holdfast lab tune`: a search of gains for the competitors of the bench, or for one's own vehicle."""

import argparse
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import RenderableType

from companion.config import DEFAULT_FILE, Config, load_config, vehicle_of
from holdfast import RefusedError, files
from lab.loop.scenarios import Scenario, ensemble
from lab.options import add_settings, positive
from lab.sources import ROOT
from lab.studies import competitors as of_dives
from lab.studies import rivals as of_rivals
from lab.studies.competitors import (
    DEFAULT,
    WIDTH,
    Competitor,
    competitors,
    knobs_of,
    place_knobs_of,
    selected,
)
from lab.studies.own_vehicle import around, nominal, vehicle_beside, write_config
from lab.studies.rivals import RIVALS, competitor
from lab.studies.search import (
    EVALUATIONS,
    TRAINING_S,
    TRAINING_SEEDS,
    TrainingCase,
    search,
    training,
    training_of_reality,
)
from lab.study import Row, Study, known, ruled
from sim_bridge.commands import DEFAULT_CONFIG, vehicle_file
from sim_bridge.config import load_config as load_plant

TUNED_FILES = {"dives": of_dives.TUNED_FILE, "rivals": of_rivals.TUNED_FILE}
"""By bench, the file of what a search found for its rows."""


class Search(NamedTuple):
    """The search of one row."""

    row: str


class Tune(Study[Search]):
    """Rows of the bench, or without any the configuration's own heave, or its surge and sway."""

    command = "lab tune"
    about = (
        "Searches gains of heave, or of surge and sway, by CMA-ES over simulated dives: half of them with "
        "40 ms more delay each way, half with 15 % more thrust and 40 ms of hidden delay. Without ROW it "
        "tunes your configuration for your vehicle and writes a configuration file. With ROW it tunes rows "
        "of `holdfast lab bench`, for lab/studies/tuned.toml."
    )
    unit = "searches"
    recipe = ("set", "vehicle", "config", "place", "reality", "evaluations", "seeds")

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("rows", nargs="*", metavar="ROW", help="a row of the bench, or all")
        parser.add_argument(
            "--vehicle",
            type=vehicle_file,
            default=DEFAULT_CONFIG,
            metavar="NAME|FILE",
            help="the simulated vehicle, as of `holdfast sim` (default: heavy)",
        )
        parser.add_argument(
            "--config", type=Path, default=DEFAULT_FILE, metavar="FILE", help="configuration of the companion"
        )
        add_settings(parser)
        parser.add_argument(
            "--place", action="store_true", help="surge and sway of your configuration, not heave; with a DVL"
        )
        parser.add_argument(
            "--reality",
            action="store_true",
            help="ROW is one of `holdfast lab bench rivals`: depth, then place",
        )
        parser.add_argument(
            "--evaluations",
            type=positive,
            default=EVALUATIONS,
            metavar="N",
            help="evaluations for each row; default %(default)s",
        )
        parser.add_argument(
            "--seeds",
            type=positive,
            default=TRAINING_SEEDS,
            metavar="N",
            help="number of vehicles; default %(default)s",
        )
        parser.add_argument("--out", type=Path, metavar="FILE", help="default: out/tune/")

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._bench = "rivals" if arguments.reality else "dives" if arguments.rows else ""
        """Whose rows are searched; empty for one's own configuration."""
        self._own = not self._bench
        if arguments.place and not self._own:
            raise RefusedError("--place is of your own configuration: leave ROW and --reality out")
        self._plant = load_plant(arguments.vehicle)
        believed = nominal(self._plant) if self._own else {}
        self._file: Path = arguments.config
        self._settings = [f"{key}={value}" for key, value in believed.items()] + arguments.set
        self._config = load_config(self._file, self._settings)
        self._rows = self._searched(arguments.rows, place=arguments.place)
        self._seeds: int = arguments.seeds
        self._out: Path | None = arguments.out
        if self._out is not None:
            files.refuse_existing(self._out, *([vehicle_beside(self._out)] if self._own else []))
        self._command: str = arguments.command
        self._evaluations: int = arguments.evaluations
        self.steps = self._evaluations * max(len(stages) for stages in self._rows.values())

    def _searched(self, names: Sequence[str], *, place: bool) -> dict[str, tuple[Competitor, ...]]:
        """Return the searches of each row: one, or that of its depth and with what it found of its place."""
        config = self._config
        if self._bench == "rivals":
            every = list(RIVALS)
            known([name for name in names if name != "all"], every, "row")
            chosen = every if not names or "all" in names else names
            return {
                name: (competitor(name, config, place=False), competitor(name, config, place=True))
                for name in chosen
            }
        if self._bench:
            return {row.name: (row,) for row in selected(_searchable(names, config), config)}
        (whole,) = selected([DEFAULT], config)
        title, knobs = ("your surge and sway", place_knobs_of) if place else ("your heave", knobs_of)
        return {DEFAULT: (replace(whole, title=title, knobs=knobs(config), place=place),)}

    @property
    def _dives(self) -> list[tuple[Scenario, TrainingCase]]:
        """Return the dives of a score."""
        if self._bench == "rivals":
            return training_of_reality(self._seeds)
        return training(self._seeds, around if self._own else ensemble)

    def journal(self, out: Path | None) -> Path:
        return (out.parent if out else Path("out/tune")) / "tune.jsonl"

    def cases(self) -> Sequence[Search]:
        return [Search(name) for name in self._rows]

    def dive(self, cases: Sequence[Search]) -> Iterator[Row]:
        for case in cases:
            values, scores, fixed = dict[str, float](), list[float](), list[str]()
            for stage in self._rows[case.row]:
                found = search(
                    stage,
                    partial(self._with, fixed),
                    self._plant,
                    self._dives,
                    evaluations=self._evaluations,
                    done=self.advance,
                )
                fixed = stage.overrides(found.values)
                values, scores = values | found.values, [*scores, found.start_score, found.score]
            yield {"values": values, "scores": scores, "evaluations": found.evaluations}

    def _with(self, fixed: Sequence[str], overrides: Sequence[str]) -> Config:
        return load_config(self._file, [*self._settings, *fixed, *overrides])

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return what was found, and the command that dives it."""
        columns = "row", "values", "scores, before and after", "evaluations"
        table = ruled("What the search found (score: mean RMS in mm, chatter priced in)", *columns, left=2)
        for row in rows:
            values = ", ".join(f"{key} {value:g}" for key, value in row["values"].items())
            scores = ", ".join(f"{score:.2f}" for score in row["scores"])
            table.add_row(self._rows[row["row"]][0].title, values, scores, str(row["evaluations"]))
        yield table
        yield next_step(self._result(self.journal(self._out).parent), [*self._rows], self._bench)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Write the configuration, or the values of the rows."""
        out = self._result(folder)
        if self._own:
            write_config(self._file, vehicle_of(self._config), rows[0]["values"], out)
        else:
            dives = self._dives
            about = {
                "command": self._command,
                "optimiser": "CMA-ES (cma), seed 1",
                "evaluations_each": max(row["evaluations"] for row in rows),
                "training_seeds": f"0..{self._seeds - 1}",
                "cases": [str(case) for case in dict.fromkeys(case for _, case in dives)],
                "dives_an_evaluation": len(dives),
                "seconds_a_dive": TRAINING_S,
            }
            out.write_text(tuned_text(about, rows), encoding="utf-8")
        return [out]

    def _result(self, folder: Path) -> Path:
        name = TUNED_FILES[self._bench].name if self._bench else "companion.toml"
        return self._out or folder / name


def tuned_text(about: Mapping[str, object], rows: Sequence[Row]) -> str:
    """Return the file of values that a search found: what it was, its scores, the values of each row."""
    lines = ["# Gains of a bench's rows: one search for all, equal budget and width. Not by hand."]
    lines += ["", "[search]", *(f"{key} = {json.dumps(value)}" for key, value in about.items())]
    lines += [f"bounds_factor = {WIDTH}", "", "[score]  # mean RMS in mm: before and after, depth and place"]
    lines += [f'"{row["row"]}" = {[round(score, 3) for score in row["scores"]]}' for row in rows]
    for row in rows:
        values: Mapping[str, float] = row["values"]
        lines += ["", f'[values."{row["row"]}"]', *(f'"{key}" = {value!r}' for key, value in values.items())]
    return "\n".join(lines) + "\n"


def next_step(out: Path, names: Sequence[str], bench: str) -> str:
    """Return the command that dives what was found; `bench` is empty for one's own vehicle."""
    if not bench:
        return (
            "Dive it: holdfast sim, and in a second terminal\n"
            f"  holdfast run --engage --arm --depth 3 --config {shlex.quote(str(out))}"
        )
    return (
        f"Dive it: put its values into {TUNED_FILES[bench].relative_to(ROOT)}, then\n"
        f"  holdfast lab bench {bench} --rows {shlex.join(names)}"
    )


def _searchable(names: Sequence[str], config: Config) -> list[str]:
    every: Sequence[Competitor] = competitors(config)
    fixed = {row.name for row in every if not row.knobs} & set(names)
    if fixed:
        raise RefusedError(f"{', '.join(sorted(fixed))}: nothing to search, it is what it is")
    return [row.name for row in every if row.knobs] if "all" in names else list(names)
