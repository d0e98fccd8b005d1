"""`holdfast lab campaign`: thousands of dives, each with a vehicle, a link and a sea drawn from its number.

`campaign_cases` draws them. No supervisor dives along in a batch.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType

from companion.config import load_config
from lab.batch.stand_in import Links
from lab.loop.scenarios import SETTLE_S, hold
from lab.options import add_count, add_out, add_settings
from lab.studies.campaign_cases import BLUEROV2, ENVELOPE, VEHICLES, CampaignCase, case, configured, plant
from lab.study import Row, Study, by

SINCE_S, DURATION_S = SETTLE_S, SETTLE_S + 40.0
"""Since boot: from when on figures count, and when a dive ends."""

BATCH = 1000
"""Dives at once at most: fewer cost more of the interpreter's time, more leave workers idle at the end."""

OUTCOMES = ("held", "strays", "lost")
"""Outcomes."""

HELD_TAIL_MM, HELD_PEAK_MM, HELD_TILT_DEG = 100.0, 500.0, 60.0
"""A dive held if its depth RMS of the last ten seconds, its depth's peak and its tilt stayed below these. Its
place is told, not judged: with a dead thruster a current may be stronger than those that are left."""


def _outcome(figures: Row) -> str:
    if not np.isnan(figures["lost_s"]):
        return "lost"
    near = figures["tail_rms_mm"] <= HELD_TAIL_MM and figures["depth_peak_mm"] <= HELD_PEAK_MM
    return "held" if near and figures["tilt_deg"] <= HELD_TILT_DEG else "strays"


def case_of(row: Row) -> CampaignCase:
    """Return the case of a row."""
    return CampaignCase(*(row[field] for field in CampaignCase._fields))


class Campaign(Study[CampaignCase]):
    """The dives of a range of numbers, in batches."""

    command = "lab campaign"
    about = (
        "Simulates every published vehicle with a DVL, varied damping, mass and thrust, with delays, dead "
        "thrusters and disturbances. The number of a dive is its seed. Each dive appends a row to "
        "DIR/dives.jsonl; if a run was interrupted, the same command continues it. At the end DIR/dives.csv "
        "has the rows. "
        "Exit status 1 if Holdfast lost a vehicle inside the declared envelope."
    )
    recipe = ("set",)
    keeps_rows = True
    rows_key = "each"

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_count(parser, "--dives", 6000, "dives")
        add_count(parser, "--first", 0, "number of the first dive", least=0)
        add_settings(parser)
        add_out(parser, "out/campaign")

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._numbers = range(arguments.first, arguments.first + arguments.dives)
        self._config = load_config(overrides=arguments.set)

    def journal(self, out: Path) -> Path:
        return out / "dives.jsonl"

    def cases(self) -> Sequence[CampaignCase]:
        return [case(number) for number in self._numbers]

    def groups(self, cases: Sequence[CampaignCase]) -> Sequence[Sequence[CampaignCase]]:
        parts: list[list[CampaignCase]] = []
        for six in (False, True):
            group = [one for one in cases if (one.vehicle == BLUEROV2) is six]
            count = -(-len(group) // BATCH)
            parts += [group[i::count] for i in range(count)]
        return sorted(parts, key=len, reverse=True)

    def dive(self, cases: Sequence[CampaignCase]) -> Iterator[Row]:
        from lab.batch.simulate import simulate  # needs numba, which the command's help does not

        half_s = 0.5e-3 * np.array([chosen.delay_ms for chosen in cases])
        found = simulate(
            configured(self._config, cases[0].vehicle),
            [plant(chosen) for chosen in cases],
            hold(),
            DURATION_S,
            [chosen.number for chosen in cases],
            Links(up_s=half_s, down_s=half_s, jitter_s=0.004),
            since_s=SINCE_S,
        )
        for i in range(len(cases)):
            figures = {key: round(float(values[i]), 4) for key, values in found.items()}
            yield {"outcome": _outcome(figures)} | figures

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        yield from super().tables(rows)
        yield "[bold]The envelope[/bold], inside which every dive must hold:"
        yield from (f"  · {line}" for line in ENVELOPE)
        for row in rows:
            if row["outcome"] != "held" and case_of(row).inside:
                yield f"[red]{row['outcome']}[/red]: {case_of(row)}"

    def failed(self, rows: Sequence[Row]) -> bool:
        return any(row["outcome"] != "held" and case_of(row).inside for row in rows)

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return outcomes by vehicle and dead thruster, and inside and outside the envelope.

        Depth and place are the median and the 99th percentile of the RMS of dives that held, mm.
        """
        groups = by([row | {"motor": case_of(row).dead_motor} for row in rows], "vehicle", "motor")
        order = sorted(groups, key=lambda group: (VEHICLES.index(group[0]), group[1]))
        lines = [[*group, *_counts(groups[group])] for group in order]
        for within, name in ((True, "inside"), (False, "outside")):
            lines.append([name, "", *_counts([row for row in rows if case_of(row).inside is within])])
        columns = ["vehicle", "dead thruster", "dives", *OUTCOMES, "depth", "99 %", "place", "99 %"]
        return {"columns": columns, "rows": lines, "envelope": ENVELOPE}


def _counts(rows: Sequence[Row]) -> list[str]:
    outcomes = Counter(row["outcome"] for row in rows)
    counts = [str(len(rows)), *(str(outcomes[outcome]) for outcome in OUTCOMES)]
    for key in ("depth_rms_mm", "place_rms_mm"):
        rms = [row[key] for row in rows if row["outcome"] == "held"]
        counts += [f"{np.quantile(rms, share):.1f}" if rms else "" for share in (0.5, 0.99)]
    return counts
