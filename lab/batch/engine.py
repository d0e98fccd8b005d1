"""Many companions at once: the controller's own observer, law and allocation over arrays (dives, 4).

`companion.engine` and `companion.estimation` serve one vehicle and its messages; here is their order of
things for many dives whose delays do not change, so that each tick looks up equally old commands.
Observer, reference, law, compensators and thrusters are the vehicle's own code.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from companion.config import Config
from lab.batch.legacy.allocation import Thrusters
from lab.batch.legacy.assembly import levelling, thrusters
from lab.batch.legacy.bounds import wrap
from lab.batch.legacy.compensator import INPUTS, Compensator
from lab.batch.legacy.controller import Controller, Gains
from lab.batch.legacy.hidden_delay import LARGEST_S, HiddenDelay
from lab.batch.legacy.integrator import Integration, Integrator
from lab.batch.legacy.network import Learning, Network
from lab.batch.legacy.observer import Noise, Observer
from lab.batch.legacy.oscillation import Oscillation, ScaledDisturbance
from lab.batch.legacy.pace import Pace
from lab.batch.legacy.positioning import Model, jacobian, to_body, to_inertial
from lab.batch.legacy.records import PSI, Array, Setpoint, VehicleState, Z
from lab.batch.legacy.reference import Limits, ReferenceModel
from lab.batch.legacy.regressor import Regressor
from lab.batch.legacy.rival_law import Law, RivalController
from lab.batch.vehicle import OVERRIDE_SPAN_US, Readings, Timing

DOF_INDEX = np.arange(4)
QUIET_N = 1.0

SLIPPED = 0.01
"""An axis that differs from what was wanted by more than this did not get it (engine.step)."""


class Engines:
    """The companions of many dives, engaged from the start in depth and heading; x and y are not measured."""

    def __init__(
        self, configs: Sequence[Config], timing: Timing, voltage_v: Array, rival: Law | None = None
    ) -> None:
        """Take a configuration for each dive: they may differ in their axes and `lead_s`.

        Raises ValueError where they differ in more.
        """
        _refuse(configs)
        common = configs[0]
        dives = len(configs)
        self._tick_s = 1.0 / common.loop.rate_hz
        self._voltage_v = voltage_v
        self._max_axis, self._slew = common.thrusters.max_axis, common.thrusters.max_slew_per_s * self._tick_s
        self._model = Model(*(_each(configs, key) for key in ("mass", "linear_damping", "quadratic_damping")))
        self._levelling = levelling(common)
        self._max_force = _each(configs, "max_force")
        self._thrusters = Thrusters(common.vehicle.frame, _max_tau(common, self._max_force))
        self._controller = _controller(configs, self._model)
        self._reference, self._pace = self._controller.reference, Pace()
        if rival is not None:
            self._controller = RivalController(self._controller, rival)
        self._observer = _Observers(configs, self._tick_s)
        self._hidden = _HiddenDelays(configs, self._tick_s)
        self._hidden_s = np.zeros(dives)
        self._stamped_s = timing.telemetry_s + timing.command_s
        self._every = np.arange(dives)[:, None]
        self._engaged = np.broadcast_to([False, False, True, True], (dives, 4))
        self._saturated = np.zeros((dives, 4), bool)
        self._reach = np.full(self.axes, self._max_axis)
        self._reach[4:] = common.levelling.max_axis
        self._command = np.zeros((dives, self.axes))
        self._scaled_disturbance = ScaledDisturbance(np.zeros((dives, 4)))
        self.pushed = np.zeros((dives, 4))
        """The body wrench that the last command really gives at the nominal curve, N and N·m."""

        lead_s = np.array([config.thrusters.lead_s for config in configs])
        ahead_s = timing.command_s + lead_s
        self._ahead_s = ahead_s[:, None]
        observed_s = timing.telemetry_s + 0.5 * self._tick_s
        self._to_observer_s = (timing.believed_age_s - observed_s)[:, None, None]
        self._late_s = observed_s[:, None] + _each(configs, "sensor_delay_s")
        self._command_s = timing.command_s[:, None]
        most_s = self._late_s.max() + LARGEST_S + ahead_s.max()
        self._steps = int(most_s / self._tick_s) + 1
        self._sent = np.zeros((self._steps + 4, dives, 4))
        self._tick = 0
        self._ago = np.zeros((self._steps + 2, dives, 4), int)
        self._share = np.zeros((dives, 4))
        self._look_up(slice(None))

    def _look_up(self, dofs: slice) -> None:
        """Work out how many ticks ago the commands were sent that the observer and the prediction need.

        All step by a tick, in which two commands were in force one after the other, the second for `_share`
        of it. Everyone reads off its own moment in between; the estimator makes whole steps of its one way.
        """
        began = (self._command_s + self._late_s[:, dofs]) / self._tick_s + 1.0
        first = np.ceil(np.round(began, 9))
        self._share[:, dofs] = first - began
        self._ago[:, :, dofs] = np.maximum(first - np.arange(self._steps + 2)[:, None, None], 1.0)

    def start(self, readings: Readings) -> None:
        """Engage: each controller rests where the first telemetry puts its vehicle."""
        self._observer.x[:] = 0.0
        self._observer.x[:, Z, 0] = readings.depth_m
        self._observer.x[:, PSI, 0] = readings.heading_rad
        self._hidden.restart(readings.depth_m)
        self._held = self._observer.x[..., 0].copy()
        still = np.zeros_like(self._held)
        delays = _Delays(self._stamped_s[:, None])
        self._controller.rest(_state(self._held, still, still, 0.0, delays))

    def step(self, setpoint: Setpoint, readings: Readings) -> Array:
        """Return the axes (dives, `axes`) that go out, in whole µs; a NaN target means: where it began."""
        J, state = self._estimate(readings)
        self._reference.pace = self._pace.step(1.0, self._saturated, self._tick_s)
        target = Setpoint(
            np.where(np.isnan(setpoint.eta_d), self._held, setpoint.eta_d),
            setpoint.eta_d_dot,
            setpoint.eta_d_ddot,
        )
        dofs = self._controller.step(state, J, target, self._engaged, ~self._saturated, self._tick_s)
        reach = self._reach
        asked = self._levelled(to_body(J, dofs.tau), readings)
        wanted = self._thrusters.allocate(asked, cast(float, self._voltage_v), reach)
        within = np.clip(wanted.axes, -reach, reach)
        self._command = self._command + np.clip(within - self._command, -self._slew, self._slew)
        applied = np.rint(OVERRIDE_SPAN_US * self._command) / OVERRIDE_SPAN_US
        self.pushed = self._thrusters.delivered(applied, cast(float, self._voltage_v))[:, :4]
        self._sent[self._tick % len(self._sent)] = to_inertial(J, self.pushed)
        self._tick += 1
        self._saturated = (wanted.saturated | (np.abs(applied - wanted.axes) > SLIPPED))[:, :4]
        self._saturated[:, :2] = self._saturated[:, :1] | self._saturated[:, 1:2]
        return applied

    @property
    def axes(self) -> int:
        """How many axes are steered."""
        return int(self._thrusters.axes)

    def _levelled(self, pushed: Array, readings: Readings) -> Array:
        """Return the wrench (dives, `axes`) with the moments that keep it level (engine.py)."""
        if self._levelling is None:
            return pushed
        moments = self._levelling.step(
            readings.angles_rad,
            readings.rates_radps,
            np.clip(self.pushed[:, :2], -self._max_force[:, :2], self._max_force[:, :2]),
            self._stamped_s[:, None],
            self._tick_s,
            learn=True,
        )
        return np.concatenate((pushed, moments[:, : self.axes - 4]), axis=-1)

    def _estimate(self, readings: Readings) -> tuple[Array, VehicleState]:
        """Bring the observer forward, correct it, predict to where a command sent now acts."""
        observer, model = self._observer, self._model
        J = jacobian(observer.x[:, PSI, 0])
        m = model.inertia(J)
        c = model.drag_coefficient(J, to_body(J, observer.x[..., 1]))
        dt_s = np.full(self._late_s.shape, self._tick_s)
        dt_s[:, Z] += self._hidden_s - self._hidden.hidden_s
        self._late_s[:, Z] += self._hidden.hidden_s - self._hidden_s
        self._hidden_s = self._hidden.hidden_s
        heave = slice(Z, Z + 1)
        self._look_up(heave)
        sent = self._sent[(self._tick - self._ago) % len(self._sent), self._every, DOF_INDEX]
        u = sent[:-1] + self._share * (sent[1:] - sent[:-1])
        observer.advance(u[0], m, c, dt_s)
        new = np.stack(
            [readings.depth_m, readings.sink_mps, readings.heading_rad, readings.heading_rate_radps], axis=-1
        ).reshape(-1, 2, 2)
        expected, rates = observer.expected[:, [Z, PSI]], observer.rates(m, c)[:, [Z, PSI]]
        now = new + rates * self._to_observer_s
        self._hidden.step(u[0][:, Z], m[..., Z], c[..., Z], dt_s[:, Z], now[:, 0])
        missed = now - expected
        missed[:, 1, 0] = wrap(missed[:, 1, 0])
        innovation = np.zeros((len(new), 4, 2))
        innovation[:, [Z, PSI]] = missed
        observer.correct(innovation)

        scale = self._controller.gain_scale
        d_hat = self._scaled_disturbance.step(observer.disturbance, scale, self._tick_s)
        way = observer.predict(u[1:], m, c, self._tick_s, d_hat)
        q, v = (np.stack([moment[i] for moment in way]) for i in (0, 1))
        place = (self._late_s + self._ahead_s) / self._tick_s
        last = np.minimum(place.astype(int), self._steps - 1)
        share = place - last
        v_0, v_1 = v[last, self._every, DOF_INDEX], v[last + 1, self._every, DOF_INDEX]
        eta_dot = v_0 + share * (v_1 - v_0)
        eta = q[last, self._every, DOF_INDEX] + (0.5 * self._tick_s) * share * (v_0 + eta_dot)
        eta[:, PSI] = wrap(eta[:, PSI])
        delays = _Delays((self._stamped_s + self._hidden.hidden_s)[:, None])
        return jacobian(eta[:, PSI]), _state(eta, eta_dot, observer.disturbance, self._ahead_s, delays)


@dataclass(frozen=True, slots=True)
class _Foreseen:
    """The part of a VehicleState that the controller reads, (dives, 4)."""

    eta_ahead: Array
    eta_dot_ahead: Array
    disturbance: Array
    ahead_s: Array | float
    delays: "_Delays"


@dataclass(frozen=True, slots=True)
class _Delays:
    """What the controller reads of `Delays`, (dives, 1)."""

    total_s: Array


def _state(
    eta: Array, eta_dot: Array, disturbance: Array, ahead_s: Array | float, delays: "_Delays"
) -> VehicleState:
    return cast(VehicleState, _Foreseen(eta, eta_dot, disturbance, ahead_s, delays))


class _Observers(Observer):
    """The observer, with the gains of every different configuration handed to its dives."""

    def __init__(self, configs: Sequence[Config], dt_s: float) -> None:
        different, which = _different(configs)
        noise = _noise(different)
        mass, drag = (_flat(different, key) for key in ("mass", "linear_damping"))
        drag = drag + 0.1 * _flat(different, "quadratic_damping")
        super().__init__(mass, drag, configs[0].thrusters.lag_s, noise, dt_s)
        self._gain = self._gain.reshape(len(different), 4, 6, 2)[which]
        self.x = np.zeros((len(configs), 4, 6))


class _HiddenDelays(HiddenDelay):
    """The search for hidden delay in heave, each dive with the gains of its configuration."""

    def __init__(self, configs: Sequence[Config], dt_s: float) -> None:
        different, which = _different(configs)
        lag_s = configs[0].thrusters.lag_s
        each = []
        for config in different:
            heave = config.heave
            m, c = np.array([heave.mass]), np.array([heave.linear_damping + 0.1 * heave.quadratic_damping])
            each.append(Observer(m, c, lag_s, _noise([config]).of(Z, QUIET_N), dt_s))
        super().__init__(m, c, lag_s, _noise([config]).of(Z, QUIET_N), dt_s)
        self._observer._gain = np.stack([observer._gain for observer in each])[which]


def _noise(configs: Sequence[Config]) -> Noise:
    """Return the noise of all configurations' axes, flat: (configs · 4,)."""
    return Noise(
        position=_flat(configs, "position_noise"),
        rate=_flat(configs, "rate_noise"),
        position_slow=_flat(configs, "position_noise_slow"),
        rate_slow=_flat(configs, "rate_noise_slow"),
        disturbance=_flat(configs, "disturbance_noise"),
        slow_time_s=configs[0].delays.slow_noise_s,
    )


