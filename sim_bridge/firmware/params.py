"""The autopilot's parameters: names, types and defaults of ArduSub 4.7."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

INT8, INT16, INT32, FLOAT = 2, 4, 6, 9
_RANGE = {INT8: (-128, 127), INT16: (-32768, 32767), INT32: (-(2**31), 2**31 - 1)}


class Kind(NamedTuple):
    """MAVLink parameter type and the firmware's default."""

    type: int
    default: float


def _defaults() -> dict[str, Kind]:
    with Path(__file__).with_suffix(".csv").open(encoding="ascii", newline="") as file:
        return {row["name"]: Kind(int(row["type"]), float(row["value"])) for row in csv.DictReader(file)}


DEFAULTS: dict[str, Kind] = _defaults()
"""All parameters of ArduSub 4.7-dev in the order of its own list, as read from the firmware (params.csv)."""


class Parameters:
    """A table of values by name, in the order that PARAM_REQUEST_LIST tells them."""

    def __init__(self, overrides: Mapping[str, float]) -> None:
        """Start from the defaults; ValueError for an override that is unknown or does not fit its type."""
        self.names = tuple(DEFAULTS)
        self.index = {name: index for index, name in enumerate(self.names)}
        self._values = {name: kind.default for name, kind in DEFAULTS.items()}
        self.changes = 0
        """How often a value was set."""
        for name, value in overrides.items():
            if not self.set(name, value):
                raise ValueError(f"parameters.{name} = {value}: unknown, or not fit for its type")

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def set(self, name: str, value: float) -> bool:
        """Store a value, integers rounded and clamped to their type; False if unknown or not finite."""
        if name not in self._values or not math.isfinite(value):
            return False
        kind = DEFAULTS[name].type
        if kind != FLOAT:
            low, high = _RANGE[kind]
            value = max(low, min(high, round(value)))
        elif abs(value) > 3.4e38:
            return False
        self._values[name] = float(value)
        self.changes += 1
        return True
