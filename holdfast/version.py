"""Which Holdfast this is: for `holdfast --version`, telemetry, recordings and studies."""

import platform
import subprocess
from functools import cache
from pathlib import Path

from holdfast import own_version

OLDEST_ARDUSUB = (4, 5, 0)
TESTED_ARDUSUB = "4.7"
"""The version against which tests/firmware run."""

CHECKOUT = Path(__file__).parents[1]
DESCRIBE = ("git", "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12")


@cache
def revision() -> str:
    """Return the commit of the checkout that runs, "-dirty" after it where it was changed since.

    Empty for an installation, which is none.
    """
    if not (CHECKOUT / ".git").exists():
        return ""
    try:
        done = subprocess.run(DESCRIBE, cwd=CHECKOUT, capture_output=True, text=True, timeout=5.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()


@cache
def running() -> str:
    """Return version and commit: "1.0.0", or in a checkout "1.0.0 (3fb5d8af455b-dirty)"."""
    return f"{own_version()} ({revision()})" if revision() else own_version()


def about() -> str:
    """Return what `holdfast --version` prints."""
    oldest = ".".join(map(str, OLDEST_ARDUSUB[:2]))
    return (
        f"holdfast {running()}\n"
        f"Python {platform.python_version()}, {platform.machine()}\n"
        f"for ArduSub {oldest} and newer, tested with {TESTED_ARDUSUB}\n"
    )
