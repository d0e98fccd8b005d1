"""What an operator may ask for while it dives: checked like the configuration, and answered with the truth.

A `ReceivedCommand` comes from any thread and waits. Before a tick the queue turns at most one into what the
engine takes anyway, a `Request`, an order or a retuned configuration, so that nothing passes the supervisor
by; after the tick it answers with what came of it. A path is built between ticks, one at a time and in steps.
"""
# ruff: noqa: D102 (of Controllable: the engine describes them)

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
    Condition,
    ControlSample,
    Request,
    State,
    Vector,
    Verdict,
    X,
    chosen,
)
from companion.steps import Task
from companion.telemetry import operator_commands as commands
from companion.telemetry.glossary import HOLD_HERE, NOBODY, on_engaging, text
from companion.telemetry.operator_commands import Payload, in_words, named, parse
from companion.telemetry.schemas import Reply
from companion.telemetry.status_line import left_text

log = logging.getLogger("holdfast")

REQUESTS: dict[type[Payload], Request] = {
    commands.Engage: Request.ENGAGE,
    commands.Release: Request.STOP,
    commands.ClearFault: Request.CLEAR_FAULT,
    commands.ResetModel: Request.RESET_MODEL,
}
MAX_WAITING = 8  # a pilot presses fewer within a tick
COST = 16
"""Steps between two looks at the clock and the sockets: a third of a millisecond."""

DEFAULTS = Config()
SETTLE_S = 2.0  # beyond the ramp: heartbeat and reply
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
class _Command:
    """A command on its way: it waits, is worked out in steps, is taken by the engine, and is answered."""

    received: ReceivedCommand
    payload: Payload | None = None
    refused: str = ""
    """Why the engine does not take it, or why it was given up."""
    task: Task[Order | None] | None = None
    until_s: float = math.inf
    was: State = State.IDLE
    old: Config = DEFAULTS
    """State and configuration when it was taken, and until when it may settle."""


class EngineInput(NamedTuple):
    """What commands gave the engine before a tick."""

    requests: list[Request]
    config: Config | None = None
    order: tuple[str, bytes] | None = None
    """A place, a path or a velocity, as it came: name and payload."""


class Controllable(Protocol):
    """What the queue needs of the engine, which describes it."""

    @property
    def config(self) -> Config: ...
    @property
    def verdict(self) -> Verdict: ...
    @property
    def target(self) -> Vector: ...
    @property
    def asked(self) -> Vector: ...
    @property
    def destination(self) -> Vector: ...
    @property
    def reads(self) -> bool: ...
    def refusal(self, request: Request) -> str: ...
    def guide(self, order: Order) -> None: ...
    def retune(self, config: Config) -> None: ...


