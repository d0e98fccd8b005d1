"""The files that a study measures, and a digest of what they hold."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]
MEASURED = ("companion/**/*.py", "sim_bridge/**/*.py", "config/**/*.toml")


def digest_of(patterns: Iterable[str], root: Path = ROOT) -> "hashlib._Hash":
    """Return the SHA-256 of what these files under `root` hold."""
    digest = hashlib.sha256()
    for pattern in patterns:
        for path in sorted(root.glob(pattern)):
            digest.update(path.read_bytes())
    return digest
