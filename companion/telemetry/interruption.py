"""Where a path was interrupted, and whether its places still are where they were.

x and y count from where the autopilot's estimator was started, or from its origin; depth from the barometer's
zero. The boot and its clock, the origin and the zero tell whether all that is as it was: the datum.
"""

from typing import Annotated

import msgspec

from companion.telemetry import ranges
from companion.telemetry.plan import Optional, Table
from companion.telemetry.words import means

PA_PER_M = 9800.0
"""ArduSub's, of water whose BARO_SPEC_GRAV is 1."""
SAME_DEPTH_M = 0.5
"""Weather moves the zero by less, and each arming sets it again."""
SAME_CLOCK_S = 1.0

Number = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
Count = Annotated[int, msgspec.Meta(ge=0, le=2**53)]


class Datum(Table, frozen=True, kw_only=True):
    """What places count from, as far as it is known."""

    boot_s: Annotated[Number, means("the autopilot's clock since its boot")]
    boots: Annotated[Count, means("how often it was booted: STAT_BOOTCNT")] | Optional = msgspec.UNSET
    origin_deg: (
        Annotated[tuple[Number, Number], means("latitude and longitude of the EKF's origin")] | Optional
    ) = msgspec.UNSET
    surface_pa: Annotated[Number, means("the barometer's zero: BAROn_GND_PRESS")] | Optional = msgspec.UNSET


class Interruption(Table, frozen=True, kw_only=True):
    """Where a path was interrupted, and where it lies."""

    leg: Annotated[Count, means("from one stop to the next, laps included, counted from 0")]
    along_m: Annotated[ranges.AlongPath, means("along this leg")]
    start: Annotated[
        tuple[ranges.Metres, ranges.Metres, ranges.Metres, ranges.Metres],
        means("added to the path's places: m, m, m, rad"),
    ]
    frame: Annotated[
        tuple[ranges.Metres, ranges.Metres, ranges.Metres],
        means("then it lies turned and moved in the EKF's: rad, m, m"),
    ]
    datum: Annotated[Datum, means("what its places count from")]
    goes_on: Annotated[bool, means("by itself, once engaged; otherwise it is paused")] = False


def difference(before: Datum, now: Datum) -> str | None:
    """Return why places of `before` are none of `now`; empty where they are, None while it is not known."""
    if isinstance(before.boots, int) and not isinstance(now.boots, int):
        return None
    rebooted = before.boots != now.boots and isinstance(before.boots, int)
    if rebooted or now.boot_s < before.boot_s - SAME_CLOCK_S:
        return "the autopilot was restarted meanwhile, and x and y count from another place"
    if before.origin_deg != now.origin_deg:
        if isinstance(now.origin_deg, msgspec.UnsetType):
            return None
        return f"the EKF's origin is another: it was {_place(before)} and is {_place(now)}"
    if isinstance(before.surface_pa, float) and isinstance(now.surface_pa, float):
        moved_m = (now.surface_pa - before.surface_pa) / PA_PER_M
        if abs(moved_m) > SAME_DEPTH_M:
            return f"the zero of the depth has moved by {moved_m:+.1f} m: it was set under water"
    return ""


def _place(datum: Datum) -> str:
    if isinstance(datum.origin_deg, msgspec.UnsetType):
        return "not set"
    return "{:.7f}, {:.7f}".format(*datum.origin_deg)
