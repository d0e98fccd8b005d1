"""Where an installation has its files, and what of it is on this machine."""

import pwd
import struct
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from holdfast import RefusedError
from holdfast.install.release import Release, from_folder

BASE = Path("/opt/holdfast")
VERSIONS = BASE / "versions"
CURRENT, PREVIOUS = BASE / "current", BASE / "previous"
UPGRADING, GOING_BACK = BASE / "upgrading", BASE / "going-back"
"""Lead to the version that a change is about, until it is whole: one that was cut off can be continued."""
UNITS = Path("/usr/local/lib/systemd/system")
"""systemd's folder for what no package brings; changes of the machine's owner are in /etc/systemd/system."""
SERIAL = UNITS / "holdfast.service.d" / "serial.conf"
PROGRAM = Path("/usr/local/bin/holdfast")
USER = "holdfast-record"
"""Owns the dives. The other services have no user: systemd lends each one of its own while it runs."""
CONFIGURATION = Path("/etc/holdfast/companion.toml")
OWNERS = "etc/systemd/system/holdfast*.service.d", "var/lib/private/holdfast*", "var/lib/holdfast*"
"""What an uninstallation leaves, besides the configuration: drop-ins, state of the services, dives."""
STEERS = ("ACTIVE", "RAMP_DOWN", "HAND_OVER")
"""The supervisor's states in which Holdfast sends thrust."""


@dataclass(frozen=True)
class Found:
    """What is on the machine."""

    current: str = ""
    """Name of the version in use; "" if none is."""
    previous: str = ""
    upgrading: str = ""
    going_back: str = ""
    versions: tuple[str, ...] = ()
    files: Mapping[Path, str] = field(default_factory=dict)
    """Units and drop-ins, with their text."""
    configuration: str | None = None
    program: str | None = None
    """Where `PROGRAM` leads to; "" if it is no link, None if it is not there."""
    owned: tuple[Path, ...] = ()
    """What belongs to the machine's owner: configuration, drop-ins, dives."""
    user: bool = False
    """Whether `USER` is there."""
    running: bool = True
    """Whether systemd runs; in an image that is being built it does not."""
    status: str = ""
    """What holdfast.service says of itself."""
    bits: int = 64
    """Of this Python: a 32-bit Raspberry Pi OS has a 64-bit kernel."""


def look() -> Found:
    """Look at this machine."""
    running = Path("/run/systemd/system").is_dir()
    return Found(
        current=_leads_to(CURRENT),
        previous=_leads_to(PREVIOUS),
        upgrading=_leads_to(UPGRADING),
        going_back=_leads_to(GOING_BACK),
        versions=tuple(sorted(path.name for path in VERSIONS.iterdir())) if VERSIONS.is_dir() else (),
        files={path: path.read_text(encoding="utf-8") for path in _own_files()},
        configuration=CONFIGURATION.read_text(encoding="utf-8") if CONFIGURATION.exists() else None,
        program=_program(),
        owned=_owned(),
        user=_is_user(USER),
        running=running,
        status=service_status() if running else "",
        bits=8 * struct.calcsize("P"),
    )


def installed(name: str) -> Release:
    """Read a version that is installed; raise RefusedError for one that is not whole."""
    for package in (VERSIONS / name).glob("lib/python3.*/site-packages/holdfast"):
        return from_folder(package, name)
    raise RefusedError(f"{VERSIONS / name} is not whole: install the wheel of this version")


def _own_files() -> list[Path]:
    return [*UNITS.glob("holdfast.service"), *UNITS.glob("holdfast-*.service"), *UNITS.glob("holdfast*.d/*")]


def _owned() -> tuple[Path, ...]:
    there = [CONFIGURATION.parent] if CONFIGURATION.parent.exists() else []
    return tuple(there + [path for pattern in OWNERS for path in sorted(Path("/").glob(pattern))])


def _leads_to(link: Path) -> str:
    return link.readlink().name if link.is_symlink() and link.exists() else ""


def _is_user(name: str) -> bool:
    try:
        return bool(pwd.getpwnam(name))
    except KeyError:
        return False


def _program() -> str | None:
    if PROGRAM.is_symlink():
        return str(PROGRAM.readlink())
    return "" if PROGRAM.exists() else None


def service_status() -> str:
    """Return what holdfast.service says of itself now."""
    shown = subprocess.run(
        ["systemctl", "show", "--property=StatusText", "--value", "holdfast.service"],
        capture_output=True,
        text=True,
        check=False,
    )
    return shown.stdout.strip()
