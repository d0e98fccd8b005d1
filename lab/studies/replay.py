"""`holdfast lab campaign --replay`: one dive of a campaign, as the batch and as the full loop have it."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import RenderableType

from lab.loop.dive import dive
from lab.studies import campaign
from lab.studies.campaign_cases import CampaignCase, configured, link, plant, scenario
from lab.study import Row, ruled


class Replay(campaign.Campaign):
    """One dive of a campaign, as the batch and as the full loop have it."""

    command = "lab campaign replay"
    keeps_rows = False

    def __init__(self, arguments: argparse.Namespace) -> None:
        super().__init__(arguments)
        self._numbers = range(arguments.replay, arguments.replay + 1)

    def journal(self, out: Path) -> Path:
        return out / "replay.jsonl"

    def dive(self, cases: Sequence[CampaignCase]) -> Iterator[Row]:
        (chosen,), (row,) = cases, super().dive(cases)
        config, dived = configured(self._config, chosen.vehicle), scenario(chosen, campaign.DURATION_S)
        full = dive(dived, config, plant(chosen), link(chosen))
        yield row | {"full": full.figures(), "held": bool(full.active[-1])}

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        (row,) = rows
        chosen = campaign.case_of(row)
        table = ruled(str(chosen), "figure", "batch", "full loop")
        for key in [*row][[*row].index("outcome") + 1 : [*row].index("full")]:
            table.add_row(key, f"{row[key]:.3f}", f"{row['full'][key]:.3f}" if key in row["full"] else "")
        table.add_row("outcome", row["outcome"], "steered to the end" if row["held"] else "gave up")
        yield table
        yield f"{'inside' if chosen.inside else 'outside'} the envelope"

    def failed(self, rows: Sequence[Row]) -> bool:
        return False