@dataclass
class CommandQueue:
    """Takes commands between ticks, gives them to the engine, answers after the tick."""

    started_with: Config
    _waiting: deque[_Command] = field(default_factory=deque)
    _taken: list[_Command] = field(default_factory=list)
    _answered: list[commands.CommandResult] = field(default_factory=list)
    _withdraw: bool = False
    _kept: str = ""
    """What engaging does beside holding."""

    def put(self, received: ReceivedCommand) -> None:
        """Take a command, from any thread, which parses it; answer at once where too many wait.

        There is always room for a release.
        """
        if len(self._waiting) >= (2 * MAX_WAITING if received.name == "release" else MAX_WAITING):
            received.answer(Reply(done=False, said=f"busy: {MAX_WAITING} commands wait already; ask again"))
            return
        command = _Command(received)
        try:
            self._permit(received)
            max_depth_m = self.started_with.supervisor.max_depth_m
            command.payload = parse(received.name, received.payload, max_depth_m=max_depth_m)
        except Exception as error:
            command.refused = _why(error)
        self._waiting.append(command)

    def prepare(self, cost: int = COST) -> bool:
        """Take some steps of what has to be done before the next command; return whether there are more.

        Call it between ticks.
        """
        if not self._waiting or (command := self._waiting[0]).payload is None or command.refused:
            return False
        if command.task is None:
            command.task = Task(ordering(command.payload, self.started_with))
        try:
            return not command.task.advance(cost)
        except Exception as error:
            command.refused = _why(error)
            return False

    def before_tick(self, engine: Controllable, now_s: float) -> EngineInput:
        """Give the next command to the engine; return what it got, requests to be asked in this tick."""
        given = EngineInput([Request.WITHDRAW] if self._withdraw else [])
        self._withdraw = False
        if not self._ready() or (isinstance(self._waiting[0].payload, commands.Engage) and engine.reads):
            return given
        command = self._waiting.popleft()
        command.old, command.was = engine.config, engine.verdict.state
        try:
            given = self._give(command, engine, given)
        except Exception as error:
            self._answer(command, Reply(done=False, said=f"refused: {_why(error)}"))
            return given
        engages = isinstance(command.payload, commands.Engage)
        command.until_s = now_s + (ENGAGE_S if engages else SETTLE_S + command.old.supervisor.ramp_down_s)
        self._taken.append(command)
        return given

    def after_tick(
        self, engine: Controllable, sample: ControlSample, now_s: float
    ) -> list[commands.CommandResult]:
        """Answer what has been settled by this tick; return all that was answered since the last one."""
        taken, self._taken = self._taken, []
        for command in taken:
            try:
                reply = self._settled(command, engine, sample, now_s)
            except Exception as error:
                reply = Reply(done=False, said=f"what came of it cannot be said: {_why(error)}")
            if reply is None:
                self._taken.append(command)
            else:
                self._answer(command, reply)
        if not any(sample.dofs.engaged):
            self._kept = sample.guided.pending
        answered, self._answered = self._answered, []
        return answered

    def _ready(self) -> bool:
        """Tell whether the next command can be taken.

        A release does not wait until a path before it is built: what came before it is withdrawn.
        """
        if not self.prepare(1):
            return bool(self._waiting)
        payloads = [command.payload for command in self._waiting.copy()]  # another thread appends meanwhile
        first = next((i for i, payload in enumerate(payloads) if isinstance(payload, commands.Release)), 0)
        for _ in range(first):
            self._answer(
                self._waiting.popleft(), Reply(done=False, said="withdrawn: a release came after it")
            )
        return first > 0 and not self.prepare(1)

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

    def _give(self, command: _Command, engine: Controllable, given: EngineInput) -> EngineInput:
        """Give a command to the engine; raise ValueError where that is not possible."""
        payload, task = command.payload, command.task
        if payload is None or command.refused:
            raise ValueError(command.refused)
        if task is not None and task.result is not None:
            engine.guide(task.result)
            return given._replace(order=(command.received.name, command.received.payload))
        if isinstance(payload, commands.SetCompensator | commands.SetGains):
            engine.retune(self._retuned(command.old, payload))
            return given._replace(config=engine.config)
        request = REQUESTS[type(payload)]
        if why := engine.refusal(request):
            raise ValueError(why)
        for taken in self._taken:
            if request is Request.STOP and isinstance(taken.payload, commands.Engage):
                taken.refused = "withdrawn: the vehicle was released meanwhile"
        return given._replace(requests=[*given.requests, request])

    def _retuned(self, config: Config, payload: commands.SetCompensator | commands.SetGains) -> Config:
        axis, wanted = _changes(payload)
        old = getattr(config, axis)
        if not getattr(payload, "confirm", True):
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

    def _settled(
        self, command: _Command, engine: Controllable, sample: ControlSample, now_s: float
    ) -> Reply | None:
        """Return the answer, or None while there is none yet."""
        verdict, payload, late = sample.verdict, command.payload, now_s >= command.until_s
        is_now, faulty = f"{verdict.state}: {verdict.reason}", verdict.state is State.FAULT
        value: dict[str, Any] = {
            "state": str(verdict.state),
            "reason": verdict.reason,
            "conditions": [condition.name for condition in verdict.conditions],
            "remedy": verdict.remedy,
        }
        if isinstance(payload, commands.Engage):
            return self._engaged(command, engine, sample, late, value)
        if isinstance(payload, commands.ResetModel):
            return Reply(done=True, said="the nominal model is in use again", value=value)
        if isinstance(payload, commands.Release):
            if verdict.authority > 0.0 and not late:
                return None
            was_held = command.was in (State.ACTIVE, State.RAMP_DOWN, State.HAND_OVER)
            said = "released" if was_held else "it was not engaged; a request to engage, if any, is withdrawn"
            nobody = f"; {NOBODY.format(sample.disarms_in_s)}" if sample.disarms_in_s else ""
            return Reply(done=verdict.authority == 0.0, said=f"{said}. {is_now}{nobody}", value=value)
        if isinstance(payload, commands.ClearFault):
            if faulty and not late:
                return None
            return Reply(done=not faulty, said=f"{'refused' if faulty else 'cleared'}. {is_now}", value=value)
        if isinstance(payload, commands.Goto | commands.Follow | commands.SetPath | commands.SetVelocity):
            at_once = isinstance(payload, commands.Goto) and payload.at_once
            return self._guided(engine, sample, value, hold="on its way" if at_once else "holds here")
        assert payload is not None
        axis, changed = _changes(payload)
        old, new = getattr(command.old, axis), msgspec.to_builtins(getattr(engine.config, axis))
        said = ", ".join(f"{key} {new[key]} (was {getattr(old, key)})" for key in changed)
        return Reply(done=True, said=f"{axis}: {said}", value={"axis": axis, **new})

    def _engaged(
        self,
        command: _Command,
        engine: Controllable,
        sample: ControlSample,
        late: bool,
        value: dict[str, Any],
    ) -> Reply | None:
        """Return what came of a request to engage; withdraw it where it takes too long."""
        verdict = sample.verdict
        if verdict.state is State.ACTIVE:
            goes = f"; now: {self._kept}" if self._kept else ""
            said = f"engaged; it was {command.was}{goes}"
            return Reply(done=True, said=said, value=value | self._aimed(engine, sample))
        if Condition.FAILSAFE_UNSAFE in verdict.conditions and not command.refused:
            command.refused = "refused"
            self._withdraw = True
        elif late and not command.refused:
            unread = verdict.state is State.READY and not verdict.conditions & Condition.PILOT_TAKEOVER
            why = ": FS_PILOT_INPUT and FS_PILOT_TIMEOUT were not answered" if unread else ""
            command.refused = f"withdrawn: it did not engage within {ENGAGE_S:.0f} s{why}"
            self._withdraw = True
        elif command.refused or verdict.state is State.FAULT:
            held = text(verdict.conditions)
            why = f"{command.refused or 'refused'}. {verdict.state}: {verdict.reason}"
            return Reply(done=False, said=f"{why}{f' ({held})' if held else ''}", value=value)
        return None

    def _guided(self, engine: Controllable, sample: ControlSample, value: dict[str, Any], hold: str) -> Reply:
        guided, said = sample.guided, self._progress(engine, sample, hold)
        if any(sample.dofs.engaged):
            said += f": {guided.name}" if guided.name else ""
            said += f", {guided.length_m:.1f} m a lap" if guided.length_m else ""
            left = left_text(guided.left_m, guided.left_s)
            said += f": {left}" if left else ""
        value |= self._aimed(engine, sample) | {"guidance": guided.kind, "length_m": guided.length_m}
        return Reply(done=guided.kind != "refused", said=said, value=value)

    def _progress(self, engine: Controllable, sample: ControlSample, hold: str) -> str:
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

    def _answer(self, command: _Command, reply: Reply) -> None:
        name, payload = command.received.name, command.payload
        known = commands.COMMANDS.get(name)
        order = in_words(payload) if payload else known.order if known else name[:40]
        self._answered.append(commands.CommandResult(order, reply))
        command.received.answer(reply)


def _why(error: Exception) -> str:
    """Return why a command is refused. What nobody has foreseen is logged with its place."""
    if isinstance(error, ValueError):
        return str(error)
    log.error("a command failed: %r", error, exc_info=error)
    return f"it leads to an error ({error!r:.200}): check its numbers, and report it"


def _changes(payload: Payload) -> tuple[str, dict[str, Any]]:
    """Return the axis that a tuning command is about, and what it changes there."""
    changed = named(payload)
    changed.pop("confirm", None)
    return changed.pop("axis"), changed
