"""Builds the parts of the controller from the configuration: keys of the file become symbols of the law."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from msgspec.structs import asdict

from companion import registry
from companion.config import AxisSection, Config, ConfigError, Network
from companion.core import allocation, oscillation, predictor, reference, thruster_watch
from companion.core.actuation import Actuation
from companion.core.allocation import Thrusters
from companion.core.axis import Axis as AxisControl
from companion.core.compensator import INPUTS, NO_COMPENSATOR, ChosenCompensator
from companion.core.controller import Control
from companion.core.law import ChosenLaw
from companion.core.levelling import NO_LEVELLING, Levelling, levelling_of
from companion.core.observers import Observers
from companion.core.positioning import Model
from companion.core.schedule import Gains, scheduled
from companion.core.tick import Parameters
from companion.core.tilt import (
    ALARM_RAD,
    LEVELLED_N_PER_S,
    SLOW_N_PER_S,
    UNLEVELLED_ALARM_RAD,
    UNLEVELLED_N,
    TiltLimit,
)
from companion.estimation.estimator import Estimator
from companion.estimation.observer_design import disturbance_lag_s, hidden_delay_parameters, model_tables
from companion.estimation.surroundings import Surroundings
from companion.records import AXES, PSI, vector
from companion.registry import LYAPUNOV, OBSERVER, PREDICTED, Compensator, Law
from companion.supervision.guard import Envelope


def model(config: Config) -> Model:
    """Return the nominal model."""
    return Model(
        vector([axis.mass for axis in config.axes]),
        vector([axis.linear_damping for axis in config.axes]),
        vector([axis.quadratic_damping for axis in config.axes]),
        config.vehicle.coriolis_share,
    )


def thrusters(config: Config) -> Thrusters:
    """Return the frame's thrusters; roll and pitch are ours only while levelling."""
    surge, sway, heave, yaw = (axis.max_force for axis in config.axes)
    tilt = config.levelling.max_moment_nm
    max_tau = (surge, sway, heave, yaw, tilt, tilt)
    return allocation.thrusters(config.vehicle.frame, max_tau, config.levels)


def levelling(config: Config) -> tuple[Levelling, Levelling]:
    """Return what keeps roll and pitch level, where that is ours."""
    if not config.levels:
        return NO_LEVELLING, NO_LEVELLING
    chosen, lag_s = config.levelling, config.thrusters.lag_s
    omega, lever_m, most_nm = chosen.frequency_radps, chosen.lever_m, chosen.max_moment_nm
    munk_roll, munk_pitch = munk_m(config, config.sway), munk_m(config, config.surge)
    return (
        levelling_of(chosen.roll_inertia, omega, lever_m, most_nm, lag_s, munk_roll),
        levelling_of(chosen.pitch_inertia, omega, -lever_m, most_nm, lag_s, munk_pitch),
    )


def munk_m(config: Config, along: AxisSection) -> float:
    """Return the Munk moment that a push along a horizontal axis makes, per newton and radian of tilt, m."""
    unequal = max(config.heave.mass - along.mass, 0.0)
    return unequal / along.quadratic_damping if along.quadratic_damping else 0.0


def tilt_limit(config: Config) -> TiltLimit:
    """Return what bounds the horizontal force: from the start where the frame cannot pitch by itself."""
    most_n = max(config.surge.max_force, config.sway.max_force) * 2.0**0.5
    if config.vehicle.frame == "vectored_6dof":
        return TiltLimit(most_n, most_n, ALARM_RAD, LEVELLED_N_PER_S, True)
    return TiltLimit(UNLEVELLED_N, most_n, UNLEVELLED_ALARM_RAD, SLOW_N_PER_S)


def gains(config: Config, axis: AxisSection) -> Gains:
    """Return λ and κ of an axis, and the delay that they tolerate."""
    return Gains(lam=axis.lambda_per_s, kappa=axis.kappa_per_s, tolerated_s=config.delays.gains_bear_s)


def estimator(config: Config) -> Estimator:
    """Return what takes in a tick's events."""
    return Estimator(config, thrusters(config))


def surroundings(config: Config) -> Surroundings:
    """Return what finds ground, current and heading."""
    return Surroundings(config, model(config))


