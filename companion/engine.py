"""One tick on one screen, read downwards. No clock, socket or thread."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec

from companion import assembly
from companion.config import Config
from companion.core import attitude, observers, tick
from companion.core.actuation import FULL, NONE
from companion.core.allocation import HORIZONTAL, ByAxis, can_lose, reserve
from companion.core.controller import Samples
from companion.core.permission import Permission, Wanted
from companion.core.tick import Demand, Known, Memory, Parameters
from companion.estimation.belief import believed
from companion.estimation.estimator import Sensed
from companion.guidance.guidance import Guidance
from companion.guidance.orders import Order
from companion.guidance.paths.shapes import Path
from companion.guidance.pilot import PilotDemand
from companion.guidance.sources import Here
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.pilot_display import PilotDisplay, values
from companion.mavlink.signing import Signing
from companion.predive.check import CheckRow
from companion.predive.fitness import Fitness
from companion.records import (
    LEVEL,
    NEUTRAL,
    SAMPLES,
    ZERO,
    AxisCommand,
    Condition,
    ControlSample,
    Dofs,
    DofSample,
    Event,
    Flags,
    LoopHealth,
    Parameter,
    PilotSticks,
    Request,
    Setpoint,
    State,
    StatusText,
    Vector,
    VehicleState,
    Verdict,
    X,
    Z,
)
from companion.supervision.guard import guard
from companion.supervision.situation import Observation
from companion.supervision.supervision import Supervision
from companion.telemetry import schemas
from companion.telemetry.glossary import Details
from companion.tuning import Tuning

MAX_DT_TICKS = 3.0

RELEASING = (State.RAMP_DOWN, State.HAND_OVER)


class Heard(msgspec.Struct, frozen=True):
    """What came in for a tick."""

    now_s: float
    dt_s: float
    control_dt_s: float
    events: list[Event]
    reports: Sequence[Event]
    """The events that are no samples."""
    requests: Sequence[Request]
    loop: LoopHealth


class Guarded(msgspec.Struct, frozen=True):
    """What may leave for the vehicle."""

    command: AxisCommand
    applied: AxisCommand
    """What the vehicle makes of the command, after rounding."""
    held: ByAxis
    """Which of the axes are ours; the others are the pilot's."""
    pilot: PilotSticks | None
    steers: bool


class Tick(NamedTuple):
    """The result of a tick, for the next one and for questions between ticks."""

    heard: Heard
    state: VehicleState
    """The state in the frame inside."""
    demand: Demand
    dofs: Dofs
    guarded: Guarded


