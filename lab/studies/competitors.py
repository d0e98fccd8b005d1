"""The competitors of the benches (`--rows`): what steers, what a search may turn, and what it found.

A knob is a key of the companion's configuration, or a parameter of the autopilot (capitals). All are
positive, and a search may go from `start`/WIDTH to `start`·WIDTH in each: the same width for everybody.
`tuned.toml` holds what the search found and how it was run. Compensators and laws that are not shipped have
rows of their own, which start where the configuration stands.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Literal

from companion import registry
from companion.config import Axis, Config
from lab.study import known

TUNED_FILE = Path(__file__).parent / "tuned.toml"
WIDTH = 6.0
FIRST_SEED = 1000
"""Of the benches: no search sees a seed from here on."""


@dataclass(frozen=True)
class Competitor:
    """What steers; `settings` are keys of the companion's configuration and what they always are."""

    name: str
    title: str
    steers: Literal["companion", "autopilot"]
    knobs: Mapping[str, float]
    """Name and start of each."""
    settings: tuple[str, ...] = ()
    place: bool = False
    """Whether a search judges it by its place, with a DVL, and not by its depth."""

    def overrides(self, values: Mapping[str, float]) -> list[str]:
        """Return what of `values` belongs into the companion's configuration, beside `settings`."""
        return [*self.settings, *(f"{key}={value!r}" for key, value in values.items() if "." in key)]


def _compensator(name: str) -> tuple[str, ...]:
    return (f"heave.compensator={name!r}",)


def _rival(name: str, compensator: str = "none") -> tuple[str, ...]:
    module = f"laws.{name}.module='lab.rivals.{name}'"
    return (f"heave.law={name!r}", module, *_compensator(compensator))


_OBSERVED = {"heave.disturbance_noise": 6.0, "thrusters.lead_s": 0.04, "delays.gains_bear_s": 0.1}
_GAINS = {"heave.lambda_per_s": 4.0, "heave.kappa_per_s": 8.0}
_LAW = _GAINS | _OBSERVED
_LEARNING = _LAW | {"heave.learning_rate": 100.0}
_AUTOPILOT = {"PSC_POSZ_P": 3.0, "PSC_VELZ_P": 8.0, "PSC_ACCZ_P": 0.5, "PSC_ACCZ_I": 0.1}
_PPI = {"laws.ppi.k_p": 4.0, "laws.ppi.k_v": 8.0, "laws.ppi.k_i": 4.0} | _OBSERVED
_L1 = _LAW | {"laws.l1.omega": 3.0}
_TWIST = _LAW | {"laws.super_twisting.k_1": 0.3, "laws.super_twisting.k_2": 0.6}
_INDI = _LAW | {"laws.indi.omega": 6.0}
_MPC = {"laws.mpc.rate_s": 0.1, "laws.mpc.change_mm_per_n": 0.3} | _OBSERVED

DEFAULT = "default"
COMPETITORS: tuple[Competitor, ...] = (
    Competitor("alt_hold_stock", "ALT_HOLD, stock", "autopilot", {}),
    Competitor("alt_hold", "ALT_HOLD, tuned", "autopilot", _AUTOPILOT),
    Competitor("ppi", "P-PI", "companion", _PPI, _rival("ppi")),
    Competitor("law", "law", "companion", _LAW, _compensator("none")),
    Competitor("integrator", "law + integrator", "companion", _LEARNING, _compensator("integrator")),
    Competitor("regressor", "law + regressor", "companion", _LEARNING, _compensator("regressor")),
    Competitor("network", "law + network", "companion", _LEARNING, _compensator("network")),
    Competitor("observer", "law + observer", "companion", _LAW, _compensator("observer")),
    Competitor(
        "network+observer", "law + network + obs.", "companion", _LEARNING, _compensator("network+observer")
    ),
    Competitor("l1", "L1 adaptive", "companion", _L1, _rival("l1")),
    Competitor("super_twisting", "super-twisting", "companion", _TWIST, _rival("super_twisting")),
    Competitor("indi", "INDI", "companion", _INDI, _rival("indi")),
    Competitor("mpc", "MPC + observer", "companion", _MPC, _rival("mpc", "observer")),
    Competitor(DEFAULT, "Holdfast", "companion", {}),
)
"""Those whose knobs `tuned.toml` has."""


def competitors(config: Config) -> tuple[Competitor, ...]:
    """Return COMPETITORS, with the compensators and laws that are not shipped before the last of them."""
    more = []
    for name, kind in registry.compensators(config.compensators).items():
        if name not in registry.SHIPPED:
            knobs = knobs_of(config) | _own("compensators", name, kind.module, config)
            for choice in (name, f"{name}+{registry.OBSERVER}"):
                more.append(Competitor(choice, choice, "companion", knobs, _compensator(choice)))
    for name, law in registry.laws(config.laws).items():
        if name != registry.LYAPUNOV:
            knobs = knobs_of(config) | _own("laws", name, law.module, config)
            more.append(Competitor(name, name, "companion", knobs, (f"heave.law={name!r}",)))
    return (*COMPETITORS[:-1], *more, COMPETITORS[-1])


def selected(names: Sequence[str], config: Config) -> list[Competitor]:
    """Return these competitors, in the table's order. Raises RefusedError for an unknown name."""
    every = competitors(config)
    known(names, [row.name for row in every], "row")
    return [row for row in every if row.name in names]


def knobs_of(config: Config) -> dict[str, float]:
    """Return what a search may turn of a configuration's own heave, from where it stands."""
    heave = config.heave
    knobs = {
        "heave.lambda_per_s": heave.lambda_per_s,
        "heave.kappa_per_s": heave.kappa_per_s,
        "heave.disturbance_noise": heave.disturbance_noise,
        "thrusters.lead_s": config.thrusters.lead_s,
        "delays.gains_bear_s": config.delays.gains_bear_s,
    }
    if registry.learners(heave.compensator, registry.compensators(config.compensators)):
        knobs["heave.learning_rate"] = heave.learning_rate
    return knobs


def place_knobs_of(config: Config) -> dict[str, float]:
    """Return what a search may turn of a configuration's own surge and sway, from where it stands."""
    return {
        f"{name}.{key}": getattr(axis, key)
        for name, axis in (("surge", config.surge), ("sway", config.sway))
        for key in ("lambda_per_s", "kappa_per_s", "disturbance_noise")
    }


def _own(group: str, name: str, module: ModuleType, config: Config) -> dict[str, float]:
    """Return what a search may turn of a file's own parameters: those above zero, from where they stand."""
    kind, table = module.Parameters, getattr(config, group).get(name, {})
    given: dict[str, float] = kind._field_defaults | table
    own = set(kind._fields).intersection(given).difference(Axis.__struct_fields__)
    return {f"{group}.{name}.{key}": float(given[key]) for key in sorted(own) if given[key] > 0.0}


def tuned(path: Path = TUNED_FILE) -> dict[str, dict[str, float]]:
    """Return the values of each row that a search has found."""
    found: dict[str, dict[str, float]] = tomllib.loads(path.read_text(encoding="utf-8"))["values"]
    return found


def values_of(row: Competitor, found: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Return a row's values: those found, and its starts for what was not searched."""
    return {key: found.get(row.name, {}).get(key, start) for key, start in row.knobs.items()}
