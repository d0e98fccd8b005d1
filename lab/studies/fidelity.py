"""`holdfast lab bench firmware`: our simulator beside the real firmware with the same plants and seeds."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lab.studies.competitors import DEFAULT
from lab.studies.dives import FIRMWARE, SIMULATOR, Dives, lost
from lab.study import Row, by

ALIKE = 0.15
"""The share by which a standard deviation may differ between the two."""


class Fidelity(Dives):
    """Every dive twice, without added delay: our simulator beside the real firmware."""

    command = "lab bench firmware"
    about = (
        "Compares our simulator with the real ArduSub: depth hold, stock and tuned, and the shipped default. "
        f"An asterisk: the standard deviations differ by more than {ALIKE:.0%}."
    ).replace("%", "%%")
    default_rows = ("alt_hold_stock", "alt_hold", DEFAULT)
    delays = (0,)

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        super().options(parser)
        parser.set_defaults(firmware="")

    def __init__(self, arguments: argparse.Namespace) -> None:
        super().__init__(arguments)
        self.vehicles = (SIMULATOR, FIRMWARE)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        return ()

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        lines = [
            [title, *(_both(some) for some in by(mine, "scenario").values())]
            for _, title, mine in self.by_title(rows)
        ]
        return {"columns": ["depth SD, mm: real ArduSub (our simulator)", *self.scenarios], "rows": lines}


def _both(rows: Sequence[Row]) -> str:
    some = by(rows, "vehicle")
    ours, theirs = some[SIMULATOR,], some[FIRMWARE,]
    ours_mm, theirs_mm = (float(np.mean([row["depth_sd_mm"] for row in each])) for each in (ours, theirs))
    unlike = "*" * (abs(theirs_mm / ours_mm - 1.0) > ALIKE)
    return f"{theirs_mm:.1f}{lost(theirs)} ({ours_mm:.1f}){unlike}"
