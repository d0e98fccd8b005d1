"""What an operator may ask for while it dives: checked like the configuration, and answered with the truth.

A `ReceivedCommand` comes from any thread and waits. Before a tick the queue turns at most one into what the
engine takes anyway, a `Request`, a setpoint or a retuned configuration, so that nothing passes the supervisor
by; after the tick it answers with what came of it. A path is built between ticks, one at a time and in steps.
No Zenoh and no clock in here.
"""

import logging
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import msgspec

from companion.config import Config, check_choices
from companion.guidance.orders import Order, ordering, place_words
from companion.guidance.target import known
from companion.records import (
    ENGAGE_S,
    PSI,
    Condition,
    ControlSample,
    Request,
    Setpoint,
    State,
    Vector,
    Verdict,
    X,
    Y,
    Z,
    chosen,
    vector,
)
from companion.steps import Steps, Task
from companion.telemetry.commands import (
    COMMANDS,
    ClearFault,
    CommandResult,
    Engage,
    Follow,
    Goto,
    Payload,
    Release,
    ResetModel,
    SetCompensator,
    SetEstimator,
    SetGains,
    SetPath,
    SetSetpoint,
    SetVelocity,
    in_words,
    named,
    parse,
)
from companion.telemetry.conditions import text
from companion.telemetry.glossary import HOLD_HERE, NOBODY, on_engaging
from companion.telemetry.schemas import Reply
from companion.telemetry.status_line import left_text

log = logging.getLogger("holdfast")

REQUESTS: dict[type[Payload], Request] = {
    Engage: Request.ENGAGE,
    Release: Request.STOP,
    ClearFault: Request.CLEAR_FAULT,
    ResetModel: Request.RESET_MODEL,
}
MAX_WAITING = 8
COST = 16
"""Steps between two looks at the clock and the sockets: a third of a millisecond."""

SETTLE_S = 2.0
MAX_STEP = 2.0
"""One command may make a value this many times larger or smaller; for more it has to be confirmed."""


class ReceivedCommand(NamedTuple):
    """A command's name and payload as they came, and where the answer goes. `answer` is called once.

    `local` if it can only have come from this machine, where everybody can speak to the vehicle anyway.
    """

    name: str
    payload: bytes
    answer: Callable[[Reply], None]
    local: bool = False


@dataclass
class _Waiting:
    """A command that waits: its payload or why it is refused, and the work to be done before it."""

    received: ReceivedCommand
    command: Payload | None = None
    refused: str = ""
    task: Task[Order | None] | None = None


class EngineInput(NamedTuple):
    """What commands gave the engine before a tick."""

    requests: list[Request]
    setpoint: Setpoint | None = None
    config: Config | None = None
    order: tuple[str, bytes] | None = None
    """A path or a move, as it came: name and payload."""


class Controllable(Protocol):
    """What the queue needs of the engine."""

    @property
    def config(self) -> Config:
        """What is in force."""

    @property
    def verdict(self) -> Verdict:
        """The last tick's."""

    @property
    def target(self) -> Vector:
        """Where it is held, or is while it is not: x, y, z, psi."""

    @property
    def asked(self) -> Vector:
        """What was asked for, NaN where nothing was."""

    @property
    def destination(self) -> Vector:
        """Where a move goes, NaN where none does, or where that is not known yet."""

    def refusal(self, request: Request) -> str:
        """Return why a request would be refused now, and what to do; empty where it is accepted."""

    def aim(self, setpoint: Setpoint) -> None:
        """Take a setpoint; raise ValueError for one that is not permitted."""

    def guide(self, order: Order) -> None:
        """Take a path, a move, or what to do with them; raise ValueError for what is not permitted."""

    def preparing(self, config: Config) -> Steps[None]:
        """Do the long part of a `retune` beforehand, in steps."""

    def retune(self, config: Config) -> None:
        """Take gains, compensators and noises, without a jump; raise ConfigError for what needs a restart."""


@dataclass
class _Pending:
    """A command that the engine has taken, not answered yet; `withdrawn` says why it was given up."""

    received: ReceivedCommand
    command: Payload
    until_s: float
    was: State
    old: Config
    withdrawn: str = ""


