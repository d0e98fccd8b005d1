"""What is published of one tick: a `ControlSample` as one record for each key, and as JSON.

The mapping is made from the schemas. A field takes its value from where its `field(...)` says; one that says
nothing has the same name in its schema's own part of the sample.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, get_type_hints

from companion.records import AXES, DOFS, Condition, ControlSample
from companion.telemetry.schemas import (
    NEVER_S,
    Command,
    Dof,
    Loop,
    Schema,
    State,
    Supervisor,
    keys,
    to_json,
)
from holdfast.version import running

_MEASURED = ("x", "x_dot", "e", "e_dot", "eps", "d_observer")
_STALE = (
    ("x_m", "x_rate_mps"),
    ("y_m", "y_rate_mps"),
    ("depth_m", "depth_rate_mps"),
    ("heading_rad", "heading_rate_radps", "roll_rad", "pitch_rad", "roll_rate_radps", "pitch_rate_radps"),
    ("armed", "mode", "system_status", "voltage_v", "pilot_gain"),
)
"""Fields of State by their source: position (two), depth, attitude, and the vehicle as a whole."""

_DOFS = (("x", "m", "N"), ("y", "m", "N"), ("z", "m", "N"), ("psi", "rad", "N·m"))
"""Name, and the units of position and of force, of each degree of freedom."""


def encode(sample: ControlSample, vehicle: str) -> list[tuple[str, str, bytes]]:
    """Return one tick as (key, encoding, JSON) for each of `keys(vehicle)`."""
    return [
        (key, encoding, to_json(record))
        for (key, encoding), record in zip(keys(vehicle).items(), records(sample), strict=True)
    ]


def records(sample: ControlSample) -> list[Schema]:
    """Return one tick as records, in the order of `keys`; here numbers may still be other than finite."""
    stale = sample.state.stale
    silent = Condition.LINK_LOST in sample.verdict.conditions
    return [
        _state(sample, absent=_stale_state((*stale, silent))),
        *[
            _dof(sample, i, absent=_MEASURED if stale[i] else (), dof=dof, unit=unit, tau_unit=tau_unit)
            for i, (dof, unit, tau_unit) in enumerate(_DOFS)
        ],
        _command(sample),
        _supervisor(sample),
        _loop(sample, version=running()),
    ]


@cache
def _names(conditions: Condition) -> tuple[str, ...]:
    return tuple(condition.name or "" for condition in conditions)


def _maker(schema: type[Schema], place: str) -> Callable[..., Schema]:
    """Compile a function of (sample, i, **rest) that makes the record.

    `place` is where fields stand that say none, such as "state.{}"; `i` is the degree of freedom.
    """
    arguments = ""
    for name, hint in get_type_hints(schema, include_extras=True).items():
        source = hint.__metadata__[0].extra["source"]
        value = f"sample.{source or place.format(name)}"
        if name.endswith("_age_s"):
            value = f"min({value}, NEVER_S)"
        elif name in ("conditions", "warnings"):
            value = f"names({value})"
        if source is not None:
            arguments += f"{name}={value}, "
    known: dict[str, Any] = {name: i for names in (DOFS, AXES) for i, name in enumerate(names)}
    known |= {"schema": schema, "names": _names, "NEVER_S": NEVER_S}
    made: Callable[..., Schema] = eval(f"lambda sample, i=0, **rest: schema({arguments}**rest)", known)
    return made


_state, _dof, _command = _maker(State, "state.{}"), _maker(Dof, "dofs.{}[i]"), _maker(Command, "command.{}")
_supervisor, _loop = _maker(Supervisor, "verdict.{}"), _maker(Loop, "loop.{}")


@cache
def _stale_state(stale: tuple[bool, ...]) -> tuple[str, ...]:
    """Return the fields of State that are stale: those of each DOF, and all others of a silent vehicle."""
    return tuple(name for is_stale, names in zip(stale, _STALE, strict=True) if is_stale for name in names)
