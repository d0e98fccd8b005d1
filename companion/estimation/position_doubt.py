"""How far the estimated position may be off: the doubt of dead reckoning, of outages and of fixes.

The EKF tells no error in metres (EKF_STATUS_REPORT has ratios of innovations), so this is a model:

| part                          | grows with                                                    |
|-------------------------------|---------------------------------------------------------------|
| white noise                   | nothing: `position_noise_slow` of the configuration           |
| scale of the DVL, along D     | SCALE · |D|, D being the way from the last jump               |
| heading, across D             | HEADING_RAD · |D|                                             |
| outage of the velocity        | t^1.5: a velocity that walks                                  |
| fixes                         | the mean size of the last jumps of the EKF                    |

A jump of the EKF's position is a fix of its source, such as a USBL: D and the outage begin again.
"""

import math

from companion.records import PositionDoubt

SCALE = 0.01
"""Of a DVL's velocity: a Water Linked A50 is specified with 1 %."""

HEADING_RAD = math.radians(2.0)
UNAIDED_MPS = 0.02
"""Walk of the velocity without its source, after a second."""

JUMPS = 5
"""So many jumps are in the mean."""

UNKNOWN = PositionDoubt(math.nan, math.nan, 0.0)


class PositionDoubtModel:
    """Follows the estimate from tick to tick."""

    def __init__(self, noise_m: float) -> None:
        self._noise_m = noise_m
        self.restart()

    def restart(self) -> None:
        """Begin again: nothing is known."""
        self._at: tuple[float, float] | None = None
        self._way = (0.0, 0.0)
        self._unaided_s = 0.0
        self._jump_m2, self._jumps = 0.0, 0

    def step(
        self, place: tuple[float, float], jump_m: float, *, stale: bool, aided: bool, dt_s: float
    ) -> PositionDoubt:
        """Take a tick: the estimate inside, the EKF's jump, whether there is a position, and its source."""
        if stale and self._at is None:
            return UNKNOWN
        if not aided or stale:
            self._unaided_s += dt_s
        if jump_m:
            self._jumps = min(self._jumps + 1, JUMPS)
            self._jump_m2 += (jump_m**2 - self._jump_m2) / self._jumps
            self._way, self._unaided_s = (0.0, 0.0), 0.0
        elif self._at is not None and not stale:
            (north, east), (north_0, east_0) = place, self._at
            self._way = (self._way[0] + north - north_0, self._way[1] + east - east_0)
        self._at = place
        walked = UNAIDED_MPS**2 * self._unaided_s**3 / 3.0
        round_m2 = self._noise_m**2 + 0.5 * self._jump_m2 + walked
        long = math.hypot(*self._way)
        along, across = (math.sqrt(round_m2 + (part * long) ** 2) for part in (SCALE, HEADING_RAD))
        return PositionDoubt(across, along, math.atan2(self._way[1], self._way[0]) + 0.5 * math.pi)
