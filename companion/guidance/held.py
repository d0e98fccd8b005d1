"""Which degrees of freedom the law holds: what the pilot took back, and x and y without a position.

Without a position x and y are released, and held again where something wants them: a place that was held
when the position was lost, a setpoint, a course.
"""

import math

from companion.core.actuation import NONE
from companion.records import PSI, Flags, X, Y, Z, either, without

HORIZONTAL: Flags = (True, True, False, False)
POSITION_SETTLES_S = 0.5
"""A position that came back is used after this time: the estimate has found its velocity by then."""


class HeldDofs:
    """The degrees of freedom that are `engaged`: held by the law."""

    def __init__(self) -> None:
        self.engaged = self._released = NONE
        self.lost = False
        """Whether x and y were held when the position was lost."""
        self.moved_meanwhile = False
        """Whether the pilot has steered in surge or sway since then."""
        self.has_position = False
        """Whether there is a position, and has been for long enough."""
        self._unpositioned_t_s = -math.inf

    @property
    def lacks_position(self) -> bool:
        """Whether x and y are not held, and the pilot did not take them back."""
        return not self.engaged[X] and not self._released[X]

    def rest(self) -> None:
        """Hold nothing."""
        self.engaged, self.lost = NONE, False

    def engage(self, holdable: Flags) -> None:
        """Hold what can be held."""
        self.engaged, self._released = holdable, NONE

    def regain(self) -> Flags:
        """Hold again what the pilot took back; return it."""
        regained, self._released = self._released, NONE
        self.engaged = either(self.engaged, regained)
        return regained

    def release(self, overridden: Flags) -> None:
        """Release what the pilot takes back."""
        self.engaged = without(self.engaged, overridden)
        self._released = either(self._released, overridden)

    def follow_position(self, t_s: float, *, positioned: bool) -> None:
        """Note whether there is a position; release x and y where there is none."""
        if not positioned:
            self._unpositioned_t_s = t_s
            if self.engaged[X] or self.engaged[Y]:
                self.engaged = (False, False, self.engaged[Z], self.engaged[PSI])
                self.lost, self.moved_meanwhile = True, False
        self.has_position = t_s - self._unpositioned_t_s >= POSITION_SETTLES_S

    def want_here(self) -> None:
        """Want x and y where the vehicle is."""
        self.lost = self.moved_meanwhile = True

    def take_up_position(self) -> Flags:
        """Hold x and y again; return them."""
        self.lost = False
        self.engaged = either(self.engaged, HORIZONTAL)
        return HORIZONTAL
