"""What an operator may ask for while it dives: checked like the configuration, and answered with the truth.

An `Order` comes from any thread and waits. Between ticks the desk turns at most one into what the engine
takes anyway, a `Request`, a setpoint or a retuned configuration, so that nothing passes the supervisor by;
after the tick it answers with what came of it. No Zenoh and no clock in here.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple, Protocol, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from companion.config import Compensator as Choice
from companion.config import Config, ConfigError, Section, explained
from companion.records import ENGAGE_S, PSI, Array, ControlSample, Request, Setpoint, State, X, Y, Z
from companion.telemetry import ranges
from companion.telemetry.schemas import Reply, means, printable

AxisName = Literal["surge", "sway", "heave", "yaw"]
Optional = msgspec.UnsetType

WAITING = 8
MAX_BYTES = 4096
SETTLE_S = 2.0
STEP = 2.0
"""One command may make a value this many times larger or smaller; for more it has to be confirmed."""


class Engage(Section, frozen=True):
    """Take control and hold. Refused, and the wish withdrawn, if that is not permitted within 5 s."""


class Release(Section, frozen=True):
    """Let go of the vehicle; a wish to engage is withdrawn."""


class ClearFault(Section, frozen=True):
    """Reset a latched fault; engages nothing."""


class Aim(Section, frozen=True):
    """Where to be; what is not named stays. Kept for when it engages if it is not engaged now."""

    depth_m: Annotated[ranges.Depth, means("below the surface")] | Optional = msgspec.UNSET
    heading_deg: Annotated[ranges.HeadingDeg, means("clockwise from north")] | Optional = msgspec.UNSET
    x_m: Annotated[ranges.Metres, means("north; held only with a position source")] | Optional = msgspec.UNSET
    y_m: Annotated[ranges.Metres, means("east; held only with a position source")] | Optional = msgspec.UNSET


class Compensator(Section, frozen=True):
    """Who compensates on one axis what the model does not know."""

    axis: AxisName
    compensator: Choice


Confirmed = Annotated[bool, means("more than twofold is meant; zero, to or from, is more than twofold")]


class Gains(Section, frozen=True):
    """Gains of one axis, as in the configuration; more than twofold at once only with `confirm`."""

    axis: AxisName
    lambda_per_s: ranges.Lambda | Optional = msgspec.UNSET
    kappa_per_s: ranges.Kappa | Optional = msgspec.UNSET
    learning_rate: ranges.LearningRate | Optional = msgspec.UNSET
    hidden_learning_rate: ranges.HiddenLearningRate | Optional = msgspec.UNSET
    leak_per_s: ranges.Leak | Optional = msgspec.UNSET
    dead_zone: ranges.DeadZone | Optional = msgspec.UNSET
    max_disturbance: ranges.Force | Optional = msgspec.UNSET
    confirm: Confirmed = False


class Estimator(Section, frozen=True):
    """What the observer of one axis believes of the noise; more than twofold at once only with `confirm`."""

    axis: AxisName
    position_noise: ranges.Noise | Optional = msgspec.UNSET
    rate_noise: ranges.Noise | Optional = msgspec.UNSET
    position_noise_slow: ranges.SlowNoise | Optional = msgspec.UNSET
    rate_noise_slow: ranges.SlowNoise | Optional = msgspec.UNSET
    disturbance_noise: ranges.DisturbanceNoise | Optional = msgspec.UNSET
    confirm: Confirmed = False


COMMANDS: dict[str, type[Section]] = {
    "engage": Engage,
    "release": Release,
    "setpoint": Aim,
    "compensator": Compensator,
    "gains": Gains,
    "estimator": Estimator,
    "clear_fault": ClearFault,
}


class Order(NamedTuple):
    """A command's name and payload as they came, and where the answer goes. `answer` is called once.

    `local` if it can only have come from this machine, where everybody can speak to the vehicle anyway.
    """

    name: str
    payload: bytes
    answer: Callable[[Reply], None]
    local: bool = False


class Handed(NamedTuple):
    """What the engine got before a tick."""

    requests: list[Request]
    setpoint: Setpoint | None = None
    config: Config | None = None


class Controllable(Protocol):
    """What the desk needs of the engine."""

    @property
    def config(self) -> Config:
        """What is in force."""

    @property
    def target(self) -> Array:
        """Where it is held, or is while it is not: x, y, z, psi."""

    def aim(self, setpoint: Setpoint) -> None:
        """Take a setpoint; raise ValueError for one that is not permitted."""

    def retune(self, config: Config) -> None:
        """Take gains, compensators and noises, without a jump; raise ConfigError for what needs a restart."""


@dataclass
class _Waiting:
    """An order that the engine has and has not answered. `withdrawn`: it gives up in this tick."""

    order: Order
    command: Section
    until_s: float
    was: State
    old: Config
    withdrawn: str = ""


@dataclass(frozen=True)
class CommandResult:
    """For the log and the event key: an order with its answer."""

    order: Order
    reply: Reply

    @property
    def text(self) -> str:
        """The order and what came of it, in words, with control characters escaped."""
        asked = self.order.payload[:200].decode(errors="replace") if len(self.order.payload) > 2 else ""
        return printable(f"{self.order.name}{' ' if asked else ''}{asked}: {self.reply.said}")


@dataclass
class CommandQueue:
    """Takes orders between ticks, hands them to the engine, answers after the tick.

    `setpoint` is what was asked for at the start, (4,) with NaN where nothing was.
    """

    started_with: Config
    setpoint: Array
    taken: list[CommandResult] = field(default_factory=list)
    """Answered in this tick."""

    _inbox: deque[Order] = field(default_factory=deque)
    _waiting: list[_Waiting] = field(default_factory=list)
    _withdraw: bool = False
    _state: State = State.IDLE

    def take(self, order: Order) -> None:
        """Take an order, from any thread; answer at once where there are too many."""
        if len(self._inbox) >= WAITING:
            order.answer(Reply(done=False, said=f"busy: {WAITING} commands wait already; ask again"))
        else:
            self._inbox.append(order)

    def before(self, engine: Controllable, now_s: float) -> Handed:
        """Hand the next order to the engine; return what it got, requests to be asked in this tick."""
        self.taken = []
        handed = Handed([Request.STOP] if self._withdraw else [])
        self._withdraw = False
        if not self._inbox:
            return handed
        order = self._inbox.popleft()
        old = engine.config
        try:
            command = self._checked(order)
            if isinstance(command, Aim):
                handed = handed._replace(setpoint=self._aim(engine, command))
            elif isinstance(command, Compensator | Gains | Estimator):
                engine.retune(self._retuned(old, command))
                handed = handed._replace(config=engine.config)
            else:
                handed.requests.append(self._asked(command))
        except (ConfigError, ValueError) as error:
            self._answer(order, done=False, said=f"refused: {error}")
            return handed
        wait_s = ENGAGE_S if order.name == "engage" else SETTLE_S
        self._waiting.append(_Waiting(order, command, now_s + wait_s, self._state, old))
        return handed

    def after(self, engine: Controllable, sample: ControlSample, now_s: float) -> None:
        """Answer what has been settled by this tick."""
        self._state = sample.verdict.state
        if sample.state.frame_shift is not None:
            held = sample.dofs.engaged & np.isfinite(self.setpoint)
            self.setpoint = np.where(held, engine.target, self.setpoint)
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            answer = self._settled(one, engine, sample, now_s)
            if answer is None:
                self._waiting.append(one)
            else:
                self._answer(one.order, **answer)

    def _checked(self, order: Order) -> Section:
        allowed = self.started_with.telemetry.allow_control
        if allowed == "never":
            raise ValueError('this companion is read-only: telemetry.allow_control = "never"')
        if allowed == "local" and not order.local:
            raise ValueError(
                "it may have come from another machine: through a router, from a network or by a Zenoh file. "
                "Start the companion with `holdfast run --allow-control`, or set "
                'telemetry.allow_control = "always"'
            )
        known = COMMANDS.get(order.name)
        if known is None:
            raise ValueError(f"there is no command '{order.name}'. There are {', '.join(COMMANDS)}")
        if len(order.payload) > MAX_BYTES:
            raise ValueError(f"{len(order.payload)} bytes are too many; {MAX_BYTES} at most")
        table = None
        try:
            table = msgspec.json.decode(order.payload)
            return msgspec.convert(table, known)
        except msgspec.ValidationError as error:
            said = explained(table, str(error), known)
            raise ValueError(f"{said}. {order.name} takes {_form(known)}") from error
        except (msgspec.MsgspecError, RecursionError) as error:
            raise ValueError(f"{error}. {order.name} takes {_form(known)}") from error

    def _aim(self, engine: Controllable, aim: Aim) -> Setpoint:
        named = _named(aim)
        if not named:
            raise ValueError(f"name at least one of {', '.join(aim.__struct_fields__)}")
        wanted = self.setpoint.copy()
        for index, key in ((X, "x_m"), (Y, "y_m"), (Z, "depth_m")):
            wanted[index] = named.get(key, wanted[index])
        if "heading_deg" in named:
            if not engine.config.vehicle.holds_heading:
                raise ValueError("heading_deg: in STABILIZE the firmware keeps the heading")
            wanted[PSI] = math.remainder(math.radians(named["heading_deg"]), math.tau)
        max_depth_m = engine.config.supervisor.max_depth_m
        if wanted[Z] > max_depth_m:
            raise ValueError(f"depth_m = {wanted[Z]:g}: supervisor.max_depth_m is {max_depth_m:g}")
        setpoint = Setpoint(wanted)
        engine.aim(setpoint)
        self.setpoint = wanted
        return setpoint

    def _retuned(self, config: Config, command: Compensator | Gains | Estimator) -> Config:
        axis, wanted = _changes(command)
        if not wanted:
            known = ", ".join(key for key in command.__struct_fields__ if key not in ("axis", "confirm"))
            raise ValueError(f"name at least one of {known} for {axis}")
        old = getattr(config, axis)
        if not getattr(command, "confirm", True):
            for key, value in wanted.items():
                now = getattr(old, key)
                if not now / STEP <= value <= now * STEP:
                    raise ValueError(
                        f"{axis}.{key} = {value:g}: it is {now:g}, and one step may take it to "
                        f"{now / STEP:g} to {now * STEP:g}; if it is meant, add confirm=true"
                    )
        return msgspec.structs.replace(config, **{axis: msgspec.structs.replace(old, **wanted)})

    def _asked(self, command: Section) -> Request:
        if isinstance(command, Engage):
            if self._state is State.FAULT:
                raise ValueError("a fault is latched; clear_fault first")
            return Request.ENGAGE
        if isinstance(command, Release):
            for one in self._waiting:
                if one.order.name == "engage":
                    one.withdrawn = "withdrawn: it was released meanwhile"
            return Request.STOP
        if self._state is not State.FAULT:
            raise ValueError(f"no fault is latched; the state is {self._state}")
        return Request.CLEAR_FAULT

    def _settled(
        self, one: _Waiting, engine: Controllable, sample: ControlSample, now_s: float
    ) -> dict[str, Any] | None:
        """Return the answer, or None while there is none yet."""
        verdict = sample.verdict
        is_now = f"{verdict.state}: {verdict.reason}"
        conditions = [condition.name for condition in verdict.conditions]
        value: dict[str, Any] = {
            "state": str(verdict.state),
            "reason": verdict.reason,
            "conditions": conditions,
            "remedy": verdict.remedy,
        }
        late = now_s >= one.until_s
        name = one.order.name
        if name == "engage":
            if verdict.state is State.ACTIVE:
                return {
                    "done": True,
                    "said": f"engaged; it was {one.was}",
                    "value": value | self._aimed(engine, sample),
                }
            if one.withdrawn or verdict.state is State.FAULT:
                holds = f" ({', '.join(map(str, conditions))})" if conditions else ""
                said = f"{one.withdrawn or 'refused'}. {is_now}{holds}"
                return {"done": False, "said": said, "value": value}
            if late:
                one.withdrawn = f"refused: not permitted within {ENGAGE_S:.0f} s, and the wish is withdrawn"
                self._withdraw = True
            return None
        if name == "release":
            if verdict.authority > 0.0 and not late:
                return None
            held = one.was in (State.ACTIVE, State.RAMP_DOWN, State.HAND_OVER)
            said = "released" if held else "it was not engaged; a wish to engage, if any, is withdrawn"
            return {"done": verdict.authority == 0.0, "said": f"{said}. {is_now}", "value": value}
        if name == "clear_fault":
            if verdict.state is State.FAULT and not late:
                return None
            done = verdict.state is not State.FAULT
            return {"done": done, "said": f"{'cleared' if done else 'refused'}. {is_now}", "value": value}
        if isinstance(one.command, Aim):
            return {"done": True, "said": self._way(sample), "value": self._aimed(engine, sample)}
        axis, changed = _changes(one.command)
        new = msgspec.to_builtins(getattr(engine.config, axis))
        said = ", ".join(f"{key} {new[key]} (was {getattr(getattr(one.old, axis), key)})" for key in changed)
        return {"done": True, "said": f"{axis}: {said}", "value": {"axis": axis, **new}}

    def _way(self, sample: ControlSample) -> str:
        engaged = sample.dofs.engaged
        if not engaged.any():
            return f"kept for when it engages; the state is {sample.verdict.state}"
        if np.isfinite(self.setpoint[:2]).any() and not engaged[X]:
            return "on its way; x and y are not held, because it engaged without a position"
        return "on its way"

    def _aimed(self, engine: Controllable, sample: ControlSample) -> dict[str, Any]:
        """Return the target, read back; while it is not engaged, what is kept for then."""
        engaged = sample.dofs.engaged
        aimed = np.where(engaged, engine.target, math.nan) if engaged.any() else self.setpoint
        x, y, z, psi = aimed.tolist()
        values = {"depth_m": z, "heading_deg": math.degrees(psi) % 360.0, "x_m": x, "y_m": y}
        return {key: value for key, value in values.items() if math.isfinite(value)}

    def _answer(self, order: Order, *, done: bool, said: str, value: dict[str, Any] | None = None) -> None:
        reply = Reply(done=done, said=said, value=value or {})
        self.taken.append(CommandResult(order, reply))
        order.answer(reply)


def _named(command: Section) -> dict[str, Any]:
    values = ((key, getattr(command, key)) for key in command.__struct_fields__)
    return {key: value for key, value in values if value is not msgspec.UNSET}


def _changes(command: Section) -> tuple[str, dict[str, Any]]:
    """Return the axis that a tuning command is about, and what it changes there."""
    named = _named(command)
    named.pop("confirm", None)
    return named.pop("axis"), named


def _form(command: type[Section]) -> str:
    """Return what a command takes, in words."""
    hints = get_type_hints(command)
    fields = (
        f"{key} ({', '.join(get_args(hint))})" if get_origin(hint) is Literal else key
        for key, hint in hints.items()
    )
    return f"a JSON object with {', '.join(fields) or 'nothing in it: {}'}"
