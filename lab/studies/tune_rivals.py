"""`holdfast lab tune --reality`: the search of the rows of `holdfast lab bench rivals`."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import RenderableType

from companion.config import load_config
from lab.loop.scenarios import Scenario
from lab.studies.reality import rough
from lab.studies.rivals import RIVALS, TUNED_FILE, competitor
from lab.studies.search import CASES, TRAINING_S, Found, TrainingCase, search
from lab.studies.tune import Search, tuned_text
from lab.studies.unlike import COUNTS_S, hold
from lab.study import Row, Study, known, ruled
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant


def training(vehicles: int) -> list[tuple[Scenario, TrainingCase]]:
    """Return the dives of a score, on vehicles that no bench dives."""
    return [
        (Scenario("rough", lambda base, seed: rough(seed), hold, COUNTS_S + TRAINING_S, seed), CASES[0])
        for seed in range(vehicles)
    ]


class Searches(Study[Search]):
    """`holdfast lab tune --reality`: the depth of each row, and with what it found its place."""

    command = "lab tune"
    about = "Searches the rows of `holdfast lab bench rivals`."
    unit = "searches"
    recipe = ("set", "evaluations", "seeds")

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add none: `holdfast lab tune` has them."""

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
        about = {
            "command": self._command,
            "evaluations_of_depth_and_of_place": max(row["evaluations"] for row in rows),
            "training_seeds": f"0..{self._vehicles - 1}",
            "seconds_a_dive": TRAINING_S,
        }
        scores = {row["row"]: [round(score, 3) for score in row["scores"]] for row in rows}
        title = "mean RMS in mm, chatter priced in: depth before and after, place before and after"
        out.write_text(tuned_text(about, title, scores, rows), encoding="utf-8")
        return [out]
