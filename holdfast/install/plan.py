"""From what is on a machine to the steps that change it. Pure: nothing is read, nothing is done."""

import re
import tomllib
from pathlib import Path

from holdfast import RefusedError
from holdfast.install.machine import (
    BASE,
    CONFIGURATION,
    CURRENT,
    GOING_BACK,
    PREVIOUS,
    PROGRAM,
    SERIAL,
    STEERS,
    UNITS,
    UPGRADING,
    USER,
    VERSIONS,
    Found,
)
from holdfast.install.release import Release
from holdfast.install.steps import LookAgain, Remove, Run, Step, Symlink, Write

ENABLED = ("holdfast.service", "holdfast-record.service", "holdfast-dashboard.service")
ALL = "holdfast*.service"
FROM_DEBIAN = ("cffi", "lz4", "numpy", "pycparser", "zstandard")
"""Of the lock, what the package index has no 32-bit files of."""
IMPORTS = "import holdfast, companion.app, dashboard.recording.record, dashboard.web.app, sim_bridge.app"


def version_before(found: Found) -> str:
    """Return the version to go back to; raise RefusedError if there is none."""
    if found.going_back:  # and was cut off
        return found.going_back
    if found.previous not in ("", found.current):
        return found.previous
    if found.upgrading:
        raise RefusedError(f"the change to {found.upgrading} was cut off: repeat it, then go back")
    raise RefusedError("there is no version before this one to go back to")


def install(
    found: Found, release: Release, python: str, wheels: Path | None = None, *, back: bool = False
) -> list[Step]:
    """Return the steps to a release in use.

    `wheels` is a folder that has all that is needed; without it the package index is asked. To go `back` to a
    version that is on the machine removes none. No step is left if the release is in use. Repeated after it
    was cut off it goes on. Raises RefusedError while the vehicle is held.
    """
    new = release.name != found.current
    change = new or release.name in (found.upgrading, found.going_back)
    bin_ = VERSIONS / release.name / "bin"
    configuration = release.configuration if found.configuration is None else found.configuration
    steps: list[Step] = []
    if new and not back and release.name != found.previous:
        steps += _version(found, release, python, wheels)
    if found.configuration is None:
        steps.append(Write(CONFIGURATION, configuration))
    if new:
        check = (str(bin_ / "holdfast"), "config", "check", str(CONFIGURATION))
        steps.append(Run(check, "check that this version takes the configuration"))
    if not found.user:
        steps.append(
            Run(
                ("useradd", "--system", "--no-create-home", "--home-dir", "/", USER),
                "add the recorder's user",
            )
        )
    if new:
        steps.append(Symlink(GOING_BACK if back else UPGRADING, f"versions/{release.name}"))
    files = _files(release, configuration)
    changed = _changes(found, files)
    steps += changed
    if new and found.current:
        steps.append(Symlink(PREVIOUS, f"versions/{found.current}"))
    if new:
        steps.append(Symlink(CURRENT, f"versions/{release.name}"))
    if found.program is None:
        steps.append(Symlink(PROGRAM, str(CURRENT / "bin" / "holdfast")))
    if change or changed:
        _refuse_while_held(found)
        replaced = found.current if new else found.previous
        steps += _started(found, first=change and not replaced)
    if change:
        steps += [Remove(UPGRADING), Remove(GOING_BACK)]
    if new and not back:
        kept = (release.name, found.current)
        steps += [Remove(VERSIONS / name) for name in found.versions if name not in kept]
    return steps