def _different(configs: Sequence[Config]) -> tuple[list[Config], list[int]]:
    """Return the different configurations, and which of them each dive has."""
    different: list[Config] = []
    for config in configs:
        if config not in different:
            different.append(config)
    return different, [different.index(config) for config in configs]


def _flat(configs: Sequence[Config], key: str) -> Array:
    return _each(configs, key).reshape(-1)


def _controller(configs: Sequence[Config], model: Model) -> Controller:
    """Build the control room for many dives: assembly.controller over arrays (dives, 4)."""
    shape = model.m.shape
    d_max, dead_zone = _each(configs, "max_disturbance"), _each(configs, "dead_zone")
    named = np.array([[axis.compensator for axis in config.axes] for config in configs])
    by_observer = np.char.find(named, "observer") >= 0
    start_delay_s = configs[0].network.start_delay_s
    lam, kappa = _each(configs, "lambda_per_s"), _each(configs, "kappa_per_s")
    bears_s = np.array([[config.delays.gains_bear_s] for config in configs])
    leak = _each(configs, "leak_per_s")
    eta, eta_v = _each(configs, "learning_rate"), _each(configs, "hidden_learning_rate")
    learning = Learning(eta=eta, eta_v=eta_v, leak=leak, dead_zone=dead_zone, d_max=d_max)
    network = configs[0].network
    learners: dict[str, Compensator] = {
        "network": Network(learning, shape, INPUTS, network.units, network.seed),
        "regressor": Regressor(learning, shape),
        "integrator": Integrator(Integration(eta, leak, dead_zone, d_max), shape),
    }
    chosen = {name: np.char.find(named, name) >= 0 for name in learners}
    gains = Gains(lam, kappa, by_observer, d_max, start_delay_s, bears_s)
    limits = Limits(_each(configs, "max_rate"), _each(configs, "max_acceleration"))
    reference = ReferenceModel(limits, angular=np.array([False, False, False, True]))
    serving = [(chosen[name], learners[name]) for name in learners if chosen[name][:, [Z, PSI]].any()]
    swing = Oscillation(_each(configs, "max_force"))
    return Controller(model, gains, reference, serving, swing)


