"""The competitors of the benches (`--rows`): what steers, what a search may turn, and what it found.

A knob is a key of the companion's configuration. All are positive, and a search may go from start/WIDTH to
start·WIDTH in each: the same width for everybody. `tuned.toml` holds what it found and how it was run; a row
that was not searched has the gains of the configuration.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from companion import registry
from companion.config import AxisSection, Config
from lab.rivals import alt_hold
from lab.study import known

TUNED_FILE = Path(__file__).with_name("tuned.toml")
WIDTH = 6.0
FIRST_SEED = 1000
"""First seed of the benches: no search sees a seed from here on."""

DEFAULT = "default"
PLACE = ("surge", "sway")

Values = Mapping[str, float]


@dataclass(frozen=True)
class Competitor:
    """What steers: the companion with this law and compensator, or the autopilot with its own parameters."""

    title: str
    law: str = ""
    """A module of `lab.rivals`, or a law of the configuration's; empty for the paper's."""
    compensator: str = ""
    """Empty for the configuration's own."""
    gains: bool = True
    """Whether the law uses λ and κ."""
    depth: Values = field(default_factory=dict)
    """Parameters of its own on heave that a search may turn, and their starts."""
    place: Values = field(default_factory=dict)
    """Those on surge and sway."""
    autopilot: Values | None = None

    def settings(self, *, place: bool) -> list[str]:
        """Return the keys of the configuration that put it on its axes."""
        settings, law = [], self.law
        if law in RIVALS:
            law = f"{law}_{'place' if place else 'depth'}"
            settings.append(f"laws.{law}.module='lab.rivals.{self.law}'")
        for axis in PLACE if place else ("heave",):
            settings += [f"{axis}.law={law!r}"] if law else []
            settings += [f"{axis}.compensator={self.compensator!r}"] if self.compensator else []
        return settings

    def knobs(self, config: Config, *, place: bool) -> dict[str, float]:
        """Return what a search may turn, from where `config` stands."""
        chosen = self.compensator or config.heave.compensator
        knobs = place_knobs_of(config) if place else knobs_of(config, chosen)
        without = () if self.gains else ("lambda_per_s", "kappa_per_s")
        knobs = {key: value for key, value in knobs.items() if not key.endswith(without)}
        return knobs | dict(self.place if place else self.depth)

    def overrides(self, config: Config, found: Values, *, place: bool) -> list[str]:
        """Return its settings with what a search found, and the starts of its own that none turned."""
        values = {**(self.place if place else self.depth), **found}
        knobs = self.knobs(config, place=place)
        return [*self.settings(place=place), *written({key: values[key] for key in knobs if key in values})]


def _rival(
    title: str, law: str, compensator: str, depth: Values, place: Values, *, gains: bool = True
) -> dict[str, Competitor]:
    """Return the law with a d̂ that stays, and with the predicted one."""
    own = [{f"laws.{law}_{of}.{key}": value for key, value in starts.items()}
           for of, starts in (("depth", depth), ("place", place))]  # fmt: skip
    predicted = Competitor(f"{title} + prediction", law, registry.PREDICTED, gains, *own)
    constant = title + (f" + {compensator}" if compensator != registry.NONE else "")
    return {law: Competitor(constant, law, compensator, gains, *own), f"{law}_predicted": predicted}


RIVALS = ("ppi", "indi", "mpc")
"""Laws of `lab.rivals`."""

COMPETITORS: Mapping[str, Competitor] = {
    "alt_hold_stock": Competitor("ALT_HOLD, stock", autopilot={}),
    "alt_hold": Competitor("ALT_HOLD, tuned", autopilot=alt_hold.TUNED),
    "law": Competitor("law", compensator="none"),
    **{name: Competitor(f"law + {name}", compensator=name) for name in ("integrator", "network", "observer")},
    "holdfast": Competitor("law + prediction"),
    **_rival(
        "P-PI",
        "ppi",
        "none",
        {"k_p": 4.0, "k_v": 8.0, "k_i": 4.0},
        {"k_p": 1.5, "k_v": 4.0, "k_i": 2.0},
        gains=False,
    ),
    **_rival("INDI", "indi", "none", {"omega": 6.0}, {"omega": 3.0}),
    **_rival(
        "MPC",
        "mpc",
        "observer",
        {"rate_s": 0.1, "change_mm_per_n": 0.3},
        {"rate_s": 0.3, "change_mm_per_n": 1.0},
        gains=False,
    ),
    DEFAULT: Competitor("Holdfast"),
}


def competitors(config: Config) -> dict[str, Competitor]:
    """Return COMPETITORS, and on heave the compensators and laws that are not shipped."""
    more = {}
    for name, kind in registry.compensators(config.compensators).items():
        if name not in registry.SHIPPED:
            own = _own("compensators", name, kind.module, config)
            for choice in (name, f"{name}+{registry.OBSERVER}"):
                more[choice] = Competitor(choice, compensator=choice, depth=own)
    for name, law in registry.laws(config.laws).items():
        if name != registry.LYAPUNOV:
            more[name] = Competitor(name, law=name, depth=_own("laws", name, law.module, config))
    return {**COMPETITORS, **more}


def selected(names: Sequence[str], config: Config) -> dict[str, Competitor]:
    """Return these competitors, in the table's order. Raises RefusedError for an unknown name."""
    every = competitors(config)
    known(names, every, "row")
    return {name: row for name, row in every.items() if name in names}


def steered(row: Competitor, config: Config, found: Values) -> list[str]:
    """Return the settings of depth and place with what a search found; none for the shipped default."""
    return [text for place in (False, True) for text in row.overrides(config, found, place=place)]


def knobs_of(config: Config, compensator: str) -> dict[str, float]:
    """Return what a search may turn of a configuration's heave with this compensator."""
    heave = config.heave
    knobs = {
        "heave.lambda_per_s": heave.lambda_per_s,
        "heave.kappa_per_s": heave.kappa_per_s,
        "heave.disturbance_noise": heave.disturbance_noise,
        "thrusters.lead_s": config.thrusters.lead_s,
        "delays.gains_bear_s": config.delays.gains_bear_s,
    }
    learner = registry.learner(compensator, registry.compensators(config.compensators))
    if learner:
        knobs["heave.learning_rate"] = heave.learning_rate
    return knobs


def place_knobs_of(config: Config) -> dict[str, float]:
    """Return what a search may turn of a configuration's own surge and sway, from where it stands."""
    keys = ("lambda_per_s", "kappa_per_s", "disturbance_noise")
    return {f"{axis}.{key}": getattr(getattr(config, axis), key) for axis in PLACE for key in keys}


def written(values: Values) -> list[str]:
    """Return values as overrides of a configuration."""
    return [f"{key}={value!r}" for key, value in values.items()]


def tuned(path: Path = TUNED_FILE) -> dict[str, dict[str, float]]:
    """Return the values of each row that a search has found."""
    found: dict[str, dict[str, float]] = tomllib.loads(path.read_text(encoding="utf-8"))["values"]
    return found


def _own(group: str, name: str, module: ModuleType, config: Config) -> dict[str, float]:
    """Return what a search may turn of a file's own parameters: those above zero, from where they stand."""
    kind, table = module.Parameters, getattr(config, group).get(name, {})
    given: dict[str, float] = kind._field_defaults | table
    own = set(kind._fields).intersection(given).difference(AxisSection.__struct_fields__)
    return {f"{group}.{name}.{key}": float(given[key]) for key in sorted(own) if given[key] > 0.0}
