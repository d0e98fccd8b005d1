"""What a version of Holdfast brings: from its wheel, or from where it is installed."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import distribution
from pathlib import Path
from urllib.parse import unquote, urlsplit
from zipfile import BadZipFile, ZipFile
from zipfile import Path as ZipPath

from holdfast import DISTRIBUTION, RefusedError

PROJECT = DISTRIBUTION.replace("-", "_")
"""What a wheel's name begins with."""


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
        lock=(package / "requirements.lock").read_text(encoding="utf-8"),
    )


def own_wheel() -> Path:
    """Return the wheel that this program runs from, or was installed from; raise RefusedError if none."""
    own = distribution(DISTRIBUTION)
    place = Path(str(own.locate_file("")))
    if place.suffix == ".whl":
        return place
    url = urlsplit(json.loads(own.read_text("direct_url.json") or "{}").get("url", ""))
    wheel = Path(unquote(url.path))
    if url.scheme == "file" and wheel.suffix == ".whl" and wheel.is_file():
        return wheel
    raise RefusedError(
        "this installation's wheel is not known: name it, as in `holdfast install "
        f"{PROJECT}-VERSION-py3-none-any.whl`; in a checkout `make wheel` builds dist/*.whl"
    )
