"""One tick on one screen: estimate, permit, law, allocate, guard, send. No clock, no socket, no thread."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion import assembly
from companion.config import Config
from companion.control.bounds import bounded, wrap
from companion.control.frames import shifted, shifted_along
from companion.control.pace import Pace
from companion.control.positioning import jacobian, to_body, to_inertial
from companion.control.tilt import (
    FOLLOWS_M,
    YAW_LEVEL_RAD,
    YAW_STEEP_RAD,
    body_force,
    coming_tilt,
    level_force,
    share,
)
from companion.estimation.estimator import Estimator
from companion.guidance.pilot import NO_DEMAND, Pilot, PilotDemand
from companion.mavlink.ardusub import Mode
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.relay import pilot_events
from companion.mavlink.signing import Signing
from companion.predive.check import Row, refusals, rows
from companion.predive.survey import Survey
from companion.records import (
    ENGAGE_S,
    NEUTRAL,
    PSI,
    Array,
    AxisCommand,
    Condition,
    ControlSample,
    DofSample,
    Event,
    Flags,
    FrameShift,
    LoopHealth,
    Request,
    Sender,
    Setpoint,
    State,
    StatusText,
    VehicleState,
    Verdict,
    Wrench,
    Z,
)
from companion.supervision.conditions import Observation, assess
from companion.supervision.handover import AT_SURFACE_M, KEEP_ALIVE_S, HandOver
from companion.supervision.monitor import FAILSAFE, Watch
from companion.supervision.steering_mode import STEERING_MODES, ModeKeeper
from companion.supervision.supervisor import BLOCKING, FAULT_CAUSES, Envelope, Supervisor, guard

NEUTRAL_BURST_S = 0.5
"""Neutral frames go out this long after steering, ours or that of a companion that died; then silence, so
that the autopilot's own failsafe sees a lost pilot."""

MAX_DT_TICKS = 3.0
CHECK_S = 0.25
MAV_SEVERITY_INFO = 6
LETS_GO = (State.RAMP_DOWN, State.HAND_OVER)


