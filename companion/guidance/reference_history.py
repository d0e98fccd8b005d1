"""The reference is computed for the time when the command acts; what is recorded is that of now."""

from collections import deque

from companion.core.bounds import clamped, wrap
from companion.records import Vector


class ReferenceHistory:
    """References x, y, z, psi of the next moments, at most as many as the delay has ticks."""

    def __init__(self) -> None:
        self._references: deque[tuple[float, Vector]] = deque()

    def clear(self) -> None:
        """Forget all references."""
        self._references.clear()

    def step(self, ahead: Vector, t_s: float, ahead_s: float) -> Vector:
        """Take the reference of `ahead_s` from now; return that of now, which was taken before."""
        references = self._references
        references.append((t_s + ahead_s, ahead))
        while len(references) > 2 and references[1][0] <= t_s:
            references.popleft()
        (t_0, early), (t_1, late) = references[0], references[min(1, len(references) - 1)]
        share = clamped((t_s - t_0) / (t_1 - t_0), 0.0, 1.0) if t_1 > t_0 else 0.0
        x, y, z, psi = [a + (b - a) * share for a, b in zip(early, late, strict=True)]
        return (x, y, z, wrap(psi))
