"""The path that is under way, in a file, so that a companion that starts again can go on with it.

A thread writes it, so that no disk holds up the tick. A crash loses what was travelled since the last time.
"""

import logging
import threading
from pathlib import Path

import msgspec

from companion.telemetry.commands import MAX_PATH_BYTES, Follow
from holdfast.state import state_directory

PERIOD_S = 2.0
LAST_WRITE_S = 0.5

log = logging.getLogger("holdfast")


class UnfinishedPath:
    """Keeps the last `Follow` that was offered in `path`. Trouble with the file is logged, once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offered: Follow | None = None
        self._written: Follow | None = None
        self._said = ""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="unfinished path", daemon=True)

    def recall(self) -> Follow | None:
        """Return what an earlier process left here."""
        try:
            with self._path.open("rb") as file:
                data = file.read(MAX_PATH_BYTES + 1)
            if len(data) > MAX_PATH_BYTES:
                raise ValueError("it is too large")
            return msgspec.json.decode(data, type=Follow)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            log.warning(
                "%s cannot be used: %s. An interrupted path has to be followed anew", self._path, error
            )
            return None

    def start(self) -> None:
        """Write what is offered from now on."""
        self._thread.start()

    def offer(self, unfinished: Follow | None) -> None:
        """Take what is under way; None where nothing is."""
        self._offered = unfinished

    def close(self) -> None:
        """Write the last offer, if the disk takes it in time."""
        self._closing.set()
        self._thread.join(LAST_WRITE_S)

    def _keep(self) -> None:
        while not self._closing.wait(PERIOD_S):
            self.write()
        self.write()

    def write(self) -> None:
        """Put a whole file in the place of the old one, or remove that of a path that has ended."""
        offered = self._offered
        if offered == self._written:
            return
        try:
            if offered is None:
                self._path.unlink(missing_ok=True)
            else:
                self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                new = self._path.with_suffix(".new")
                new.write_bytes(msgspec.json.encode(offered))
                new.replace(self._path)
            self._written = offered
        except OSError as error:
            if str(error) != self._said:
                self._said = str(error)
                log.warning(
                    "the path under way cannot be kept: %s; after a restart it would begin anew. "
                    "Make the folder writable; a service: StateDirectory=holdfast",
                    error,
                )


def unfinished_path(vehicle: str) -> UnfinishedPath:
    """Return the file of a vehicle."""
    return UnfinishedPath(state_directory() / f"path-{vehicle}.json")