def uninstall(found: Found, *, purge: bool) -> list[Step]:
    """Return the steps to nothing left; configuration and dives are left without `purge`."""
    steps: list[Step] = []
    if any(UNITS / name in found.files for name in ENABLED):
        _refuse_while_held(found)
        steps.append(_systemctl("do not start it any more", "disable", *ENABLED))
        if found.running:
            steps.append(LookAgain())
            steps.append(_systemctl("stop", "stop", ALL))
    steps += [Remove(path) for path in sorted(found.files)]
    if SERIAL in found.files:
        steps.append(Remove(SERIAL.parent))
    if found.program == str(CURRENT / "bin" / "holdfast"):
        steps.append(Remove(PROGRAM))
    if found.versions or found.current:
        steps.append(Remove(BASE))
    if found.user:
        steps.append(Run(("userdel", USER), "remove the recorder's user"))
    if purge:
        steps += [Remove(path) for path in found.owned]
    if found.running and found.files:
        steps.append(_systemctl("forget the units", "daemon-reload"))
    return steps


def _version(found: Found, release: Release, python: str, wheels: Path | None) -> list[Step]:
    """Return the steps to a virtual environment; one that was begun and not finished is removed first."""
    folder = VERSIONS / release.name
    inside = str(folder / "bin" / "python")
    lock = folder / "requirements.lock"
    pip = (
        inside,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
        "--no-compile",
    )
    source = () if wheels is None else ("--no-index", "--find-links", str(wheels))
    narrow = found.bits == 32
    binary = () if narrow else ("--only-binary", ":all:")  # msgspec and pymavlink are sources there
    share = ("--system-site-packages",) if narrow else ()
    return [
        *([Remove(folder)] if release.name in found.versions else []),
        Run((python, "-m", "venv", *share, str(folder)), "make a virtual environment"),
        Run((*pip, "--no-index", str(release.wheel)), "install Holdfast"),  # first: it says which Pythons fit
        Write(lock, _without(release.lock, FROM_DEBIAN) if narrow else release.lock),
        Run(
            (*pip, *source, "--require-hashes", *binary, "-r", str(lock)),
            "install what it needs, each file known by its hash",
        ),
        Run((inside, "-c", IMPORTS), "try and compile what the services import"),
    ]


def _without(lock: str, names: tuple[str, ...]) -> str:
    """Return a lock without some packages; each has a line of its own, and one for each hash."""
    return re.sub(rf"^(?:{'|'.join(names)})==(?:.*\\\n)*.*\n", "", lock, flags=re.MULTILINE)


def _files(release: Release, configuration: str) -> dict[Path, str]:
    files = {UNITS / name: text for name, text in release.units.items()}
    drop_in = _serial(configuration)
    return {**files, SERIAL: drop_in} if drop_in else files


def _changes(found: Found, files: dict[Path, str]) -> list[Step]:
    there = found.files
    return [
        *(Write(path, text) for path, text in sorted(files.items()) if there.get(path) != text),
        *(Remove(path) for path in sorted(there) if path not in files),
    ]


def _serial(configuration: str) -> str:
    """Return the drop-in for a vehicle on a serial line, or "" for one that is on none."""
    endpoint = tomllib.loads(configuration).get("link", {}).get("endpoint", "")
    match = re.fullmatch(r"serial:(/[^\s:]+):\d+", str(endpoint))
    if not match:
        return ""
    return (
        f"# From link.endpoint in {CONFIGURATION}, by `holdfast install`.\n"
        f"[Service]\nPrivateDevices=no\nDeviceAllow={match[1]} rw\nSupplementaryGroups=dialout\n"
    )


def _started(found: Found, *, first: bool) -> list[Step]:
    """Return the steps that start it, or start it afresh; who disabled a service keeps it so."""
    steps: list[Step] = []
    if found.running:
        steps.append(_systemctl("read the units", "daemon-reload"))
    if first:
        steps.append(_systemctl("start it at every boot", "enable", *ENABLED))
    if found.running and first:
        steps.append(_systemctl("start it", "start", *ENABLED))
    elif found.running:
        steps += [LookAgain(), _systemctl("start afresh what runs", "try-restart", ALL)]
    return steps


def _systemctl(why: str, *words: str) -> Run:
    return Run(("systemctl", *words), why)


def _refuse_while_held(found: Found) -> None:
    if found.status.startswith(STEERS):
        raise RefusedError(
            "Holdfast steers the vehicle now, and this would restart it. First: holdfast tell NAME release"
        )
