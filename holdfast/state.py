"""Where a process keeps what outlasts it."""

import os
from pathlib import Path


def state_directory() -> Path:
    """Return systemd's state directory, or the user's."""
    systemd = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if systemd:
        return Path(systemd)
    home = Path(os.environ.get("HOME", "/")) / ".local" / "state"
    return Path(os.environ.get("XDG_STATE_HOME") or home) / "holdfast"
