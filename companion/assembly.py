"""From the configuration to the control room's objects: where words of the file become symbols of the law."""

import numpy as np

from companion.config import Config, ConfigError
from companion.control import allocation
from companion.control.actuation import Actuation
from companion.control.allocation import Thrusters
from companion.control.compensator import INPUTS, Compensator
from companion.control.controller import Controller, Gains
from companion.control.integrator import Integration, Integrator
from companion.control.levelling import Levelling
from companion.control.network import Learning, Network
from companion.control.oscillation import Oscillation
from companion.control.positioning import Model
from companion.control.reference import Limits, ReferenceModel
from companion.control.regressor import Regressor
from companion.control.tilt import (
    ALARM_RAD,
    FAST_N_PER_S,
    SLOW_N_PER_S,
    UNLEVELLED_ALARM_RAD,
    UNLEVELLED_N,
    TiltLimit,
)
from companion.estimation.estimator import Estimator
from companion.records import Array
from companion.supervision.guard import Envelope


def model(config: Config) -> Model:
    """Return the nominal model."""
    return Model(each(config, "mass"), each(config, "linear_damping"), each(config, "quadratic_damping"))


def thrusters(config: Config) -> Thrusters:
    """Return the frame's thrusters; roll and pitch are ours only while levelling."""
    surge, sway, heave, yaw = (axis.max_force for axis in config.axes)
    tilt = config.levelling.max_moment_nm
    max_tau = (surge, sway, heave, yaw, tilt, tilt)
    return allocation.thrusters(config.vehicle.frame, max_tau, config.levels)


def levelling(config: Config) -> Levelling | None:
    """Return what keeps roll and pitch level; None where that is not ours."""
    if not config.levels:
        return None
    chosen = config.levelling
    inertia = np.array([chosen.roll_inertia, chosen.pitch_inertia])
    return Levelling(
        inertia, chosen.frequency_radps, chosen.lever_m, chosen.max_moment_nm, config.thrusters.lag_s
    )


def tilt_limit(config: Config) -> TiltLimit:
    """Return what bounds the horizontal force: from the start where the frame cannot pitch by itself."""
    most_n = max(config.surge.max_force, config.sway.max_force) * 2.0**0.5
    if config.vehicle.frame == "vectored_6dof":
        return TiltLimit(most_n, most_n, ALARM_RAD, FAST_N_PER_S)
    return TiltLimit(UNLEVELLED_N, most_n, UNLEVELLED_ALARM_RAD, SLOW_N_PER_S)


def gains(config: Config) -> Gains:
    """Return λ, κ and what goes with them."""
    return Gains(
        lam=each(config, "lambda_per_s"),
        kappa=each(config, "kappa_per_s"),
        by_observer=np.array(["observer" in axis.compensator for axis in config.axes]),
        d_max=each(config, "max_disturbance"),
        start_delay_s=config.network.start_delay_s,
        delay_s=config.delays.gains_bear_s,
    )


def estimator(config: Config) -> Estimator:
    """Return what knows where the vehicle is."""
    return Estimator(config, model(config), thrusters(config))


def actuation(config: Config) -> Actuation:
    """Return what makes axes of a wrench."""
    return Actuation(thrusters(config), levelling(config), tilt_limit(config), max_horizontal_force(config))


def max_horizontal_force(config: Config) -> Array:
    """Return the largest force of surge and sway, (2,), N."""
    return np.array((config.surge.max_force, config.sway.max_force))


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
    drawn back for that delay. The λ and κ that keep a gain margin of 2 at a known delay (docs/theory.md, 8)
    have 1.9 to 3.8 times that T.

    Without `delay_s` it is the one believed until it has been measured. What is no faster than in `old`,
    which is in force, always passes.
    """
    if delay_s is None:
        delay_s = config.delays.telemetry_s + config.delays.command_s
    late_s = delay_s + max(config.thrusters.lag_s - config.thrusters.lead_s, 0.0)
    now = _times_s(config, delay_s)
    before = now if old is None else _times_s(old, delay_s)
    for what, found_s in now.items():
        least_s = np.full(4, late_s) if old is None else np.minimum(late_s, before[what])
        for name, axis, one_s, wanted_s in zip(AXES, config.axes, found_s, least_s, strict=True):
            if one_s < wanted_s:
                values = ", ".join(f"{name}.{key} = {getattr(axis, key):g}" for key in DYNAMIC)
                raise ConfigError(
                    f"{values}: {what} is {one_s:.3f} s and must be over {late_s:.3f} s, which the loop is "
                    f"late: {delay_s:.3f} s of delay, the rest the thrusters' lag"
                )


def _times_s(config: Config, delay_s: float) -> dict[str, Array]:
    """Return for each axis (4,) the times that have to exceed what is late, by what they are."""
    lam, kappa, learning = gains(config).scheduled(delay_s)
    strength = {"network": 0.25 * config.network.units, "regressor": 1.0, "integrator": 1.0}
    learners = np.array(
        [sum(strength.get(name, 0.0) for name in a.compensator.split("+")) for a in config.axes]
    )
    K = learners * each(config, "learning_rate") * learning
    settles_s = np.full(4, np.inf)
    np.divide(each(config, "mass") * kappa, K, out=settles_s, where=K > 0.0)
    return {"1/lambda + 1/kappa": 1.0 / lam + 1.0 / kappa, "mass kappa / learning rate": settles_s}


def controller(config: Config, nominal: Model) -> Controller:
    """Return reference, law and the compensators that were chosen."""
    d_max = each(config, "max_disturbance")
    leak, dead_zone = each(config, "leak_per_s"), each(config, "dead_zone")
    eta, eta_v = each(config, "learning_rate"), each(config, "hidden_learning_rate")
    learning = Learning(eta=eta, eta_v=eta_v, leak=leak, dead_zone=dead_zone, d_max=d_max)
    learners: dict[str, Compensator] = {
        "network": Network(learning, (4,), INPUTS, config.network.units, config.network.seed),
        "regressor": Regressor(learning, (4,)),
        "integrator": Integrator(Integration(eta, leak, dead_zone, d_max), (4,)),
    }
    chosen = {
        name: np.array([name in axis.compensator.split("+") for axis in config.axes]) for name in learners
    }
    limits = Limits(each(config, "max_rate"), each(config, "max_acceleration"))
    reference = ReferenceModel(limits, angular=np.array([False, False, False, True]))
    serving = [(serves, learners[name]) for name, serves in chosen.items() if serves.any()]
    swing = Oscillation(each(config, "max_force"))
    return Controller(nominal, gains(config), reference, serving, swing)


AXES = ("surge", "sway", "heave", "yaw")
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


def each(config: Config, key: str) -> Array:
    """Return one key of all four axes, (4,): surge, sway, heave, yaw."""
    return np.array([getattr(axis, key) for axis in config.axes])
