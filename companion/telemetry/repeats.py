"""How many lines of one cause are told: a flood, such as of refused commands, may not fill disk and page."""

MOST, WITHIN_S = 10, 10.0
"""So many lines of one cause pass within this time of the first; the others are counted."""


def cause(text: str) -> str:
    """Return a line without the words that have digits: what differs in them alone has one cause."""
    words = text.partition("\n")[0].split()
    return " ".join(word for word in words if not any(map(str.isdigit, word)))


class Repeats:
    """Tells which lines pass. `now_s` is one clock that never goes back."""

    def __init__(self) -> None:
        self._causes: dict[str, tuple[float, int]] = {}
        """For each cause: until when its lines are counted together, and how many came."""

    def passes(self, cause: str, now_s: float) -> bool:
        """Take a line; tell whether it passes."""
        until_s, count = self._causes.get(cause, (now_s + WITHIN_S, 0))
        self._causes[cause] = until_s, count + 1
        return count < MOST

    def left_out(self, now_s: float) -> list[str]:
        """Return a line for each cause whose time is over and of which lines did not pass."""
        over = {cause: count for cause, (until_s, count) in self._causes.items() if now_s >= until_s}
        for cause in over:
            del self._causes[cause]
        words = f"more lines in {WITHIN_S:g} s were left out"
        return [f"{count - MOST} {words}: {cause}" for cause, count in over.items() if count > MOST]
