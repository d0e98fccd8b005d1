"""One tick as what is published of it: a `ControlSample` as one record of each key, and those as JSON.

The mapping is made from the schemas. A field takes its value from where its `means(...)` says; one that says
nothing has the same name in its schema's own part of the sample.
"""

from collections.abc import Callable, Iterable
from functools import cache
from operator import attrgetter
from typing import Any, get_type_hints

from companion.records import AXES, DOFS, Condition, ControlSample
from companion.telemetry.schemas import NEVER_S, Command, Dof, Loop, Schema, State, Supervisor, keys, to_json

_MEASURED = ("x", "x_dot", "e", "e_dot", "eps", "d_observer")
_ANGLES = ("roll_rad", "pitch_rad", "roll_rate_radps", "pitch_rate_radps")
_STALE = (
    ("x_m", "x_rate_mps"),
    ("y_m", "y_rate_mps"),
    ("depth_m", "depth_rate_mps"),
    ("heading_rad", "heading_rate_radps", *_ANGLES),
    ("armed", "mode", "system_status", "voltage_v", "pilot_gain"),
)
"""Fields of State by their source: position (two), depth, attitude, and the vehicle as a whole."""

_UNITS = (("m", "N"), ("m", "N"), ("m", "N"), ("rad", "N·m"))
"""The units of position and of force of each degree of freedom."""

_INDEX = {name: index for names in (DOFS, AXES) for index, name in enumerate(names)}


def encode(sample: ControlSample, vehicle: str) -> list[tuple[str, str, bytes]]:
    """One tick as (key, encoding, JSON) for each of `keys(vehicle)`."""
    return [
        (key, encoding, to_json(record))
        for (key, encoding), record in zip(keys(vehicle).items(), records(sample), strict=True)
    ]


def records(sample: ControlSample) -> list[Schema]:
    """One tick as schema records, in the order of `keys`; here numbers may still be other than finite."""
    stale = sample.state.stale
    silent = Condition.LINK_LOST in sample.verdict.conditions
    return [
        State(absent=_stale_state(*stale, silent), **_state(sample)),
        *[
            Dof(absent=_MEASURED if stale[i] else (), dof=dof, unit=unit, tau_unit=tau_unit, **fields)
            for i, (dof, (unit, tau_unit), fields) in enumerate(zip(DOFS, _UNITS, _dofs(sample), strict=True))
        ],
        Command(**_command(sample)),
        Supervisor(**_supervisor(sample)),
        Loop(**_loop(sample)),
    ]


def _sources(schema: type[Schema], part: str, without: tuple[str, ...] = ()) -> dict[str, str]:
    """Return the place in a `ControlSample` of each field, such as "state.eta[z]"."""
    hints = get_type_hints(schema, include_extras=True)
    places = {name: hint.__metadata__[0].extra["source"] for name, hint in hints.items()}
    return {
        name: place or f"{part}.{name}" for name, place in places.items() if name not in ("absent", *without)
    }


def _reader(schema: type[Schema], part: str) -> Callable[[ControlSample], dict[str, Any]]:
    """Make what reads the fields of a schema; `part` of the sample has those that say no place."""
    sources = _sources(schema, part)
    names, places = tuple(sources), [place.rstrip("]").partition("[") for place in sources.values()]
    read = attrgetter(*[place for place, _, _ in places])
    parts = [(name, _INDEX[index]) for name, (_, _, index) in zip(names, places, strict=True) if index]
    ages = [name for name in names if name.endswith("_age_s")]
    conditions = [name for name in names if name in ("conditions", "warnings")]

    def values(sample: ControlSample) -> dict[str, Any]:
        fields = dict(zip(names, read(sample), strict=True))
        for name, index in parts:
            fields[name] = fields[name][index]
        for name in ages:
            fields[name] = min(fields[name], NEVER_S)
        for name in conditions:
            fields[name] = _names(fields[name])
        return fields

    return values


_state, _command = _reader(State, "state"), _reader(Command, "command")
_supervisor, _loop = _reader(Supervisor, "verdict"), _reader(Loop, "loop")

_DOF_SOURCES = _sources(Dof, "dofs", without=("dof", "unit", "tau_unit"))
_dof_values = attrgetter(*_DOF_SOURCES.values())


def _dofs(sample: ControlSample) -> Iterable[dict[str, Any]]:
    """Return the fields by degree of freedom: a source is a vector, or one number for all of them."""
    columns = [value if isinstance(value, tuple) else (value,) * 4 for value in _dof_values(sample)]
    return [dict(zip(_DOF_SOURCES, row, strict=True)) for row in zip(*columns, strict=True)]


@cache
def _stale_state(x: bool, y: bool, z: bool, psi: bool, silent: bool) -> tuple[str, ...]:
    """Return the fields of State that are stale: those of each DOF, and all others if it is `silent`."""
    flags = (x, y, z, psi, silent)
    return tuple(name for stale, names in zip(flags, _STALE, strict=True) if stale for name in names)


@cache
def _names(conditions: Condition) -> tuple[str, ...]:
    return tuple(condition.name or "" for condition in conditions)
