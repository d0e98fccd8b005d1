"""The files that a study measures, and a digest of what they hold."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROGRAMS = ("companion/**/*.py", "sim_bridge/**/*.py", "config/**/*.toml")
MEASURED = (
    "companion/assembly.py",
    "companion/config.py",
    "companion/engine.py",
    "companion/control/*.py",
    "companion/core/*.py",
    "companion/estimation/*.py",
    "companion/guidance/**/*.py",
    "companion/mavlink/*.py",
    "companion/records/*.py",
    "companion/supervision/*.py",
    "sim_bridge/config.py",
    "sim_bridge/vehicle.py",
    "sim_bridge/firmware/*.py",
    "sim_bridge/physics/*.py",
    "config/**/*.toml",
)
"""What decides how a dive goes: a table that is older than it is marked so."""


def digest_of(patterns: Iterable[str], root: Path = ROOT) -> "hashlib._Hash":
    """Return the SHA-256 of what these files under `root` hold."""
    digest = hashlib.sha256()
    for pattern in patterns:
        for path in sorted(root.glob(pattern)):
            digest.update(path.read_bytes())
    return digest
