"""Events to VehicleState: an age for every signal, an observer for each degree of freedom.

A sample counts for the time at which it was true: the autopilot's stamp (or arrival minus the measured
telemetry delay, where a message has none) minus the sensor's own delay.
"""

import math
from collections.abc import Callable, Sequence
from operator import add
from typing import Any

from msgspec.structs import replace

from companion.config import Config, SupervisorLimits
from companion.control.allocation import T200_VOLTAGE_V, Thrusters, axes_from_motors
from companion.control.bounds import clamped, wrap
from companion.control.frames import joined, shifted, turned
from companion.control.oscillation import mean_disturbance, scaled_disturbance
from companion.control.positioning import (
    Model,
    coriolis_and_damping,
    drag_coefficient,
    inertia,
    jacobian,
    to_body,
)
from companion.estimation import hidden_delay, observer, thruster_watch
from companion.estimation.command_history import CommandHistory
from companion.estimation.delay import DelayMeter
from companion.estimation.ground import GroundFinder
from companion.estimation.model_learner import ModelLearner
from companion.estimation.observer import (
    Motion,
    Noise,
    ObserverParameters,
    ObserverState,
    ObserverTable,
    observer_parameters,
    observer_table,
)
from companion.estimation.position_doubt import PositionDoubtModel
from companion.estimation.resets import MAX_GAP_S, POSITION_WARNED_M, position_resets, yaw_resets
from companion.estimation.vehicle_model import DISTURBANCE_RATIO, MOST_LAG_S, MOST_LOG_GAIN, Tables
from companion.estimation.water import Water
from companion.mavlink.ardusub import motor_demand
from companion.records import (
    DOFS,
    PSI,
    ZERO,
    Ages,
    Attitude,
    Axes,
    Battery,
    Delays,
    Depth,
    DepthRate,
    EkfStatus,
    Event,
    Flags,
    FrameShift,
    Heartbeat,
    PilotGain,
    PilotHeartbeat,
    Position,
    Range,
    Reboot,
    ServoOutput,
    TimeSync,
    Vector,
    VehicleState,
    X,
    Y,
    Z,
    vector,
)

PREDICTION_STEP_S = 0.035
SHORTEST_S = 1e-9

MAX_RESET_INNOVATION = 1.0
"""m, rad: so much of a tick's resets counts as innovation. One is no surprise; one with every sample is."""

LATER_S = {"pressure": 0.053, "ahrs2": 0.048}
"""How much older than relative_alt and climb these depths are (docs/ardusub.md, "Telemetry")."""

ZERO_MOVED_M = 0.05
"""A disarmed vehicle whose depth jumps by more has a new zero, as arming makes one: that is no motion."""

JUMP_BELIEVED_S = 2.0
"""A depth that jumped is left out, and so is stale soon; after this long it is where the vehicle is."""

MIN_VOLTAGE_V, MAX_VOLTAGE_V = 10.0, 20.0
MIN_COS_PITCH = 0.1
MAX_EXTRAPOLATION_S = (0.06, 0.06, 0.045, 0.03)
"""How far, s, samples of each DOF are extrapolated to the observer's moment by its own rates. Further, its
error would feed itself: with the shipped noises it grows from 0.06 s on, in yaw from 0.035 s."""

TYPICAL_RATE = 0.1
"""m/s, rad/s: the rate at which the drag is taken for the Kalman gain."""

WATCH_TICKS = 4
"""The thrusters are watched every so many ticks: it takes 70 µs, and what they turn is slow."""

QUIET_N = 1.0
"""Disturbance noise, N/√s, of the observer that looks for hidden delay: it leans on the model."""


Measurement = tuple[bool, float, float]
"""One sample of a degree of freedom: whether of its rate or its position, its value, when it was true (s)."""

Estimate = tuple[float, float, float, float, float]
"""Position and rate of one degree of freedom now, both `ahead_s` later, and its disturbance."""


