"""Compile the equations of the companion and the simulator for the lab, where they stand: as plain Python.

`compiled(function)` is a numba function with the behaviour of `function`. The Python functions that it
calls are compiled with it: no equation needs a decorator, and no vehicle needs numba. Two things differ
from plain Python: floats do not raise (division by zero gives inf or NaN), and whole numbers are of 64
bits. Finite floats are the same to the last bit in functions without whole powers, `hypot` and sums of
floats.

What the lab runs (`cached`) stays on disk, in a folder named by a digest of every source that it may be made
of. numba's own cache looks at the file of the function alone, and not at those that it calls.
"""

import dis
import fcntl
import functools
import gc
import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numba

import lab.batch.replace  # numba learns NamedTuple._replace  # noqa: F401
from lab.batch.pipeline import PART, WHOLE

PACKAGES = ("companion", "sim_bridge", "lab")
OPTIONS = {"error_model": "numpy"}
"""Floats do not raise. Without `fastmath` a product and a sum are rounded twice, as in Python."""

KEPT_FOLDERS = 4
"""Of compiled code; those of older sources are removed."""


class Slotted(NamedTuple):
    """A function, and by what the functions are replaced that it calls by some names: its slots."""

    function: Callable[..., Any]
    slots: tuple[tuple[str, "Callable[..., Any] | Slotted"], ...]


def slotted(function: Callable[..., Any], **slots: "Callable[..., Any] | Slotted") -> Slotted:
    """Return `function` with other functions in its slots."""
    return Slotted(function, tuple(slots.items()))


@functools.cache
def cached(entry: Slotted) -> Any:
    """Return a function of the lab, compiled for the types that it is called with.

    What is compiled stays on disk, unless it is made of sources other than PACKAGES. Another process that
    compiles the same meanwhile is waited for.
    """
    body = _with_callees(*entry)
    keeps = _ours(entry)
    name = hashlib.sha256(_described(entry).encode()).hexdigest()[:12]
    body.__qualname__ += f"_{name}"
    folder = cache_folder()
    if keeps:
        numba.config.CACHE_DIR = str(folder)
    dispatcher = numba.njit(cache=keeps, **WHOLE, **OPTIONS)(body)
    compile_alone = dispatcher.compile

    def compile_in_turn(types: Any) -> Any:
        with (folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            gc.disable()  # millions of objects that stay: it takes a tenth of the time
            try:
                return compile_alone(types)
            finally:
                gc.enable()

    dispatcher.compile = compile_in_turn
    return dispatcher


def digest(root: Path) -> str:
    """Return the SHA-256, in hex, of all Python sources of PACKAGES below `root`."""
    sources = hashlib.sha256()
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        data = path.read_bytes()
        sources.update(f"{path.relative_to(root)} {len(data)}\n".encode() + data)
    return sources.hexdigest()


@functools.cache
def compiled(function: Callable[..., Any] | Slotted) -> Any:
    """Return a function that numba compiles for the types with which it is called."""
    entry = function if isinstance(function, Slotted) else Slotted(function, ())
    return numba.njit(**WHOLE, **OPTIONS)(_with_callees(*entry))


@functools.cache
def _callee(function: Callable[..., Any] | Slotted) -> Any:
    """Return the same for calls from what is compiled alone."""
    entry = function if isinstance(function, Slotted) else Slotted(function, ())
    return numba.njit(**PART, **OPTIONS)(_with_callees(*entry))


def _with_callees(
    function: Callable[..., Any], slots: tuple[tuple[str, Callable[..., Any] | Slotted], ...]
) -> FunctionType:
    """Copy a Python function, with compiled ones in the place of the functions that it refers to."""
    assert isinstance(function, FunctionType)
    scope = dict(function.__globals__)
    named, attributes = _names(function.__code__, "LOAD_GLOBAL"), _names(function.__code__, "LOAD_")
    for name in named & scope.keys():
        value = scope[name]
        if _is_python(value) and value is not function:
            scope[name] = _callee(value)
        elif isinstance(value, ModuleType):
            functions = {key: item for key in attributes if _is_python(item := vars(value).get(key))}
            if functions:
                scope[name] = ModuleType(value.__name__)
                vars(scope[name]).update(
                    vars(value) | {key: _callee(item) for key, item in functions.items()}
                )
    scope |= {name: _callee(chosen) for name, chosen in slots}
    copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
    functools.update_wrapper(copy, function)
    return copy


def _names(code: CodeType, operation: str) -> set[str]:
    """Return what a function's operations of this name load, those of its comprehensions as well."""
    loaded = {
        instruction.argval
        for instruction in dis.get_instructions(code)
        if instruction.opname.startswith(operation)
    }
    inner = [_names(constant, operation) for constant in code.co_consts if isinstance(constant, CodeType)]
    return loaded.union(*inner)


def _is_python(value: Any) -> bool:
    """Whether numba does not know this function itself."""
    return isinstance(value, FunctionType) and value.__module__.partition(".")[0] not in ("numba", "numpy")


def _ours(entry: Callable[..., Any] | Slotted) -> bool:
    if isinstance(entry, Slotted):
        return _ours(entry.function) and all(_ours(chosen) for _, chosen in entry.slots)
    return entry.__module__.partition(".")[0] in PACKAGES


def _described(entry: Callable[..., Any] | Slotted) -> str:
    if isinstance(entry, Slotted):
        slots = (f"{name}={_described(chosen)}" for name, chosen in entry.slots)
        return f"{_described(entry.function)}({','.join(slots)})"
    return f"{entry.__module__}.{entry.__qualname__}"


@functools.cache
def cache_folder() -> Path:
    """Return the folder for what is compiled of today's sources, made if need be; older ones go."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "holdfast" / "compiled"
    folder = base / digest(Path(__file__).parents[2])[:16]
    folder.mkdir(parents=True, exist_ok=True)
    folder.touch()
    by_age = sorted(base.iterdir(), key=lambda path: path.stat().st_mtime)
    for old in by_age[:-KEPT_FOLDERS]:
        shutil.rmtree(old, ignore_errors=True)
    return folder
