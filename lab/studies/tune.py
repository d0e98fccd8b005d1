"""`holdfast lab tune`: a search of gains for the competitors of the bench, or for one's own vehicle."""

import argparse
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rich.console import RenderableType

from companion.config import DEFAULT_FILE, Config, load_config, vehicle_of
from holdfast import RefusedError
from lab.loop.scenarios import ensemble
from lab.options import add_settings, positive
from lab.studies.competitors import (
    DEFAULT,
    TUNED_FILE,
    WIDTH,
    Competitor,
    competitors,
    knobs_of,
    place_knobs_of,
    selected,
)
from lab.studies.own_vehicle import around, nominal, write_config
from lab.studies.search import CASES, EVALUATIONS, TRAINING_S, TRAINING_SEEDS, search, training
from lab.study import Row, Study, ruled
from sim_bridge.commands import DEFAULT_CONFIG, vehicle_file
from sim_bridge.config import load_config as load_plant


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
    recipe = ("set", "vehicle", "config", "place", "evaluations", "seeds")
    variants = {"reality": "lab.studies.tune_rivals:Searches"}  # noqa: RUF012

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
        self._own, place = not arguments.rows, arguments.place
        if place and not self._own:
            raise RefusedError("--place: the rows of the bench are of heave; leave them out")
        self._plant = load_plant(arguments.vehicle)
        believed = nominal(self._plant) if self._own else {}
        self._file: Path = arguments.config
        self._settings = [f"{key}={value}" for key, value in believed.items()] + arguments.set
        self._config = load_config(self._file, self._settings)
        if self._own:
            whole = selected([DEFAULT], self._config)[0]
            title, knobs = ("your surge and sway", place_knobs_of) if place else ("your heave", knobs_of)
            chosen = [replace(whole, title=title, knobs=knobs(self._config), place=place)]
        else:
            chosen = selected(_searchable(arguments.rows, self._config), self._config)
        self._rows = {row.name: row for row in chosen}
        self._seeds: int = arguments.seeds
        self._out: Path | None = arguments.out
        self._command: str = arguments.command
        self.steps = arguments.evaluations

    def journal(self, out: Path | None) -> Path:
        return (out.parent if out else Path("out/tune")) / "tune.jsonl"

    def cases(self) -> Sequence[Search]:
        return [Search(name) for name in self._rows]

    def dive(self, cases: Sequence[Search]) -> Iterator[Row]:
        for case in cases:
            found = search(
                self._rows[case.row],
                lambda overrides: load_config(self._file, [*self._settings, *overrides]),
                self._plant,
                training(self._seeds, around if self._own else ensemble),
                evaluations=self.steps,
                done=self.advance,
            )
            yield found._asdict()

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return what was found, and the command that dives it."""
        columns = ("row", "values", "score before", "score", "evaluations")
        table = ruled("What the search found (score: mean RMS in mm, chatter priced in)", *columns, left=2)
        for row in rows:
            values = ", ".join(f"{key} {value:g}" for key, value in row["values"].items())
            scores = f"{row['start_score']:.2f}", f"{row['score']:.2f}"
            table.add_row(self._rows[row["row"]].title, values, *scores, str(row["evaluations"]))
        yield table
        yield next_step(self._result(self.journal(self._out).parent), [*self._rows], own=self._own)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Write the configuration, or the values of the rows."""
        out = self._result(folder)
        if self._own:
            write_config(self._file, vehicle_of(self._config), rows[0]["values"], out)
        else:
            about = {
                "command": self._command,
                "optimiser": "CMA-ES (cma), seed 1",
                "evaluations_each": max(row["evaluations"] for row in rows),
                "training_seeds": f"0..{self._seeds - 1}",
                "cases": [str(case) for case in CASES],
                "dives_an_evaluation": 4 * self._seeds,
                "seconds_a_dive": TRAINING_S,
            }
            scores = {row["row"]: round(row["score"], 3) for row in rows}
            title = "mean RMS in mm over scenarios, chatter priced in"
            out.write_text(tuned_text(about, title, scores, rows), encoding="utf-8")
        return [out]

    def _result(self, folder: Path) -> Path:
        return self._out or folder / ("companion.toml" if self._own else "tuned.toml")


def tuned_text(
    about: Mapping[str, object], scored: str, scores: Mapping[str, object], rows: Sequence[Row]
) -> str:
    """Return the file of values that a search found: what it was, its scores, the values of each row."""
    lines = ["# Gains of a bench's rows: one search for all, equal budget and width. Not by hand."]
    lines += ["", "[search]", *(f"{key} = {json.dumps(value)}" for key, value in about.items())]
    lines += [f"bounds_factor = {WIDTH}", "", f"[score]  # {scored}"]
    lines += [f'"{name}" = {score}' for name, score in scores.items()]
    for row in rows:
        values: Mapping[str, float] = row["values"]
        lines += ["", f'[values."{row["row"]}"]', *(f'"{key}" = {value!r}' for key, value in values.items())]
    return "\n".join(lines) + "\n"


def next_step(out: Path, names: Sequence[str], *, own: bool) -> str:
    """Return the command that dives what was found."""
    if own:
        return (
            "Dive it: holdfast sim, and in a second terminal\n"
            f"  holdfast run --engage --arm --depth 3 --config {shlex.quote(str(out))}"
        )
    return (
        f"Dive it: put its values into {TUNED_FILE.relative_to(Path(__file__).parents[2])}, then\n"
        f"  holdfast lab bench dives --rows {shlex.join(names)}"
    )


def _searchable(names: Sequence[str], config: Config) -> list[str]:
    every: Sequence[Competitor] = competitors(config)
    fixed = {row.name for row in every if not row.knobs} & set(names)
    if fixed:
        raise RefusedError(f"{', '.join(sorted(fixed))}: nothing to search, it is what it is")
    return [row.name for row in every if row.knobs] if "all" in names else list(names)
