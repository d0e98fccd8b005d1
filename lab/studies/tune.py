"""`holdfast lab tune`: a search of gains for the rows of the benches."""

import argparse
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import RenderableType

from companion.config import DEFAULT_FILE, Config, load_config
from holdfast import RefusedError, files
from lab.measured_sources import ROOT
from lab.options import add_count, add_settings
from lab.studies.competitors import (
    COMPETITORS,
    DEFAULT,
    TUNED_FILE,
    WIDTH,
    Competitor,
    competitors,
    selected,
    steered,
)
from lab.studies.gain_search import (
    EVALUATIONS,
    TRAINING_SEEDS,
    Stage,
    mean_chatter_n,
    search,
    training,
)
from lab.study import Row, Study, ruled
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config as load_plant


class Search(NamedTuple):
    """The search of one row."""

    row: str


class Tune(Study[Search]):
    """Rows of the benches, in depth and then in place."""

    command = "lab tune"
    about = (
        "Searches gains by CMA-ES over simulated dives for rows of `holdfast lab bench`, on vehicles unlike "
        "the model, first in depth, then in place, at the chatter of the shipped default; for "
        "lab/studies/tuned.toml."
    )
    unit = "searches"
    recipe = ("set", "config", "evaluations", "seeds")

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("rows", nargs="+", metavar="ROW", help="a row of the bench, or all")
        parser.add_argument(
            "--config", type=Path, default=DEFAULT_FILE, metavar="FILE", help="configuration of the companion"
        )
        add_settings(parser)
        add_count(parser, "--evaluations", EVALUATIONS, "evaluations for each row")
        add_count(parser, "--seeds", TRAINING_SEEDS, "number of vehicles")
        parser.add_argument("--out", type=Path, metavar="FILE", help="default: out/tune/")

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._file: Path = arguments.config
        self._settings: list[str] = arguments.set
        self._config = load_config(self._file, self._settings)
        self._plant = load_plant(DEFAULT_CONFIG)
        self._rows = _searched(arguments.rows, self._config)
        self._seeds: int = arguments.seeds
        self._out: Path | None = arguments.out
        if self._out is not None:
            files.refuse_existing(self._out)
        self._command: str = arguments.command
        self._evaluations: int = arguments.evaluations
        self.steps = 2 * self._evaluations

    def journal(self, out: Path | None) -> Path:
        return (out.parent if out else Path("out/tune")) / "tune.jsonl"

    def cases(self) -> Sequence[Search]:
        return [Search(name) for name in self._rows]

    def dive(self, cases: Sequence[Search]) -> Iterator[Row]:
        dives = training(self._seeds)
        for case in cases:
            row, values, scores = self._rows[case.row], dict[str, float](), list[float]()
            fixed = steered(row, self._config, {})
            for place in (False, True):
                knobs, settings = row.knobs(self._config, place=place), row.settings(place=place)
                equal_n = mean_chatter_n(self._config, self._plant, dives, place=place)
                stage = Stage(knobs, settings, place, equal_n)
                load = partial(self._with, fixed)
                found = search(
                    stage, load, self._plant, dives, evaluations=self._evaluations, done=self.advance
                )
                fixed += stage.overrides(found.values)
                values, scores = values | found.values, [*scores, found.start_score, found.score]
            yield {"values": values, "scores": scores, "evaluations": found.evaluations}

    def _with(self, fixed: Sequence[str], overrides: Sequence[str]) -> Config:
        return load_config(self._file, [*self._settings, *fixed, *overrides])

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        columns = "row", "values", "scores, before and after", "evaluations"
        table = ruled("What the search found (score: mean RMS in mm, chatter priced in)", *columns, left=2)
        for row in rows:
            values = ", ".join(f"{key} {value:g}" for key, value in row["values"].items())
            scores = ", ".join(f"{score:.2f}" for score in row["scores"])
            table.add_row(self._rows[row["row"]].title, values, scores, str(row["evaluations"]))
        yield table
        yield next_step([*self._rows])

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        out = self._out or folder / TUNED_FILE.name
        about = {"command": self._command, "training_seeds": f"0..{self._seeds - 1}"}
        out.write_text(tuned_text(about, rows), encoding="utf-8")
        return [out]


def _searched(names: Sequence[str], config: Config) -> dict[str, Competitor]:
    every = {name: row for name, row in competitors(config).items() if row.autopilot is None}
    if fixed := set(names).intersection(COMPETITORS).difference(every):
        raise RefusedError(f"{', '.join(sorted(fixed))}: nothing to search, it is what it is")
    return (
        {name: every[name] for name in every if name != DEFAULT}
        if "all" in names
        else selected(names, config)
    )


def tuned_text(about: Mapping[str, object], rows: Sequence[Row]) -> str:
    """Return the file of values that a search found: what it was, its scores, the values of each row."""
    lines = ["# Gains of the benches' rows: one search for all, equal budget and width. Not by hand."]
    lines += ["", "[search]", *(f"{key} = {json.dumps(value)}" for key, value in about.items())]
    lines += [f"bounds_factor = {WIDTH}", "", "[score]  # mean RMS in mm: before and after, depth and place"]
    lines += [f'"{row["row"]}" = {[round(score, 3) for score in row["scores"]]}' for row in rows]
    for row in rows:
        values: Mapping[str, float] = row["values"]
        lines += ["", f'[values."{row["row"]}"]', *(f'"{key}" = {value!r}' for key, value in values.items())]
    return "\n".join(lines) + "\n"


def next_step(names: Sequence[str]) -> str:
    """Return the command that dives what was found."""
    return (
        f"Dive it: put its values into {TUNED_FILE.relative_to(ROOT)}, then\n"
        f"  holdfast lab bench dives --rows {shlex.join(names)}"
    )
