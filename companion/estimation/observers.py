"""The motion of all degrees of freedom: samples and commands in, where they are now and `ahead_s` later out.

An observer for each is brought on to its newest samples, under the thrust that was in force, and predicts
from there through the commands that are still under way.
"""

import math
from collections.abc import Sequence

from companion.config import Config
from companion.control.bounds import clamped, wrap
from companion.control.frames import shifted, turned
from companion.control.oscillation import mean_disturbance, scaled_disturbance
from companion.control.positioning import (
    Model,
    coriolis_and_damping,
    drag_coefficient,
    inertia,
    jacobian,
    to_body,
)
from companion.estimation import hidden_delay, observer
from companion.estimation.command_history import CommandHistory
from companion.estimation.model_learner import ModelLearner
from companion.estimation.observer import Motion, ObserverState
from companion.estimation.parameters import hidden_delay_parameters, model_tables
from companion.estimation.resets import MAX_GAP_S
from companion.records import DOFS, PSI, ZERO, Delays, Flags, FrameShift, Vector, X, Y, Z, vector

PREDICTION_STEP_S = 0.035
SHORTEST_S = 1e-9

ZERO_MOVED_M = 0.05
"""A disarmed vehicle whose depth jumps by more has a new zero, as arming makes one: that is no motion."""

BELIEVABLE = 1e9
"""m, m/s, N or N·m: an estimate that is larger has diverged, for telemetry is bounded where it is decoded. It
counts as NaN, so that nothing computed from an estimate overflows: `**` would raise."""

MAX_EXTRAPOLATION_S = (0.06, 0.06, 0.045, 0.03)
"""How far, s, samples of each DOF are extrapolated to the observer's moment by its own rates. Further, its
error would feed itself: with the shipped noises it grows from 0.06 s on, in yaw from 0.035 s."""

Measurement = tuple[bool, float, float]
"""One sample of a degree of freedom: whether of its rate or its position, its value, when it was true (s)."""

Estimate = tuple[float, float, float, float, float]
"""Position and rate of one degree of freedom now, both `ahead_s` later, and its disturbance."""

LOST: Estimate = (math.nan,) * 5


