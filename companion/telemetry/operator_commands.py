"""The commands of an operator during a dive: the payload of each, with the same checks everywhere.

One table for the companion, which obeys, and for all that ask: the web page, `holdfast tell`, the documents.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import UNSET

from companion.telemetry import ranges
from companion.telemetry.fields import fields_of, means, unit_of
from companion.telemetry.plan import MAX_SEGMENTS, PathPlan
from companion.telemetry.schemas import Reply, printable
from holdfast import validation

MAX_DEPTH = "supervisor.max_depth_m"
MAX_BYTES = 4096  # ten times the longest that is no path
MAX_PATH_BYTES = 1 << 18
"""A longer payload is refused unread."""
MAX_VALUES = 7 * MAX_SEGMENTS + 100
"""A command of more values and brackets is refused; a waypoint has six. Reading it takes less than a tick."""

AxisName = Literal["surge", "sway", "heave", "yaw"]
Optional = msgspec.UnsetType
Confirmed = Annotated[bool, means("confirms a change of more than twofold, or from or to zero")]


class Payload(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """What every command has: no field beyond its own; `order` is the command in words, without fields."""

    order = ""

    def __post_init__(self) -> None:
        validation.check_beside_zero(self)


class Engage(Payload, frozen=True):
    """Take control and hold, within 5 s. Refused if more is missing than the mode and a permitted arming.

    Just after a start it waits up to 5 s for what the vehicle has not reported yet.
    """

    order = "engage"


class Release(Payload, frozen=True):
    """Release the vehicle, and withdraw a request to engage."""

    order = "release"


class ClearFault(Payload, frozen=True):
    """Clear a latched fault, and trust a motor again that was found dead; does not engage."""

    order = "clear the fault"


class ResetModel(Payload, frozen=True):
    """Forget what was found of the vehicle's gain and lag, and use the nominal model again."""

    order = "forget the model that was found"


class Goto(Payload, frozen=True):
    """Go to a place in a straight line, and hold it; coordinates that are not given stay.

    While not engaged, it is kept for engaging. In the frames "offset" and "body" coordinates count from where
    the vehicle is. `x_m` and `y_m` need a position source, `altitude_m`, kept until a depth is given, a
    rangefinder. Roll and pitch, held until the release, need a Heavy.
    """

    order = "go to"

    x_m: Annotated[ranges.Metres, means("north, or forward")] | Optional = UNSET
    y_m: Annotated[ranges.Metres, means("east, or to the right")] | Optional = UNSET
    depth_m: Annotated[ranges.Metres, means("below the surface, or down")] | Optional = UNSET
    heading_deg: Annotated[ranges.HeadingDeg, means("clockwise from north")] | Optional = UNSET
    altitude_m: Annotated[ranges.Altitude, means("over the ground, instead of a depth")] | Optional = UNSET
    roll_deg: Annotated[ranges.HeldAngle, means("angle to be held, right side down")] | Optional = UNSET
    pitch_deg: Annotated[ranges.HeldAngle, means("angle to be held, bow up")] | Optional = UNSET
    frame: Annotated[Literal["local", "offset", "body"], means("what they count from")] = "local"
    speed_mps: Annotated[ranges.PathSpeed, means("slower where a limit asks for it")] = 0.2
    acceleration_mps2: ranges.PathAcceleration = 0.1
    at_once: Annotated[bool, means("each axis by its own max_rate and max_acceleration, not in a line")] = (
        False
    )


class Follow(Payload, frozen=True):
    """Follow a path from where the vehicle is; `holdfast follow` reads it from a file."""

    order = "follow the path"

    path: Annotated[PathPlan, means("as in docs/guidance.md")]


class SetVelocity(Payload, frozen=True):
    """Move at a velocity for a time; send it again before the time ends to go on. Then stop, and hold there.

    Only what is engaged moves. It pauses a path, as a stick does; the pilot's sticks have the last word.
    """

    order = "move"

    forward_mps: Annotated[ranges.Speed, means("forward; north in the frame local")] = 0.0
    right_mps: Annotated[ranges.Speed, means("to the right; east in the frame local")] = 0.0
    down_mps: Annotated[ranges.Speed, means("downward")] = 0.0
    heading_rate_degps: Annotated[ranges.TurnRate, means("clockwise")] = 0.0
    frame: Annotated[Literal["body", "local"], means("whose axes")] = "body"
    lasts_s: Annotated[ranges.VelocityTime, means("from the moment it arrives")] = 1.0


class SetPath(Payload, frozen=True):
    """Pause the path or the move, let it go on, or stop and hold here."""

    order = "change the path"

    action: Annotated[Literal["pause", "resume", "hold"], means("what to do")]


class SetCompensator(Payload, frozen=True):
    """Choose the compensator of one axis, which estimates the disturbance."""

    order = "choose the compensator"

    axis: AxisName
    compensator: Annotated[str, means("a name listed in the vehicle's `choices`")]


