"""`holdfast bench firmware`: our simulator beside the real firmware with the same plants, seas and seeds."""

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from lab.studies.competitors import DEFAULT
from lab.studies.dives import BenchDive, Dives
from lab.study import Row, by, ruled

ALIKE = 0.15
"""The share by which a standard deviation may differ between the two."""

COLUMNS = {
    "mean_mm": ("depth_mean_mm", "+.1f"),
    "rms_mm": ("depth_rms_mm", ".1f"),
    "chatter_n": ("chatter_n", ".1f"),
    "heading_sd_deg": ("heading_sd_deg", ".2f"),
}
"""What is compared beside the deviation of depth."""


class FirmwareDive(NamedTuple):
    """A dive of the bench with the `simulator` or the `firmware`."""

    vehicle: str
    row: str
    scenario: str
    delay_ms: int
    seed: int


class Fidelity(Dives):
    """Every dive twice, without added delay."""

    command = "bench firmware"
    about = (
        "Compares our simulator with the real ArduSub: depth hold, stock and tuned, and the shipped default."
    )
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

    def tables(self, rows: Sequence[Row]) -> Iterator[Table]:
        """Lay the two side by side; an asterisk where the deviations differ by more than ALIKE."""
        table = ruled(
            f"our simulator | the real firmware, means of {len(self._seeds)} vehicles",
            "", " ", "SD mm", "ratio", "mean mm", "RMS mm", "chatter N/tick", "heading SD °",
            left=2,
            caption=f"* standard deviations differ by more than {ALIKE:.0%}; (n) dives that were given up",
        )  # fmt: skip
        for (name,), mine in by(pairs(rows), "row").items():
            for i, pair in enumerate(mine):
                ratio = pair["sd_mm"][1] / pair["sd_mm"][0]
                table.add_row(
                    "" if i else self.titles[name],
                    pair["scenario"],
                    _both(pair["sd_mm"], ".1f", pair["gave_up"]),
                    f"{ratio:.2f}{'' if pair['alike'] else '*'}",
                    *(_both(pair[key], form) for key, (_, form) in COLUMNS.items()),
                )
        yield table

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw nothing."""
        return ()

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the table for docs/results.md: deviations with the firmware, and in brackets with ours."""
        measured = by(pairs(rows), "row")
        lines = [
            [self.titles[name]]
            + [
                f"{pair['sd_mm'][1]:.1f}" + "†" * pair["gave_up"][1] + f" ({pair['sd_mm'][0]:.1f})"
                for pair in mine
            ]
            for (name,), mine in sorted(measured.items(), key=lambda row: row[0] != (DEFAULT,))
        ]
        return {"columns": ["depth SD, mm: real ArduSub (our simulator)", *self._scenarios], "rows": lines}


def pairs(rows: Sequence[Row]) -> list[Row]:
    """Return each competitor in each scenario: means over the seeds, (simulator, firmware) each.

    `mean_mm` is the mean of the error with its sign: the firmware's EKF takes its own zero on arming.
    """
    result = []
    for (name, scenario), some in by(rows, "row", "scenario").items():
        by_vehicle = [*by(some, "vehicle").values()]

        def mean(key: str, by_vehicle: list[list[Row]] = by_vehicle) -> tuple[float, ...]:
            return tuple(float(np.mean([row[key] for row in dives])) for dives in by_vehicle)

        ours_mm, theirs_mm = sd_mm = mean("depth_sd_mm")
        result.append(
            {
                "row": name,
                "scenario": scenario,
                "seeds": len(by_vehicle[0]),
                "gave_up": tuple(sum(not row["held"] for row in dives) for dives in by_vehicle),
                "sd_mm": sd_mm,
            }
            | {key: mean(figure) for key, (figure, _) in COLUMNS.items()}
            | {"alike": abs(theirs_mm / ours_mm - 1.0) <= ALIKE}
        )
    return result


def _both(values: Sequence[float], form: str, gave_up: Sequence[int] = (0, 0)) -> str:
    cells = (
        f"{value:{form}}" + (f" ({lost})" if lost else "")
        for value, lost in zip(values, gave_up, strict=True)
    )
    return " | ".join(cells)
