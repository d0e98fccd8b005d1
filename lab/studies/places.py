"""`holdfast lab bench position`: how well each competitor holds places and follows paths of `courses`."""

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

from companion.config import load_config
from holdfast import RefusedError
from lab.options import add_bench, seeds_of
from lab.rivals.alt_hold import TICK_S
from lab.studies.competitors import DEFAULT, FIRST_SEED
from lab.studies.courses import COURSES, ROWS, SETTLES_S, sail
from lab.study import Row, Study, by, known
from lab.style import BLACK, BLUE, GREEN, ORANGE, PRINTED, SMALL, VERMILLION, save
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config as load_plant

FIGURES = (
    *("place_rms_mm", "place_peak_mm", "believed_rms_mm", "depth_rms_mm", "heading_rms_deg"),
    *("tilt_deg", "saturated_percent", "place_chatter_n"),
)
"""Of `Dive.figures`."""
LOOKS = {DEFAULT: (BLUE, "-"), "ppi": (VERMILLION, "-."), "poshold": (GREEN, "--")}
LOOKS["poshold_stock"] = (ORANGE, ":")
SEEN_EVERY = 5
WITH_FIRMWARE = (
    "our simulator has no POSHOLD and GUIDED; use the real ArduSub: --firmware PATH (docs/sitl.md)"
)


class CourseDive(NamedTuple):
    """One dive of one competitor."""

    row: str
    course: str
    seed: int


class Courses(Study[CourseDive]):
    """Every course with every competitor and vehicle."""

    command = "lab bench position"
    about = (
        "Holds a place and follows paths in a current, with a DVL, beside a P-PI and, with --firmware, "
        "ArduSub's POSHOLD and GUIDED. "
        "Exit status 1 if the supervisor gave up a dive."
    )

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, "default ppi", ", ".join(COURSES))

    def __init__(self, arguments: argparse.Namespace) -> None:
        load_config(overrides=arguments.set)
        self._firmware: Path | None = arguments.firmware
        alone = [name for name, row in ROWS.items() if row.autopilot is None]
        self._rows: Sequence[str] = arguments.rows or (alone if self._firmware is None else [*ROWS])
        self._courses: Sequence[str] = arguments.scenarios or [*COURSES]
        known(self._rows, ROWS, "row")
        known(self._courses, COURSES, "scenario")
        if self._firmware is None and (refused := set(self._rows).difference(alone)):
            raise RefusedError(f"row {min(refused)}: {WITH_FIRMWARE}")
        self._seeds = range(FIRST_SEED, FIRST_SEED + seeds_of(arguments))
        self._settings: list[str] = arguments.set
        self._base = load_plant(DEFAULT_CONFIG)

    def cases(self) -> Sequence[CourseDive]:
        return [
            CourseDive(row, course, seed)
            for course, row, seed in product(self._courses, self._rows, self._seeds)
        ]

    def dive(self, cases: Sequence[CourseDive]) -> Iterator[Row]:
        for case in cases:
            course = COURSES[case.course]
            dived = sail(
                case.row, course, self._base, case.seed, settings=self._settings, firmware=self._firmware
            )
            figures = dived.part(slice(round(SETTLES_S / TICK_S) if course.dead else 0, None)).figures()
            row: Row = {"held": dived.held} | {key: figures[key] for key in FIGURES}
            if case.seed == FIRST_SEED:
                seen = {"true": dived.truth, "reference": dived.reference}
                row["trace"] = {name: line[::SEEN_EVERY, :2].round(3).tolist() for name, line in seen.items()}
            yield row

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        lines = [
            [ROWS[name].title]
            + [
                f"{np.mean([dive['place_rms_mm'] for dive in dives]):.0f}"
                + "†" * sum(not dive["held"] for dive in dives)
                for dives in by(mine, "course").values()
            ]
            for (name,), mine in by(rows, "row").items()
        ]
        return {"columns": ["place RMS, mm", *self._courses], "rows": lines}

    def failed(self, rows: Sequence[Row]) -> bool:
        return not all(row["held"] for row in rows)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        courses = by([row for row in rows if "trace" in row], "course")
        with mpl.rc_context(PRINTED):
            figure, panels = plt.subplots(1, len(courses), figsize=(3.3 * len(courses), 3.6), squeeze=False)
            for panel, ((name,), shown) in zip(panels[0], courses.items(), strict=True):
                for row in shown:
                    north, east = np.transpose(row["trace"]["true"])
                    colour, line = LOOKS[row["row"]]
                    title = ROWS[row["row"]].title
                    panel.plot(east, north, color=colour, linestyle=line, linewidth=1.0, label=title)
                north, east = np.transpose(shown[0]["trace"]["reference"])
                still = np.ptp(north) + np.ptp(east) < 0.1
                look: dict[str, Any] = {"linestyle": "none", "marker": "+"} if still else {"linestyle": ":"}
                until = 1 if still else len(east)
                panel.plot(east[:until], north[:until], color=BLACK, markersize=12, label="reference", **look)
                panel.set_aspect("equal", adjustable="datalim")
                panel.set_xlabel("east (m)")
                panel.set_title(COURSES[name].title.replace(", ", ",\n", 1), fontsize=SMALL)
            panels[0][0].set_ylabel("north (m)")
            handles, labels = panels[0][0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=False)
            return [save(figure, folder / "position.png")]
