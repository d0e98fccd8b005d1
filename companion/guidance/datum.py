"""What places count from, and whether they still are where they were.

x and y count from where the autopilot's estimator was started, or from its origin; depth from the barometer's
zero. The boot and its clock, the origin and the zero tell whether all that is as it was.
"""

import math
from typing import NamedTuple

PA_PER_M = 9800.0
"""ArduSub's, of water whose BARO_SPEC_GRAV is 1."""
SAME_DEPTH_M = 0.5
"""Weather moves the zero by less, and each arming sets it again."""
SAME_CLOCK_S = 1.0
"""A clock that goes back by less was estimated anew; a boot takes longer."""


class Datum(NamedTuple):
    """What places count from, as far as it is known."""

    boot_s: float = -math.inf
    """The autopilot's clock since its boot."""
    boots: int | None = None
    """How often it was booted: STAT_BOOTCNT."""
    origin_deg: tuple[float, float] | None = None
    """Latitude and longitude of the EKF's origin."""
    surface_pa: float | None = None
    """The barometer's zero: BAROn_GND_PRESS."""


def difference(before: Datum, now: Datum) -> str | None:
    """Return why places of `before` are none of `now`; empty where they are, None while it is not known."""
    if before.boots is not None and now.boots is None:
        return None
    rebooted = before.boots is not None and before.boots != now.boots
    if rebooted or now.boot_s < before.boot_s - SAME_CLOCK_S:
        return "the autopilot was restarted meanwhile, and x and y count from another place"
    if before.origin_deg != now.origin_deg:
        if now.origin_deg is None:
            return None
        return f"the EKF's origin is another: it was {_place(before)} and is {_place(now)}"
    if before.surface_pa is not None and now.surface_pa is not None:
        moved_m = (now.surface_pa - before.surface_pa) / PA_PER_M
        if abs(moved_m) > SAME_DEPTH_M:
            return f"the zero of the depth has moved by {moved_m:+.1f} m: it was set under water"
    return ""


def _place(datum: Datum) -> str:
    if datum.origin_deg is None:
        return "not set"
    return "{:.7f}, {:.7f}".format(*datum.origin_deg)