class Engine:
    """The controller without its process: `step` once a tick, `shutdown_frames` on every way out."""

    def __init__(
        self, config: Config, setpoint: Setpoint, *, arm: bool = False, signing: Signing | None = None
    ) -> None:
        self.tuning = Tuning(config)
        self._tick_s = 1.0 / config.loop.rate_hz
        self._autopilot = autopilot = Autopilot(config, signing)
        self.heard, self.sender, self.hello = autopilot.heard, autopilot.sender, autopilot.hello
        self._estimator, self._surroundings = assembly.estimator(config), assembly.surroundings(config)
        self._fitness = Fitness(autopilot)
        self._supervision = Supervision(config, autopilot.parameters, arm=arm)
        self.refusal = self._supervision.engagement.refusal
        self._guidance = Guidance(config, setpoint)
        self.memory = tick.start(self.parameters)
        """All that the core remembers: a value, which may be kept, compared and given back."""
        self._display = PilotDisplay()
        self._envelope = assembly.envelope(config)
        self.last: Tick | None = None
        """The last tick; `step` sets it and what follows at its end."""

    def step(
        self,
        now_s: float,
        datagrams: Sequence[tuple[int, bytes]],
        loop: LoopHealth,
        requests: Sequence[Request] = (),
        ground: Sequence[tuple[int, bytes]] = (),
        excitation: Vector = ZERO,
    ) -> tuple[list[bytes], ControlSample]:
        """Advance one tick: take what arrived (monotonic ns, bytes), return what to send and the record.

        `ground` are the pilot's frames as `Relay.take` gives them. `excitation` is a body force that is added
        to the law's, N and N·m, to identify the vehicle.
        """
        heard = self._receive(now_s, datagrams, ground, requests, loop)
        sensed = self._sense(heard)
        memory = self._remembered(heard, sensed)
        memory, known = tick.observe(self.parameters, memory, sensed.inputs)
        state = self._believe(sensed, memory, known)
        demanded = self._guidance.pilot_demand(state, heard.dt_s, heard.reports)
        requests, refused = self._asked(heard, state, demanded)
        verdict, permission = self._permit(heard, memory, known, state, demanded, requests)
        memory = tick.begin(self.parameters, memory, known, permission)
        wanted = self._guide(heard, memory, known, state, demanded, verdict)
        memory, demand = tick.control(
            self.parameters, memory, known, permission, wanted, heard.control_dt_s, excitation
        )
        guarded = self._guard(demand, state, demanded, verdict)
        frames = self._send(heard, state, guarded)
        memory = tick.confirm(self.parameters, memory, demand, guarded.applied, guarded.held)

        self.memory = memory if demand.finite else self._without_motion(memory)
        self.last = Tick(heard, state, demand, by_quantity(demand.samples), guarded)
        return frames, self._record(self.last, refused)

    def displayed(self, sample: ControlSample, events: Sequence[schemas.Event]) -> list[bytes]:
        """Return what the pilot's ground station is to show of the last tick, and answers to its commands.

        It goes to the ground station's link, and without one to the vehicle's, which forwards it.
        """
        assert self.last is not None, "nothing is shown before the first tick"
        messages = self._display.step(sample, events, self.last.heard.reports)
        if self._display.plots(sample.state.t_s):
            applied, reach = self.last.guarded.applied, self._reach(sample.state)
            messages += values(sample, reserve(self.parameters.actuation.thrusters, applied, reach))
        return self._autopilot.displayed(messages)

    def last_words(self, words: str) -> list[bytes]:
        """Return what the pilot's ground station shows when this process ends."""
        return self._autopilot.displayed(self._display.last_words(words))

    def shutdown_frames(self) -> bytes:
        """Return what every way out sends, whatever state the rest is in; nothing where nothing is ours.

        Neutral while the vehicle follows our frames, and the mode of before where we changed it. Frames of
        one who does not steer would count as a pilot, and the silence after them as his loss: FS_PILOT_INPUT
        would then disarm somebody else's vehicle.
        """
        mode = self._supervision.restore_mode()
        neutral = self._autopilot.neutral() if self.steering else b""
        return neutral + (self._autopilot.set_mode(mode) if mode is not None else b"")

    @property
    def steering(self) -> bool:
        """Whether the last tick sent a steering frame: nobody else's should reach the vehicle meanwhile."""
        return self.last is not None and self.last.guarded.steers

    @property
    def config(self) -> Config:
        """What is in force now."""
        return self.tuning.config

    @property
    def parameters(self) -> Parameters:
        """What the core knows beforehand."""
        return self.tuning.parameters

    @property
    def verdict(self) -> Verdict:
        """The last tick's."""
        return self._supervision.verdict

    @property
    def state(self) -> VehicleState:
        """What the last tick believed of the vehicle."""
        assert self.last is not None, "nothing is known before the first tick"
        return self._estimator.frame.reported_state(self.last.state)

    @property
    def target(self) -> Vector:
        """Where it is held, or is while it is not: x, y, z, psi."""
        return self._estimator.frame.now.outside(self._guidance.target.eta_d)

    def aim(self, setpoint: Setpoint) -> None:
        """Take a new setpoint (`Sources.aim`)."""
        self._guidance.sources.aim(setpoint, self._estimator.frame)

    @property
    def asked(self) -> Vector:
        """What was asked for, NaN where nothing was."""
        return self._guidance.sources.target.asked.eta_d

    @property
    def destination(self) -> Vector:
        """Where a move goes (`Course.destination`)."""
        return self._guidance.sources.course.destination

    @property
    def path(self) -> tuple[Path, Callable[[Vector], Vector]] | None:
        """The path that is followed, and what gives its places in the EKF's frame."""
        return self._guidance.sources.path(self._estimator.frame)

    def guide(self, order: Order) -> None:
        """Take a path, a move, or what to do with them. Raises ValueError for what is not possible."""
        t_s, eta = (0.0, ZERO) if self.last is None else (self.last.state.t_s, self.last.state.eta)
        self._guidance.guide(order, self._here(t_s, eta, self.memory))

    @property
    def check_list(self) -> list[CheckRow]:
        """The pre-dive list as it was made last; empty before the first."""
        return self._fitness.listed

    @property
    def reads(self) -> bool:
        """Whether the vehicle is not known yet, as a short while after its start: engaging waits for that."""
        return self._fitness.reads

    def retune(self, config: Config) -> None:
        """Go on with `config` from the next tick, without a step in thrust; call it between ticks.

        Raises ConfigError, and goes on with what was in force, for a section that cannot change while running
        (`assembly.LIVE` can), for values from which no finite gain follows and for gains that are too fast
        for the measured delay.
        """
        last, changed = self.last, config != self.config
        self._guidance.refuse(config)
        delay_s, demand = (None, None) if last is None else (last.state.delays.total_s, last.demand)
        self.memory = self.tuning.change(config, delay_s, self.memory, demand)
        self._surroundings.retune(config, self.parameters.control.model)
        self._supervision.retune(config, changed=changed)
        self._estimator.retune(config)
        self._guidance.retune(config)

    def _receive(
        self,
        now_s: float,
        datagrams: Sequence[tuple[int, bytes]],
        ground: Sequence[tuple[int, bytes]],
        requests: Sequence[Request],
        loop: LoopHealth,
    ) -> Heard:
        """Turn what arrived into events, the vehicle's first."""
        dt_s = self._tick_s if self.last is None else now_s - self.last.heard.now_s
        events = self._autopilot.receive(datagrams, ground)
        accepted = self._supervision.engagement.accepted(requests)
        if Request.ENGAGE in accepted:
            self._surroundings.trust_heading()
        return Heard(
            now_s=now_s,
            dt_s=dt_s,
            control_dt_s=min(max(dt_s, 0.0), MAX_DT_TICKS * self._tick_s),
            events=events,
            reports=[event for event in events if type(event) not in SAMPLES],
            requests=accepted,
            loop=loop,
        )

    def _sense(self, heard: Heard) -> Sensed:
        """Return all that the events say."""
        expected = observers.outlook(self.memory.observed)
        if self.last is not None and not self.last.demand.finite:
            expected = expected._replace(believable=False)
        return self._estimator.take(
            heard.now_s,
            heard.events,
            expected,
            self._learns(),
            drift=self._surroundings.drift,
            held=self._guidance.engaged[X],
        )

    def _remembered(self, heard: Heard, sensed: Sensed) -> Memory:
        """Return the memory from which this tick goes on, with gains for the noise that is there."""
        memory = self.tuning.follow(self._estimator.noise, self.memory)
        before = observed = memory.observed
        if sensed.restarted:
            observed = observers.restarted(observed)
        if Request.RESET_MODEL in heard.requests:
            observed = observers.forgotten(self.parameters.observers, observed)
        if Condition.HEADING_WRONG in self.verdict.warnings:
            observed = observers.place_forgotten(self.parameters.observers, observed)
        return memory if observed is before else memory._replace(observed=observed)

    def _believe(self, sensed: Sensed, memory: Memory, known: Known) -> VehicleState:
        """Return all that is believed of the vehicle and what is around it."""
        motion, model, dead, turned = known.motion, known.model, known.dead_motor, known.reversed_motor
        delivered, whole = memory.actuated.delivered, dead + turned == 0
        heaves = self.verdict.authority > 0.0 and self._guidance.engaged[Z]
        around = self._surroundings.step(sensed, motion, model, delivered, whole=whole, heaves=heaves)
        return believed(sensed, motion, around, model, dead, turned)

    def _learns(self) -> Flags:
        """Tell by axis whether what moves the vehicle was our command alone."""
        straight = attitude.is_straight(self.memory.actuated.held)
        steers = self.verdict.authority == 1.0 and not self.verdict.freeze and straight
        surge, sway, heave, yaw = self._guidance.engaged
        return (steers and surge, steers and sway, steers and heave, steers and yaw)

    def _asked(self, heard: Heard, state: VehicleState, demanded: PilotDemand) -> tuple[list[Request], str]:
        """Return what operator and pilot request, and why an engage button is refused."""
        return self._supervision.engagement.with_buttons(
            heard.requests, state.t_s, engage=demanded.engage, release=demanded.release
        )

    def _permit(
        self,
        heard: Heard,
        memory: Memory,
        known: Known,
        state: VehicleState,
        demanded: PilotDemand,
        requests: Sequence[Request],
    ) -> tuple[Verdict, Permission]:
        """Return the supervisor's verdict, and who may steer."""
        guidance, before, last = self._guidance, self.verdict, self.last
        sources = guidance.sources
        held = before.authority > 0.0 or before.state is State.ACTIVE
        thrusters = self.parameters.actuation.thrusters
        observed = Observation(
            state=state,
            angles=attitude.angles(memory.actuated.held),
            events=heard.reports,
            requests=requests,
            loop=heard.loop,
            dt_s=heard.dt_s,
            held=guidance.engaged if held else guidance.holdable(state),
            awaits_position=sources.awaits_position,
            offers_position=sources.offers_position,
            wants_ground=sources.altitude is not None,
            doubts_range=sources.altitude is not None and sources.altitude.doubts,
            dofs=None if last is None else last.dofs,
            finite=last is None or last.demand.finite,
            full_override=demanded.full_override,
            misses_motor=known.dead_motor > 0 and not can_lose(thrusters, known.dead_motor),
            details=self._details(heard, state, holding=held),
        )
        verdict = self._supervision.step(observed)
        engage = Request.ENGAGE in requests
        frame = self._estimator.frame
        regained = guidance.update(before, verdict, state, frame, engage=engage)
        return verdict, Permission(
            authority=verdict.authority,
            freeze=verdict.freeze,
            active=verdict.state is State.ACTIVE,
            releases=verdict.state in RELEASING,
            rests=regained is None,
            regained=regained or NONE,
            trusts_thrusters=Request.CLEAR_FAULT in heard.requests or _was_mended(heard, state),
            reach=self._reach(state),
        )

    def _details(self, heard: Heard, state: VehicleState, *, holding: bool) -> Details:
        """Return what is known of conditions beyond their words."""
        config, conditions = self.config, self.verdict.conditions
        failure = self._fitness.step(heard.events, state, config, conditions, holding=holding)
        details = {Condition.PREFLIGHT_FAILURE: (failure, "")} if failure else {}
        if motor := state.reversed_motor:
            todo = Condition.THRUSTER_REVERSED.remedy.replace("MOT_n", f"MOT_{motor}")
            details[Condition.THRUSTER_REVERSED] = (f"motor {motor}", todo)
        if not state.ages.heartbeat_s <= config.supervisor.heartbeat_timeout_s:
            details[Condition.LINK_LOST] = self.heard.contact(heard.now_s)
        return details

    def _reach(self, state: VehicleState) -> AxisCommand:
        return self._autopilot.reach(state.pilot_gain, self._envelope.max_axis)

    def _guide(
        self,
        heard: Heard,
        memory: Memory,
        known: Known,
        state: VehicleState,
        demanded: PilotDemand,
        verdict: Verdict,
    ) -> Wanted:
        """Return where to go."""
        guidance, here = self._guidance, self._here(state.t_s, state.eta, memory)
        target = guidance.step(demanded, heard.reports, verdict, state, here, heard.control_dt_s)
        full = verdict.state is State.ACTIVE and verdict.authority >= 1.0
        pitches = full and max(known.dead_motor, known.reversed_motor) <= HORIZONTAL
        return Wanted(target, guidance.engaged, guidance.sources.angles.asked if pitches else LEVEL)

    def _here(self, t_s: float, eta: Vector, memory: Memory) -> Here:
        return Here(t_s, eta, tick.referred(memory.controlled, memory.limits), self._estimator.frame)

    def _guard(self, demand: Demand, state: VehicleState, demanded: PilotDemand, verdict: Verdict) -> Guarded:
        """Bound what is demanded, and leave the pilot's axes to him."""
        autopilot = self._autopilot
        steers = self._supervision.steers(state)
        pilot = demanded.sticks if steers else None
        sticks, held = autopilot.sticks_beside(demand.wanted.engaged, pilot, state.pilot_gain)
        last = NEUTRAL if self.last is None else self.last.guarded.command
        command = guard(AxisCommand(*demand.axes), verdict, last, self._envelope, self._tick_s, sticks, held)
        return Guarded(command, autopilot.applied(command, state.pilot_gain), held, pilot, steers)

    def _send(self, heard: Heard, state: VehicleState, guarded: Guarded) -> list[bytes]:
        """Return the frames of this tick."""
        autopilot, supervision = self._autopilot, self._supervision
        self._estimator.sent(state.t_s, guarded.applied[:4])
        frames = autopilot.upkeep(
            state.t_s,
            heard.reports,
            mode=supervision.wanted_mode(state),
            arm=supervision.engagement.asks_arming,
            confirm=supervision.engagement.unconfirmed,
        )
        if guarded.steers:
            frames.append(autopilot.steer(guarded.command, state.pilot_gain, guarded.pilot))
        return frames

    def _without_motion(self, memory: Memory) -> Memory:
        """Begin again after a number that is not finite: this tick sent neutral, and the next one faults."""
        return memory._replace(actuated=memory.actuated._replace(pace=FULL))

    def _record(self, done: Tick, refused: str) -> ControlSample:
        """Return the record of a tick."""
        heard, state, frame, actuated = done.heard, done.state, self._estimator.frame, self.memory.actuated
        references = self._guidance.references
        said = [report for report in heard.reports if isinstance(report, StatusText)]
        return ControlSample(
            state=frame.reported_state(state),
            eta_d=frame.now.outside(references.step(done.dofs.x_d, state.t_s, state.ahead_s)),
            angles_d=attitude.angles(actuated.held),
            dofs=frame.reported_dofs(done.dofs),
            command=done.guarded.command,
            requested=done.demand.requested,
            delivered=actuated.delivered,
            verdict=self.verdict,
            counters=msgspec.structs.replace(self._autopilot.counters),
            loop=heard.loop,
            guided=self._guidance.sources.guided,
            texts=(*self._fitness.introduced(heard.now_s), *said),
            refused=refused,
            disarms_in_s=self._supervision.disarms_in_s(state),
            reads=self.reads,
        )


def _was_mended(heard: Heard, state: VehicleState) -> bool:
    """Tell whether somebody set, or read, the direction of the motor that was found reversed, on deck."""
    name = f"MOT_{state.reversed_motor}_DIRECTION"
    said = (report.name for report in heard.reports if isinstance(report, Parameter))
    return state.reversed_motor > 0 and not state.armed and name in said


def by_quantity(samples: Samples) -> Dofs:
    """Return the law's inside with the four degrees of freedom of each quantity."""
    columns: Any = zip(*samples, strict=True)
    return DofSample._make(columns)