def observers(config: Config) -> Observers:
    """Return what observes the degrees of freedom."""
    nominal = model(config)
    x, y, z, psi = model_tables(config, nominal)
    return Observers(
        nominal,
        (x, y, z, psi),
        hidden_delay_parameters(config, nominal),
        hidden_s=config.thrusters.delay_s,
        lag_s=config.thrusters.lag_s,
        adapts=config.vehicle.adapts,
        sensor_delay_s=vector([axis.sensor_delay_s for axis in config.axes]),
        tick_s=1.0 / config.loop.rate_hz,
        predictors=vector([predictor_of(config, dof) for dof in range(len(AXES))]),
        d_lag_s=vector([disturbance_lag_s(config, nominal, dof) for dof in range(len(AXES))]),
    )


def predictor_of(config: Config, dof: int) -> predictor.Parameters:
    """Return the network that predicts the disturbance of a degree of freedom."""
    axis, V = config.axes[dof], hidden_layer(config.network, predictor.INPUTS)
    parameters = predictor.Parameters(
        V=V,
        rest=(0.0,) * len(V),
        disturbance_noise=axis.disturbance_noise,
        max_disturbance=axis.max_disturbance,
        tick_s=1.0 / config.loop.rate_hz,
        turn=dof,
        predicts=predicts(axis),
    )
    return parameters._replace(rest=tuple(predictor.hidden(parameters, predictor.AT_REST)))


def parameters(config: Config) -> Parameters:
    """Return what a tick needs to know beforehand."""
    levelling, yaw, lag_s = config.levelling, config.yaw, config.thrusters.lag_s
    watch = thruster_watch.Parameters(
        thrusters(config), levelling.roll_inertia, levelling.pitch_inertia, yaw.mass, lag_s
    )
    return Parameters(observers(config), control(config), actuation(config), watch)


def actuation(config: Config) -> Actuation:
    """Return what makes axes of a wrench."""
    roll, pitch = levelling(config)
    max_force = (config.surge.max_force, config.sway.max_force)
    righting_nm = (config.levelling.roll_righting_nm, config.levelling.pitch_righting_nm)
    return Actuation(
        thrusters(config),
        config.levels,
        roll,
        pitch,
        tilt_limit(config),
        max_force,
        righting_nm,
        config.yaw.mass,
    )


def envelope(config: Config) -> Envelope:
    """Return what may leave this machine."""
    limits = config.thrusters
    return Envelope(
        limits.max_axis, limits.max_slew_per_s, config.levelling.max_axis if config.levels else 0.0
    )


DYNAMIC = ("lambda_per_s", "kappa_per_s", "learning_rate")


def refuse_fast_gains(config: Config, delay_s: float | None = None, old: Config | None = None) -> None:
    """Raise ConfigError for an axis whose gains a loop that is `delay_s` late cannot be trusted with.

    Routh-Hurwitz, with a lag T for all that is late: the delay and what `thrusters.lead_s` leaves of the
    thrusters' lag, as if nothing were predicted.

        the law        T s³ + s² + (λ + κ) s + λκ = 0   is stable if and only if   1/λ + 1/κ > T
        what learns    T s³ + s² + κ s + K/m = 0        (ε, integrated by K)       m κ/K > T

    K is the learning rate, n/4 times as large for a network of n units (its outputs are ½ at rest). All are
    reduced for that delay. The λ and κ that keep a gain margin of 2 at a known delay (docs/theory.md, 6)
    have 1.9 to 3.8 times that T.

    Without `delay_s` it is the one believed until it has been measured. What is no faster than in `old`,
    which is in force, always passes. A law other than the paper's is its author's to judge.
    """
    if delay_s is None:
        delay_s = config.delays.telemetry_s + config.delays.command_s
    late_s = delay_s + max(config.thrusters.from_rest_s - config.thrusters.lead_s, 0.0)
    now = _times_s(config, delay_s)
    before = now if old is None else _times_s(old, delay_s)
    for what, found_s in now.items():
        least_s = [min(late_s, before_s) if old is not None else late_s for before_s in before[what]]
        for name, axis, one_s, wanted_s in zip(AXES, config.axes, found_s, least_s, strict=True):
            if one_s < wanted_s:
                values = ", ".join(f"{name}.{key} = {getattr(axis, key):g}" for key in DYNAMIC)
                raise ConfigError(
                    f"{values}: {what} is {one_s:.3f} s and must be over {late_s:.3f} s, which the loop is "
                    f"late: {delay_s:.3f} s of delay, the rest the thrusters' lag"
                )


