"""The files that a study measures, and a digest of what they hold."""

import ast
import hashlib
import io
import re
import tokenize
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TypeGuard

ROOT = Path(__file__).parents[1]
PROGRAMS = ("companion/**/*.py", "sim_bridge/**/*.py", "config/**/*.toml")
NOT_DIVED = (
    "companion/app.py",
    "companion/commands.py",
    "companion/identify/",
    "companion/io/",
    "companion/mavlink/pilot_display.py",
    *(f"companion/telemetry/{name}.py" for name in ("degrees", "event_log", "fields")),
    *(f"companion/telemetry/{name}.py" for name in ("glossary", "path_files", "samples", "schemas")),
    *(f"companion/telemetry/{name}.py" for name in ("session", "status_line")),
    "sim_bridge/app.py",
    "sim_bridge/commands.py",
    "sim_bridge/zenoh_link.py",
)
"""Parts of PROGRAMS that no study runs, or that only report: how a dive goes does not depend on them."""

SPACES = re.compile(r"(?<=\S) +")


def digest_of(patterns: Iterable[str], root: Path = ROOT, without: tuple[str, ...] = ()) -> "hashlib._Hash":
    """Return the SHA-256 of the code in these files under `root`, but not in paths that begin as `without`.

    Comments, blank lines and docstrings are not code.
    """
    digest = hashlib.sha256()
    for pattern in patterns:
        for path in sorted(root.glob(pattern)):
            if not path.relative_to(root).as_posix().startswith(without):
                digest.update(_code(path, path.stat().st_mtime_ns))
    return digest


@cache
def _code(path: Path, _: int) -> bytes:
    """Return a file's lines of code: every Python that Holdfast supports returns the same."""
    if path.suffix != ".py":
        return path.read_bytes()
    text = path.read_text(encoding="utf-8")
    lines = text.split("\n")
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(text)):
        if _is_text(node):
            for row in range(node.lineno, (node.end_lineno or node.lineno) + 1):
                lines[row - 1] = ""
    return "\n".join(SPACES.sub(" ", line.rstrip()) for line in lines if line.strip()).encode()


def _is_text(node: ast.AST) -> TypeGuard[ast.Expr]:
    return isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str)


def measured_code(root: Path = ROOT) -> str:
    """Return a digest of the code that decides how a dive goes."""
    return digest_of(PROGRAMS, root, NOT_DIVED).hexdigest()[:16]