class SetGains(Payload, frozen=True):
    """Set gains of one axis, as in the configuration; a change of more than twofold needs `confirm`."""

    order = "set gains"

    axis: AxisName
    lambda_per_s: ranges.Lambda | Optional = UNSET
    kappa_per_s: ranges.Kappa | Optional = UNSET
    learning_rate: ranges.LearningRate | Optional = UNSET
    hidden_learning_rate: ranges.HiddenLearningRate | Optional = UNSET
    leak_per_s: ranges.Leak | Optional = UNSET
    dead_zone: ranges.DeadZone | Optional = UNSET
    max_disturbance: ranges.MaxDisturbance | Optional = UNSET
    confirm: Confirmed = False


COMMANDS: dict[str, type[Payload]] = {
    "engage": Engage,
    "release": Release,
    "goto": Goto,
    "follow": Follow,
    "path": SetPath,
    "velocity": SetVelocity,
    "compensator": SetCompensator,
    "gains": SetGains,
    "clear_fault": ClearFault,
    "reset_model": ResetModel,
}
"""The companion's commands by the last part of their key."""


class CommandResult(NamedTuple):
    """An order, in words, and the answer that it got."""

    order: str
    reply: Reply

    @property
    def text(self) -> str:
        """The order and what came of it, with control characters escaped."""
        return printable(f"{self.order}: {self.reply.said}")


_STEPS = {
    "offset": {"x_m": " m north", "y_m": " m east", "depth_m": " m down", "heading_deg": "° clockwise"},
    "body": {"x_m": " m forward", "y_m": " m right", "depth_m": " m down", "heading_deg": "° clockwise"},
}
"""What each coordinate of a `Goto` means that counts from the vehicle."""


def in_words(command: Payload) -> str:
    """Return a command as an order in words."""
    if isinstance(command, Follow):
        here = " from where it is" if command.path.relative else ""
        return f"{command.order} {printable(command.path.name)}".rstrip() + here
    if isinstance(command, SetPath):
        return "hold here" if command.action == "hold" else f"{command.action} the path"
    given = msgspec.to_builtins(command)
    given.pop("confirm", None)
    axis, at_once = given.pop("axis", ""), given.pop("at_once", False)
    steps = _STEPS.get(given.pop("frame", ""), {}) if isinstance(command, Goto) else {}
    said = ", ".join(
        f"{value:g}{steps[key]}" if key in steps else _in_words(key, value, command.order)
        for key, value in given.items()
    )
    words = f"{command.order.removesuffix(' to' if steps else '')}{f' of {axis}:' if axis else ''} {said}"
    return f"{words.rstrip()}{' from where it is' if steps else ''}{' at once' if at_once else ''}"


def _in_words(key: str, value: object, order: str) -> str:
    name, unit = unit_of(key)
    name = {"x": "north", "y": "east"}.get(name, name.replace("_", " "))
    number = f"{value:g}" if isinstance(value, float) else str(value)
    gap = "" if unit.startswith("°") or not unit else " "
    return f"{'' if name in order else f'{name} '}{number}{gap}{unit.replace('1/s', 'per s')}"


def parse(
    name: str, payload: bytes, known: Mapping[str, type[Payload]] = COMMANDS, max_depth_m: float = math.inf
) -> Payload:
    """Return the payload of a command; raise ValueError, in words, for what cannot be one."""
    kind = known.get(name)
    if kind is None:
        raise ValueError(f"there is no command '{name}'. There are {', '.join(known)}")
    longest = MAX_PATH_BYTES if kind is Follow else MAX_BYTES
    if len(payload) > longest:
        raise ValueError(f"{len(payload)} bytes are too many; {longest} at most")
    if (values := sum(map(payload.count, b",[{"))) > MAX_VALUES:
        raise ValueError(
            f"{values} values are too many; a path has {MAX_SEGMENTS} waypoints at most: divide it"
        )
    try:
        table = msgspec.json.decode(payload)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"{error}. {name} takes {_form(kind)}") from error
    try:
        command = msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        said = validation.explained(table, str(error), kind, {"depth_m": (max_depth_m, MAX_DEPTH)})
        raise ValueError(f"{said}. {name} takes {_form(kind)}") from error
    settable = [field.name for field in msgspec.structs.fields(kind) if field.default is UNSET]
    if settable and not named(command).keys() & set(settable):
        axis = getattr(command, "axis", None)
        raise ValueError(f"name at least one of {', '.join(settable)}{f' for {axis}' if axis else ''}")
    return command


def named(command: Payload) -> dict[str, Any]:
    """Return the fields that a payload names, with their values."""
    values = ((key, getattr(command, key)) for key in command.__struct_fields__)
    return {key: value for key, value in values if value is not UNSET}


def _form(kind: type[Payload]) -> str:
    """Return what a command takes, in words."""
    taken = [
        f"{name} ({', '.join(field.choices)})" if field.choices else name
        for name, field in fields_of(kind).items()
    ]
    return f"a JSON object with {', '.join(taken) or 'nothing in it: {}'}"