class Estimator:
    """What is known of the vehicle; `step` once a tick, `sent` after each command."""

    def __init__(self, config: Config, model: Model, thrusters: Thrusters) -> None:
        self._thrusters = thrusters
        self._delays = config.delays
        self._lead_s = config.thrusters.lead_s
        self._tick_s = 1.0 / config.loop.rate_hz
        self._depth_later_s = LATER_S.get(config.vehicle.depth_source, 0.0)
        self._watches = config.levels
        self._watch_tick = 0
        self._watch = thruster_watch.START
        self._hidden_parameters = hidden_delay_parameters(config, model)
        self._hidden = hidden_delay.start(0.0, 0.0)
        tables, adapts = model_tables(config, model), config.vehicle.adapts
        self.learner = ModelLearner(tables, config.thrusters.lag_s, adapts=adapts)
        """What was found of the vehicle's gain and lag."""
        self.limit(config.supervisor)
        self.retune(config, model)
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
            Range: self._on_range,
            ServoOutput: self._on_servo_output,
            TimeSync: self._on_timesync,
            Heartbeat: self._on_heartbeat,
            Battery: self._on_battery,
            PilotGain: self._on_pilot_gain,
            EkfStatus: self._on_ekf_status,
            Reboot: lambda _: self.restart(),
        }
        self.restart()

    def retune(self, config: Config, model: Model) -> None:
        """Go on from the present estimate with another model, other noises and sensor delays."""
        self._watch_parameters = thruster_watch_parameters(config, self._thrusters)
        self.learner.retune(model_tables(config, model))
        self._model = model
        self._position_noise_m = max(config.surge.position_noise_slow, config.sway.position_noise_slow)
        self._sensor_delay_s = [axis.sensor_delay_s for axis in config.axes]

    def limit(self, limits: SupervisorLimits) -> None:
        """Take what the supervisor's configuration says of jumps and ages."""
        self.max_depth_jump_m = limits.max_depth_jump_m
        position_s = limits.position_timeout_s
        self._timeout_s = (position_s, position_s, limits.depth_timeout_s, limits.attitude_timeout_s)

    def restart(self) -> None:
        """Forget the motion, the clocks and the commands: a rebooted autopilot, or numbers gone bad."""
        self._meter = DelayMeter(self._delays.telemetry_s, self._delays.command_s)
        self._commands = CommandHistory()
        self._attitude = Attitude(-math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._measured_t_s = [-math.inf] * len(DOFS)
        self._observed_t_s: list[float] | None = None
        self._new: list[list[Measurement]] = [[] for _ in DOFS]
        self._observers = [observer.at_rest(0.0) for _ in DOFS]
        for dof in range(len(DOFS)):
            self.learner.begin(dof, 0.0)
        self._hidden = hidden_delay.start(0.0, self._hidden.hidden_s)
        self._mean_disturbance: list[float] = [0.0] * len(DOFS)
        self._ground = GroundFinder()
        self._ranges: list[Range] = []
        self._water = Water()
        self._position_doubt = PositionDoubtModel(self._position_noise_m)
        self._aided = True
        self._eta = ZERO
        self._refusing = False
        self._yaw_resets, self._x_resets, self._y_resets = yaw_resets(), position_resets(), position_resets()
        self._yaw_reset_t_s = self._position_reset_t_s = -math.inf
        self._frame_shift: FrameShift | None = None

    def step(
        self,
        now_s: float,
        events: Sequence[Event],
        d_share: Sequence[float] = (1.0, 1.0, 1.0, 1.0),
        learns: Flags = (False, False, False, False),
    ) -> VehicleState:
        """Take in what came since the last tick; say where the vehicle is and where a command finds it.

        `d_share`, by DOF, is what the controller scales d̂ by: the predicted d is scaled alike.
        `learns`, by axis, tells whether our commands alone move it: then its gain and lag are learnt.
        """
        self._depth_refused = False
        self._frame_shift = None
        self._reset_by = [0.0] * len(DOFS)
        self._innovation = [0.0] * len(DOFS)
        for event in events:
            self._take(event)
        delays = replace(self._meter.delays, hidden_s=self._hidden.hidden_s)
        if not math.isfinite(delays.total_s):
            self.restart()
            delays = self._meter.delays
        stale = (
            self._is_stale(X, now_s),
            self._is_stale(Y, now_s),
            self._is_stale(Z, now_s),
            self._is_stale(PSI, now_s),
        )
        ahead_s = delays.command_s + self._lead_s
        estimates = self._estimates(now_s, ahead_s, delays, stale, d_share)
        self.learner.learn(learns, self._tick_s)
        eta, eta_dot, eta_ahead, eta_dot_ahead, disturbance = map(vector, zip(*estimates, strict=True))
        self._eta = eta
        attitude = self._attitude
        tilt_cos = math.cos(attitude.roll) * math.cos(attitude.pitch)
        ground = self._ground.step(
            now_s, self._ranges, eta[Z], math.nan if stale[PSI] or stale[Z] else tilt_cos
        )
        self._ranges.clear()
        doubt = self._position_doubt.step(
            (eta[X], eta[Y]), self._frame_shift, stale=stale[X], aided=self._aided, dt_s=self._tick_s
        )
        seen = learns[X] and learns[Y] and not (stale[X] or stale[Y] or stale[PSI])
        gain = self.learner.model.dof_gain
        J = jacobian(eta[PSI])
        current = self._water.step(self._model, J, eta_dot, disturbance, gain, self._tick_s, seen)
        return VehicleState(
            t_s=now_s,
            boot_s=now_s + self._meter.clock.offset_s,
            eta=_wrapped(eta),
            eta_dot=eta_dot,
            ahead_s=ahead_s,
            eta_ahead=_wrapped(eta_ahead),
            eta_dot_ahead=eta_dot_ahead,
            disturbance=disturbance,
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
            innovation=vector(map(add, self._innovation, self._reset_by)),
            depth_refused=self._depth_refused,
            clock_doubt_s=self._meter.clock.doubt_s(now_s),
            frame_shift=self._frame_shift,
            stale=stale,
            dead_motor=self._watch.dead,
            model=self.learner.model,
            ground=ground,
            current=current,
            position_doubt=doubt,
        )

    def sent(self, now_s: float, axes: Vector, tau_ned: Vector) -> None:
        """Note what was sent: axes and the thrust in NED that they really give."""
        self._commands.append(now_s, axes, tau_ned)

    def watch_thrusters(self, now_s: float, axes: Axes, *, steady: bool) -> None:
        """Look for a motor that gives no thrust, where roll and pitch are ours; `axes` were sent now.

        `steady` tells that the vehicle follows our frames, at full authority.
        """
        if not self._watches:
            return
        attitude = self._attitude
        if not steady or now_s - attitude.t_s > self._timeout_s[PSI]:
            self._watch = thruster_watch.rest(self._watch)
            return
        self._watch_tick += 1
        if self._watch_tick % WATCH_TICKS:
            return
        turning = (attitude.roll, attitude.pitch, attitude.p, attitude.q, attitude.r)
        delay_s = self._meter.delays.total_s
        self._watch = thruster_watch.step(
            self._watch_parameters,
            self._watch,
            axes,
            self._voltage_v,
            turning,
            delay_s,
            WATCH_TICKS * self._tick_s,
        )

    def trust_thrusters(self) -> None:
        """Take all motors for sound again."""
        self._watch = thruster_watch.START

    def lose(self, tau_ned: Vector) -> None:
        """Take from thrust and d what a motor that gives no thrust was believed to give, N and N·m.

        The commands on their way give it neither: in d alone it would be a step that is not there.
        """
        self._commands.lose(tau_ned)
        for dof, lost in enumerate(tau_ned):
            state = self._observers[dof]
            self._observers[dof] = state._replace(f=state.f - lost, d=state.d - lost)
            self._mean_disturbance[dof] -= lost

    def _is_stale(self, dof: int, now_s: float) -> bool:
        """Tell whether a DOF was not measured for longer than its timeout: then it rests where it was."""
        if now_s - self._measured_t_s[dof] <= self._timeout_s[dof]:
            return False
        self._observers[dof] = observer.at_rest(self._eta[dof])
        self.learner.begin(dof, self._eta[dof])
        self._new[dof].clear()
        return True

    def _estimates(
        self,
        now_s: float,
        ahead_s: float,
        delays: Delays,
        stale: tuple[bool, bool, bool, bool],
        d_share: Sequence[float],
    ) -> list[Estimate]:
        """Bring each observer on to the newest measurements and predict from there to now and ahead."""
        psi = self._observers[PSI].q
        J = jacobian(psi)
        nu = to_body(J, vector([one.v for one in self._observers]))
        m = inertia(self._model, J)
        c = drag_coefficient(self._model, J, nu)
        forces = coriolis_and_damping(self._model, J, nu)
        learner = self.learner
        learner.turn(J)

        from_s, observed_s = self._moments(now_s, delays)
        to_go_s = [max(now_s - at_s + ahead_s, 0.0) for at_s in observed_s]
        steps = max(1, math.ceil(max(to_go_s) / PREDICTION_STEP_S))
        estimates: list[Estimate] = []
        for dof in range(len(DOFS)):
            if stale[dof]:
                self._mean_disturbance[dof] = mean_disturbance(self._mean_disturbance[dof], 0.0, self._tick_s)
                estimates.append((self._eta[dof], 0.0, self._eta[dof], 0.0, 0.0))
                continue
            step_s, since_s = to_go_s[dof] / steps, observed_s[dof] - delays.command_s
            edges_s = [from_s[dof] - delays.command_s, *[since_s + step_s * k for k in range(steps + 1)]]
            thrust, *thrusts = self._commands.mean_thrusts(dof, edges_s)
            gain = learner.gain(dof)
            m_eff, c_eff = m[dof] / gain, c[dof] / gain
            before_s, at_s = from_s[dof], observed_s[dof]
            state = self._observe(dof, thrust, m_eff, c_eff, before_s, at_s, (m[dof], c[dof]))
            mean = mean_disturbance(self._mean_disturbance[dof], state.d, self._tick_s)
            self._mean_disturbance[dof] = mean
            model = observer.coefficients(learner.parameters(dof), m_eff, c_eff, step_s)
            d_hat = scaled_disturbance(mean, state.d, d_share[dof])
            trajectory = observer.predict(model, state, thrusts, d_hat)
            q, q_dot = interpolate(trajectory, (now_s - observed_s[dof]) / max(step_s, SHORTEST_S))
            q_ahead, q_dot_ahead, _ = trajectory[-1]
            # What of k + h the observer's diagonal drag leaves out it takes for disturbance.
            left_out = forces[dof] / gain - c_eff * state.v if self._measured_t_s[X] > -math.inf else 0.0
            estimates.append((q, q_dot, q_ahead, q_dot_ahead, state.d - left_out))
        return estimates

    def _moments(self, now_s: float, delays: Delays) -> tuple[list[float], list[float]]:
        """Return when each DOF was last observed, and when its newest measurements were true."""
        newest_s = now_s - delays.telemetry_s - 0.5 * self._tick_s
        to_s = [newest_s - later_s for later_s in self._sensor_delay_s]
        to_s[Z] -= delays.hidden_s
        from_s = self._observed_t_s
        if from_s is None or to_s[Z] - from_s[Z] > MAX_GAP_S or from_s[Z] > now_s:
            from_s = to_s
        observed_s = [min(max(pair), now_s) for pair in zip(from_s, to_s, strict=True)]
        self._observed_t_s = observed_s
        return from_s, observed_s

    def _observe(
        self,
        dof: int,
        thrust: float,
        m: float,
        c: float,
        from_s: float,
        to_s: float,
        nominal: tuple[float, float],
    ) -> ObserverState:
        """Bring a DOF's observer on under the thrust that was in force, correct it, return it.

        `nominal` are m and c of the nominal vehicle.
        """
        parameters, dt_s = self.learner.parameters(dof), to_s - from_s
        state = observer.advance(parameters, self._observers[dof], thrust, m, c, dt_s)
        measured, innovation = [math.nan, math.nan], [0.0, 0.0]
        if self._new[dof]:
            expected, rates = observer.expected(state), observer.rates(state, m, c)
            for of_rate, value, at_s in self._new[dof]:
                most_s = MAX_EXTRAPOLATION_S[dof]
                now = value + rates[of_rate] * clamped(to_s - at_s, -most_s, most_s)
                error = now - expected[of_rate]
                if dof == PSI and not of_rate:
                    error = wrap(error)
                elif dof == Z and not of_rate and self._zero_moved(error):
                    state = state._replace(q=state.q + error)
                    self._hidden = hidden_delay.start(now, self._hidden.hidden_s)
                    self.learner.begin(dof, now)
                    continue
                measured[of_rate], innovation[of_rate] = now, error
            self._new[dof].clear()
            self._innovation[dof] = innovation[0]
            state = observer.correct(parameters, state, *innovation)
        if dt_s > 0.0:
            self.learner.observe(dof, thrust, *nominal, dt_s, *measured)
        if dof == Z and dt_s > 0.0:
            self._hidden = hidden_delay.step(
                self._hidden_parameters, self._hidden, thrust, m, c, dt_s, *measured
            )
        self._observers[dof] = state
        return state

    def _zero_moved(self, innovation_m: float) -> bool:
        return abs(innovation_m) > ZERO_MOVED_M and not self._heartbeat.armed

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
            return event.t_s - meter.telemetry_s - self._sensor_delay_s[dof]
        meter.stamped(event.t_s, event.boot_s)
        return meter.clock.local(event.boot_s) - self._sensor_delay_s[dof]

    def _position(self, dof: int, value: float, t_s: float, at_s: float) -> None:
        """Keep a position sample; a degree of freedom that was not measured for long begins anew."""
        if t_s - self._measured_t_s[dof] > min(MAX_GAP_S, self._timeout_s[dof]):
            self._observers[dof] = observer.at_rest(value)
            self.learner.begin(dof, value)
            if dof == Z:
                self._hidden = hidden_delay.start(value, self._hidden.hidden_s)
        self._measured_t_s[dof] = t_s
        self._new[dof].append((False, value, at_s))

    def _rate(self, dof: int, value: float, at_s: float) -> None:
        self._new[dof].append((True, value, at_s))

    def _shift(self, shift: FrameShift) -> None:
        """Go on in the frame of a reset estimate; samples of this tick from before it are left out."""
        q, *others = (vector(column) for column in zip(*self._observers, strict=True))
        columns = [shifted(shift, q), *(turned(shift, column) for column in others)]
        self._observers = [ObserverState(*row) for row in zip(*columns, strict=True)]
        self._mean_disturbance = list(turned(shift, vector(self._mean_disturbance)))
        self._eta = shifted(shift, self._eta)
        self._commands.turn(shift)
        self._water.turn(shift.turn_rad)
        for dof in (X, Y, PSI):
            self._new[dof].clear()
            self.learner.begin(dof, self._observers[dof].q)
        self._frame_shift = joined(self._frame_shift, shift)

    def _on_attitude(self, event: Attitude) -> None:
        self._attitude = event
        at_s = self._sampled(event, PSI)
        heading_rate = _heading_rate(event)
        turn_rad = self._yaw_resets.step(event.boot_s, event.yaw, heading_rate)
        if turn_rad:
            self._yaw_reset_t_s = event.t_s
            self._reset_by[PSI] = min(self._reset_by[PSI] + abs(turn_rad), MAX_RESET_INNOVATION)
            self._shift(FrameShift(turn_rad, 0.0, 0.0))
        self._position(PSI, event.yaw, event.t_s, at_s)
        self._rate(PSI, heading_rate, at_s)

    def _on_depth(self, event: Depth) -> None:
        at_s = self._sampled(event, Z) - self._depth_later_s - self._hidden.hidden_s
        expected_m, _ = observer.expected(self._observers[Z])
        innovation_m = abs(event.z_m - expected_m)
        known_s = event.t_s - self._measured_t_s[Z]
        believed_s = JUMP_BELIEVED_S if self._refusing else MAX_GAP_S
        if innovation_m > self.max_depth_jump_m and known_s <= believed_s and self._heartbeat.armed:
            self._depth_refused = self._refusing = True
            return
        self._refusing = False
        self._position(Z, event.z_m, event.t_s, at_s)

    def _on_depth_rate(self, event: DepthRate) -> None:
        at_s = self._sampled(event, Z) - self._hidden.hidden_s
        self._rate(Z, event.w_mps, at_s)

    def _on_position(self, event: Position) -> None:
        at_s = self._sampled(event, X)
        north_m = self._x_resets.step(event.boot_s, event.x_m, event.vx_mps)
        east_m = self._y_resets.step(event.boot_s, event.y_m, event.vy_mps)
        if north_m or east_m:
            if math.hypot(north_m, east_m) > POSITION_WARNED_M:
                self._position_reset_t_s = event.t_s
            self._reset_by[X] = min(self._reset_by[X] + abs(north_m), MAX_RESET_INNOVATION)
            self._reset_by[Y] = min(self._reset_by[Y] + abs(east_m), MAX_RESET_INNOVATION)
            self._shift(FrameShift(0.0, north_m, east_m))
        self._position(X, event.x_m, event.t_s, at_s)
        self._position(Y, event.y_m, event.t_s, at_s)
        self._rate(X, event.vx_mps, at_s)
        self._rate(Y, event.vy_mps, at_s)

    def _on_range(self, event: Range) -> None:
        self._ranges.append(event)

    def _on_ekf_status(self, event: EkfStatus) -> None:
        self._aided = event.position

    def _on_servo_output(self, event: ServoOutput) -> None:
        count = self._thrusters.motor_count
        if len(event.pwm_us) >= count:
            axes = axes_from_motors(self._thrusters, motor_demand(event.pwm_us[:count]))
            self._meter.echo(event.boot_s, axes[:4], self._commands.t_s, self._commands.axes)

    def _on_timesync(self, event: TimeSync) -> None:
        self._meter.timesync(event.sent_s, event.t_s, event.boot_s)

    def _on_heartbeat(self, event: Heartbeat) -> None:
        self._heartbeat = event
        self._heartbeat_t_s = event.t_s

    def _on_battery(self, event: Battery) -> None:
        self._voltage_v = min(max(event.voltage_v, MIN_VOLTAGE_V), MAX_VOLTAGE_V)

    def _on_pilot_gain(self, event: PilotGain) -> None:
        self._gain = event.gain


def interpolate(trajectory: Sequence[Motion], step_index: float) -> tuple[float, float]:
    """Return position and rate on a trajectory, `step_index` steps after its start."""
    i = min(max(int(step_index), 0), len(trajectory) - 2)
    (q_0, v_0, _), (q_1, v_1, _) = trajectory[i], trajectory[i + 1]
    share = step_index - i
    return q_0 + share * (q_1 - q_0), v_0 + share * (v_1 - v_0)


def model_tables(config: Config, model: Model) -> list[Tables]:
    """Return the observers of each degree of freedom, by gain and lag."""
    return [
        Tables(
            *(
                table_of(config, model, dof, ratio * axis.disturbance_noise)
                for ratio in (1.0, DISTURBANCE_RATIO)
            )
        )
        for dof, axis in enumerate(config.axes)
    ]


def thruster_watch_parameters(config: Config, thrusters: Thrusters) -> thruster_watch.Parameters:
    """Return what the watch over the thrusters needs."""
    levelling = config.levelling
    return thruster_watch.Parameters(
        thrusters,
        levelling.roll_inertia,
        levelling.pitch_inertia,
        config.yaw.mass,
        levelling.lever_m,
        config.thrusters.lag_s,
    )


def hidden_delay_parameters(config: Config, model: Model) -> ObserverParameters:
    """Return the parameters of the observer that looks for hidden delay."""
    drag = model.d1[Z] + TYPICAL_RATE * model.d2[Z]
    tick_s = 1.0 / config.loop.rate_hz
    return observer_parameters(model.m[Z], drag, config.thrusters.lag_s, _noise(config, Z, QUIET_N), tick_s)


def table_of(config: Config, model: Model, dof: int, disturbance: float) -> ObserverTable:
    """Return a degree of freedom's observers that expect so much `disturbance` noise."""
    drag = model.d1[dof] + TYPICAL_RATE * model.d2[dof]
    noise, tick_s = _noise(config, dof, disturbance), 1.0 / config.loop.rate_hz
    lag_s = config.thrusters.lag_s
    return observer_table(model.m[dof], drag, lag_s, noise, tick_s, MOST_LOG_GAIN, MOST_LAG_S)


def _noise(config: Config, dof: int, disturbance: float) -> Noise:
    axis = config.axes[dof]
    return Noise(
        position=axis.position_noise,
        rate=axis.rate_noise,
        position_slow=axis.position_noise_slow,
        rate_slow=axis.rate_noise_slow,
        disturbance=disturbance,
        slow_time_s=config.delays.slow_noise_s,
    )


def _heading_rate(attitude: Attitude) -> float:
    """Return ψ' = (q sin φ + r cos φ)/cos θ (Fossen 2011, eq. 2.28), θ kept off the singularity."""
    cos_pitch = max(math.cos(attitude.pitch), MIN_COS_PITCH)
    return (attitude.q * math.sin(attitude.roll) + attitude.r * math.cos(attitude.roll)) / cos_pitch


def _wrapped(eta: Vector) -> Vector:
    x, y, z, psi = eta
    return (x, y, z, wrap(psi))
