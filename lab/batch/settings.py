"""A companion's parameters for the compiled loop: numbers, and the function that puts their functions back.

numba keeps on disk what it compiled for numbers, not for functions: so a companion goes in as numbers, and
`companion.core.tick.Parameters` are made of them inside, with the functions of its laws and compensators.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from companion import assembly
from companion.config import Config
from companion.core.tick import Parameters
from companion.records import Axes
from lab.batch.stand_in import TICK_S

ROWS = 8
"""A tuple of so many tuples is a table: it becomes an array, for numba takes each number for a parameter."""


class Companion(NamedTuple):
    """Numbers of a dive's companion."""

    parameters: Any
    reach: Axes
    slew: float
    """Change of a demand in a tick, at most."""
    lead_s: float


def companion_of(config: Config) -> tuple[Companion, Callable[[Any], Parameters]]:
    """Return a configured companion as numbers, and what makes its parameters of them.

    Raises ValueError for what only the full loop can do.
    """
    if config.vehicle.thrust_path != "rc_override":
        raise ValueError("a batch steers by rc_override: set vehicle.thrust_path")
    if abs(1.0 / config.loop.rate_hz - TICK_S) > 1e-9:
        raise ValueError(f"a batch ticks as the autopilot's input loop does, in {TICK_S} s")
    limits = config.thrusters
    tilts = config.levelling.max_axis if config.levels else 0.0
    numbers, built = numbers_of(assembly.parameters(config))
    return Companion(
        numbers, (limits.max_axis,) * 4 + (tilts,) * 2, limits.max_slew_per_s * TICK_S, limits.lead_s
    ), built


def numbers_of(tree: Any) -> tuple[Any, Callable[[Any], Any]]:
    """Return a tree of (named) tuples without its functions, and the function that makes the tree of it."""
    scope: dict[str, Any] = {}
    source = _source(tree, "numbers", scope)
    return _numbers(tree), _built(source, tuple(scope.items()))


@cache
def _built(source: str, scope: tuple[tuple[str, Any], ...]) -> Callable[[Any], Any]:
    made: dict[str, Any] = dict(scope)
    exec(f"def built(numbers):\n    return {source}\n", made)  # made of field names alone
    built: Callable[[Any], Any] = made["built"]
    built.__module__ = __name__
    built.__qualname__ = f"built: {source}"
    return built


def _source(value: Any, path: str, scope: dict[str, Any]) -> str:
    """Return the expression that gives a value; its functions and types go into `scope`."""
    if isinstance(value, type) or not callable(value):
        if not isinstance(value, tuple) or not _has_functions(value):
            return path
        parts = [_source(part, f"{path}[{i}]", scope) for i, part in enumerate(value)]
        if not hasattr(value, "_fields"):
            return f"({', '.join(parts)},)"
        return f"{_named(type(value), scope)}({', '.join(parts)})"
    return _named(value, scope)


def _named(what: Any, scope: dict[str, Any]) -> str:
    """Return a name for a function or a type that is the same in every process."""
    name = f"{what.__module__}.{what.__qualname__}".replace(".", "_")
    assert scope.setdefault(name, what) is what
    return name


def _has_functions(value: Any) -> bool:
    return callable(value) or (isinstance(value, tuple) and any(map(_has_functions, value)))


def _numbers(value: Any) -> Any:
    if callable(value):
        return 0.0
    if not isinstance(value, (tuple, list)):
        return value
    if len(value) >= ROWS and not hasattr(value, "_fields"):
        return np.array(value, dtype=float)
    parts = [_numbers(part) for part in value]
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