class Engine:
    """The controller without its process: `step` once a tick, `shutdown_frames` on every way out."""

    def __init__(
        self, config: Config, setpoint: Setpoint, *, arm: bool = False, signing: Signing | None = None
    ) -> None:
        self._config = config
        self._tick_s = 1.0 / config.loop.rate_hz
        self._arm = arm
        assembly.refuse_fast_gains(config)
        model = assembly.model(config)
        self._delay_s: float | None = None
        self._autopilot = Autopilot(config, signing)
        self._thrusters = assembly.thrusters(config)
        self._estimator = Estimator(config, model, self._thrusters)
        self._supervisor = Supervisor(config.supervisor.ramp_down_s, config.supervisor.ramp_up_s)
        self._watch = Watch()
        self._survey = Survey()
        self._preflight_failure = ""
        self._checked_s = -math.inf
        self._about = ""
        self._hand_over = HandOver()
        self._levelling = assembly.levelling(config)
        limits = config.thrusters
        max_tilt_axis = config.levelling.max_axis if self._levelling else 0.0
        self._envelope = Envelope(limits.max_axis, limits.max_slew_per_s, max_tilt_axis)
        self._controller = assembly.controller(config, model)
        self._modes = ModeKeeper(STEERING_MODES[config.vehicle.steering_mode])
        self._setpoint = self._target = _checked(setpoint, config.supervisor.max_depth_m)
        self._engaged_at = self._target
        """Where it stays until it may push with all authority."""
        self._engage_asked = False
        self._engage_until_s = math.inf
        """When the wish to engage ends if it was not granted."""
        self._engaged = np.zeros(4, bool)
        self._saturated = np.zeros(4, bool)
        self._finite = True
        self._command = NEUTRAL
        self._last_s: float | None = None
        self._met = False
        self._neutral_until_s = -math.inf
        self._had_authority = False
        self._last_wrench = np.zeros(4)
        """What the law last asked while ACTIVE: this is let go, evenly, whatever it would say by then."""
        self._delivered = np.zeros(4)
        """What the last command, with the pilot's share, should have given."""
        self._kept_alive_s = -math.inf
        self._dofs: DofSample | None = None
        self._pilot = Pilot(config)
        self._handed_back = np.zeros(4, bool)
        self._pace = Pace()
        self._tilt_limit = assembly.tilt_limit(config)
        self.steering = False
        """Whether the last tick sent a steering frame: nobody else's should reach the vehicle meanwhile."""
        self._references: deque[tuple[float, Array]] = deque()
        self.verdict = Verdict(State.IDLE, Condition(0), 0.0, "just started")

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
        self._last_s = now_s

        events = [*self._autopilot.receive(datagrams), *pilot_events(ground)]
        state = self._estimator.step(now_s, events, self._controller.gain_scale)
        self._delay_s = state.delays.total_s
        if state.frame_shift is not None:
            self._shift(state.frame_shift, state)
        held = tuple(self._engaged.tolist())
        demand = self._pilot.step(now_s, dt_s, events, held, self.target.item(Z))
        requests = [*requests, *self._pressed(demand, requests, now_s)]
        verdict = self._permit(state, events, requests, loop, dt_s, taken_back=demand.full_override)

        J = jacobian(state.eta_ahead[PSI])
        self._apply_pilot_demand(demand, state.eta_ahead[PSI], dt_s)
        control_dt_s = min(max(dt_s, 0.0), MAX_DT_TICKS * self._tick_s)
        self._controller.frozen, self._controller.authority = verdict.freeze, verdict.authority
        rising = verdict.state is State.ACTIVE and verdict.authority < 1.0
        target = self._engaged_at if rising else self._target
        dofs = self._controller.step(state, J, target, self._engaged, ~self._saturated, control_dt_s)
        self._dofs = dofs
        requested = to_body(J, dofs.tau)
        self._finite = math.isfinite(requested.sum())
        if not self._finite:
            self._estimator.restart()
            self._pace = Pace()
        if verdict.state is State.ACTIVE:
            self._last_wrench = requested
        pushed = self._last_wrench if verdict.state in LETS_GO else requested
        tilt = coming_tilt(state.roll, state.pitch, state.p, state.q)
        borne = self._borne(tilt, state, control_dt_s)
        pushed = borne * pushed
        pushed[:3] = body_force(state.roll, state.pitch, tilt, tuple(pushed[:3].tolist()))
        reach = self._ours(self._autopilot.reach(state.pilot_gain)) * self._envelope.max_axis
        asked = verdict.authority * self._levelled(pushed, state, control_dt_s)
        wanted = self._thrusters.allocate(asked, state.voltage_v, reach)
        wanted.axes[PSI] *= self._engaged[PSI]  # unequal curves ask for a little, of a heading not ours
        command = guard(
            AxisCommand(*wanted.axes.tolist()), verdict, self._command, self._envelope, self._tick_s
        )

        self.steering = self._steers(state, verdict)
        pilot = demand.sticks if self.steering else None
        sent = self._autopilot.blended(command, self._engaged, pilot, state.pilot_gain)
        applied = self._ours(self._autopilot.applied(sent, state.pilot_gain))
        self._delivered = delivered = self._thrusters.delivered(applied, state.voltage_v)[:4]
        level = level_force(state.roll, state.pitch, tuple(delivered[:3].tolist()))
        self._estimator.sent(now_s, applied[:4], to_inertial(J, np.array((*level, delivered[3]))))
        short = (np.abs(applied - wanted.axes) > 0.01) | self._thrusters.overloaded(applied)
        self._saturated = _by_dof((wanted.saturated | short)[:4] | (borne < 1.0))
        self._command = command

        mode = self._modes.wanted(now_s, state.mode, verdict.state, engage=self._engage_asked)
        if verdict.state is State.HAND_OVER:
            mode = self._hand_over.wanted
        out = self._autopilot.upkeep(now_s, events, mode=mode, arm=self._asks_arming(verdict))
        if self.steering:
            out.append(self._autopilot.steer(sent, state.pilot_gain, pilot))
        return out, ControlSample(
            state=state,
            eta_d=self._reference_now(dofs.x_d, state),
            dofs=dofs,
            command=command,
            requested=Wrench(requested),
            delivered=Wrench(delivered),
            verdict=verdict,
            counters=replace(self._autopilot.counters),
            loop=loop,
            texts=(*self._introduced(now_s), *(event for event in events if isinstance(event, StatusText))),
        )

    def shutdown_frames(self) -> bytes:
        """Return what every way out sends, whatever state the rest is in; nothing where nothing is ours.

        Neutral while the vehicle follows our frames, and the mode of before where we changed it. Frames of
        one who does not steer would count as a pilot, and the silence after them as his loss: FS_PILOT_INPUT
        would then disarm somebody else's vehicle.
        """
        mode = self._modes.restore_mode()
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
    def target(self) -> Array:
        """Where it is held, or is while it is not: x, y, z, psi."""
        return self._target.eta_d

    def aim(self, setpoint: Setpoint) -> None:
        """Take a new setpoint; its NaN targets stay what they are.

        Raises ValueError for one that is infinite, or deeper than `supervisor.max_depth_m`.
        """
        self._setpoint = _checked(setpoint, self._config.supervisor.max_depth_m)
        self._target = _filled(setpoint, self._target.eta_d)

    def retune(self, config: Config) -> None:
        """Go on with `config` from the next tick, without a step in thrust; call it between ticks.

        Raises ConfigError, and goes on with what was in force, for a section that cannot change while running
        (`assembly.LIVE` can), for values from which no finite gain follows and for gains that are too fast
        for the measured delay.
        """
        changed = assembly.changed(self._config, config)
        _checked(self._setpoint, config.supervisor.max_depth_m)
        assembly.refuse_fast_gains(config, self._delay_s, self._config)
        if changed - {"supervisor"}:
            model = assembly.model(config)
            controller = assembly.controller(config, model)
            self._estimator.retune(config, model)
            self._thrusters = assembly.thrusters(config)
            controller.transfer_from(self._controller)
            self._controller = controller
        limits = config.supervisor
        self._supervisor.ramp_up_s, self._supervisor.ramp_down_s = limits.ramp_up_s, limits.ramp_down_s
        self._estimator.limit(limits)
        self._pilot.retune(config)
        self._config = config
        if changed:
            self._watch.config_changed()

    def _pressed(self, demand: PilotDemand, requests: Sequence[Request], now_s: float) -> list[Request]:
        """Return what the pilot's buttons ask for, beside `requests`.

        To engage clears a fault first, but not while its cause holds.
        """
        if Request.ENGAGE in requests:
            self._engage_until_s = math.inf
        if demand.release:
            return [Request.STOP]
        faulty = self.verdict.state is State.FAULT
        if not demand.engage or (faulty and self.verdict.conditions & FAULT_CAUSES):
            return []
        self._engage_until_s = now_s + ENGAGE_S
        return [Request.CLEAR_FAULT, Request.ENGAGE] if faulty else [Request.ENGAGE]

    def _permit(
        self,
        state: VehicleState,
        events: Sequence[Event],
        requests: Sequence[Request],
        loop: LoopHealth,
        dt_s: float,
        *,
        taken_back: bool,
    ) -> Verdict:
        """Ask the supervisor; on engaging and while resting, set the controller to where the vehicle is."""
        if Request.ENGAGE in requests:
            self._engage_asked = True
        if Request.STOP in requests or state.t_s > self._engage_until_s:
            self._engage_asked = False
        before, limits = self.verdict, self._config.supervisor
        handing_over, steered = before.state is State.HAND_OVER, before.authority > 0.0
        conditions = Condition(0)
        ground = self._config.ground_station
        if handing_over:
            surface_m = -0.01 * self._autopilot.parameters.get("SURFACE_DEPTH", -10.0)
            conditions |= self._hand_over.step(
                state.t_s,
                state.mode,
                thrusting=steered,
                pilot_heard_s=self._watch.pilot_heard_s,
                keep_s=limits.keep_alt_hold_s,
                at_surface=bool(state.eta[Z] <= surface_m + AT_SURFACE_M),
            )
        self._survey.take(events)
        if state.t_s - self._checked_s >= CHECK_S:
            self._checked_s = state.t_s
            self._preflight_failure = refusals(self.checked(state), holding=steered)
        watched = self._watch.step(
            dt_s,
            events,
            state,
            limits,
            loop,
            dofs=self._dofs,
            held=self._engaged if steered else self._holdable(state),
            steering=steered,
            parameters=self._autopilot.parameters,
        )
        right = self._hand_over.allows(state.mode) if handing_over else state.mode == self._modes.steering
        seen = Observation(
            state=state,
            mode_right=right,
            parameters=self._autopilot.parameters,
            watched=watched,
            preflight_failure=self._preflight_failure,
            holds_position=bool(self._engaged[0]),
            finite=self._finite,
            late_s=dt_s - self._tick_s,
            taken_back=taken_back,
            pilot_timeout_s=ground.timeout_s if ground.endpoint and ground.on_loss != "hold" else math.inf,
            surface_on_loss=ground.on_loss == "surface",
            stop=Request.STOP in requests,
            engage=self._engage_asked,
            clear=Request.CLEAR_FAULT in requests,
        )
        self.verdict = self._supervisor.step(conditions | assess(seen, limits), dt_s, self._preflight_failure)
        now = self.verdict.state
        surfaces = Condition.FAILSAFE_SURFACES in self.verdict.conditions
        if now is State.HAND_OVER and (not handing_over or surfaces):
            up = surfaces or Condition.PILOT_LOST_SURFACE in self.verdict.conditions
            tilted = Condition.TILT_PERSISTS in self.verdict.conditions
            goal = Mode.SURFACE if up else Mode.ALT_HOLD
            self._hand_over.begin(state.t_s, state.mode, goal, for_good=tilted)
        if self.verdict.authority == 0.0:
            self._references.clear()
            self._engaged = np.zeros(4, bool)
            self._controller.rest(state)
            self._target = Setpoint(np.array(state.eta_ahead))
        elif not steered:
            self._engaged = self._holdable(state)
            self._controller.rest(state)
            eta = np.array(state.eta)
            self._engaged_at = Setpoint(eta)
            self._target = _filled(self._setpoint, eta)
            self._handed_back = np.zeros(4, bool)
        elif Request.ENGAGE in requests and now is State.ACTIVE:
            back, self._handed_back = self._handed_back, np.zeros(4, bool)
            self._controller.reference.catch_up(
                np.array(state.eta_ahead), np.array(state.eta_dot_ahead), back
            )
            self._target = replace(self._target, eta_d=np.where(back, state.eta, self._target.eta_d))
            self._engaged = self._engaged | back
        if now is State.FAULT or (before.state is State.ACTIVE and now is not State.ACTIVE):
            self._engage_asked = False
        return self.verdict

    def _shift(self, shift: FrameShift, state: VehicleState) -> None:
        """Hold the same physical place and direction in the frame of a reset estimate."""
        self._controller.shift(shift, np.array(state.eta_ahead))
        self._target = replace(self._target, eta_d=shifted(shift, self._target.eta_d))
        self._engaged_at = replace(self._engaged_at, eta_d=shifted(shift, self._engaged_at.eta_d))
        asked = self._engaged & np.isfinite(self._setpoint.eta_d)
        self._setpoint = replace(
            self._setpoint, eta_d=np.where(asked, self._target.eta_d, self._setpoint.eta_d)
        )
        self._references = deque(
            (t_s, shifted_along(shift, eta_d, np.array(state.eta))) for t_s, eta_d in self._references
        )

    def _holdable(self, state: VehicleState) -> Flags:
        """Return the degrees of freedom that would be held if it engaged now."""
        positioned = state.ages.position_s <= self._config.supervisor.position_timeout_s
        return np.array((positioned, positioned, True, self._config.vehicle.holds_heading))

    def checked(self, state: VehicleState) -> list[Row]:
        """Return the pre-dive list as far as it is known without trying anything."""
        autopilot = self._autopilot
        seen = self._survey.observed(
            state,
            parameters=autopilot.parameters,
            measured_hz=autopilot.measured_hz,
            asked_hz=autopilot.asked_hz,
            messages=autopilot.counters.messages,
            refused=autopilot.counters.refused,
        )
        return rows(seen, self._config)

    def _introduced(self, now_s: float) -> tuple[StatusText, ...]:
        """Say, once it is known and whenever it changes, which autopilot this is."""
        if now_s != self._checked_s:
            return ()
        about = self._autopilot.about
        if about == self._about:
            return ()
        self._about = about
        return (StatusText(now_s, MAV_SEVERITY_INFO, about),) if about else ()

    def _borne(self, tilt: float, state: VehicleState, dt_s: float) -> Array:
        """Return the share (4,) of the law's force that the tilt leaves; what is let go is not pulled at.

        Heave is always ours. While the horizontal force is limited the reference stays near the vehicle.
        """
        pushed, asked = (math.hypot(*tau[:2].tolist()) for tau in (self._delivered, self._last_wrench))
        if self.verdict.authority == 0.0:
            self._tilt_limit.reset()
        most_n = self._tilt_limit.step(tilt, pushed, dt_s)
        level = most_n / asked if asked > most_n else 1.0
        yaw = share(tilt, YAW_LEVEL_RAD, YAW_STEEP_RAD)
        reference = self._controller.reference
        reference.pace = self._pace.step(share(tilt), self._saturated, dt_s)
        if level < 1.0:
            astray = math.hypot(*(state.eta_ahead - reference.x_d)[:2].tolist()) > FOLLOWS_M
            gone = np.array((astray, astray, False, yaw == 0.0))
            if gone.any():
                reference.catch_up(np.array(state.eta_ahead), np.array(state.eta_dot_ahead), gone)
        return np.array((level, level, 1.0, yaw))

    def _levelled(self, requested: Array, state: VehicleState, dt_s: float) -> Array:
        """Return the wrench with the moments that keep it level, where those are ours.

        Beside what the law pushes on the axes that are held goes what the pilot pushes on the others.
        """
        if self._levelling is None:
            return requested
        limits = np.array((self._config.surge.max_force, self._config.sway.max_force))
        if self.verdict.authority == 0.0:
            self._levelling.reset()
        moments = self._levelling.step(
            np.array((state.roll, state.pitch)),
            np.array((state.p, state.q)),
            bounded(np.where(self._engaged[:2], requested[:2], self._delivered[:2]), limits),
            state.delays.total_s,
            dt_s,
            learn=self.verdict.authority == 1.0,
        )
        return np.append(requested, moments[: self._thrusters.axes - 4])

    def _ours(self, command: AxisCommand) -> Array:
        """Return the axes that are ours: the first four, and while levelling roll and pitch."""
        axes = (command.surge, command.sway, command.heave, command.yaw, command.roll, command.pitch)
        return np.array(axes[: self._thrusters.axes])

    def _apply_pilot_demand(self, demand: PilotDemand, psi: float, dt_s: float) -> None:
        """Release the DOFs that the pilot overrides, and move the setpoint as the sticks say."""
        if demand is NO_DEMAND:
            return
        overridden = np.array(demand.overridden)
        self._engaged = self._engaged & ~overridden
        self._handed_back = self._handed_back | overridden
        held, x_d = tuple(self._engaged.tolist()), tuple(self._controller.reference.x_d.tolist())
        self._target, moved = self._pilot.move(self._target, demand, psi, held, x_d, dt_s)
        let_go = np.array(moved) | overridden
        if let_go.any():
            eta_d = np.where(let_go, np.nan, self._setpoint.eta_d)
            self._setpoint = replace(self._setpoint, eta_d=eta_d)

    def _steers(self, state: VehicleState, verdict: Verdict) -> bool:
        """Tell whether a steering frame goes out: with authority, and neutral for a while after.

        While handing over neutral goes on, and slowly once ALT_HOLD has the vehicle.
        """
        now_s = state.t_s
        if verdict.state is State.HAND_OVER and verdict.authority == 0.0:
            kept_alive = self._hand_over.held and now_s - self._kept_alive_s < KEEP_ALIVE_S
            self._kept_alive_s = self._kept_alive_s if kept_alive else now_s
            self._neutral_until_s, self._had_authority = now_s, False
            return not kept_alive
        if verdict.authority > 0.0 or self._had_authority or self._finds_it_steered(state):
            self._neutral_until_s = now_s + NEUTRAL_BURST_S
        self._had_authority = verdict.authority > 0.0
        return now_s <= self._neutral_until_s

    def _finds_it_steered(self, state: VehicleState) -> bool:
        """Tell, at the first heartbeat, whether somebody's commands are in force: perhaps of one who died.

        Where nobody steers nothing may be sent: it would count as a pilot, and our silence then as his loss,
        for which the autopilot disarms whoever has armed meanwhile.
        """
        met, self._met = self._met, self._met or math.isfinite(state.ages.heartbeat_s)
        return self._met and not met and state.armed and state.system_status != FAILSAFE

    def _asks_arming(self, verdict: Verdict) -> bool:
        """Tell whether to ask for arming: once nothing else is missing for engaging."""
        return self._arm and self._engage_asked and not verdict.conditions & BLOCKING & ~Condition.DISARMED

    def _reference_now(self, ahead: Array, state: VehicleState) -> Array:
        """Return the reference for this moment, which was computed when it lay ahead."""
        references = self._references
        references.append((state.t_s + state.ahead_s, ahead))
        while len(references) > 2 and references[1][0] <= state.t_s:
            references.popleft()
        (t_0, early), (t_1, late) = references[0], references[min(1, len(references) - 1)]
        share = min(max((state.t_s - t_0) / (t_1 - t_0), 0.0), 1.0) if t_1 > t_0 else 0.0
        eta_d = early + (late - early) * share
        eta_d[PSI] = wrap(eta_d[PSI])
        return eta_d


def _checked(setpoint: Setpoint, max_depth_m: float) -> Setpoint:
    motion = np.concatenate((setpoint.eta_d_dot, setpoint.eta_d_ddot))
    if np.isinf(setpoint.eta_d).any() or not np.isfinite(motion).all() or setpoint.eta_d[Z] > max_depth_m:
        raise ValueError(
            f"setpoint {setpoint.eta_d.tolist()} (x, y, depth, heading): must be finite, "
            f"and no deeper than supervisor.max_depth_m = {max_depth_m:g}"
        )
    return setpoint


def _by_dof(by_axis: Flags) -> Flags:
    """Surge and sway turn into x and y: what either lacks, both lack."""
    horizontal = by_axis[0] | by_axis[1]
    return np.array((horizontal, horizontal, by_axis[2], by_axis[3]))


def _filled(setpoint: Setpoint, eta: Array) -> Setpoint:
    """Return the setpoint with NaN targets replaced by `eta`."""
    return replace(setpoint, eta_d=np.where(np.isnan(setpoint.eta_d), eta, setpoint.eta_d))
