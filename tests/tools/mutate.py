"""Mutation testing, small and sampled: `python tests/tools/mutate.py supervisor --sample 60 --seed 1`.

A mutant is the source with one change: a comparison, an operator, a number, a truth value or a condition
turned round, a statement or a row of a table left out. It is written into a copy of the repository, where the
tests that are meant to hold that file are run; a mutant that they let pass is a survivor, and is shown.
Annotations and texts are left alone. Neither mutmut nor cosmic-ray is needed.
"""

import argparse
import ast
import copy
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parent.parent.parent
TIMEOUT_S = 180.0
ROW = 3
"""A tuple of at least as many calls is a table."""

LAWS = ("levelling", "law", "network", "integrator", "regressor", "positioning", "reference", "controller")
GROUPS = {
    "supervisor": (
        [f"companion/supervision/{name}.py" for name in ("supervisor", "conditions", "monitor", "handover")],
        ["unit/test_supervisor.py", "unit/test_watching.py", "unit/test_guard.py"],
    ),
    "core": (
        [str(path.relative_to(ROOT)) for path in sorted((ROOT / "companion/core").glob("[a-z]*.py"))],
        [
            *(f"unit/test_{name}.py" for name in (*LAWS, "taking_over")),
            "property/test_control_any.py",
            "property/test_reference_any.py",
        ],
    ),
    "ardusub": (
        [f"companion/mavlink/{name}.py" for name in ("ardusub", "decode", "encode")],
        ["unit/test_mavlink_ardusub.py", "property/test_mavlink_axes.py", "property/test_mavlink_bytes.py"],
    ),
}
PAIRS: tuple[tuple[Any, Any], ...] = (
    (ast.Lt, ast.LtE),
    (ast.Gt, ast.GtE),
    (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot),
    (ast.In, ast.NotIn),
    (ast.Add, ast.Sub),
    (ast.Mult, ast.Div),
    (ast.BitAnd, ast.BitOr),
    (ast.And, ast.Or),
)
OTHER = {one: other for pair in PAIRS for one, other in (pair, pair[::-1])}


def changes(node: ast.AST) -> list[ast.AST]:
    """Return the changed copies of a node, without those of its parts."""
    new: Any = copy.copy(node)
    match new:
        case ast.Compare(ops=[op]) if type(op) in OTHER:
            new.ops = [OTHER[type(op)]()]
        case ast.BinOp(op=op) | ast.AugAssign(op=op) | ast.BoolOp(op=op) if type(op) in OTHER:
            new.op = OTHER[type(op)]()
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            return [new.operand]
        case ast.Constant(value=bool()):
            new.value = not new.value
        case ast.Constant(value=int() | float() as value):
            new.value = value + 1 if value == 0 or isinstance(value, int) else value * 1.5
        case ast.If() | ast.IfExp():
            new.test = ast.UnaryOp(ast.Not(), new.test)
        case ast.Expr(value=ast.Call()):
            return [ast.Pass()]
        case ast.Tuple(elts=rows) if len(rows) >= ROW and all(isinstance(row, ast.Call) for row in rows):
            return [ast.Tuple([*rows[:i], *rows[i + 1 :]], new.ctx) for i in range(len(rows))]
        case _:
            return []
    return [new]


class Mutation(ast.NodeTransformer):
    """Makes change number `wanted` of a source, in its order; counts all of them."""

    def __init__(self, wanted: int = -1) -> None:
        self.count, self.said = 0, ""
        self._wanted = wanted

    def visit(self, node: ast.AST) -> Any:
        """Change a node, or go on to its parts."""
        found = changes(node)
        at = self._wanted - self.count
        self.count += len(found)
        if 0 <= at < len(found):
            self.said = f"{getattr(node, 'lineno', 0)}: {_short(node)}  ->  {_short(found[at])}"
            return found[at]
        return super().visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Leave annotations alone."""
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_arg(self, node: ast.arg) -> ast.AST:
        """Leave annotations alone."""
        return node


def _short(node: ast.AST) -> str:
    text = ast.unparse(ast.fix_missing_locations(node)).split("\n")[0]
    return text if len(text) < 90 else text[:87] + "..."


def mutant(source: str, wanted: int) -> tuple[str, Mutation]:
    """Return the source with change number `wanted`, and what was changed."""
    mutation = Mutation(wanted)
    tree = mutation.visit(ast.parse(source))
    return ast.unparse(ast.fix_missing_locations(tree)), mutation


def pass_all(workshop: Path, tests: list[str]) -> bool:
    """Tell whether the tests pass; what hangs does not."""
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(workshop)}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        run = subprocess.run(
            command, cwd=workshop, env=environment, capture_output=True, timeout=TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return run.returncode == 0


def main() -> int:
    """Try a sample of a group's mutants; show those that survive."""
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
        sources = {path: (workshop / path).read_text() for path in files if arguments.file in (None, path)}
        every = [(path, i) for path, source in sources.items() for i in range(mutant(source, -1)[1].count)]
        picked = np.random.default_rng(arguments.seed).permutation(len(every))[: arguments.sample]
        if not pass_all(workshop, tests):
            raise SystemExit("the tests fail without any mutant")
        survived = 0
        for path, index in (every[i] for i in sorted(picked)):
            changed, mutation = mutant(sources[path], index)
            (workshop / path).write_text(changed)
            if pass_all(workshop, tests):
                survived += 1
                sys.stdout.write(f"survived: {path}:{mutation.said}\n")
                sys.stdout.flush()
            (workshop / path).write_text(sources[path])
    sys.stdout.write(
        f"{arguments.group}: {len(picked) - survived} of {len(picked)} mutants killed, "
        f"{len(every)} possible, seed {arguments.seed}\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