@dataclass
class CommandQueue:
    """Takes commands between ticks, gives them to the engine, answers after the tick."""

    started_with: Config
    results: list[CommandResult] = field(default_factory=list)
    """What was answered in this tick."""

    _inbox: deque[_Waiting] = field(default_factory=deque)
    _pending: list[_Pending] = field(default_factory=list)
    _withdraw: bool = False
    _kept: str = ""
    """What engaging does beside holding."""

    def put(self, received: ReceivedCommand) -> None:
        """Take a command, from any thread, which parses it; answer at once where too many wait.

        There is always room for a release.
        """
        if len(self._inbox) >= (2 * MAX_WAITING if received.name == "release" else MAX_WAITING):
            received.answer(Reply(done=False, said=f"busy: {MAX_WAITING} commands wait already; ask again"))
        else:
            self._inbox.append(self._parsed(received))

    def prepare(self, engine: Controllable, cost: int = COST) -> bool:
        """Take some steps of what has to be done before the next command; return whether there are more.

        Call it between ticks.
        """
        if not self._inbox or (waiting := self._inbox[0]).command is None or waiting.refused:
            return False
        if waiting.task is None:
            waiting.task = Task(self._preparing(waiting.command, engine))
        try:
            return not waiting.task.advance(cost)
        except Exception as error:
            waiting.refused = _why(error)
            return False

    def before_tick(self, engine: Controllable, now_s: float) -> EngineInput:
        """Give the next command to the engine; return what it got, requests to be asked in this tick."""
        self.results = []
        given = EngineInput([Request.WITHDRAW] if self._withdraw else [])
        self._withdraw = False
        if not self._ready(engine):
            return given
        waiting = self._inbox.popleft()
        received, command, task = waiting.received, waiting.command, waiting.task
        old, was = engine.config, engine.verdict.state
        try:
            if command is None or waiting.refused:
                raise ValueError(waiting.refused)
            if task is not None and task.result is not None:
                engine.guide(task.result)
                given = given._replace(order=(received.name, received.payload))
            elif isinstance(command, SetSetpoint):
                given = given._replace(setpoint=self._aim(engine, command))
            elif isinstance(command, SetCompensator | SetGains | SetEstimator):
                engine.retune(self._retuned(old, command))
                given = given._replace(config=engine.config)
            else:
                given.requests.append(self._requested(engine, command))
        except Exception as error:
            self._answer(received, command, Reply(done=False, said=f"refused: {_why(error)}"))
            return given
        wait_s = ENGAGE_S if received.name == "engage" else SETTLE_S + old.supervisor.ramp_down_s
        self._pending.append(_Pending(received, command, now_s + wait_s, was, old))
        return given

    def after_tick(self, engine: Controllable, sample: ControlSample, now_s: float) -> None:
        """Answer what has been settled by this tick."""
        waiting, self._pending = self._pending, []
        for pending in waiting:
            try:
                reply = self._settled(pending, engine, sample, now_s)
            except Exception as error:
                reply = Reply(done=False, said=f"what came of it cannot be said: {_why(error)}")
            if reply is None:
                self._pending.append(pending)
            else:
                self._answer(pending.received, pending.command, reply)
        if not any(sample.dofs.engaged):
            self._kept = sample.guided.pending

    def _parsed(self, received: ReceivedCommand) -> _Waiting:
        try:
            self._permit(received)
            max_depth_m = self.started_with.supervisor.max_depth_m
            return _Waiting(received, parse(received.name, received.payload, max_depth_m=max_depth_m))
        except Exception as error:
            return _Waiting(received, refused=_why(error))

    def _preparing(self, command: Payload, engine: Controllable) -> Steps[Order | None]:
        """Return the order that a command is; None for another command."""
        if isinstance(command, SetEstimator):
            yield from engine.preparing(self._retuned(engine.config, command))
            return None
        return (yield from ordering(command, self.started_with))

    def _ready(self, engine: Controllable) -> bool:
        """Tell whether the next command can be taken.

        A release does not wait until a path before it is built: what came before it is withdrawn.
        """
        if not self.prepare(engine, 1):
            return bool(self._inbox)
        commands = [waiting.command for waiting in self._inbox]
        first = next((i for i, command in enumerate(commands) if isinstance(command, Release)), 0)
        for _ in range(first):
            withdrawn = self._inbox.popleft()
            reply = Reply(done=False, said="withdrawn: a release came after it")
            self._answer(withdrawn.received, withdrawn.command, reply)
        return first > 0 and not self.prepare(engine, 1)

    def _permit(self, received: ReceivedCommand) -> None:
        allowed = self.started_with.telemetry.allow_control
        if allowed == "never":
            raise ValueError('this companion is read-only: telemetry.allow_control = "never"')
        if allowed == "local" and not received.local:
            raise ValueError(
                "it may have come from another machine: through a router, from a network or by a Zenoh file. "
                "Start the companion with `holdfast run --allow-control`, or set "
                'telemetry.allow_control = "always"'
            )

    def _aim(self, engine: Controllable, command: SetSetpoint) -> Setpoint:
        given = named(command)
        wanted = list(engine.asked)
        for index, key in ((X, "x_m"), (Y, "y_m"), (Z, "depth_m")):
            wanted[index] = given.get(key, wanted[index])
        if "heading_deg" in given:
            if not engine.config.vehicle.holds_heading:
                raise ValueError("heading_deg: in STABILIZE the firmware keeps the heading")
            wanted[PSI] = math.remainder(math.radians(given["heading_deg"]), math.tau)
        max_depth_m = engine.config.supervisor.max_depth_m
        if wanted[Z] > max_depth_m:
            raise ValueError(f"depth_m = {wanted[Z]:g}: supervisor.max_depth_m is {max_depth_m:g}")
        setpoint = Setpoint(vector(wanted))
        engine.aim(setpoint)
        return setpoint

    def _retuned(self, config: Config, command: SetCompensator | SetGains | SetEstimator) -> Config:
        axis, wanted = _changes(command)
        old = getattr(config, axis)
        if not getattr(command, "confirm", True):
            for key, value in wanted.items():
                now = getattr(old, key)
                if not now / MAX_STEP <= value <= now * MAX_STEP:
                    raise ValueError(
                        f"{axis}.{key} = {value:g}: it is {now:g}, and one step may take it to "
                        f"{now / MAX_STEP:g} to {now * MAX_STEP:g}; if it is meant, add confirm=true"
                    )
        retuned = msgspec.structs.replace(config, **{axis: msgspec.structs.replace(old, **wanted)})
        check_choices(retuned)
        return retuned

    def _requested(self, engine: Controllable, command: Payload) -> Request:
        request = REQUESTS[type(command)]
        if why := engine.refusal(request):
            raise ValueError(why)
        if request is Request.STOP:
            for pending in self._pending:
                if pending.received.name == "engage":
                    pending.withdrawn = "withdrawn: the vehicle was released meanwhile"
        return request

    def _settled(
        self, pending: _Pending, engine: Controllable, sample: ControlSample, now_s: float
    ) -> Reply | None:
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
        late = now_s >= pending.until_s
        name = pending.received.name
        if name == "engage":
            if verdict.state is State.ACTIVE:
                value |= self._aimed(engine, sample)
                goes = f"; now: {self._kept}" if self._kept else ""
                return Reply(done=True, said=f"engaged; it was {pending.was}{goes}", value=value)
            if Condition.FAILSAFE_UNSAFE in verdict.conditions and not pending.withdrawn:
                pending.withdrawn = "refused"
                self._withdraw = True
            elif late and not pending.withdrawn:
                unread = verdict.state is State.READY and not verdict.conditions & Condition.PILOT_TAKEOVER
                why = ": FS_PILOT_INPUT and FS_PILOT_TIMEOUT were not answered" if unread else ""
                pending.withdrawn = f"withdrawn: it did not engage within {ENGAGE_S:.0f} s{why}"
                self._withdraw = True
            elif pending.withdrawn or verdict.state is State.FAULT:
                held = text(verdict.conditions)
                said = f"{pending.withdrawn or 'refused'}. {is_now}{f' ({held})' if held else ''}"
                return Reply(done=False, said=said, value=value)
            return None
        if name == "reset_model":
            return Reply(done=True, said="the nominal model is in use again", value=value)
        if name == "release":
            if verdict.authority > 0.0 and not late:
                return None
            was_held = pending.was in (State.ACTIVE, State.RAMP_DOWN, State.HAND_OVER)
            said = "released" if was_held else "it was not engaged; a request to engage, if any, is withdrawn"
            nobody = f"; {NOBODY.format(sample.disarms_in_s)}" if sample.disarms_in_s else ""
            return Reply(done=verdict.authority == 0.0, said=f"{said}. {is_now}{nobody}", value=value)
        if name == "clear_fault":
            if verdict.state is State.FAULT and not late:
                return None
            done = verdict.state is not State.FAULT
            said = "cleared" if done else "refused"
            return Reply(done=done, said=f"{said}. {is_now}", value=value)
        if isinstance(pending.command, Goto | Follow | SetPath | SetVelocity):
            guided = sample.guided
            value |= self._aimed(engine, sample) | {"guidance": guided.kind, "length_m": guided.length_m}
            said = self._progress(engine, sample)
            if any(sample.dofs.engaged):
                said += f": {guided.name}" if guided.name else ""
                said += f", {guided.length_m:.1f} m a lap" if guided.length_m else ""
                left = left_text(guided.left_m, guided.left_s)
                said += f": {left}" if left else ""
            return Reply(done=guided.kind != "refused", said=said, value=value)
        if isinstance(pending.command, SetSetpoint):
            said = self._progress(engine, sample, hold="on its way")
            return Reply(done=True, said=said, value=self._aimed(engine, sample))
        axis, changed = _changes(pending.command)
        new = msgspec.to_builtins(getattr(engine.config, axis))
        said = ", ".join(
            f"{key} {new[key]} (was {getattr(getattr(pending.old, axis), key)})" for key in changed
        )
        return Reply(done=True, said=f"{axis}: {said}", value={"axis": axis, **new})

    def _progress(self, engine: Controllable, sample: ControlSample, hold: str = "holds here") -> str:
        engaged = sample.dofs.engaged
        if not any(engaged):
            kept = on_engaging(sample.guided.pending or HOLD_HERE)
            return f"kept, {kept}; the state is {sample.verdict.state}"
        awaited = Condition.POSITION_STALE in sample.verdict.conditions
        if not engaged[X] and (awaited or any(map(math.isfinite, engine.asked[:2]))):
            return "on its way; x and y are not held until there is a position"
        kinds = {"paused": "paused", "hold": hold, "refused": "refused"}
        goal = place_words(engine.destination).replace("go to", " to", 1)
        return kinds.get(sample.guided.kind, f"on its way{goal}")

    def _aimed(self, engine: Controllable, sample: ControlSample) -> dict[str, Any]:
        """Return where it goes, or the target, read back; while it is not engaged, what is kept for then."""
        engaged, goal = sample.dofs.engaged, engine.destination
        asked = chosen(engaged, engine.target, goal) if any(engaged) else engine.asked
        x, y, z, psi = chosen(known(goal), goal, asked)
        values = {"depth_m": z, "heading_deg": math.degrees(psi) % 360.0, "x_m": x, "y_m": y}
        return {key: value for key, value in values.items() if math.isfinite(value)}

    def _answer(self, received: ReceivedCommand, command: Payload | None, reply: Reply) -> None:
        known = COMMANDS.get(received.name)
        order = in_words(command) if command else known.order if known else received.name[:40]
        self.results.append(CommandResult(order, reply))
        received.answer(reply)


def _why(error: Exception) -> str:
    """Return why a command is refused. What nobody has foreseen is logged with its place."""
    if isinstance(error, ValueError):
        return str(error)
    log.error("a command failed: %r", error, exc_info=error)
    return f"it leads to an error ({error!r:.200}): check its numbers, and report it"


def _changes(command: Payload) -> tuple[str, dict[str, Any]]:
    """Return the axis that a tuning command is about, and what it changes there."""
    changed = named(command)
    changed.pop("confirm", None)
    return changed.pop("axis"), changed
