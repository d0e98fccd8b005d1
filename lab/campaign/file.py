"""A campaign on disk: a CSV row for each dive, appended as it comes, and the configuration that they had."""

import csv
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec

from companion.config import Config
from holdfast import RefusedError
from lab.campaign.campaign import CampaignCase, CampaignRow
from lab.tables import plain


class CampaignError(RefusedError):
    """A folder that cannot be continued; says why and what to do."""


class CampaignFile:
    """`dives.csv` and `config.json` in a folder; what is there already is continued."""

    def __init__(self, folder: Path, config: Config) -> None:
        """Open or begin. Raises CampaignError if the rows there were made with another configuration."""
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "dives.csv"
        made_with, now = folder / "config.json", msgspec.json.encode(config)
        if self._path.exists() and made_with.exists() and made_with.read_bytes() != now:
            raise CampaignError(
                f"{folder} holds dives of another configuration: choose another --out, or remove that folder"
            )
        made_with.write_bytes(now)
        self.rows = self._read() if self._path.exists() else []

    def append(self, rows: Iterable[CampaignRow]) -> None:
        """Add rows; they are on disk when this returns."""
        rows = list(rows)
        self.rows += rows
        begins = not self._path.exists() or not self._path.stat().st_size
        with self._path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0].record()), lineterminator="\n")
            if begins:
                writer.writeheader()
            writer.writerows(plain(row.record()) for row in rows)

    def _read(self) -> list[CampaignRow]:
        """Return what was dived; a line that was torn by the end of a run is dropped from the file."""
        text = self._path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self._path.write_text(whole, encoding="utf-8")
        try:
            return [_row(record) for record in csv.DictReader(whole.splitlines())]
        except (KeyError, TypeError, ValueError) as error:
            raise CampaignError(
                f"{self._path} is of another version of holdfast ({error!r}): choose another --out"
            ) from error


def _row(record: dict[str, str]) -> CampaignRow:
    given = {field.name: _typed(field.type, record.pop(field.name)) for field in fields(CampaignCase)}
    outcome = record.pop("outcome")
    figures = {key: float(value or "nan") for key, value in record.items()}
    return CampaignRow(CampaignCase(**given), outcome, figures)


def _typed(kind: Any, text: str) -> Any:
    """Return the text as a CampaignCase's int, float or str."""
    return kind(text)
