"""What a version of Holdfast brings: from its wheel, or from where it is installed."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution
from pathlib import Path
from urllib.parse import unquote, urlsplit
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile, ZipInfo
from zipfile import Path as ZipPath

from holdfast import DISTRIBUTION, RefusedError

PROJECT = DISTRIBUTION.replace("-", "_")
"""What a wheel's name begins with."""
BY_PIP = ("INSTALLER", "REQUESTED", "direct_url.json")
"""What pip adds to a wheel's files."""


@dataclass(frozen=True)
class Release:
    """A version's own files.

    `name` is the version and the first hex digits of the wheel's SHA-256, so that two builds are two names.
    `wheel` is None for a version that is installed. `lock` has what it needs, by version and hash.
    """

    name: str
    wheel: Path | None
    units: Mapping[str, str]
    configuration: str
    lock: str


def from_wheel(wheel: Path) -> Release:
    """Read a wheel; raise RefusedError for a file that is none of ours."""
    name = _name(wheel)
    try:
        with ZipFile(wheel) as file:
            return _read(ZipPath(file, "holdfast/"), name, wheel.resolve())
    except (BadZipFile, KeyError, ValueError, FileNotFoundError) as error:
        raise RefusedError(f"{wheel}: this is no wheel of Holdfast; `make wheel` builds one") from error


def from_folder(package: Path, name: str) -> Release:
    """Read the package `holdfast` of an installed version."""
    return _read(package, name, None)


def _name(wheel: Path) -> str:
    project, version, *_ = [*wheel.name.split("-"), ""]
    if project != PROJECT or wheel.suffix != ".whl":
        raise RefusedError(f"{wheel}: a wheel of Holdfast is called {PROJECT}-VERSION-py3-none-any.whl")
    return f"{version}-{hashlib.sha256(wheel.read_bytes()).hexdigest()[:8]}"


def _read(package: Path | ZipPath, name: str, wheel: Path | None) -> Release:
    return Release(
        name=name,
        wheel=wheel,
        units={
            unit.name: unit.read_text(encoding="utf-8")
            for unit in (package / "systemd").iterdir()
            if unit.name.endswith(".service")
        },
        configuration=(package / "config" / "companion.toml").read_text(encoding="utf-8"),
        lock=(package / "requirements" / "vehicle.lock").read_text(encoding="utf-8"),
    )


def own_wheel(folder: Path) -> Path:
    """Return the wheel that this program runs from, or was installed from.

    If that is not known, as after an installation from the package index, it is made again in `folder` of the
    files that are installed. Raises RefusedError in a checkout, which is no wheel.
    """
    own = distribution(DISTRIBUTION)
    place = Path(str(own.locate_file("")))
    if place.suffix == ".whl":
        return place
    url = urlsplit(json.loads(own.read_text("direct_url.json") or "{}").get("url", ""))
    wheel = Path(unquote(url.path))
    if url.scheme == "file" and wheel.suffix == ".whl" and wheel.is_file():
        return wheel
    if (place / "holdfast" / "requirements" / "vehicle.lock").exists():
        return packed(own, folder)
    raise RefusedError(
        "this is a checkout: name the wheel to install, as in `holdfast install "
        f"{PROJECT}-VERSION-py3-none-any.whl`; `make wheel` builds dist/*.whl"
    )


def packed(installed: Distribution, folder: Path) -> Path:
    """Make a wheel of what is installed; the same files give the same bytes."""
    wheel = folder / f"{PROJECT}-{installed.version}-py3-none-any.whl"
    files = {
        str(file): file.read_binary()
        for file in installed.files or ()
        if ".." not in file.parts and file.suffix != ".pyc" and file.name not in BY_PIP
    }
    (record,) = (name for name in files if name.endswith(".dist-info/RECORD"))
    rows = files[record].decode().splitlines(keepends=True)
    files[record] = "".join(row for row in rows if row.partition(",")[0] in files).encode()
    with ZipFile(wheel, "w", ZIP_DEFLATED) as archive:
        for name, data in sorted(files.items()):
            archive.writestr(ZipInfo(name), data, ZIP_DEFLATED)
    return wheel
