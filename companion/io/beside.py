"""What runs beside the tick: the dive does not need it, so no error in it ends the dive."""

import logging
from collections import deque
from collections.abc import Callable

log = logging.getLogger("holdfast")


class Beside:
    """Does such work. An error is counted; the first of its kind is logged with its place, and told.

    One thread uses it. Exceptions of `passed` are raised.
    """

    def __init__(self, *passed: type[Exception]) -> None:
        self.count = 0
        self.told: deque[str] = deque(maxlen=8)
        """Descriptions of failures; the reader removes them."""
        self._passed: tuple[type[BaseException], ...] = (KeyboardInterrupt, SystemExit, *passed)
        self._known: set[tuple[str, str]] = set()

    def do(self, what: str, work: Callable[[], object]) -> bool:
        """Do `work`; return whether it returned something true."""
        try:
            return bool(work())
        except self._passed:
            raise
        except BaseException as error:  # Zenoh's PanicException is no Exception
            self.fail(what, error)
            return False

    def fail(self, what: str, error: BaseException) -> None:
        """Count an error, and tell it."""
        self.count += 1
        if (kind := (what, type(error).__name__)) not in self._known:
            self._known.add(kind)
            self.told.append(f"{what} failed and is left out: {error!r:.200}; report it")
            log.error("%s failed", what, exc_info=error)
