"""Mutation testing, small and sampled: `python tests/tools/mutate.py supervisor --sample 60 --seed 1`.

A mutant is the source with one change: a comparison, an operator, a number, a truth value or a condition
turned round, a statement left out. It is written into a copy of the repository, where the tests that are
meant to hold that file are run; a mutant that they let pass is a survivor, and is shown. Annotations, texts
and the lines of `__all__`-like bookkeeping are left alone. Neither mutmut nor cosmic-ray is needed.
"""

import argparse
import ast
import copy
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np

ROOT = Path(__file__).parent.parent.parent
TIMEOUT_S = 180.0

SUPERVISOR = ("unit/test_supervisor.py", "unit/test_watching.py", "property/test_guard.py")
CONTROL = tuple(
    f"unit/test_{name}.py"
    for name in (
        "levelling",
        "law",
        "network",
        "integrator",
        "regressor",
        "positioning",
        "reference",
        "controller",
    )
)
GROUPS = {
    "supervisor": (
        (
            "companion/supervision/supervisor.py",
            "companion/supervision/conditions.py",
            "companion/supervision/monitor.py",
            "companion/supervision/handover.py",
        ),
        SUPERVISOR,
    ),
    "control": (
        tuple(str(path.relative_to(ROOT)) for path in sorted((ROOT / "companion/control").glob("[a-z]*.py"))),
        (
            *CONTROL,
            "property/test_control_any.py",
            "property/test_reference_any.py",
            "unit/test_taking_over.py",
        ),
    ),
    "ardusub": (
        ("companion/mavlink/ardusub.py", "companion/mavlink/decode.py", "companion/mavlink/encode.py"),
        ("unit/test_mavlink_ardusub.py", "property/test_mavlink_axes.py", "property/test_mavlink_bytes.py"),
    ),
}

COMPARISONS = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
OPERATORS = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}


def sites(tree: ast.AST) -> Iterator[ast.AST]:
    """Give the nodes that may be changed, in the order of the source."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(tree, ast.AnnAssign) and node is tree.annotation:
            continue
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                yield from sites(ast.Expression(node.value))
            continue
        if isinstance(node, ast.arguments):
            for default in (*node.defaults, *(d for d in node.kw_defaults if d is not None)):
                yield from sites(ast.Expression(default))
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        yield node
        if isinstance(node, ast.FunctionDef):
            for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
                yield from sites(ast.Expression(default))
            for part in node.body:
                if not (isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant)):
                    yield part
                yield from sites(part)
            continue
        yield from sites(node)


def changes(node: ast.AST) -> list[str]:
    """Return the names of the changes that `node` allows."""
    match node:
        case ast.Compare(ops=[op]) if type(op) in COMPARISONS:
            return ["compare"]
        case ast.BinOp(op=op) | ast.AugAssign(op=op) if type(op) in OPERATORS:
            return ["operator"]
        case ast.BoolOp():
            return ["and/or"]
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            return ["drop sign"]
        case ast.Constant(value=bool()):
            return ["flip"]
        case ast.Constant(value=int() | float()):
            return ["number"]
        case ast.If() | ast.IfExp():
            return ["condition"]
        case ast.Expr(value=ast.Call()):
            return ["leave out"]
        case _:
            return []


def changed(node: ast.AST, change: str) -> ast.AST:
    """Return a changed copy of `node`."""
    new: Any = copy.deepcopy(node)
    match change:
        case "compare":
            new.ops = [COMPARISONS[type(new.ops[0])]()]
        case "operator":
            new.op = OPERATORS[type(new.op)]()
        case "and/or":
            new.op = ast.Or() if isinstance(new.op, ast.And) else ast.And()
        case "drop sign":
            return cast(ast.AST, new.operand)
        case "flip":
            new.value = not new.value
        case "number":
            new.value = new.value + 1 if new.value == 0 or isinstance(new.value, int) else new.value * 1.5
        case "condition":
            new.test = ast.UnaryOp(ast.Not(), new.test)
        case "leave out":
            return ast.Pass()
    return cast(ast.AST, new)


class Swap(ast.NodeTransformer):
    """Puts one node in another's place."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self._new if node is self._old else super().visit(node)


def mutants(workshop: Path, path: str) -> list[tuple[str, int]]:
    """Return every mutant of a file as (path, index)."""
    tree = ast.parse((workshop / path).read_text(encoding="utf-8"))
    return [(path, i) for i in range(sum(len(changes(node)) for node in sites(tree)))]


def mutant(workshop: Path, path: str, index: int) -> tuple[str, str]:
    """Return the mutant's source and what was changed."""
    tree = ast.parse((workshop / path).read_text(encoding="utf-8"))
    every = [(node, change) for node in sites(tree) for change in changes(node)]
    node, change = every[index]
    new = changed(node, change)
    said = f"{path}:{getattr(node, 'lineno', 0)}: {_short(node)}  ->  {_short(new)}"
    return ast.unparse(ast.fix_missing_locations(Swap(node, new).visit(tree))), said


def _short(node: ast.AST) -> str:
    text = ast.unparse(ast.fix_missing_locations(node)).split("\n")[0]
    return text if len(text) < 90 else text[:87] + "..."


def survives(workshop: Path, path: str, source: str, tests: list[str]) -> bool:
    """Run the tests against the mutant; one that hangs is killed."""
    target = workshop / path
    original = target.read_text(encoding="utf-8")
    target.write_text(source, encoding="utf-8")
    try:
        return pass_all(workshop, tests)
    finally:
        target.write_text(original, encoding="utf-8")


def pass_all(workshop: Path, tests: list[str]) -> bool:
    """Tell whether the tests pass."""
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(workshop)}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        run = subprocess.run(
            command, cwd=workshop, env=environment, capture_output=True, timeout=TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return run.returncode == 0


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("group", choices=sorted(GROUPS))
    parser.add_argument("--sample", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--file", help="only this file of the group")
    arguments = parser.parse_args()
    files, names = GROUPS[arguments.group]
    tests = [f"tests/{name}" for name in names]
    with tempfile.TemporaryDirectory() as folder:
        workshop = Path(folder) / "repository"
        kept = shutil.ignore_patterns(".git", ".venv", "out", "__pycache__", ".*_cache", ".hypothesis")
        shutil.copytree(ROOT, workshop, ignore=kept)
        every = [one for path in files if arguments.file in (None, path) for one in mutants(workshop, path)]
        picked = np.random.default_rng(arguments.seed).permutation(len(every))[: arguments.sample]
        chosen = [every[i] for i in sorted(picked)]
        if not pass_all(workshop, tests):
            say("the tests fail without any mutant")
            return 2
        survivors = []
        for count, (path, index) in enumerate(chosen, 1):
            source, said = mutant(workshop, path, index)
            if survives(workshop, path, source, tests):
                survivors.append(said)
                say(f"[{count}/{len(chosen)}] survived: {said}")
    killed = len(chosen) - len(survivors)
    say(
        f"{arguments.group}: {killed} of {len(chosen)} mutants killed ({killed / len(chosen):.0%}), "
        f"{len(every)} possible, seed {arguments.seed}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
