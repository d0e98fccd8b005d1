"""The rows of `holdfast bench`: what steers, what a search may turn, and what it found.

A knob is a key of the companion's configuration, or a parameter of the autopilot (capitals). All are
positive, and a search may go from `start`/WIDTH to `start`·WIDTH in each: the same width for everybody.
`tuned.toml` holds what the search found and how it was run.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

TUNED_FILE = Path(__file__).parent / "tuned.toml"
WIDTH = 6.0


@dataclass(frozen=True)
class Row:
    """One competitor; `settings` are keys of the companion's configuration and what they always are."""

    name: str
    title: str
    steers: Literal["companion", "autopilot"]
    knobs: Mapping[str, float]
    """Name and start of each."""
    settings: tuple[str, ...] = ()

    def overrides(self, values: Mapping[str, float]) -> list[str]:
        """Return what of `values` belongs into the companion's configuration, beside `settings`."""
        return [*self.settings, *(f"{key}={value!r}" for key, value in values.items() if "." in key)]


def _compensator(name: str) -> tuple[str, ...]:
    return (f"heave.compensator={name!r}",)


def _rival(name: str) -> tuple[str, ...]:
    module = f"laws.{name}.module='lab.rivals.{name}'"
    return (f"heave.law={name!r}", module, *_compensator("none"))


_OBSERVED = {"heave.disturbance_noise": 6.0, "thrusters.lead_s": 0.04, "delays.gains_bear_s": 0.1}
_GAINS = {"heave.lambda_per_s": 4.0, "heave.kappa_per_s": 8.0}
_LAW = _GAINS | _OBSERVED
_LEARNING = _LAW | {"heave.learning_rate": 100.0}
_AUTOPILOT = {"PSC_POSZ_P": 3.0, "PSC_VELZ_P": 8.0, "PSC_ACCZ_P": 0.5, "PSC_ACCZ_I": 0.1}
_PPI = {"laws.ppi.k_p": 4.0, "laws.ppi.k_v": 8.0, "laws.ppi.k_i": 4.0} | _OBSERVED
_L1 = _LAW | {"laws.l1.omega": 3.0}
_TWIST = _LAW | {"laws.super_twisting.k_1": 0.3, "laws.super_twisting.k_2": 0.6}

DEFAULT = "default"
ROWS: tuple[Row, ...] = (
    Row("alt_hold_stock", "ALT_HOLD, stock", "autopilot", {}),
    Row("alt_hold", "ALT_HOLD, tuned", "autopilot", _AUTOPILOT),
    Row("ppi", "P-PI", "companion", _PPI, _rival("ppi")),
    Row("law", "law", "companion", _LAW, _compensator("none")),
    Row("integrator", "law + integrator", "companion", _LEARNING, _compensator("integrator")),
    Row("regressor", "law + regressor", "companion", _LEARNING, _compensator("regressor")),
    Row("network", "law + network", "companion", _LEARNING, _compensator("network")),
    Row("observer", "law + observer", "companion", _LAW, _compensator("observer")),
    Row("network+observer", "law + network + obs.", "companion", _LEARNING, _compensator("network+observer")),
    Row("l1", "L1 adaptive", "companion", _L1, _rival("l1")),
    Row("super_twisting", "super-twisting", "companion", _TWIST, _rival("super_twisting")),
    Row(DEFAULT, "shipped default", "companion", {}),
)


def selected(names: Sequence[str]) -> list[Row]:
    """Return the rows of these names, in the table's order. Raises ValueError for a name that is none."""
    unknown = set(names) - {row.name for row in ROWS}
    if unknown:
        raise ValueError(
            f"no such row: {', '.join(sorted(unknown))}; there are {', '.join(r.name for r in ROWS)}"
        )
    return [row for row in ROWS if row.name in names]


def tuned(path: Path = TUNED_FILE) -> dict[str, dict[str, float]]:
    """Return the values of each row that a search has found."""
    found: dict[str, dict[str, float]] = tomllib.loads(path.read_text(encoding="utf-8"))["values"]
    return found


def values_of(row: Row, found: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Return a row's values: those found, and its starts for what was not searched."""
    return {key: found.get(row.name, {}).get(key, start) for key, start in row.knobs.items()}
