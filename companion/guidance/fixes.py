"""Jumps of the EKF's position: a reset of its frame, or fixes of a slow source such as USBL."""

import math

from companion.records import FrameShift

RESET_M = 1.0
"""Jumps that come to more are a reset: what is wanted stays where it lies."""

RESET_LASTS_S = 10.0
"""Jumps so soon after a reset belong to it."""

MADE_GOOD_S, MADE_GOOD_MPS = 20.0, 0.03
"""Jumps that come to less are fixes: so slowly, and no faster, the vehicle follows them."""


class PositionFixes:
    """By how much fixes moved what is wanted, and the way back to the coordinates that were asked for."""

    def __init__(self) -> None:
        self._owed = (0.0, 0.0)
        """North and east, m."""
        self._reset_t_s = -math.inf

    def forget(self) -> None:
        """Owe nothing."""
        self._owed = (0.0, 0.0)

    def jumped(self, shift: FrameShift, t_s: float, *, held: bool) -> None:
        """Take a jump that what is wanted was moved by; `held`: a place was held at that time."""
        north_m, east_m = self._owed[0] + shift.north_m, self._owed[1] + shift.east_m
        if math.hypot(north_m, east_m) > RESET_M:
            self._reset_t_s = t_s
        fixed = held and t_s - self._reset_t_s > RESET_LASTS_S
        self._owed = (north_m, east_m) if fixed else (0.0, 0.0)

    def made_good(self, dt_s: float) -> FrameShift | None:
        """Return by how much to move what is wanted back in this tick; None where nothing is owed."""
        if not any(self._owed):
            return None
        share = min(dt_s / MADE_GOOD_S, MADE_GOOD_MPS * dt_s / math.hypot(*self._owed))
        north_m, east_m = (share * owed for owed in self._owed)
        self._owed = (self._owed[0] - north_m, self._owed[1] - east_m)
        return FrameShift(0.0, -north_m, -east_m)
