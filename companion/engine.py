"""One tick on one screen: estimate, permit, guide, law, thrust, guard, send. No clock, socket or thread."""

import math
from collections.abc import Sequence
from operator import add

from msgspec.structs import replace

from companion import assembly
from companion.config import Config
from companion.control.positioning import Jacobian, jacobian, to_body, to_inertial
from companion.estimation.parameters import tables_in_steps
from companion.guidance.guidance import Guidance
from companion.guidance.orders import Order
from companion.guidance.paths.shapes import Path
from companion.guidance.pilot import PilotDemand
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.relay import pilot_events
from companion.mavlink.signing import Signing
from companion.predive.check import CheckRow
from companion.predive.fitness import Fitness
from companion.records import (
    NEUTRAL,
    PSI,
    SAMPLES,
    ZERO,
    AxisCommand,
    ControlSample,
    DofSample,
    Event,
    Flags,
    LoopHealth,
    Request,
    Sender,
    Setpoint,
    StatusText,
    Vector,
    VehicleState,
    Verdict,
    Wrench,
    vector,
)
from companion.steps import Steps
from companion.supervision.guard import guard
from companion.supervision.supervision import Supervision

MAX_DT_TICKS = 3.0


class Engine:
    """The controller without its process: `step` once a tick, `shutdown_frames` on every way out."""

    def __init__(
        self, config: Config, setpoint: Setpoint, *, arm: bool = False, signing: Signing | None = None
    ) -> None:
        assembly.refuse_fast_gains(config)
        self._config = config
        self._tick_s = 1.0 / config.loop.rate_hz
        self._autopilot = Autopilot(config, signing)
        self._estimator = assembly.estimator(config)
        self._fitness = Fitness(self._autopilot)
        self._supervision = Supervision(config, self._autopilot.parameters, arm=arm)
        self._guidance = Guidance(config, setpoint)
        self._controller = assembly.controller(config, assembly.model(config))
        self._actuation = assembly.actuation(config)
        self._envelope = assembly.envelope(config)
        self._sent = NEUTRAL
        self._dofs: DofSample | None = None
        self._finite = True
        self._last_s: float | None = None
        self._delay_s: float | None = None
        self.events: list[Event] = []
        """What the last tick took in."""
        self.applied = NEUTRAL
        """What the vehicle makes of the last command, after rounding."""
        self.excitation = ZERO
        """A body force that is added to the law's, N and N·m, to identify the vehicle."""
        self.steering = False
        """Whether the last tick sent a steering frame: nobody else's should reach the vehicle meanwhile."""

    def step(
        self,
        now_s: float,
        datagrams: Sequence[tuple[int, bytes]],
        loop: LoopHealth,
        requests: Sequence[Request] = (),
        ground: Sequence[tuple[int, bytes]] = (),
    ) -> tuple[list[bytes], ControlSample]:
        """Advance one tick: take what arrived (monotonic ns, bytes), return what to send and the record.

        `ground` are the pilot's frames as `Relay.take` gives them.
        """
        dt_s = self._tick_s if self._last_s is None else now_s - self._last_s
        control_dt_s = min(max(dt_s, 0.0), MAX_DT_TICKS * self._tick_s)
        self._last_s = now_s
        guidance, controller, actuation = self._guidance, self._controller, self._actuation
        reference = controller.reference

        events = self.events = [*self._autopilot.receive(datagrams), *pilot_events(ground)]
        reports = [event for event in events if type(event) not in SAMPLES]
        requests = self._supervision.accepted(requests)
        state = self._estimate(now_s, events, requests)
        demand = guidance.pilot_demand(state, dt_s, reports)
        verdict = self._permit(state, reports, requests, demand, loop, dt_s)
        target = guidance.step(demand, reports, verdict, state, reference, control_dt_s)

        J, engaged = jacobian(state.eta_ahead[PSI]), guidance.engaged
        dofs = controller.step(state, J, target, engaged, actuation.saturated, verdict, control_dt_s)
        requested = self._requested(J, dofs)
        reach = self._autopilot.reach(state.pilot_gain, self._envelope.max_axis)
        wanted = actuation.step(requested, verdict, state, engaged, reach, reference, control_dt_s)
        out = self._send(wanted, verdict, state, demand, reports, J)
        self._dofs = dofs

        return out, ControlSample(
            state=state,
            eta_d=guidance.reference_now(dofs.x_d, state),
            dofs=dofs,
            command=self._sent,
            requested=Wrench(requested),
            delivered=Wrench(actuation.delivered),
            verdict=verdict,
            counters=replace(self._autopilot.counters),
            loop=loop,
            guided=guidance.guided,
            texts=(
                *self._fitness.introduced(now_s),
                *[report for report in reports if isinstance(report, StatusText)],
            ),
            refused=self._supervision.refused,
        )

    def shutdown_frames(self) -> bytes:
        """Return what every way out sends, whatever state the rest is in; nothing where nothing is ours.

        Neutral while the vehicle follows our frames, and the mode of before where we changed it. Frames of
        one who does not steer would count as a pilot, and the silence after them as his loss: FS_PILOT_INPUT
        would then disarm somebody else's vehicle.
        """
        mode = self._supervision.restore_mode()
        neutral = self._autopilot.neutral() if self.steering else b""
        return neutral + (self._autopilot.set_mode(mode) if mode is not None else b"")

    def sender(self, datagram: bytes) -> Sender:
        """Tell whether a datagram is our vehicle's, for a link that listens (`Autopilot.sender`)."""
        return self._autopilot.sender(datagram)

    def hello(self) -> bytes:
        """Return a heartbeat for whoever is not yet our peer (`Autopilot.hello`)."""
        return self._autopilot.hello()

    @property
    def config(self) -> Config:
        """What is in force now."""
        return self._config

    @property
    def verdict(self) -> Verdict:
        """The last tick's."""
        return self._supervision.verdict

    def refusal(self, request: Request) -> str:
        """Return why a request would be refused now, and what to do; empty where it is accepted."""
        return self._supervision.refusal(request)

    @property
    def target(self) -> Vector:
        """Where it is held, or is while it is not: x, y, z, psi."""
        return self._guidance.target.eta_d

    def aim(self, setpoint: Setpoint) -> None:
        """Take a new setpoint (`Guidance.aim`)."""
        self._guidance.aim(setpoint)

    @property
    def asked(self) -> Vector:
        """What was asked for, NaN where nothing was."""
        return self._guidance.asked

    @property
    def path(self) -> tuple[Path, Vector] | None:
        """The path that is followed, and what its places are moved by."""
        return self._guidance.path

    def guide(self, order: Order) -> None:
        """Take a path, a move, or what to do with them. Raises ValueError for what is not possible."""
        self._guidance.guide(order, self._last_s or 0.0, self._controller.reference)

    def checked(self, state: VehicleState) -> list[CheckRow]:
        """Return the pre-dive list as far as it is known without trying anything."""
        return self._fitness.checked(state, self._config)

    def preparing(self, config: Config) -> Steps[None]:
        """Do beforehand, in steps, what takes long of a `retune`: the Kalman gains of axes that change."""
        for dof, (axis, wanted) in enumerate(zip(self._config.axes, config.axes, strict=True)):
            if axis != wanted:
                yield from tables_in_steps(config, assembly.model(config), dof)

    def retune(self, config: Config) -> None:
        """Go on with `config` from the next tick, without a step in thrust; call it between ticks.

        Raises ConfigError, and goes on with what was in force, for a section that cannot change while running
        (`assembly.LIVE` can), for values from which no finite gain follows and for gains that are too fast
        for the measured delay.
        """
        changed = assembly.changed(self._config, config)
        self._guidance.refuse(config)
        assembly.refuse_fast_gains(config, self._delay_s, self._config)
        if changed - {"supervisor"}:
            model = assembly.model(config)
            controller = assembly.controller(config, model)
            self._estimator.retune(config, model)
            self._actuation.retune(assembly.thrusters(config), assembly.max_horizontal_force(config))
            controller.transfer_from(self._controller)
            self._controller = controller
        self._supervision.retune(config, changed=bool(changed))
        self._estimator.limit(config.supervisor)
        self._guidance.retune(config)
        self._config = config

    def _estimate(self, now_s: float, events: Sequence[Event], requests: Sequence[Request]) -> VehicleState:
        """Return what is believed of the vehicle; hold on to the same place where its frame was reset."""
        if Request.RESET_MODEL in requests:
            self._estimator.learner.reset()
        state = self._estimator.step(now_s, events, self._controller.d_share, self._learns())
        self._delay_s = state.delays.total_s
        if state.frame_shift is not None:
            self._controller.shift(state.frame_shift, state.eta_ahead)
            self._guidance.shift(state.frame_shift, state)
        self._follow_thrusters(state, trusted=Request.CLEAR_FAULT in requests)
        return state

    def _learns(self) -> Flags:
        """Tell by axis whether what moves the vehicle was our command alone."""
        steers = self.verdict.authority == 1.0 and not self.verdict.freeze
        surge, sway, heave, yaw = self._guidance.engaged
        return (steers and surge, steers and sway, steers and heave, steers and yaw)

    def _follow_thrusters(self, state: VehicleState, *, trusted: bool) -> None:
        """Allocate around a motor that gives no thrust; with `trusted` the next tick trusts all again."""
        if state.dead_motor != self._actuation.dead_motor:
            lost = self._actuation.go_on_without(state.dead_motor, state)
            lost_ned = to_inertial(jacobian(state.eta_ahead[PSI]), lost)
            self._estimator.lose(lost_ned)
            self._controller.lose(lost_ned)
        if trusted:
            self._estimator.trust_thrusters()

    def _permit(
        self,
        state: VehicleState,
        reports: Sequence[Event],
        requests: Sequence[Request],
        demand: PilotDemand,
        loop: LoopHealth,
        dt_s: float,
    ) -> Verdict:
        """Return who may steer; start law and reference where the vehicle is, unless they hold it already."""
        guidance, holding = self._guidance, self.verdict.authority > 0.0
        requests = self._supervision.with_buttons(
            requests, state.t_s, engage=demand.engage, release=demand.release
        )
        verdict = self._supervision.step(
            state,
            reports,
            requests,
            loop,
            dt_s=dt_s,
            held=guidance.engaged if holding else guidance.holdable(state),
            awaits_position=guidance.awaits_position,
            wants_ground=guidance.wants_ground,
            dofs=self._dofs,
            finite=self._finite,
            full_override=demand.full_override,
            misses_motor=self._actuation.misses_motor,
            preflight_failure=self._fitness.step(self.events, state, self._config, holding=holding),
        )
        engage = Request.ENGAGE in requests
        regained = guidance.update(self._supervision.before, verdict, state, engage=engage)
        if regained is None:
            self._controller.rest(state)
        else:
            self._controller.reference.catch_up(state.eta_ahead, state.eta_dot_ahead, regained)
        return verdict

    def _requested(self, J: Jacobian, dofs: DofSample) -> Vector:
        """Return the law's body wrench; forget the motion if it is not finite: the next tick faults."""
        requested = to_body(J, dofs.tau)
        self._finite = math.isfinite(sum(requested))
        if not self._finite:
            self._estimator.restart()
            self._actuation.restart()
        return requested if self.excitation is ZERO else vector(map(add, requested, self.excitation))

    def _send(
        self,
        wanted: AxisCommand,
        verdict: Verdict,
        state: VehicleState,
        demand: PilotDemand,
        reports: Sequence[Event],
        J: Jacobian,
    ) -> list[bytes]:
        """Guard what is wanted, note what the vehicle makes of it, and return the frames of this tick."""
        autopilot, estimator = self._autopilot, self._estimator
        self.steering = self._supervision.steers(state)
        pilot = demand.sticks if self.steering else None
        sticks, held = autopilot.sticks_beside(self._guidance.engaged, pilot, state.pilot_gain)
        self._sent = guard(wanted, verdict, self._sent, self._envelope, self._tick_s, sticks, held)
        applied = self.applied = autopilot.applied(self._sent, state.pilot_gain)
        estimator.sent(state.t_s, applied[:4], to_inertial(J, self._actuation.sent(applied, state, held)))
        estimator.watch_thrusters(state.t_s, applied, steady=verdict.authority == 1.0)

        mode, arm = self._supervision.wanted_mode(state), self._supervision.asks_arming
        confirm = self._supervision.unconfirmed
        out = autopilot.upkeep(state.t_s, reports, mode=mode, arm=arm, confirm=confirm)
        if self.steering:
            out.append(autopilot.steer(self._sent, state.pilot_gain, pilot))
        return out
