"""Compile the equations of the companion and the simulator for the lab, where they stand: as plain Python.

`compiled(function)` is a numba function with the behaviour of `function`. The Python functions that it calls
are compiled with it: no equation needs a decorator, and no vehicle needs numba. Two things differ from plain
Python: floats do not raise (division by zero gives inf or NaN), and arguments have the annotated types.

An entry of the lab (`cached`) is kept on disk, in a folder named by a digest of every source that it may have
been made of. numba's own cache looks at the file of the function alone, and not at those that it calls.
"""

import fcntl
import functools
import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numba
import numpy as np

PACKAGES = ("companion", "sim_bridge", "lab")
KEPT_FOLDERS = 4
"""Of compiled code; those of older sources are removed."""

OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}}
"""Floats do not raise; a product and a sum may be one instruction, rounded once. NaN stays NaN."""

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return `function`, compiled with every function of PACKAGES that it refers to."""
    made: Function = _jit(function, False)
    return made


def cached(function: Function) -> Function:
    """Return `function` compiled as `compiled` does, from disk if these sources were compiled before.

    Another process that compiles the same sources now is waited for.
    """
    folder = _folder()
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        numba.config.CACHE_DIR = str(folder)
        made: Function = _jit(function, True)
    return made


def signature(function: Callable[..., Any]) -> tuple[Any, ...]:
    """Return the numba types of the arguments, from their annotations.

    Raises TypeError for an annotation that the equations do not use.
    """
    hints = get_type_hints(function)
    hints.pop("return", None)
    return tuple(numba.typeof(example(hint)) for hint in hints.values())


def example(hint: Any) -> Any:
    """Return a value of an annotation: float, int, bool, a tuple or NamedTuple of these, or an array.

    An array is `np.ndarray[tuple[int, ...], np.dtype[...]]` with an `int` for each dimension, C-contiguous.
    """
    if hint in (float, int, bool):
        return hint()
    if isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields"):
        fields = get_type_hints(hint)
        return hint(*(example(fields[name]) for name in hint._fields))
    if get_origin(hint) is tuple:
        return tuple(map(example, get_args(hint)))
    if get_origin(hint) is np.ndarray:
        shape, dtype = get_args(hint)
        return np.zeros((1,) * len(get_args(shape)), get_args(dtype)[0])
    raise TypeError(f"{hint} is no type of an equation: use float, int, bool, tuples and NamedTuples of them")


def digest(root: Path) -> str:
    """Return the SHA-256, in hex, of all Python sources of PACKAGES below `root`."""
    sources = hashlib.sha256()
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        data = path.read_bytes()
        sources.update(f"{path.relative_to(root)} {len(data)}\n".encode() + data)
    return sources.hexdigest()


@functools.cache
def _jit(function: Callable[..., Any], cache: bool) -> Any:
    jit = numba.njit(signature(function), cache=cache, **OPTIONS)
    return jit(_with_compiled_callees(function))


@functools.cache
def _callee(function: Callable[..., Any]) -> Any:
    """Return a function that numba compiles for the types with which it is called."""
    return numba.njit(**OPTIONS)(_with_compiled_callees(function))


def _with_compiled_callees(function: Callable[..., Any]) -> FunctionType:
    """Copy a Python function, with compiled ones in the place of the functions that it refers to."""
    assert isinstance(function, FunctionType)
    scope = dict(function.__globals__)
    for name in _names(function.__code__):
        if isinstance(callee := scope.get(name), FunctionType) and _ours(callee) and callee is not function:
            scope[name] = _callee(callee)
    copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
    functools.update_wrapper(copy, function)
    return copy


def _names(code: Any) -> set[str]:
    inner = [_names(constant) for constant in code.co_consts if hasattr(constant, "co_names")]
    return set(code.co_names).union(*inner)


def _ours(function: FunctionType) -> bool:
    return function.__module__.partition(".")[0] in PACKAGES


@functools.cache
def _folder() -> Path:
    """Return the folder for what is compiled of today's sources, made if need be; older ones go."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "holdfast" / "compiled"
    folder = base / digest(Path(__file__).parents[2])[:16]
    folder.mkdir(parents=True, exist_ok=True)
    folder.touch()
    by_age = sorted(base.iterdir(), key=lambda path: path.stat().st_mtime)
    for old in by_age[:-KEPT_FOLDERS]:
        shutil.rmtree(old, ignore_errors=True)
    return folder