def _times_s(config: Config, delay_s: float) -> dict[str, list[float]]:
    """Return for each axis the times that have to exceed what is late, by what they are."""
    laws, settling = [], []
    for axis in config.axes:
        left = scheduled(gains(config, axis), delay_s, 1.0)
        lam, kappa = left.gains.lam, left.gains.kappa
        K = compensator(config, axis)[1] if axis.law == LYAPUNOV else 0.0
        laws.append(1.0 / lam + 1.0 / kappa if axis.law == LYAPUNOV else math.inf)
        settling.append(axis.mass * kappa / (K * left.share * left.share) if K > 0.0 else math.inf)
    return {"1/lambda + 1/kappa": laws, "mass kappa / learning rate": settling}


def control(config: Config) -> Control:
    """Return reference, law and the compensators that were chosen."""
    x, y, z, psi = (axis_control(config, number) for number in range(len(AXES)))
    return Control(model(config), (x, y, z, psi))


def predicts(axis: AxisSection) -> bool:
    """Return whether the network predicts an axis' disturbance."""
    return axis.compensator == PREDICTED


def axis_control(config: Config, number: int) -> AxisControl:
    """Return how a degree of freedom is controlled."""
    axis = config.axes[number]
    return AxisControl(
        gains=gains(config, axis),
        reference=reference.Parameters(axis.max_rate, axis.max_acceleration, angular=number == PSI),
        oscillation=oscillation.Parameters(
            axis.max_force,
            oscillation.SHARES[number] * axis.max_force,
            first=oscillation.FIRST_SCALES[number],
        ),
        law=law(config, axis),
        compensator=compensator(config, axis)[0],
        by_observer=by_observer(axis),
        predicts=predicts(axis),
        max_disturbance=axis.max_disturbance,
    )


def by_observer(axis: AxisSection) -> bool:
    """Return whether the observer's d is fed back on an axis."""
    return predicts(axis) or OBSERVER in axis.compensator.split("+")


def compensator(config: Config, axis: AxisSection) -> tuple[ChosenCompensator, float]:
    """Return what learns on an axis, and the gain by which it integrates −ε near rest."""
    known = registry.compensators(config.compensators)
    name = registry.learner(axis.compensator, known)
    if not name:
        return NO_COMPENSATOR, 0.0
    functions = known[name]
    shared = asdict(config.network) | {"hidden": hidden_layer(config.network, INPUTS)}
    values = asdict(axis) | shared | config.compensators.get(name, {})
    parameters = parameters_of(functions, values, name)
    chosen = ChosenCompensator(
        functions.initial, functions.step, functions.seed, functions.weight_norm, parameters
    )
    return chosen, functions.integral_gain(parameters)


@cache
def hidden_layer(network: Network, inputs: int) -> tuple[Any, ...]:
    """Return V of a network at first, a column a unit, each N(0, 1)."""
    columns = np.random.default_rng(network.seed).standard_normal((inputs, network.units)).T
    return tuple(map(tuple, columns.tolist()))


def law(config: Config, axis: AxisSection) -> ChosenLaw:
    """Return the law of an axis."""
    functions = registry.laws(config.laws)[axis.law]
    shared = {"lag_s": config.thrusters.lag_s, "lead_s": config.thrusters.lead_s}
    values = asdict(axis) | shared | config.laws.get(axis.law, {})
    return ChosenLaw(functions.initial, functions.step, parameters_of(functions, values, axis.law))


def parameters_of(functions: Compensator | Law, values: Mapping[str, Any], name: str) -> Any:
    """Return the parameters of a compensator or a law; raise ConfigError where the values do not fit."""
    try:
        parameters = functions.parameters(values)
        registry.refuse_misshapen(functions, parameters)
        return parameters
    except registry.UnusableError as error:
        raise ConfigError(f"{name}: {error}") from error


LIVE = (*AXES, "supervisor")
"""The sections that may change while running; the rest is built into links, clocks and sizes."""


def changed(old: Config, new: Config) -> set[str]:
    """Return the sections in which `new` differs, all of them LIVE.

    Raises ConfigError naming the section that cannot change while running.
    """
    names = {name for name in Config.__struct_fields__ if getattr(old, name) != getattr(new, name)}
    if fixed := names.difference(LIVE):
        raise ConfigError(
            f"{', '.join(sorted(fixed))}: cannot change while running; of the file only {', '.join(LIVE)} can"
        )
    return names
