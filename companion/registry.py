"""Compensators and laws by the names that the configuration gives them.

A name is shipped, or an entry point of the group `holdfast.compensators` or `holdfast.laws` of an installed
package, or the table `[compensators.NAME]` or `[laws.NAME]` of the configuration whose `module` is the file.
What such a file defines is said in `companion/core/compensator.py` and `companion/core/law.py`.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from importlib import import_module
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any, NamedTuple, TypeVar, get_type_hints

import msgspec

from companion.core import integrator, law, network
from companion.core.compensator import Signals
from companion.core.law import Motion
from companion.core.schedule import Gains

NONE, OBSERVER, PREDICTED, LYAPUNOV = "none", "observer", "predictor", "lyapunov"
"""No compensator; the observer's d fed back; as the network predicts it; the paper's law."""

SHIPPED = {"integrator": integrator, "network": network}

Tables = Mapping[str, Mapping[str, Any]]


class Compensator(NamedTuple):
    """A compensator's file and its functions."""

    module: ModuleType
    parameters: Callable[[Mapping[str, Any]], Any]
    initial: Callable[[Any], Any]
    step: Callable[[Any, Any, Signals, float, bool], tuple[Any, float, bool]]
    seed: Callable[[Any, Any, Signals, float], Any]
    weight_norm: Callable[[Any], float]
    integral_gain: Callable[[Any], float]


class Law(NamedTuple):
    """A law's file and its functions."""

    module: ModuleType
    parameters: Callable[[Mapping[str, Any]], Any]
    initial: Callable[[Any], Any]
    step: Callable[[Any, Any, Motion, float], tuple[Any, float, float]]


Functions = TypeVar("Functions", Compensator, Law)


class UnusableError(ValueError):
    """A compensator or a law that cannot be used, and why."""


def compensators(tables: Tables) -> dict[str, Compensator]:
    """Return what learns, by its name, with what the configuration's `[compensators]` add."""
    return _all("compensators", Compensator, SHIPPED, tables)


def laws(tables: Tables) -> dict[str, Law]:
    """Return the laws by their names, with what the configuration's `[laws]` add."""
    return _all("laws", Law, {LYAPUNOV: law}, tables)


def choices(tables: Tables) -> tuple[str, ...]:
    """Return what an axis' `compensator` may be, each that learns alone and beside the observer."""
    known = compensators(tables)
    beside = (f"{name}+{OBSERVER}" for name in known if name != "network")
    return (NONE, OBSERVER, PREDICTED, *known, *beside)


def learner(choice: str, known: Mapping[str, Compensator]) -> str:
    """Return the name of what learns from ε by `choice`, such as "drag+observer"; empty for nothing.

    Raises UnusableError for a choice that there is not.
    """
    if choice in (NONE, OBSERVER, PREDICTED):
        return ""
    name = choice.removesuffix(f"+{OBSERVER}")
    if name not in known or choice == f"network+{OBSERVER}":
        single = ", ".join((NONE, OBSERVER, PREDICTED, *known))
        raise UnusableError(
            f"must be one of {single}, or one that learns +{OBSERVER}; the network beside it is {PREDICTED}"
        )
    return name


def _all(
    group: str, kind: Callable[..., Functions], shipped: Mapping[str, ModuleType], tables: Tables
) -> dict[str, Functions]:
    modules: dict[str, ModuleType] = {**shipped, **_installed(group)}
    for own, table in tables.items():
        if "module" in table:
            modules[own] = _imported(f"{group}.{own}.module", str(table["module"]))
        if own not in modules:
            raise UnusableError(f"{group}.{own}: not installed; name its file: {group}.{own}.module")
    found = {name: _functions(kind, module) for name, module in modules.items()}
    for own, table in tables.items():
        _check_table(f"{group}.{own}", table, modules[own].Parameters)
    return found


