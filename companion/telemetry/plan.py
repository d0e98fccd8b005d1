"""A path as an operator writes it: waypoints, or one of three shapes, with speed, corners and heading.

The same tables in a TOML file (`holdfast follow FILE`), in the `follow` command and in the recorded dive.
docs/guidance.md explains them with examples. x is north, y is east, in metres.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import UNSET

from companion.telemetry import ranges
from companion.telemetry.fields import means
from holdfast import validation

MAX_SEGMENTS = 1000
"""Largest number of straight lines of a path, with their corners. More take longer than a dive."""

Optional = msgspec.UnsetType
Depth = Annotated[ranges.Depth, means("below the surface; without it, the depth of the start")]
North = Annotated[ranges.Metres, means("north of the origin")]
East = Annotated[ranges.Metres, means("east of the origin")]
Bearing = Annotated[ranges.HeadingDeg, means("clockwise from north")]


class PlanTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """What every table of a plan has: no key beyond its own."""

    def __post_init__(self) -> None:
        validation.check_beside_zero(self)


class Waypoint(PlanTable, frozen=True, kw_only=True):
    """A point of a polyline. With `wait_s` the vehicle stops there; without, the corner is rounded."""

    x_m: North
    y_m: East
    depth_m: Depth | Optional = UNSET
    heading_deg: Bearing | Optional = UNSET
    corner_m: (
        Annotated[ranges.Corner, means("the turn begins and ends this far from the point; 0: stop")]
        | Optional
    ) = UNSET
    wait_s: Annotated[ranges.Hour, means("rest here")] = 0.0


class Centred(PlanTable, frozen=True, kw_only=True):
    """What has a centre and a depth."""

    x_m: Annotated[ranges.Metres, means("north, of the centre")] = 0.0
    y_m: Annotated[ranges.Metres, means("east, of the centre")] = 0.0
    depth_m: Depth | Optional = UNSET


class Circle(Centred, frozen=True, kw_only=True):
    """A circle; it begins at the bearing `start_deg` from its centre."""

    radius_m: ranges.Length
    start_deg: Bearing = 0.0
    clockwise: bool = True


class Lemniscate(Centred, frozen=True, kw_only=True):
    """A figure of eight (Gerono's), which begins at its crossing."""

    length_m: Annotated[ranges.Length, means("from end to end")]
    width_m: Annotated[ranges.Length, means("across")]
    direction_deg: Bearing = 0.0


class LawnMower(Centred, frozen=True, kw_only=True):
    """Parallel lines over a rectangle, from its first corner: `x_m`, `y_m`."""

    length_m: Annotated[ranges.Length, means("of a line, along direction_deg")]
    width_m: Annotated[ranges.Length, means("of the area, to the right of the first line")]
    spacing_m: Annotated[ranges.Length, means("largest distance of two lines")]
    direction_deg: Bearing = 0.0


class PathPlan(PlanTable, frozen=True, kw_only=True):
    """A path: waypoints, a circle, a lemniscate or a lawn-mower pattern, exactly one of them."""

    name: Annotated[str, msgspec.Meta(max_length=64)] = ""
    relative: Annotated[bool, means("x_m and y_m count from where the vehicle starts")] = False
    speed_mps: Annotated[ranges.PathSpeed, means("along the path; slower where a limit asks for it")] = 0.2
    acceleration_mps2: Annotated[ranges.PathAcceleration, means("largest, in any direction")] = 0.1
    heading: Annotated[Literal["along", "keep"], means("follow the path, or keep that of the start")] = (
        "along"
    )
    heading_deg: Annotated[ranges.HeadingDeg, means("a fixed heading instead")] | Optional = UNSET
    altitude_m: Annotated[ranges.Altitude, means("over the ground, instead of depths")] | Optional = UNSET
    roll_deg: Annotated[ranges.HeldAngle, means("angle to be held, right side down")] | Optional = UNSET
    pitch_deg: Annotated[ranges.HeldAngle, means("angle to be held, bow up")] | Optional = UNSET
    corner_m: Annotated[ranges.Corner, means("of waypoints that have none of their own")] = 0.5
    laps: Annotated[ranges.Laps, means("how often; 0: until stopped")] = 1
    closed: Annotated[bool, means("go back from the last waypoint to the first")] = False
    waypoint: tuple[Waypoint, ...] = ()
    circle: Circle | Optional = UNSET
    lemniscate: Lemniscate | Optional = UNSET
    lawn_mower: LawnMower | Optional = UNSET
