"""The commands that the page may send, checked before they leave. The companion checks them again."""

from typing import Annotated, Literal

import msgspec

Axis = Literal["surge", "sway", "heave", "yaw"]
Number = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
Unset = msgspec.UnsetType


class Order(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A command without payload: engage, release, clear_fault."""


class Aim(Order, frozen=True):
    """Where to be; what is not named stays."""

    depth_m: Annotated[float, msgspec.Meta(ge=0.0, le=1e4)] | Unset = msgspec.UNSET
    heading_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] | Unset = msgspec.UNSET
    x_m: Number | Unset = msgspec.UNSET
    y_m: Number | Unset = msgspec.UNSET


class Compensator(Order, frozen=True):
    """Who compensates on an axis."""

    axis: Axis
    compensator: str


class Gains(Order, frozen=True):
    """Gains of an axis; what is not named stays."""

    axis: Axis
    lambda_per_s: NotNegative | Unset = msgspec.UNSET
    kappa_per_s: NotNegative | Unset = msgspec.UNSET
    learning_rate: NotNegative | Unset = msgspec.UNSET
    hidden_learning_rate: NotNegative | Unset = msgspec.UNSET
    leak_per_s: NotNegative | Unset = msgspec.UNSET
    dead_zone: NotNegative | Unset = msgspec.UNSET
    max_disturbance: NotNegative | Unset = msgspec.UNSET


class Estimator(Order, frozen=True):
    """The noises that the observer of an axis believes in; what is not named stays."""

    axis: Axis
    position_noise: NotNegative | Unset = msgspec.UNSET
    rate_noise: NotNegative | Unset = msgspec.UNSET
    position_noise_slow: NotNegative | Unset = msgspec.UNSET
    rate_noise_slow: NotNegative | Unset = msgspec.UNSET
    disturbance_noise: NotNegative | Unset = msgspec.UNSET


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
    if kind is not Order and not named.keys() - {"axis"}:
        raise ValueError(f"{name}: name what is to change: {', '.join(kind.__struct_fields__)}")
    return msgspec.json.encode(order)
