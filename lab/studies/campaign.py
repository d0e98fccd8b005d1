"""`holdfast lab campaign`: thousands of dives, each with a vehicle, a link and a sea drawn from its number.

`campaign_cases` draws them, `corners` and `replay` are studies of their own.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType

from companion.config import load_config
from lab.batch.stand_in import ENGAGED_S, Links
from lab.loop.scenarios import SETTLE_S, hold
from lab.options import add_out, add_settings, not_negative, positive
from lab.studies.campaign_cases import BLUEROV2, ENVELOPE, VEHICLES, CampaignCase, case, configured, plant
from lab.study import Row, Study, by, ruled

SINCE_S, DURATION_S = SETTLE_S, SETTLE_S + 40.0
"""Since boot: from when on figures count, and when a dive ends."""

BATCH = 1000
"""Dives at once at most: fewer cost more of the interpreter's time, more leave workers idle at the end."""

WORST = 3
"""Dives that are named, inside the envelope and outside."""

OF = ("depth_rms_mm", "place_rms_mm")
RANK = {"lost": 2, "strays": 1, "held": 0}

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


def batches(cases: Iterable[CampaignCase]) -> list[list[CampaignCase]]:
    """Sort cases into batches of one frame each, the longest first."""
    groups: dict[bool, list[CampaignCase]] = {}
    for chosen in cases:
        groups.setdefault(chosen.vehicle == BLUEROV2, []).append(chosen)
    parts = []
    for group in groups.values():
        count = -(-len(group) // BATCH)
        parts += [group[i::count] for i in range(count)]
    return sorted(parts, key=len, reverse=True)


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
    variants = {  # noqa: RUF012
        "replay": "lab.studies.replay:Replay",
        "corners": "lab.studies.corners:Corners",
    }
    recipe = ("set",)
    keeps_rows = True
    rows_key = "each"

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--dives", type=positive, default=6000, metavar="N", help="default %(default)s")
        parser.add_argument(
            "--first", type=not_negative, default=0, metavar="ID", help="number of the first dive; default 0"
        )
        parser.add_argument(
            "--replay",
            type=not_negative,
            metavar="ID",
            help="repeat only this dive, in the batch and in the full loop",
        )
        parser.add_argument(
            "--corners",
            action="store_true",
            help="instead 32 vehicles of 1/3 and 3 times the nominal gain, with lags and delays, in the full "
            "loop; exit status 1 if one oscillates for 3 s or is given up",
        )
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
        return batches(cases)

    def dive(self, cases: Sequence[CampaignCase]) -> Iterator[Row]:
        from lab.batch.simulate import simulate  # needs numba, which the command's help does not

        delay_s = 1e-3 * np.array([chosen.delay_ms for chosen in cases])
        found = simulate(
            configured(self._config, cases[0].vehicle),
            [plant(chosen) for chosen in cases],
            hold(),
            DURATION_S,
            [chosen.number for chosen in cases],
            Links(up_s=0.5 * delay_s, down_s=0.5 * delay_s, jitter_s=0.004),
            since_s=SINCE_S,
        )
        for i in range(len(cases)):
            figures = {key: round(float(values[i]), 4) for key, values in found.items()}
            yield {"outcome": _outcome(figures)} | figures

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return the outcomes by vehicle and dead thruster, the envelope, and the worst dives."""
        table = ruled(
            f"{len(rows)} dives of {DURATION_S - ENGAGED_S:.0f} s, from engaging on",
            "vehicle", "dead thruster", "dives", "held", "strays", "lost", "depth RMS mm", "99 % mm",
            "place RMS mm", "99 % mm", left=2,
        )  # fmt: skip
        inside, outside = _split(rows)
        for name, dead, some in [*_groups(rows), ("inside", "", inside), ("outside", "", outside)]:
            counts = _counts(some)
            numbers = (str(counts[key]) for key in ("dives", "held", "strays", "lost"))
            rms = (counts[f"held_{of}_{which}"] for of in OF for which in ("median", "p99"))
            table.add_row(name, dead, *numbers, *("" if x is None else f"{x:.1f}" for x in rms))
        yield table
        yield "[bold]The envelope[/bold], inside which every dive must hold:"
        yield from (f"  · {line}" for line in ENVELOPE)
        count = _counts(inside)["not_held"]
        yield f"[red]{count} dives inside it did not hold[/red]" if count else "All dives inside it held."
        yield "No supervisor dives along in a batch: what it does with a lost vehicle, --replay shows."
        for where, some in (("inside", inside), ("outside", outside)):
            if some:
                yield f"Worst {where}:"
            for row in _worst(some):
                rms_mm, tilt_deg, number = row["depth_rms_mm"], row["tilt_deg"], row["number"]
                yield (
                    f"  {case_of(row)}: {row['outcome']}, depth RMS {rms_mm:.1f} mm, tilt {tilt_deg:.0f}°  "
                    f"·  holdfast lab campaign --replay {number}"
                )

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a dive inside the envelope did not hold."""
        return bool(_counts(_split(rows)[0])["not_held"])

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return outcomes inside and outside the envelope, and by vehicle and dead thruster."""
        inside, outside = map(_counts, _split(rows))
        return {
            "dives": len(rows),
            "envelope": ENVELOPE,
            "inside": inside,
            "outside": outside,
            "by": [{"vehicle": name, "dead": dead, **_counts(some)} for name, dead, some in _groups(rows)],
        }


def _split(rows: Iterable[Row]) -> tuple[list[Row], list[Row]]:
    """Return the rows inside the envelope, and the others."""
    inside: tuple[list[Row], list[Row]] = [], []
    for row in rows:
        inside[not case_of(row).inside].append(row)
    return inside


def _worst(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: (RANK[row["outcome"]], row["depth_rms_mm"]), reverse=True)[:WORST]


def _counts(rows: Sequence[Row]) -> dict[str, Any]:
    outcomes = Counter(row["outcome"] for row in rows)
    held = [row for row in rows if row["outcome"] == "held"]
    counts: dict[str, Any] = {
        "dives": len(rows),
        **{outcome: outcomes[outcome] for outcome in RANK},
        "not_held": len(rows) - outcomes["held"],
    }
    for of in OF:
        rms = [row[of] for row in held]
        counts[f"held_{of}_median"] = round(float(np.median(rms)), 2) if held else None
        counts[f"held_{of}_p99"] = round(float(np.quantile(rms, 0.99)), 2) if held else None
    return counts


def _groups(rows: Sequence[Row]) -> Iterator[tuple[str, str, list[Row]]]:
    """Give the rows of each vehicle with no, a horizontal and a vertical thruster dead."""
    for (name,), some in sorted(by(rows, "vehicle").items(), key=lambda item: VEHICLES.index(item[0][0])):
        for dead in ("none", "horizontal", "vertical"):
            if of_it := [row for row in some if _dead(row) == dead]:
                yield name, dead, of_it


def _dead(row: Row) -> str:
    return "vertical" if case_of(row).dead_vertical else "horizontal" if row["dead"] else "none"
