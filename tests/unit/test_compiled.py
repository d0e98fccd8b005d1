"""The lab compiles plain functions of other packages, and keeps what it compiled until a source changes."""

import ast
import inspect
import math
import textwrap
from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
import pytest
from virtual import ROOT

from companion import assembly, core
from companion.config import load_config
from companion.core import bounds as subject_of_modules
from companion.core import integrator
from companion.core.tick import confirm, control, observe
from lab.batch import compiled as subject
from lab.batch.compiled import cached, compiled, digest
from sim_bridge.firmware import mixer


class Parameters(NamedTuple):
    gain: float
    steps: int
    flags: tuple[bool, bool]


class Motion(NamedTuple):
    position: float
    rate: float


def limited(x: float, limit: float) -> float:
    return max(-limit, min(limit, x))


def step(parameters: Parameters, motion: Motion, dt_s: float) -> Motion:
    rate = motion.rate
    for _ in range(parameters.steps):
        rate += limited(parameters.gain * motion.position, 1.0) if parameters.flags[0] else math.sin(rate)
    return Motion(motion.position + dt_s * rate, rate)


def quotient(a: float, b: float) -> float:
    return a / b


@pytest.mark.parametrize("flags", [(True, False), (False, True)])
def test_compiled_function_and_its_callees_do_what_python_does(flags):
    arguments = Parameters(3.0, 4, flags), Motion(0.2, -0.1), 0.02
    result = compiled(step)(*arguments)
    assert isinstance(result, Motion)
    assert result == step(*arguments)


def test_compiled_floats_do_not_raise():
    assert compiled(quotient)(1.0, 0.0) == math.inf
    assert math.isnan(compiled(quotient)(0.0, 0.0))


class Kept(NamedTuple):
    motion: Motion
    weights: list[float]
    steps: int


def replaced(x: float) -> Kept:
    kept = Kept(steps=1, weights=[x], motion=Motion(rate=x, position=2.0 * x))
    return kept._replace(motion=kept.motion._replace(rate=-x), weights=[*kept.weights, 3.0])


def test_records_are_made_by_keyword_and_replaced():
    assert compiled(replaced)(0.5) == replaced(0.5) == Kept(Motion(1.0, -0.5), [0.5, 3.0], 1)


def doubled(x: float) -> float:
    return 2.0 * x


def halved(x: float) -> float:
    return 0.5 * x


def twice(change: Callable[[float], float], x: float) -> float:
    return change(change(x)) + subject_of_modules.wrap(0.0)


def test_compiled_code_is_taken_from_disk_for_the_functions_that_it_is_given(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(subject, "PACKAGES", (*subject.PACKAGES, __name__.partition(".")[0]))
    subject.cache_folder.cache_clear()
    for hits in (0, 1):
        cached.cache_clear()
        for chosen, expected in ((doubled, 12.0), (halved, 0.75)):
            call = cached(twice)
            assert call(chosen, 3.0) == expected
        assert sum(call.stats.cache_hits.values()) == 2 * hits
    subject.cache_folder.cache_clear()
    cached.cache_clear()


def test_a_changed_or_new_source_changes_the_digest(tmp_path):
    (tmp_path / "companion" / "core").mkdir(parents=True)
    source = tmp_path / "companion" / "core" / "law.py"
    source.write_text("k = 1\n")
    seen = {digest(tmp_path)}
    source.write_text("k = 2\n")
    seen.add(digest(tmp_path))
    (tmp_path / "companion" / "other.py").write_text("")
    seen.add(digest(tmp_path))
    assert len(seen) == 3


def example(name):
    """A user's compensator or law: a file of docs/examples."""
    spec = spec_from_file_location(name, ROOT / "docs" / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


EQUATIONS = [example("drag").step, example("pd").step, integrator.step, mixer.mix_vectored]
"""Those that the dive of test_batch.py does not go through."""


def values(hint, rng):
    """Random values of an annotation's form, away from zero."""
    if hint is float:
        return float(rng.uniform(0.1, 0.9))
    if hint is int:
        return 8
    if hint is bool:
        return bool(rng.integers(2))
    fields = get_type_hints(hint).values() if hasattr(hint, "_fields") else get_args(hint)
    made = [values(field, rng) for field in fields]
    return hint(*made) if hasattr(hint, "_fields") else tuple(made)


@pytest.mark.parametrize("equation", EQUATIONS, ids=lambda equation: equation.__qualname__)
def test_an_equation_compiled_is_the_equation(equation):
    hints = get_type_hints(equation)
    hints.pop("return")
    rng = np.random.default_rng(1)
    for _ in range(3):
        given = [values(hint, rng) for hint in hints.values()]
        assert np.array_equal(flat(compiled(equation)(*given)), flat(equation(*given)), equal_nan=True)


def called_by(function, seen):
    """Add a function and all Python functions that it calls."""
    if function in seen:
        return seen
    seen.add(function)
    names = inspect.getclosurevars(function)
    for value in [*names.globals.values(), *names.nonlocals.values()]:
        members = [value]
        if inspect.ismodule(value):
            members = [vars(value).get(name) for name in function.__code__.co_names]
        for one in members:
            if inspect.isfunction(one) and one.__module__.startswith("companion"):
                called_by(one, seen)
    return seen


def functions_of(tree):
    if inspect.isfunction(tree):
        return {tree}
    return set().union(*map(functions_of, tree)) if isinstance(tree, tuple) else set()


def test_nothing_in_the_core_rounds_otherwise_when_it_is_compiled():
    """A power of a whole number, `hypot`, `pow` and a sum of floats do; fractional powers do not."""
    functions: set[Any] = set()
    for chosen in {observe, control, confirm} | functions_of(assembly.parameters(load_config())):
        called_by(chosen, functions)
    assert len(functions) > 150
    for function in functions:
        for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(function)))):
            where = f"{function.__module__}.{function.__qualname__}"
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
                assert isinstance(node.right, ast.Name), f"{where}: a product instead of a power"
            if isinstance(node, ast.Call):
                assert ast.unparse(node.func) not in ("sum", "pow", "math.hypot", "math.fsum"), where


MAY_IMPORT = ("math", "typing", "collections.abc", "companion.core", "companion.records")


@pytest.mark.parametrize("file", sorted(Path(core.__file__).parent.glob("*.py")), ids=lambda file: file.stem)
def test_a_file_of_the_core_holds_equations_alone(file):
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert all(name.name in MAY_IMPORT for name in node.names), ast.unparse(node)
        if isinstance(node, ast.ImportFrom):
            assert node.module in MAY_IMPORT or str(node.module).startswith("companion.core."), ast.unparse(
                node
            )
        if isinstance(node, ast.ClassDef):
            assert "NamedTuple" in map(ast.unparse, node.bases), node.name


def flat(result):
    return [number for part in result for number in flat(part)] if isinstance(result, tuple) else [result]
