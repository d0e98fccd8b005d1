"""The commands that the page may send, checked before they leave. The companion checks them again."""

from typing import Literal, get_type_hints

import msgspec

from companion.telemetry import ranges

Axis = Literal["surge", "sway", "heave", "yaw"]
Unset = msgspec.UnsetType


class Order(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A command without payload: engage, release, clear_fault."""


class Aim(Order, frozen=True):
    """Where to be; what is not named stays."""

    depth_m: ranges.Depth | Unset = msgspec.UNSET
    heading_deg: ranges.HeadingDeg | Unset = msgspec.UNSET
    x_m: ranges.Metres | Unset = msgspec.UNSET
    y_m: ranges.Metres | Unset = msgspec.UNSET


class Compensator(Order, frozen=True):
    """Who compensates on an axis."""

    axis: Axis
    compensator: str


class Gains(Order, frozen=True):
    """Gains of an axis; what is not named stays."""

    axis: Axis
    lambda_per_s: ranges.Lambda | Unset = msgspec.UNSET
    kappa_per_s: ranges.Kappa | Unset = msgspec.UNSET
    learning_rate: ranges.LearningRate | Unset = msgspec.UNSET
    hidden_learning_rate: ranges.HiddenLearningRate | Unset = msgspec.UNSET
    leak_per_s: ranges.Leak | Unset = msgspec.UNSET
    dead_zone: ranges.DeadZone | Unset = msgspec.UNSET
    max_disturbance: ranges.Force | Unset = msgspec.UNSET
    confirm: bool | Unset = msgspec.UNSET


class Estimator(Order, frozen=True):
    """The noises that the observer of an axis believes in; what is not named stays."""

    axis: Axis
    position_noise: ranges.Noise | Unset = msgspec.UNSET
    rate_noise: ranges.Noise | Unset = msgspec.UNSET
    position_noise_slow: ranges.SlowNoise | Unset = msgspec.UNSET
    rate_noise_slow: ranges.SlowNoise | Unset = msgspec.UNSET
    disturbance_noise: ranges.DisturbanceNoise | Unset = msgspec.UNSET
    confirm: bool | Unset = msgspec.UNSET


class Record(Order, frozen=True):
    """Start or stop the recorder."""

    on: bool


ORDERS: dict[str, type[Order]] = {
    "engage": Order,
    "release": Order,
    "clear_fault": Order,
    "setpoint": Aim,
    "compensator": Compensator,
    "gains": Gains,
    "estimator": Estimator,
    "record": Record,
}

RANGES = {
    name: found
    for order in ORDERS.values()
    for name, hint in get_type_hints(order, include_extras=True).items()
    if (found := ranges.bounds(hint))
}
"""The least and the largest of each number that a command may carry, for the page's fields."""


def checked(name: str, body: bytes) -> bytes:
    """Return the payload of a command as it may leave; raise ValueError, in words, for what may not."""
    kind = ORDERS.get(name)
    if kind is None:
        raise ValueError(f"there is no command '{name}'; there are {', '.join(ORDERS)}")
    try:
        order = msgspec.json.decode(body or b"{}", type=kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"{name}: {error}") from error
    named = msgspec.to_builtins(order)
    if kind is not Order and not named.keys() - {"axis", "confirm"}:
        raise ValueError(f"{name}: name what is to change: {', '.join(kind.__struct_fields__)}")
    return msgspec.json.encode(order)
