"""`holdfast lab bench firmware`: our simulator beside the real firmware with the same plants and seeds."""

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.studies.competitors import DEFAULT
from lab.studies.dives import BenchDive, Dives
from lab.study import Row, by

ALIKE = 0.15
"""The share by which a standard deviation may differ between the two."""


class FirmwareDive(NamedTuple):
    """A dive of the bench with the `simulator` or the `firmware`."""

    vehicle: str
    row: str
    scenario: str
    delay_ms: int
    seed: int


class Fidelity(Dives):
    """Every dive twice, without added delay."""

    command = "lab bench firmware"
    about = (
        "Compares our simulator with the real ArduSub: depth hold, stock and tuned, and the shipped default. "
        f"An asterisk: the standard deviations differ by more than {ALIKE:.0%}."
    ).replace("%", "%%")
    default_rows = ("alt_hold_stock", "alt_hold", DEFAULT)

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add the options of a bench; the firmware is needed."""
        super().options(parser)
        parser.set_defaults(firmware="")

    def cases(self) -> Sequence[Any]:
        """Return the dives of our simulator, then those of the firmware."""
        vehicles = ("simulator", "firmware")
        return [
            FirmwareDive(*case) for case in product(vehicles, self._rows, self._scenarios, (0,), self._seeds)
        ]

    def dive(self, cases: Sequence[Any]) -> Iterator[Row]:
        """Dive with the vehicle that each case names."""
        for case in cases:
            firmware = self._firmware if case.vehicle == "firmware" else None
            yield self.dived(BenchDive(*case[1:]), firmware)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw nothing."""
        return ()

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return deviations with the firmware, in brackets with ours; † is a dive that was given up."""
        lines = [
            [self.titles[name], *(_both(some) for some in by(mine, "scenario").values())]
            for (name,), mine in sorted(by(rows, "row").items(), key=lambda row: row[0] != (DEFAULT,))
        ]
        return {"columns": ["depth SD, mm: real ArduSub (our simulator)", *self._scenarios], "rows": lines}


def _both(rows: Sequence[Row]) -> str:
    ours, theirs = (some for _, some in sorted(by(rows, "vehicle").items(), reverse=True))
    ours_mm, theirs_mm = (float(np.mean([row["depth_sd_mm"] for row in some])) for some in (ours, theirs))
    unlike = "*" * (abs(theirs_mm / ours_mm - 1.0) > ALIKE)
    lost = "†" * sum(not row["held"] for row in theirs)
    return f"{theirs_mm:.1f}{lost} ({ours_mm:.1f}){unlike}"
