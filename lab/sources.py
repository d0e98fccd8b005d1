"""The files that a study measures, and a digest of what they hold."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROGRAMS = ("companion/**/*.py", "sim_bridge/**/*.py", "config/**/*.toml")
NOT_DIVED = (
    "companion/app.py",
    "companion/commands.py",
    "companion/identify/",
    "companion/io/",
    "companion/telemetry/glossary.py",
    "sim_bridge/app.py",
    "sim_bridge/commands.py",
    "sim_bridge/status.py",
    "sim_bridge/zenoh_link.py",
)
"""Of PROGRAMS what no study runs, and texts: how a dive goes does not depend on it."""


def digest_of(patterns: Iterable[str], root: Path = ROOT, without: tuple[str, ...] = ()) -> "hashlib._Hash":
    """Return the SHA-256 of what these files under `root` hold, but not paths that begin as `without`."""
    digest = hashlib.sha256()
    for pattern in patterns:
        for path in sorted(root.glob(pattern)):
            if not path.relative_to(root).as_posix().startswith(without):
                digest.update(path.read_bytes())
    return digest


def measured_code(root: Path = ROOT) -> str:
    """Return a digest of the code that decides how a dive goes."""
    return digest_of(PROGRAMS, root, NOT_DIVED).hexdigest()[:16]
