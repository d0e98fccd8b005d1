"""Events to VehicleState: an age for every signal, one observer for all four degrees of freedom.

A sample counts for the time at which it was true: the autopilot's stamp (or arrival minus the measured
telemetry delay, where a message has none) minus the sensor's own delay.
"""

import math
from collections.abc import Sequence

import numpy as np

from companion.config import Config
from companion.control.positioning import Model, rotate, wrap
from companion.delay import DelayMeter
from companion.observer import Noise, Observer
from companion.thrust import T200_VOLTAGE_V, Thrusters
from companion.types import (
    DOFS,
    PSI,
    Ages,
    Array,
    Attitude,
    Battery,
    Depth,
    DepthRate,
    Event,
    Heartbeat,
    PilotGain,
    Position,
    ServoOutput,
    TimeSync,
    VehicleState,
    X,
    Y,
    Z,
)

PREDICTION_STEP_S = 0.025
MAX_GAP_S = 0.5
"""A degree of freedom that was not measured for longer starts anew with its next sample."""

REBOOT_S = 1.0
"""An autopilot clock that falls back by more than this belongs to a rebooted autopilot."""

MIN_VOLTAGE_V, MAX_VOLTAGE_V = 10.0, 20.0
HISTORY = 128


class CommandHistory:
    """The last commands: when each was sent, its axes and its thrust in NED, both (4,)."""

    def __init__(self) -> None:
        self._t_s = np.full(2 * HISTORY, -np.inf)
        self._axes = np.zeros((2 * HISTORY, 4))
        self._tau = np.zeros((2 * HISTORY, 4))
        self._next = 0

    def append(self, t_s: float, axes: Array, tau: Array) -> None:
        """Add what was sent at `t_s`, later than all before."""
        for i in (self._next, self._next + HISTORY):
            self._t_s[i], self._axes[i], self._tau[i] = t_s, axes, tau
        self._next = (self._next + 1) % HISTORY

    def tau_at(self, t_s: Array) -> Array:
        """Return the thrust in force at each of `t_s` (n,), as (n, 4); the newest one holds."""
        window = slice(self._next, self._next + HISTORY)
        at = np.searchsorted(self._t_s[window], t_s, side="right") - 1
        return self._tau[window][np.maximum(at, 0)]

    @property
    def sent(self) -> tuple[Array, Array]:
        """Times (n,) and axes (n, 4) of all that is kept, oldest first."""
        window = slice(self._next, self._next + HISTORY)
        known = np.isfinite(self._t_s[window])
        return self._t_s[window][known], self._axes[window][known]


