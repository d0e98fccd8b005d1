"""Compile the equations of the companion and the simulator for the lab, where they stand: as plain Python.

`compiled(function)` is a numba function with the behaviour of `function`. The Python functions that it
calls, or is given as arguments, are compiled with it: no equation needs a decorator, and no vehicle needs
numba. Two things differ from plain Python: floats do not raise (division by zero gives inf or NaN), and whole
numbers are of 64 bits. Finite floats are the same to the last bit in functions without whole powers, `hypot`
and sums of floats.

What the lab runs (`cached`) stays on disk, in a folder named by a digest of every source that it may be made
of. numba's own cache looks at the file of the function alone, and not at those that it calls.
"""

import fcntl
import functools
import gc
import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core import types
from numba.core.datamodel import models
from numba.extending import register_model, typeof_impl

import lab.batch.replace  # numba learns NamedTuple._replace  # noqa: F401
from lab.batch.pipeline import PART, WHOLE

PACKAGES = ("companion", "sim_bridge", "lab")
OPTIONS = {"error_model": "numpy"}
"""Floats do not raise. Without `fastmath` a product and a sum are rounded twice, as in Python."""

KEPT_FOLDERS = 4
"""Folders of compiled code that are kept; older ones are removed."""


class PythonFunction(types.Dispatcher):
    """The type of a Python function: its name, the same in every process."""

    def __init__(self, function: FunctionType) -> None:
        self.function = function
        super(types.Dispatcher, self).__init__(f"{function.__module__}.{function.__qualname__}")

    __eq__ = types.Type.__eq__
    __hash__ = types.Type.__hash__

    @property
    def key(self) -> Any:
        """What tells types apart."""
        return self.name

    @property
    def dispatcher(self) -> Any:
        """What compiles it where it is called."""
        return _callee(self.function)

    def __reduce__(self) -> tuple[Any, ...]:
        return PythonFunction, (self.function,)


@typeof_impl.register(FunctionType)  # type: ignore[untyped-decorator]
def _type_of(function: FunctionType, _: Any) -> PythonFunction | None:
    """Give the type, unless numba knows the function itself."""
    return None if _package(function) in ("numba", "numpy") else PythonFunction(function)


register_model(PythonFunction)(models.OpaqueModel)


@functools.cache
def cached(entry: Callable[..., Any], *, keeps: bool = True) -> Any:
    """Return a function of the lab, compiled for the types that it is called with.

    It stays on disk, unless it is given functions from outside PACKAGES; one process compiles it.
    """
    folder = cache_folder()
    if keeps:
        numba.config.CACHE_DIR = str(folder)
    dispatcher = numba.njit(cache=keeps, **WHOLE, **OPTIONS)(entry)
    compile_alone = dispatcher.compile

    def compile_in_turn(types: Any) -> Any:
        with (folder / f"{entry.__module__}.{entry.__qualname__}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            gc.disable()  # millions of objects that stay: it takes a tenth of the time
            try:
                return compile_alone(types)
            finally:
                gc.enable()

    dispatcher.compile = compile_in_turn
    return dispatcher


def is_ours(tree: Any) -> bool:
    """Tell whether all functions in a tree of tuples are of PACKAGES."""
    if isinstance(tree, tuple):
        return all(map(is_ours, tree))
    return not callable(tree) or _package(tree) in PACKAGES


def _package(function: Callable[..., Any]) -> str:
    return function.__module__.partition(".")[0]


def digest(root: Path) -> str:
    """Return the SHA-256, in hex, of all Python sources of PACKAGES below `root`."""
    sources = hashlib.sha256()
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        data = path.read_bytes()
        sources.update(f"{path.relative_to(root)} {len(data)}\n".encode() + data)
    return sources.hexdigest()


@functools.cache
def compiled(function: Callable[..., Any]) -> Any:
    """Return a function that numba compiles for the types with which it is called."""
    return numba.njit(**WHOLE, **OPTIONS)(function)


@functools.cache
def _callee(function: Callable[..., Any]) -> Any:
    """Return the same for calls from what is compiled alone."""
    return numba.njit(**PART, **OPTIONS)(function)


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
