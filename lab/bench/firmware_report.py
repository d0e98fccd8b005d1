"""`holdfast bench firmware`: our stand-in beside the real firmware with the same plants, seas and seeds."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from rich import box
from rich.table import Table

from lab.bench.bench import SCENARIOS, Run
from lab.bench.rows import ROWS

ALIKE = 0.15
"""The share by which an RMS may differ between the two."""


@dataclass(frozen=True)
class Pair:
    """One row in one scenario on both vehicles: means over the seeds, mm; N a tick for the chatter."""

    row: str
    scenario: str
    seeds: int
    gave_up: tuple[int, int]
    rms_mm: tuple[float, float]
    """Stand-in, firmware; so are the others."""
    mean_mm: tuple[float, float]
    """Of the error with its sign: the firmware's EKF takes its own zero on arming."""
    sd_mm: tuple[float, float]
    chatter_n: tuple[float, float]
    heading_sd_deg: tuple[float, float]

    @property
    def alike(self) -> bool:
        """Whether the deviations about the mean differ by no more than ALIKE."""
        ours, theirs = self.sd_mm
        return abs(theirs / ours - 1.0) <= ALIKE


def pairs(ours: Sequence[Run], theirs: Sequence[Run]) -> list[Pair]:
    """Put together what `lab.bench.measure_both` measured, in its order of rows."""
    result = []
    for row in dict.fromkeys(run.row for run in ours):
        for scenario in SCENARIOS:
            both = [
                [run for run in runs if (run.row, run.scenario) == (row, scenario)] for runs in (ours, theirs)
            ]

            def mean(figure: str, both: list[list[Run]] = both) -> tuple[float, float]:
                one, other = (float(np.mean([run.figures[figure] for run in runs])) for runs in both)
                return one, other

            lost, lost_there = (sum(not run.held for run in runs) for runs in both)
            result.append(
                Pair(
                    row,
                    scenario,
                    len(both[0]),
                    (lost, lost_there),
                    mean("depth_rms_mm"),
                    mean("depth_mean_mm"),
                    mean("depth_sd_mm"),
                    mean("chatter_n"),
                    mean("heading_sd_deg"),
                )
            )
    return result


def side_by_side(measured: Sequence[Pair]) -> Table:
    """Lay the pairs side by side; an asterisk where the deviations differ by more than ALIKE."""
    seeds = measured[0].seeds if measured else 0
    drawn = Table(
        title=f"our stand-in | the real firmware, means of {seeds} vehicles",
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        padding=(0, 1),
        caption=f"* standard deviations differ by more than {ALIKE:.0%}; (n) dives that were given up",
    )
    drawn.add_column("", no_wrap=True)
    for title in ("", "SD mm", "ratio", "mean mm", "RMS mm", "chatter N/tick", "heading SD °"):
        drawn.add_column(title, justify="right" if title else "left")
    titles = {row.name: row.title for row in ROWS}
    for i, pair in enumerate(measured):
        first = i == 0 or measured[i - 1].row != pair.row
        drawn.add_row(
            titles.get(pair.row, pair.row) if first else "",
            pair.scenario,
            _both(pair.sd_mm, ".1f", pair.gave_up),
            f"{pair.sd_mm[1] / pair.sd_mm[0]:.2f}{'' if pair.alike else '*'}",
            _both(pair.mean_mm, "+.1f"),
            _both(pair.rms_mm, ".1f"),
            _both(pair.chatter_n, ".1f"),
            _both(pair.heading_sd_deg, ".2f"),
        )
    return drawn


def as_records(measured: Sequence[Pair]) -> list[dict[str, object]]:
    """Return flat records for JSON."""
    return [asdict(pair) | {"alike": pair.alike} for pair in measured]


def _both(values: tuple[float, float], form: str, gave_up: tuple[int, int] = (0, 0)) -> str:
    cells = [
        f"{value:{form}}" + (f" ({lost})" if lost else "")
        for value, lost in zip(values, gave_up, strict=True)
    ]
    return " | ".join(cells)
