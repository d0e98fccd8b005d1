"""One tick on one screen: estimate, permit, law, allocate, guard, send. No clock, no socket, no thread."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion import assembly
from companion.config import Config
from companion.control.bounds import wrap
from companion.control.positioning import jacobian, to_body, to_inertial
from companion.estimation import Estimator
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.signing import Signing
from companion.steering_mode import STEERING_MODES, ModeKeeper
from companion.supervisor import UNFIT, Envelope, Supervisor, assess, guard
from companion.thrust import Thrusters
from companion.types import (
    NEUTRAL,
    PSI,
    Array,
    AxisCommand,
    Condition,
    ControlSample,
    Event,
    Flags,
    LoopHealth,
    PilotInput,
    Request,
    Setpoint,
    State,
    StatusText,
    VehicleState,
    Verdict,
    Wrench,
    Z,
)

NEUTRAL_BURST_S = 0.5
"""Neutral frames go out this long on first contact and after steering; then silence, so that the autopilot's
own failsafe sees a lost pilot."""

MAX_DT_TICKS = 3.0


class Engine:
    """The controller without its process: `step` once a tick, `farewell` on every way out."""

    def __init__(
        self, config: Config, setpoint: Setpoint, *, arm: bool = False, signing: Signing | None = None
    ) -> None:
        self._config = config
        self._tick_s = 1.0 / config.loop.rate_hz
        self._arm = arm
        model = assembly.model(config)
        self._autopilot = Autopilot(config, signing)
        self._thrusters = Thrusters(config.vehicle.frame, assembly.each(config, "max_force"))
        self._estimator = Estimator(config, model, self._thrusters)
        self._supervisor = Supervisor(config.supervisor.ramp_down_s)
        self._envelope = Envelope(config.thrusters.max_axis, config.thrusters.max_slew_per_s)
        self._controller = assembly.controller(config, model)
        self._modes = ModeKeeper(STEERING_MODES[config.vehicle.steering_mode])
        self._setpoint = self._target = _checked(setpoint, config.supervisor.max_depth_m)
        self._engage_asked = False
        self._engaged = np.zeros(4, bool)
        self._saturated = np.zeros(4, bool)
        self._finite = True
        self._command = NEUTRAL
        self._last_s: float | None = None
        self._neutral_until_s: float | None = None
        self._had_authority = False
        self._pilot_t_s = -math.inf
        self._pilot_deflection = 0.0
        self._references: deque[tuple[float, Array]] = deque()
        self.verdict = Verdict(State.IDLE, Condition(0), 0.0, "just started")

    def step(
        self,
        now_s: float,
        datagrams: Sequence[tuple[int, bytes]],
        loop: LoopHealth,
        requests: Sequence[Request] = (),
    ) -> tuple[list[bytes], ControlSample]:
        """Advance one tick: take what arrived (monotonic ns, bytes), return what to send and the record."""
        dt_s = self._tick_s if self._last_s is None else now_s - self._last_s
        self._last_s = now_s

        events = self._autopilot.receive(datagrams)
        state = self._estimator.step(now_s, events)
        verdict = self._permit(state, requests, self._pilot(now_s, events), dt_s)

        J = jacobian(state.eta_ahead[PSI])
        control_dt_s = min(max(dt_s, 0.0), MAX_DT_TICKS * self._tick_s)
        dofs = self._controller.step(state, J, self._target, self._engaged, ~self._saturated, control_dt_s)
        requested = to_body(J, dofs.tau)
        self._finite = math.isfinite(requested.sum())
        if not self._finite:
            self._estimator.restart()
        reach = _axes(self._autopilot.reach(state.pilot_gain)) * self._envelope.max_axis
        wanted = self._thrusters.allocate(requested, state.voltage_v, reach)
        command = guard(
            AxisCommand(*wanted.axes.tolist()), verdict, self._command, self._envelope, self._tick_s
        )

        applied = _axes(self._autopilot.applied(command, state.pilot_gain))
        delivered = self._thrusters.delivered(applied, state.voltage_v)
        self._estimator.sent(now_s, applied, to_inertial(J, delivered))
        self._saturated = _by_dof(wanted.saturated | (np.abs(applied - wanted.axes) > 0.01))
        self._command = command

        mode = self._modes.wanted(now_s, state.mode, verdict.state, engage=self._engage_asked)
        out = self._autopilot.upkeep(now_s, events, mode=mode, arm=self._asks_arming(verdict))
        if self._steers(now_s, verdict):
            out.append(self._autopilot.steer(command, state.pilot_gain))
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
            texts=tuple(event for event in events if isinstance(event, StatusText)),
        )

    def farewell(self) -> bytes:
        """Return what every way out sends, whatever state the rest is in: neutral, and the mode of before."""
        mode = self._modes.parting()
        return self._autopilot.neutral() + (self._autopilot.set_mode(mode) if mode is not None else b"")

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

        Raises ConfigError for a section that cannot change while running (`assembly.LIVE` can).
        """
        changed = assembly.changed(self._config, config)
        _checked(self._setpoint, config.supervisor.max_depth_m)
        if changed - {"supervisor"}:
            model = assembly.model(config)
            self._thrusters = Thrusters(config.vehicle.frame, assembly.each(config, "max_force"))
            self._estimator.retune(config, model)
            controller = assembly.controller(config, model)
            controller.take_over(self._controller)
            self._controller = controller
        self._config = config

    def _permit(self, state: VehicleState, requests: Sequence[Request], pilot: float, dt_s: float) -> Verdict:
        """Ask the supervisor; on engaging and while resting, set the controller to where the vehicle is."""
        if Request.ENGAGE in requests:
            self._engage_asked = True
        if Request.STOP in requests:
            self._engage_asked = False
        before = self.verdict.state
        conditions = assess(
            state,
            self._config.supervisor,
            steering_mode=self._modes.steering,
            parameters=self._autopilot.parameters,
            holds_position=bool(self._engaged[0]),
            finite=self._finite,
            late_s=dt_s - self._tick_s,
            pilot_deflection=pilot,
            stop=Request.STOP in requests,
            engage=self._engage_asked,
            clear=Request.CLEAR_FAULT in requests,
        )
        self.verdict = self._supervisor.step(conditions, dt_s)
        now = self.verdict.state
        if now not in (State.ACTIVE, State.RAMP_DOWN):
            self._references.clear()
            self._engaged = np.zeros(4, bool)
            self._controller.rest(state)
            self._target = Setpoint(state.eta_ahead)
        elif before not in (State.ACTIVE, State.RAMP_DOWN):
            positioned = state.ages.position_s <= self._config.supervisor.position_timeout_s
            self._engaged = np.array([positioned, positioned, True, self._config.vehicle.holds_heading])
            self._controller.rest(state)
            self._target = _filled(self._setpoint, state.eta)
        if now is State.FAULT or (before is State.ACTIVE and now is not State.ACTIVE):
            self._engage_asked = False
        return self.verdict

    def _steers(self, now_s: float, verdict: Verdict) -> bool:
        """Tell whether a steering frame goes out: with authority; neutral at first and for a while after."""
        if self._neutral_until_s is None and not self._autopilot.heard:
            return False
        if self._neutral_until_s is None or verdict.authority > 0.0 or self._had_authority:
            self._neutral_until_s = now_s + NEUTRAL_BURST_S
        self._had_authority = verdict.authority > 0.0
        return now_s <= self._neutral_until_s

    def _asks_arming(self, verdict: Verdict) -> bool:
        """Tell whether to ask for arming: once nothing else is missing for engaging."""
        return self._arm and self._engage_asked and not verdict.conditions & UNFIT & ~Condition.DISARMED

    def _pilot(self, now_s: float, events: Sequence[Event]) -> float:
        """Return how far the pilot deflected a stick, this tick or up to `pilot_hold_s` ago."""
        limits = self._config.supervisor
        for event in events:
            if isinstance(event, PilotInput) and event.deflection > limits.pilot_deflection:
                self._pilot_t_s, self._pilot_deflection = event.t_s, event.deflection
        return self._pilot_deflection if now_s - self._pilot_t_s <= limits.pilot_hold_s else 0.0

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


def _axes(command: AxisCommand) -> Array:
    return np.array((command.surge, command.sway, command.heave, command.yaw))


def _by_dof(by_axis: Flags) -> Flags:
    """Surge and sway turn into x and y: what either lacks, both lack."""
    horizontal = by_axis[0] | by_axis[1]
    return np.array((horizontal, horizontal, by_axis[2], by_axis[3]))


def _filled(setpoint: Setpoint, eta: Array) -> Setpoint:
    """Return the setpoint with NaN targets replaced by `eta`."""
    return replace(setpoint, eta_d=np.where(np.isnan(setpoint.eta_d), eta, setpoint.eta_d))
