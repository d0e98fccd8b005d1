"""Files that hold a path: TOML as docs/guidance.md describes it."""

from pathlib import Path

import msgspec

from companion.telemetry.plan import PathPlan
from holdfast import files, validation
from holdfast.command_line import located


def read(path: Path) -> PathPlan:
    """Return the path of a file. Raises ValueError naming file, key, value and what is allowed."""
    try:
        table = files.toml(files.text(path))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    table.setdefault("name", path.stem[:64])
    try:
        return msgspec.convert(table, PathPlan)
    except msgspec.ValidationError as error:
        said = validation.explained(table, str(error), PathPlan)
        raise ValueError(located(path, (), said)) from error
