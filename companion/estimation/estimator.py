"""Events to VehicleState: an age for every signal, one observer for all four degrees of freedom.

A sample counts for the time at which it was true: the autopilot's stamp (or arrival minus the measured
telemetry delay, where a message has none) minus the sensor's own delay.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from companion.config import Config
from companion.config import Supervisor as Limits
from companion.control.allocation import T200_VOLTAGE_V, Thrusters
from companion.control.bounds import wrap
from companion.control.frames import joined, shifted, turned
from companion.control.oscillation import ScaledDisturbance
from companion.control.positioning import Model, jacobian, to_body
from companion.estimation.delay import DelayMeter
from companion.estimation.hidden_delay import HiddenDelay
from companion.estimation.observer import Noise, Observer
from companion.estimation.resets import MAX_GAP_S, position_resets, yaw_resets
from companion.mavlink.ardusub import motor_demand
from companion.records import (
    DOFS,
    PSI,
    Ages,
    Array,
    Attitude,
    Battery,
    Delays,
    Depth,
    DepthRate,
    Event,
    FrameShift,
    Heartbeat,
    PilotGain,
    PilotHeartbeat,
    Position,
    Reboot,
    ServoOutput,
    TimeSync,
    Vector,
    VehicleState,
    X,
    Y,
    Z,
)

PREDICTION_STEP_S = 0.035
SHORTEST_S = 1e-9

RESET_INNOVATION = np.array([1.0, 1.0, 0.0, 1.0])
"""m, rad: so much of a reset counts as innovation. One is no surprise; one with every sample is."""

LATER_S = {"pressure": 0.053, "ahrs2": 0.048}
"""How much older than relative_alt and climb these depths are (ArduSub facts)."""

ZERO_MOVED_M = 0.05
"""A disarmed vehicle whose depth jumps by more has a new zero, as arming makes one: that is no motion."""

JUMP_BELIEVED_S = 2.0
"""A depth that jumped is left out, and so is stale soon; after this long it is where the vehicle is."""

MIN_VOLTAGE_V, MAX_VOLTAGE_V = 10.0, 20.0
MIN_COS_PITCH = 0.1
HISTORY = 128
DOF_INDEX = np.arange(4)
FULL = np.ones(4)
LONG_AGO_S = -1e6
MAX_EXTRAPOLATION_S = (0.06, 0.06, 0.045, 0.03)
"""How far, s, samples of each DOF are brought to the observer's moment by its own rates. Further, its error
would feed itself: with the shipped noises it grows from 0.06 s on, in yaw from 0.035 s."""
QUIET_N = 1.0
"""Disturbance noise, N/√s, of the observer that looks for hidden delay: it leans on the model."""


class CommandHistory:
    """The last commands: when each was sent, its axes and its thrust in NED, both (4,)."""

    def __init__(self) -> None:
        self._t_s = np.full(2 * HISTORY, LONG_AGO_S)
        self._axes = np.zeros((2 * HISTORY, 4))
        self._tau = np.zeros((2 * HISTORY, 4))
        self._impulse = np.zeros((2 * HISTORY, 4))
        self._next = 0

    def append(self, t_s: float, axes: Array, tau: Array) -> None:
        """Add what was sent at `t_s`, later than all before."""
        last = self._next + HISTORY - 1
        impulse = self._impulse[last] + self._tau[last] * (t_s - self._t_s[last])
        for i in (self._next, self._next + HISTORY):
            self._t_s[i], self._axes[i], self._tau[i], self._impulse[i] = t_s, axes, tau, impulse
        self._next = (self._next + 1) % HISTORY

    def mean_tau(self, t_s: Array) -> Array:
        """Return the mean thrust of each DOF between its own ascending `t_s` (n + 1, 4), as (n, 4).

        The newest command holds; zero where no time passes.
        """
        window = slice(self._next, self._next + HISTORY)
        at = np.maximum(np.searchsorted(self._t_s[window], t_s, side="right") - 1, 0)
        since_s = t_s - self._t_s[window][at]
        impulse = self._impulse[window][at, DOF_INDEX] + self._tau[window][at, DOF_INDEX] * since_s
        spans_s = t_s[1:] - t_s[:-1]
        mean: Array = (impulse[1:] - impulse[:-1]) / np.where(spans_s > 0.0, spans_s, np.inf)
        return mean

    def turn(self, shift: FrameShift) -> None:
        """Go on in a frame that has turned."""
        self._tau, self._impulse = turned(shift, self._tau), turned(shift, self._impulse)

    @property
    def sent(self) -> tuple[Array, Array]:
        """Times (n,) and axes (n, 4) of all that is kept, oldest first."""
        window = slice(self._next, self._next + HISTORY)
        known = self._t_s[window] > LONG_AGO_S
        return self._t_s[window][known], self._axes[window][known]


class Measurement(NamedTuple):
    """One sample of one degree of freedom: `kind` 0 is its position, 1 its rate; `at_s` when it was true."""

    dof: int
    kind: int
    value: float
    at_s: float


class Estimator:
    """What is known of the vehicle; `step` once a tick, `sent` after each command."""

    def __init__(self, config: Config, model: Model, thrusters: Thrusters) -> None:
        self._model = model
        self._thrusters = thrusters
        self._delays = config.delays
        self._lead_s = config.thrusters.lead_s
        self._tick_s = 1.0 / config.loop.rate_hz
        self._sensor_delay_s = [axis.sensor_delay_s for axis in config.axes]
        self._depth_later_s = LATER_S.get(config.vehicle.depth_source, 0.0)
        self.limit(config.supervisor)
        self._observer = _observer(config, model)
        self._hidden = _hidden_delay(config, model)
        self._heartbeat = Heartbeat(-math.inf, armed=False, mode=-1, system_status=0)
        self._voltage_v = T200_VOLTAGE_V
        self._gain = 1.0
        self._link_t_s = -math.inf
        self._heartbeat_t_s = -math.inf
        self._pilot_t_s = -math.inf
        self._handlers: dict[type, Callable[[Any], None]] = {
            Attitude: self._on_attitude,
            Depth: self._on_depth,
            DepthRate: self._on_depth_rate,
            Position: self._on_position,
            ServoOutput: self._on_servo_output,
            TimeSync: self._on_timesync,
            Heartbeat: self._on_heartbeat,
            Battery: self._on_battery,
            PilotGain: self._on_pilot_gain,
            Reboot: lambda _: self.restart(),
        }
        self.restart()

    def retune(self, config: Config, model: Model) -> None:
        """Go on from the present estimate with another model, other noises and sensor delays."""
        observer = _observer(config, model)
        observer.x = self._observer.x
        self._observer, self._model = observer, model
        self._sensor_delay_s = [axis.sensor_delay_s for axis in config.axes]

    def limit(self, limits: Limits) -> None:
        """Take what the supervisor's configuration says of jumps and ages."""
        self.max_depth_jump_m = limits.max_depth_jump_m
        position_s = limits.position_timeout_s
        self._timeout_s = np.array(
            (position_s, position_s, limits.depth_timeout_s, limits.attitude_timeout_s)
        )

    def restart(self) -> None:
        """Forget the motion, the clocks and the commands: a rebooted autopilot, or numbers gone bad."""
        self._meter = DelayMeter(self._delays.telemetry_s, self._delays.command_s)
        self._commands = CommandHistory()
        self._attitude = Attitude(-math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._measured_t_s = [-math.inf] * len(DOFS)
        self._observed_t_s: Array | None = None
        self._new: list[Measurement] = []
        self._observer.x = np.zeros((4, 6))
        self._hidden.restart(0.0)
        self._scaled_disturbance = ScaledDisturbance(np.zeros(4))
        self._eta = np.zeros(4)
        self._refusing = False
        self._yaw_resets, self._x_resets, self._y_resets = yaw_resets(), position_resets(), position_resets()
        self._yaw_reset_t_s = self._position_reset_t_s = -math.inf
        self._frame_shift: FrameShift | None = None

    def step(self, now_s: float, events: Sequence[Event], gain_scale: Array = FULL) -> VehicleState:
        """Take in what came since the last tick; say where the vehicle is and where a command finds it.

        `gain_scale` (4,) is what the controller has left of its gains: the predicted d is drawn back alike.
        """
        self._depth_refused = False
        self._frame_shift = None
        self._reset_by = np.zeros(4)
        self._innovation = np.zeros((4, 2))
        for event in events:
            self._take(event)
        delays = replace(self._meter.delays, hidden_s=float(self._hidden.hidden_s))
        if not math.isfinite(delays.total_s):
            self.restart()
            delays = self._meter.delays
        observer = self._observer
        stale = now_s - np.array(self._measured_t_s) > self._timeout_s
        if stale.any():
            observer.x[stale] = 0.0
            observer.x[stale, 0] = self._eta[stale]
        J = jacobian(observer.x[PSI, 0])
        nu = to_body(J, observer.x[:, 1])
        m = self._model.inertia(J)
        c = self._model.drag_coefficient(J, nu)

        from_s, observed_s = self._moments(now_s, delays)
        ahead_s = delays.command_s + self._lead_s
        to_go_s = np.maximum(now_s - observed_s + ahead_s, 0.0)
        steps = max(1, math.ceil(max(to_go_s.tolist()) / PREDICTION_STEP_S))
        step_s = to_go_s / steps
        edges_s = np.concatenate((from_s[None], observed_s + step_s * np.arange(steps + 1)[:, None]))
        u = self._commands.mean_tau(edges_s - delays.command_s)
        self._observe(u[0], m, c, from_s, observed_s)
        d_hat = self._scaled_disturbance.step(observer.disturbance, gain_scale, self._tick_s)
        way = observer.predict(u[1:], m, c, step_s, d_hat)
        eta, eta_dot = _along(way, (now_s - observed_s) / np.maximum(step_s, SHORTEST_S))
        eta_ahead, eta_dot_ahead, _ = way[-1]
        disturbance = observer.disturbance - self._unmodelled(J, nu, c)
        if stale.any():
            eta[stale] = eta_ahead[stale] = self._eta[stale]
            eta_dot[stale] = eta_dot_ahead[stale] = disturbance[stale] = 0.0
        self._eta = eta
        attitude = self._attitude
        return VehicleState(
            t_s=now_s,
            boot_s=now_s + self._meter.offset_s,
            eta=_wrapped(eta),
            eta_dot=_vector(eta_dot),
            ahead_s=ahead_s,
            eta_ahead=_wrapped(eta_ahead),
            eta_dot_ahead=_vector(eta_dot_ahead),
            disturbance=_vector(disturbance),
            roll=attitude.roll,
            pitch=attitude.pitch,
            p=0.0 if stale[PSI] else attitude.p,
            q=0.0 if stale[PSI] else attitude.q,
            armed=self._heartbeat.armed,
            mode=self._heartbeat.mode,
            system_status=self._heartbeat.system_status,
            voltage_v=self._voltage_v,
            pilot_gain=self._gain,
            ages=Ages(
                link_s=now_s - self._link_t_s,
                heartbeat_s=now_s - self._heartbeat_t_s,
                depth_s=now_s - self._measured_t_s[Z],
                attitude_s=now_s - attitude.t_s,
                position_s=now_s - self._measured_t_s[X],
                pilot_s=now_s - self._pilot_t_s,
                yaw_reset_s=now_s - self._yaw_reset_t_s,
                position_reset_s=now_s - self._position_reset_t_s,
            ),
            delays=delays,
            innovation=_vector(self._innovation[:, 0] + np.minimum(self._reset_by, RESET_INNOVATION)),
            depth_refused=self._depth_refused,
            clock_doubt_s=self._meter.doubt_s(now_s),
            frame_shift=self._frame_shift,
            stale=(bool(stale[X]), bool(stale[Y]), bool(stale[Z]), bool(stale[PSI])),
        )

    def sent(self, now_s: float, axes: Array, tau_ned: Array) -> None:
        """Note what was sent: axes and the thrust in NED that they really give, (4,) each."""
        self._commands.append(now_s, axes, tau_ned)

    def _unmodelled(self, J: Array, nu: Array, c: Array) -> Array | float:
        """Return what of k + h the observer's diagonal drag leaves out and so takes for disturbance."""
        if self._measured_t_s[X] == -math.inf:
            return 0.0
        return self._model.coriolis_and_damping(J, nu) - c * self._observer.x[:, 1]

    def _moments(self, now_s: float, delays: Delays) -> tuple[Array, Array]:
        """Return when each DOF was last observed, and when its newest measurements were true."""
        newest_s = now_s - delays.telemetry_s - 0.5 * self._tick_s
        to_s = np.array([newest_s - later_s for later_s in self._sensor_delay_s])
        to_s[Z] -= delays.hidden_s
        from_s = self._observed_t_s
        if from_s is None or to_s[Z] - from_s[Z] > MAX_GAP_S:
            from_s = to_s
        self._observed_t_s = np.minimum(np.maximum(from_s, to_s), now_s)
        return from_s, self._observed_t_s

    def _observe(self, u: Array, m: Array, c: Array, from_s: Array, to_s: Array) -> None:
        """Bring each DOF on under the thrust `u` that was in force, and correct it."""
        observer = self._observer
        dt_s = to_s - from_s
        observer.advance(u, m, c, dt_s)
        heave = [math.nan, math.nan]
        if self._new:
            expected = observer.expected.tolist()
            rates, moments_s = observer.rates(m, c).tolist(), to_s.tolist()
            innovation = [[0.0, 0.0] for _ in DOFS]
            for dof, kind, value, at_s in self._new:
                later_s = min(max(moments_s[dof] - at_s, -MAX_EXTRAPOLATION_S[dof]), MAX_EXTRAPOLATION_S[dof])
                now = value + rates[dof][kind] * later_s
                missed = now - expected[dof][kind]
                if dof == Z and not kind and abs(missed) > ZERO_MOVED_M and not self._heartbeat.armed:
                    observer.x[Z, 0] += missed
                    self._hidden.restart(now)
                    continue
                innovation[dof][kind] = wrap(missed) if dof == PSI and not kind else missed
                if dof == Z:
                    heave[kind] = now
            self._innovation = np.array(innovation)
            observer.correct(self._innovation)
            self._new.clear()
        if dt_s[Z] > 0.0:
            self._hidden.step(u[Z], m[Z], c[Z], dt_s[Z], np.array(heave))

    def _take(self, event: Event) -> None:
        kind = type(event)
        if kind is PilotHeartbeat:
            self._pilot_t_s = event.t_s
        handler = self._handlers.get(kind)
        if handler is None:
            return
        self._link_t_s = event.t_s
        handler(event)

    def _sampled(self, event: Depth | DepthRate | Attitude | Position, dof: int) -> float:
        """Return the time at which this sample of `dof` was true."""
        meter = self._meter
        if event.boot_s is None:
            return event.t_s - meter.delays.telemetry_s - self._sensor_delay_s[dof]
        meter.stamped(event.t_s, event.boot_s)
        return meter.local(event.boot_s) - self._sensor_delay_s[dof]

    def _position(self, dof: int, value: float, t_s: float, at_s: float) -> None:
        """Keep a position sample; a degree of freedom that was not measured for long begins anew."""
        if t_s - self._measured_t_s[dof] > min(MAX_GAP_S, self._timeout_s[dof]):
            self._observer.start(dof, value)
            if dof == Z:
                self._hidden.restart(value)
        self._measured_t_s[dof] = t_s
        self._new.append(Measurement(dof, 0, value, at_s))

    def _shift(self, shift: FrameShift) -> None:
        """Go on in the frame of a reset estimate; samples of this tick from before it are left out."""
        observer = self._observer
        place = observer.x[:, 0]
        observer.x = turned(shift, observer.x.T).T
        observer.x[:, 0] = shifted(shift, place)
        self._scaled_disturbance.mean = turned(shift, self._scaled_disturbance.mean)
        self._eta = shifted(shift, self._eta)
        self._commands.turn(shift)
        self._new = [one for one in self._new if one.dof == Z]
        self._frame_shift = joined(self._frame_shift, shift)

    def _on_attitude(self, event: Attitude) -> None:
        self._attitude = event
        at_s = self._sampled(event, PSI)
        turn_rad = self._yaw_resets.step(event.boot_s, event.yaw, _heading_rate(event))
        if turn_rad:
            self._yaw_reset_t_s = event.t_s
            self._reset_by[PSI] += abs(turn_rad)
            self._shift(FrameShift(turn_rad, 0.0, 0.0))
        self._position(PSI, event.yaw, event.t_s, at_s)
        self._new.append(Measurement(PSI, 1, _heading_rate(event), at_s))

    def _on_depth(self, event: Depth) -> None:
        at_s = self._sampled(event, Z) - self._depth_later_s - float(self._hidden.hidden_s)
        missed = abs(event.z_m - float(self._observer.expected[Z, 0]))
        known_s = event.t_s - self._measured_t_s[Z]
        believed_s = JUMP_BELIEVED_S if self._refusing else MAX_GAP_S
        if missed > self.max_depth_jump_m and known_s <= believed_s and self._heartbeat.armed:
            self._depth_refused = self._refusing = True
            return
        self._refusing = False
        self._position(Z, event.z_m, event.t_s, at_s)

    def _on_depth_rate(self, event: DepthRate) -> None:
        at_s = self._sampled(event, Z) - float(self._hidden.hidden_s)
        self._new.append(Measurement(Z, 1, event.w_mps, at_s))

    def _on_position(self, event: Position) -> None:
        at_s = self._sampled(event, X)
        north_m = self._x_resets.step(event.boot_s, event.x_m, event.vx_mps)
        east_m = self._y_resets.step(event.boot_s, event.y_m, event.vy_mps)
        if north_m or east_m:
            self._position_reset_t_s = event.t_s
            self._reset_by[:2] += (abs(north_m), abs(east_m))
            self._shift(FrameShift(0.0, north_m, east_m))
        self._position(X, event.x_m, event.t_s, at_s)
        self._position(Y, event.y_m, event.t_s, at_s)
        self._new.append(Measurement(X, 1, event.vx_mps, at_s))
        self._new.append(Measurement(Y, 1, event.vy_mps, at_s))

    def _on_servo_output(self, event: ServoOutput) -> None:
        count = self._thrusters.count
        if len(event.pwm_us) >= count:
            motors = np.array(motor_demand(event.pwm_us[:count]))
            self._meter.echo(event.boot_s, self._thrusters.axes_from_motors(motors)[:4], *self._commands.sent)

    def _on_timesync(self, event: TimeSync) -> None:
        self._meter.timesync(event.sent_s, event.t_s, event.boot_s)

    def _on_heartbeat(self, event: Heartbeat) -> None:
        self._heartbeat = event
        self._heartbeat_t_s = event.t_s

    def _on_battery(self, event: Battery) -> None:
        self._voltage_v = min(max(event.voltage_v, MIN_VOLTAGE_V), MAX_VOLTAGE_V)

    def _on_pilot_gain(self, event: PilotGain) -> None:
        self._gain = event.gain


def _along(way: Sequence[tuple[Array, Array, Array]], place: Array) -> tuple[Array, Array]:
    """Return position and rate of each DOF at its own `place` (4,), counted in steps of the way."""
    q, v = np.zeros(4), np.zeros(4)
    for dof, at in enumerate(place.tolist()):
        i = min(max(int(at), 0), len(way) - 2)
        (q_0, v_0, _), (q_1, v_1, _) = way[i], way[i + 1]
        q[dof] = q_0[dof] + (at - i) * (q_1[dof] - q_0[dof])
        v[dof] = v_0[dof] + (at - i) * (v_1[dof] - v_0[dof])
    return q, v


def _observer(config: Config, model: Model) -> Observer:
    drag = model.d1 + 0.1 * model.d2
    return Observer(model.m, drag, config.thrusters.lag_s, _noise(config), 1.0 / config.loop.rate_hz)


def _hidden_delay(config: Config, model: Model) -> HiddenDelay:
    heave = slice(Z, Z + 1)
    drag = (model.d1 + 0.1 * model.d2)[heave]
    quiet = _noise(config).of(Z, QUIET_N)
    return HiddenDelay(model.m[heave], drag, config.thrusters.lag_s, quiet, 1.0 / config.loop.rate_hz)


def _noise(config: Config) -> Noise:
    axes = config.axes
    return Noise(
        position=np.array([axis.position_noise for axis in axes]),
        rate=np.array([axis.rate_noise for axis in axes]),
        position_slow=np.array([axis.position_noise_slow for axis in axes]),
        rate_slow=np.array([axis.rate_noise_slow for axis in axes]),
        disturbance=np.array([axis.disturbance_noise for axis in axes]),
        slow_time_s=config.delays.slow_noise_s,
    )


def _heading_rate(attitude: Attitude) -> float:
    """Return ψ' = (q sin φ + r cos φ)/cos θ (Fossen 2011, eq. 2.28), θ kept off the singularity."""
    cos_pitch = max(math.cos(attitude.pitch), MIN_COS_PITCH)
    return (attitude.q * math.sin(attitude.roll) + attitude.r * math.cos(attitude.roll)) / cos_pitch


def _wrapped(eta: Array) -> Vector:
    x, y, z, psi = eta.tolist()
    return x, y, z, wrap(psi)


def _vector(array: Array) -> Vector:
    x, y, z, psi = array.tolist()
    return x, y, z, psi