class Observers:
    """The observers of x, y, z and psi, what was found of the vehicle's model, and what was sent."""

    def __init__(self, config: Config, model: Model) -> None:
        self._tick_s = 1.0 / config.loop.rate_hz
        self._hidden_parameters = hidden_delay_parameters(config, model)
        self._hidden = hidden_delay.start(0.0, 0.0)
        tables, adapts = model_tables(config, model), config.vehicle.adapts
        self.learner = ModelLearner(tables, config.thrusters.lag_s, adapts=adapts)
        """What was found of the vehicle's gain and lag."""
        self.retune(config, model)
        self.restart()

    @property
    def hidden_s(self) -> float:
        """Delay of the depth that no stamp shows."""
        return self._hidden.hidden_s

    def retune(self, config: Config, model: Model) -> None:
        """Go on from the present estimate with another model, other noises and sensor delays."""
        self.learner.retune(model_tables(config, model))
        self._model = model
        self.sensor_delay_s = [axis.sensor_delay_s for axis in config.axes]

    def restart(self) -> None:
        """Forget motion and commands."""
        self.diverged = False
        """Whether an estimate of the last step was lost: nothing is right until a restart."""
        self.commands = CommandHistory()
        self._observed_t_s: list[float] | None = None
        self._new: list[list[Measurement]] = [[] for _ in DOFS]
        self.states = [observer.at_rest(0.0) for _ in DOFS]
        for dof in range(len(DOFS)):
            self.learner.begin(dof, 0.0)
        self._hidden = hidden_delay.start(0.0, self._hidden.hidden_s)
        self._mean_disturbance: list[float] = [0.0] * len(DOFS)
        self._eta = ZERO
        self.innovation: list[float] = [0.0] * len(DOFS)
        """The newest positions minus what was expected."""

    def begin(self, dof: int, position: float) -> None:
        """Start a degree of freedom at rest at a position that was measured."""
        self._rest(dof, position)
        if dof == Z:
            self._hidden = hidden_delay.start(position, self._hidden.hidden_s)

    def take(self, dof: int, measurement: Measurement) -> None:
        """Keep a sample for the next step."""
        self._new[dof].append(measurement)

    def shift(self, shift: FrameShift) -> None:
        """Go on in the frame of a reset estimate; samples of this tick from before it are left out."""
        q, *others = (vector(column) for column in zip(*self.states, strict=True))
        columns = [shifted(shift, q), *(turned(shift, column) for column in others)]
        self.states = [ObserverState(*row) for row in zip(*columns, strict=True)]
        self._mean_disturbance = list(turned(shift, vector(self._mean_disturbance)))
        self._eta = shifted(shift, self._eta)
        self.commands.turn(shift)
        for dof in (X, Y, PSI):
            self._new[dof].clear()
            self.learner.begin(dof, self.states[dof].q)

    def lose(self, tau_ned: Vector) -> None:
        """Take from thrust and d what a motor that gives no thrust was believed to give, N and N·m.

        The commands on their way give it neither: in d alone it would be a step that is not there.
        """
        self.commands.lose(tau_ned)
        for dof, lost in enumerate(tau_ned):
            state = self.states[dof]
            self.states[dof] = state._replace(f=state.f - lost, d=state.d - lost)
            self._mean_disturbance[dof] -= lost

    def step(
        self,
        now_s: float,
        ahead_s: float,
        delays: Delays,
        stale: Flags,
        d_share: Sequence[float],
        *,
        armed: bool,
        positioned: bool,
    ) -> list[Vector]:
        """Bring each observer on to the newest measurements and predict from there to now and ahead.

        Return position and rate now, both `ahead_s` later, and the disturbance. What is `stale` rests where
        it was. `positioned` tells whether there ever was a position.
        """
        self.innovation = [0.0] * len(DOFS)
        for dof in range(len(DOFS)):
            if stale[dof]:
                self._rest(dof, self._eta[dof])
                self._new[dof].clear()
        psi = self.states[PSI].q
        J = jacobian(psi)
        nu = to_body(J, vector([one.v for one in self.states]))
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
            thrust, *thrusts = self.commands.mean_thrusts(dof, edges_s)
            gain = learner.gain(dof)
            m_eff, c_eff = m[dof] / gain, c[dof] / gain
            before_s, at_s = from_s[dof], observed_s[dof]
            state = self._observe(dof, thrust, m_eff, c_eff, before_s, at_s, (m[dof], c[dof]), armed)
            if not abs(state.q) + abs(state.v) + abs(state.f) + abs(state.d) < BELIEVABLE:
                self.diverged = True
                estimates.append(LOST)
                continue
            mean = mean_disturbance(self._mean_disturbance[dof], state.d, self._tick_s)
            self._mean_disturbance[dof] = mean
            model = observer.coefficients(learner.parameters(dof), m_eff, c_eff, step_s)
            d_hat = scaled_disturbance(mean, state.d, d_share[dof])
            trajectory = observer.predict(model, state, thrusts, d_hat)
            q, q_dot = interpolate(trajectory, (now_s - observed_s[dof]) / max(step_s, SHORTEST_S))
            q_ahead, q_dot_ahead, _ = trajectory[-1]
            # What of k + h the observer's diagonal drag leaves out it takes for disturbance.
            left_out = forces[dof] / gain - c_eff * state.v if positioned else 0.0
            estimates.append((q, q_dot, q_ahead, q_dot_ahead, state.d - left_out))
        eta, *others = (vector(column) for column in zip(*estimates, strict=True))
        self._eta = eta
        return [eta, *others]

    def _rest(self, dof: int, position: float) -> None:
        self.states[dof] = observer.at_rest(position)
        self.learner.begin(dof, position)

    def _moments(self, now_s: float, delays: Delays) -> tuple[list[float], list[float]]:
        """Return when each DOF was last observed, and when its newest measurements were true."""
        newest_s = now_s - delays.telemetry_s - 0.5 * self._tick_s
        to_s = [newest_s - later_s for later_s in self.sensor_delay_s]
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
        armed: bool,
    ) -> ObserverState:
        """Bring a DOF's observer on under the thrust that was in force, correct it, return it.

        `nominal` are m and c of the nominal vehicle.
        """
        parameters, dt_s = self.learner.parameters(dof), to_s - from_s
        state = observer.advance(parameters, self.states[dof], thrust, m, c, dt_s)
        measured, innovation = [math.nan, math.nan], [0.0, 0.0]
        if self._new[dof]:
            expected, rates = observer.expected(state), observer.rates(state, m, c)
            for of_rate, value, at_s in self._new[dof]:
                most_s = MAX_EXTRAPOLATION_S[dof]
                now = value + rates[of_rate] * clamped(to_s - at_s, -most_s, most_s)
                error = now - expected[of_rate]
                if dof == PSI and not of_rate:
                    error = wrap(error)
                elif dof == Z and not of_rate and abs(error) > ZERO_MOVED_M and not armed:
                    state = state._replace(q=state.q + error)
                    self._hidden = hidden_delay.start(now, self._hidden.hidden_s)
                    self.learner.begin(dof, now)
                    continue
                measured[of_rate], innovation[of_rate] = now, error
            self._new[dof].clear()
            self.innovation[dof] = innovation[0]
            state = observer.correct(parameters, state, *innovation)
        if dt_s > 0.0:
            self.learner.observe(dof, thrust, *nominal, dt_s, *measured)
        if dof == Z and dt_s > 0.0:
            self._hidden = hidden_delay.step(
                self._hidden_parameters, self._hidden, thrust, m, c, dt_s, *measured
            )
        self.states[dof] = state
        return state


def interpolate(trajectory: Sequence[Motion], step_index: float) -> tuple[float, float]:
    """Return position and rate on a trajectory, `step_index` steps after its start."""
    i = min(max(int(step_index), 0), len(trajectory) - 2)
    (q_0, v_0, _), (q_1, v_1, _) = trajectory[i], trajectory[i + 1]
    share = step_index - i
    return q_0 + share * (q_1 - q_0), v_0 + share * (v_1 - v_0)