def _each(configs: Sequence[Config], key: str) -> Array:
    """Return one key of all axes, (dives, 4)."""
    return np.array([[getattr(axis, key) for axis in config.axes] for config in configs], float)


def _max_tau(common: Config, max_force: Array) -> Array:
    """Return the largest wrench, (dives, axes): with roll and pitch where they are ours."""
    tilts = thrusters(common).axes - 4
    return np.pad(max_force, ((0, 0), (0, tilts)), constant_values=common.levelling.max_moment_nm)


def _refuse(configs: Sequence[Config]) -> None:
    """Raise ValueError where configurations of one batch differ in more than axes and lead."""
    first = configs[0]
    if first.vehicle.thrust_path != "rc_override":
        raise ValueError("a batch steers by rc_override: set vehicle.thrust_path")
    for config in configs:
        same = (
            config.loop == first.loop
            and config.network == first.network
            and config.vehicle == first.vehicle
            and config.levelling == first.levelling
            and config.delays.slow_noise_s == first.delays.slow_noise_s
            and config.thrusters.lag_s == first.thrusters.lag_s
            and config.thrusters.max_axis == first.thrusters.max_axis
            and config.thrusters.max_slew_per_s == first.thrusters.max_slew_per_s
        )
        if not same:
            raise ValueError("configurations of one batch may differ in their axes and thrusters.lead_s only")
