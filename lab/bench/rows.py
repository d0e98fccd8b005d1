"""The rows of `holdfast bench`: what steers, what a search may turn, and what it found.

A knob is a key of the companion's configuration (with a dot), a gain of a rival's law, or a parameter of the
autopilot (capitals). All are positive, and a search may go from `start`/WIDTH to `start`·WIDTH in each: the
same width for everybody. `tuned.toml` holds what the search found and how it was run.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from companion.config import Axis, Config
from companion.records import Array
from lab.rivals.l1 import L1, L1Gains
from lab.rivals.law import Law
from lab.rivals.ppi import PPI, PPIGains
from lab.rivals.super_twisting import SuperTwisting, TwistGains

TUNED_FILE = Path(__file__).parent / "tuned.toml"
WIDTH = 6.0

Gains = Mapping[str, Array | float]


@dataclass(frozen=True)
class Row:
    """One competitor. `compensator` is the companion's in heave, None leaves the configuration as it is."""

    name: str
    title: str
    steers: Literal["companion", "rival", "autopilot"]
    knobs: Mapping[str, float]
    """Name and start of each."""
    compensator: str | None = None
    law: Callable[[Gains, Config], Law] | None = None

    def overrides(self, values: Mapping[str, float]) -> list[str]:
        """Return what of `values` belongs into the companion's configuration."""
        chosen = [] if self.compensator is None else [f"heave.compensator={self.compensator!r}"]
        return chosen + [f"{key}={value!r}" for key, value in values.items() if "." in key]

    def rival(self, values: Gains, config: Config) -> Law | None:
        """Return the law that takes the helm in heave, or None where the companion's own does."""
        return None if self.law is None else self.law(values, config)


def _ppi(values: Gains, config: Config) -> Law:
    return PPI(PPIGains(values["k_p"], values["k_v"], values["k_i"], config.heave.max_disturbance))


def _l1(values: Gains, config: Config) -> Law:
    heave: Axis = config.heave
    lead_s = values.get("thrusters.lead_s", config.thrusters.lead_s)
    return L1(
        L1Gains(
            lam=values["lam"],
            kappa=values["kappa"],
            omega=values["omega"],
            d_max=heave.max_disturbance,
            max_force=heave.max_force,
            lag_s=config.thrusters.lag_s,
            lead_s=lead_s,
        )
    )


def _twist(values: Gains, config: Config) -> Law:
    d_max = config.heave.max_disturbance
    return SuperTwisting(TwistGains(values["lam"], values["kappa"], values["k_1"], values["k_2"], d_max))


_OBSERVED = {"heave.disturbance_noise": 6.0, "thrusters.lead_s": 0.04, "delays.gains_bear_s": 0.1}
_LAW = {"heave.lambda_per_s": 4.0, "heave.kappa_per_s": 8.0} | _OBSERVED
_LEARNING = _LAW | {"heave.learning_rate": 100.0}
_RIVAL = {"lam": 4.0, "kappa": 8.0} | _OBSERVED
_AUTOPILOT = {"PSC_POSZ_P": 3.0, "PSC_VELZ_P": 8.0, "PSC_ACCZ_P": 0.5, "PSC_ACCZ_I": 0.1}

DEFAULT = "default"
ROWS: tuple[Row, ...] = (
    Row("alt_hold_stock", "ALT_HOLD, stock", "autopilot", {}),
    Row("alt_hold", "ALT_HOLD, tuned", "autopilot", _AUTOPILOT),
    Row("ppi", "P-PI", "rival", {"k_p": 4.0, "k_v": 8.0, "k_i": 4.0} | _OBSERVED, "none", _ppi),
    Row("law", "law", "companion", _LAW, "none"),
    Row("integrator", "law + integrator", "companion", _LEARNING, "integrator"),
    Row("regressor", "law + regressor", "companion", _LEARNING, "regressor"),
    Row("network", "law + network", "companion", _LEARNING, "network"),
    Row("observer", "law + observer", "companion", _LAW, "observer"),
    Row("network+observer", "law + network + obs.", "companion", _LEARNING, "network+observer"),
    Row("l1", "L1 adaptive", "rival", _RIVAL | {"omega": 3.0}, "none", _l1),
    Row("super_twisting", "super-twisting", "rival", _RIVAL | {"k_1": 0.3, "k_2": 0.6}, "none", _twist),
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