def _check_table(where: str, table: Mapping[str, Any], kind: Any) -> None:
    known = get_type_hints(kind, include_extras=True)
    for key, value in table.items():
        if key in known:
            _converted(f"{where}.{key}", value, known[key])
        elif key != "module":
            raise UnusableError(f"{where}.{key}: unknown key; known here: {', '.join(('module', *known))}")


def _converted(key: str, value: Any, hint: Any) -> Any:
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        raise UnusableError(f"{key} = {value!r:.80}: {str(error).lower()}") from error


@cache
def _installed(group: str) -> dict[str, ModuleType]:
    found = {}
    for point in entry_points(group=f"holdfast.{group}"):
        try:
            found[point.name] = point.load()
        except Exception as error:
            raise UnusableError(f"{point.value}, installed as {group}.{point.name}: {error}") from error
    return found


@cache
def _imported(key: str, name: str) -> ModuleType:
    try:
        return import_module(name)
    except (Exception, SystemExit) as error:
        raise UnusableError(f"{key} = {name!r}: cannot be imported: {error}") from error


@cache
def _functions(kind: Callable[..., Functions], module: ModuleType) -> Functions:
    """Return the functions of a file, with the usual `parameters` where it does not define its own."""
    names: list[str] = list(get_type_hints(kind))
    given = {"module": module, "parameters": partial(_parameters, module)} | vars(module)
    if missing := [name for name in ("Parameters", "State", *names) if name not in given]:
        raise UnusableError(f"{module.__name__} has no {', '.join(missing)}")
    return kind(*(given[name] for name in names))


def _parameters(module: ModuleType, values: Mapping[str, Any]) -> Any:
    """Return a file's Parameters, each field the value of its key, or its default.

    Raises UnusableError for a value that is missing or of another type.
    """
    kind = module.Parameters
    hints = get_type_hints(kind, include_extras=True)
    if missing := [name for name in hints if name not in values and name not in kind._field_defaults]:
        raise UnusableError(f"{', '.join(missing)}: missing")
    return kind(
        **{name: _converted(name, values[name], hint) for name, hint in hints.items() if name in values}
    )


def refuse_misshapen(functions: Compensator | Law, parameters: Any) -> None:
    """Try the functions of a file that is not shipped once.

    Raises UnusableError, with the file, where one fails, or does not return what it should.
    """
    module = functions.module
    if module in (law, *SHIPPED.values()):
        return
    try:
        for name, value, *kinds in _tried(functions, parameters):
            if not _fits(value, tuple(kinds) if kinds[1:] else kinds[0]):
                wanted = ", ".join(kind.__name__ for kind in kinds)
                raise UnusableError(f"{name} returns {value!r:.80}: must be {wanted}")
    except UnusableError as error:
        raise UnusableError(f"{module.__file__}: {error}") from error
    except Exception as error:
        raise UnusableError(f"{module.__file__}: {type(error).__name__}: {error}") from error


def _tried(functions: Compensator | Law, parameters: Any) -> Iterator[tuple[Any, ...]]:
    """Give of each function its name, what it returns, and of which types that must be."""
    kind, small = functions.module.State, 0.01
    state = functions.initial(parameters)
    yield "initial", state, kind
    if isinstance(functions, Compensator):
        signals = Signals(*[small] * len(Signals._fields))
        yield "step", functions.step(parameters, state, signals, small, True), kind, float, bool
        yield "seed", functions.seed(parameters, state, signals, small), kind
        yield "weight_norm", functions.weight_norm(state), float
        yield "integral_gain", functions.integral_gain(parameters), float
    else:
        ones: Any = dict.fromkeys(Motion._fields, 1.0) | {"gains": Gains(lam=1.0, kappa=1.0, tolerated_s=1.0)}
        yield "step", functions.step(parameters, state, Motion(**ones), small), kind, float, float


def _fits(value: Any, kind: Any) -> bool:
    if isinstance(kind, tuple):
        return isinstance(value, tuple) and len(value) == len(kind) and all(map(_fits, value, kind))
    return isinstance(value, (int, float) if kind is float else kind)