class Estimator:
    """What is known of the vehicle; `step` once a tick, `sent` after each command."""

    def __init__(self, config: Config, model: Model, thrusters: Thrusters) -> None:
        self._model = model
        self._thrusters = thrusters
        self._delays = config.delays
        self._lead_s = config.thrusters.lead_s
        self._tick_s = 1.0 / config.loop.rate_hz
        axes = config.axes
        self._sensor_delay_s = [axis.sensor_delay_s for axis in axes]
        noise = Noise(
            position=np.array([axis.position_noise for axis in axes]),
            rate=np.array([axis.rate_noise for axis in axes]),
            position_slow=np.array([axis.position_noise_slow for axis in axes]),
            rate_slow=np.array([axis.rate_noise_slow for axis in axes]),
            disturbance=np.array([axis.disturbance_noise for axis in axes]),
            slow_time_s=config.delays.slow_noise_s,
        )
        drag = model.d1 + 0.1 * model.d2
        self._observer = Observer(model.m, drag, config.thrusters.lag_s, noise, self._tick_s)
        self._heartbeat = Heartbeat(-math.inf, armed=False, mode=-1, system_status=0)
        self._voltage_v = T200_VOLTAGE_V
        self._gain = 1.0
        self._link_t_s = -math.inf
        self._restart()

    def _restart(self) -> None:
        self._meter = DelayMeter(self._delays.telemetry_s, self._delays.command_s)
        self._commands = CommandHistory()
        self._attitude = Attitude(-math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._measured_t_s = [-math.inf] * len(DOFS)
        self._rate_t_s = -math.inf
        self._boot_s = -math.inf
        self._observed_t_s: float | None = None

    def step(self, now_s: float, events: Sequence[Event]) -> VehicleState:
        """Take in what came since the last tick; say where the vehicle is and where a command finds it."""
        self._note(events)
        delays = self._meter.delays
        psi = float(self._observer.x[PSI, 0])
        nu = rotate(self._observer.x[:, 1], -psi)
        m, c = self._model.inertia(psi), self._model.drag_coefficient(nu, psi)
        if not self._any_measured:
            self._observed_t_s = None
        else:
            self._observe(now_s, events, m, c)
        observed_s = now_s if self._observed_t_s is None else self._observed_t_s

        ahead_s = delays.command_s + self._lead_s
        to_go_s = now_s - observed_s + ahead_s
        steps = max(1, math.ceil(to_go_s / PREDICTION_STEP_S))
        step_s = to_go_s / steps
        middle_s = observed_s + step_s * (np.arange(steps, dtype=np.float64) + 0.5)
        way = self._observer.predict(self._commands.tau_at(middle_s - delays.command_s), m, c, step_s)
        now = way[min(round((now_s - observed_s) / step_s), steps)] if step_s else way[0]
        attitude = self._attitude
        return VehicleState(
            t_s=now_s,
            boot_s=now_s + self._meter.offset_s,
            eta=_wrapped(now[:, 0]),
            eta_dot=now[:, 1],
            ahead_s=ahead_s,
            eta_ahead=_wrapped(way[-1, :, 0]),
            eta_dot_ahead=way[-1, :, 1],
            disturbance=self._observer.disturbance,
            roll=attitude.roll,
            pitch=attitude.pitch,
            p=attitude.p,
            q=attitude.q,
            armed=self._heartbeat.armed,
            mode=self._heartbeat.mode,
            system_status=self._heartbeat.system_status,
            voltage_v=self._voltage_v,
            pilot_gain=self._gain,
            ages=Ages(
                link_s=now_s - self._link_t_s,
                depth_s=now_s - self._measured_t_s[Z],
                attitude_s=now_s - self._attitude.t_s,
                position_s=now_s - self._measured_t_s[X],
            ),
            delays=delays,
        )

    def sent(self, now_s: float, axes: Array, tau_ned: Array) -> None:
        """Note what was sent: axes and the thrust in NED that they really give, (4,) each."""
        self._commands.append(now_s, axes, tau_ned)

    @property
    def _any_measured(self) -> bool:
        return max(self._measured_t_s) > -math.inf

    def _note(self, events: Sequence[Event]) -> None:
        """Keep what is not for the observer."""
        for event in events:
            self._link_t_s = event.t_s
            boot_s = getattr(event, "boot_s", None)
            if boot_s is not None:
                if boot_s < self._boot_s - REBOOT_S:
                    self._restart()
                self._boot_s = boot_s
            match event:
                case Attitude():
                    self._attitude = event
                    self._meter.stamped(event.t_s, event.boot_s)
                case TimeSync():
                    self._meter.timesync(event.sent_s, event.t_s, event.boot_s)
                case ServoOutput() if len(event.pwm_us) >= self._thrusters.count:
                    motors = (np.array(event.pwm_us[: self._thrusters.count]) - 1500.0) / 400.0
                    self._meter.echo(
                        event.boot_s, self._thrusters.axes_from_motors(motors), *self._commands.sent
                    )
                case Heartbeat():
                    self._heartbeat = event
                case Battery():
                    self._voltage_v = min(max(event.voltage_v, MIN_VOLTAGE_V), MAX_VOLTAGE_V)
                case PilotGain():
                    self._gain = event.gain
            self._measured(event)

    def _measured(self, event: Event) -> None:
        """Remember when each degree of freedom was measured; one not seen for long begins anew."""
        match event:
            case Attitude():
                positions = {PSI: event.yaw}
            case Depth():
                positions = {Z: event.z_m}
            case Position():
                positions = {X: event.x_m, Y: event.y_m}
            case _:
                return
        for dof, value in positions.items():
            if event.t_s - self._measured_t_s[dof] > MAX_GAP_S:
                self._observer.start(dof, value)
            self._measured_t_s[dof] = event.t_s

    def _observe(self, now_s: float, events: Sequence[Event], m: Array, c: Array) -> None:
        """Bring the observer to the time of the newest measurements and correct it by them."""
        delays = self._meter.delays
        wanted_t_s = now_s - delays.telemetry_s - 0.5 * self._tick_s
        if self._observed_t_s is None or wanted_t_s - self._observed_t_s > MAX_GAP_S:
            self._observed_t_s = wanted_t_s
        passed_s = max(0.0, wanted_t_s - self._observed_t_s)
        if passed_s > 0.0:
            middle_s = np.array([self._observed_t_s + 0.5 * passed_s - delays.command_s])
            self._observer.advance(self._commands.tau_at(middle_s)[0], m, c, passed_s)
            self._observed_t_s = wanted_t_s
        innovation = np.zeros((4, 2))
        expected = self._observer.expected
        rate = self._observer.x[:, 1]
        acceleration = self._observer.acceleration(m, c)

        def take(dof: int, kind: int, value: float, t_s: float, boot_s: float | None) -> None:
            stamp_s = t_s - delays.telemetry_s if boot_s is None else self._meter.local(boot_s)
            later_s = wanted_t_s - (stamp_s - self._sensor_delay_s[dof])
            moved = (rate if kind == 0 else acceleration)[dof] * later_s
            missed = value + moved - expected[dof, kind]
            innovation[dof, kind] = wrap(missed) if dof == PSI and kind == 0 else missed

        for event in events:
            match event:
                case Attitude():
                    take(PSI, 0, event.yaw, event.t_s, event.boot_s)
                    take(PSI, 1, event.r, event.t_s, event.boot_s)
                case Depth():
                    take(Z, 0, event.z_m, event.t_s, event.boot_s)
                case DepthRate():
                    take(Z, 1, event.w_mps, event.t_s, event.boot_s)
                case Position():
                    take(X, 0, event.x_m, event.t_s, event.boot_s)
                    take(X, 1, event.vx_mps, event.t_s, event.boot_s)
                    take(Y, 0, event.y_m, event.t_s, event.boot_s)
                    take(Y, 1, event.vy_mps, event.t_s, event.boot_s)
        if innovation.any():
            self._observer.correct(innovation)


def _wrapped(eta: Array) -> Array:
    eta = eta.copy()
    eta[PSI] = wrap(eta[PSI])
    return eta
