"""From the configuration to the control room's objects: where words of the file become symbols of the law."""

import numpy as np

from companion.config import Config, ConfigError
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
from companion.thrust import Thrusters
from companion.types import Array


def model(config: Config) -> Model:
    """Return the nominal model."""
    return Model(each(config, "mass"), each(config, "linear_damping"), each(config, "quadratic_damping"))


def thrusters(config: Config) -> Thrusters:
    """Return the frame's thrusters with the axes that are ours: roll and pitch only while levelling."""
    tilts = (2 if config.vehicle.frame == "vectored_6dof" else 1) if config.levels else 0
    max_tau = np.append(each(config, "max_force"), np.full(tilts, config.levelling.max_moment_nm))
    return Thrusters(config.vehicle.frame, max_tau)


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


def refuse_fast_gains(config: Config, delay_s: float | None = None, old: Config | None = None) -> None:
    """Raise ConfigError for an axis whose λ and κ a loop that is `delay_s` late cannot be trusted with.

    The law's q'' = −(λ + κ) q' − λκ q behind a lag T is T s³ + s² + (λ + κ) s + λκ = 0: stable if and only if
    1/λ + 1/κ > T (Routh-Hurwitz). T is all that is late, the delay and what `thrusters.lead_s` leaves of the
    thrusters' lag, as if nothing were predicted. λ and κ are those drawn back for that delay. The gains that
    keep a gain margin of 2 at a known delay (shared/paper.md) have 1.9 to 3.8 times that.

    Without `delay_s` it is the one believed until it has been measured. Gains that are no faster than those
    of `old`, which are in force, always pass.
    """
    if delay_s is None:
        delay_s = config.delays.telemetry_s + config.delays.command_s
    late_s = delay_s + max(config.thrusters.lag_s - config.thrusters.lead_s, 0.0)
    slow_s = _slowness_s(config, delay_s)
    least_s = np.full(4, late_s) if old is None else np.minimum(late_s, _slowness_s(old, delay_s))
    for name, axis, found_s, wanted_s in zip(AXES, config.axes, slow_s, least_s, strict=True):
        if found_s < wanted_s:
            raise ConfigError(
                f"{name}.lambda_per_s = {axis.lambda_per_s:g}, {name}.kappa_per_s = {axis.kappa_per_s:g}: "
                f"1/lambda + 1/kappa is {found_s:.3f} s and must be over {late_s:.3f} s, which the loop is "
                f"late: {delay_s:.3f} s of delay, the rest the thrusters' lag; lower one of them"
            )


def _slowness_s(config: Config, delay_s: float) -> Array:
    """Return 1/λ + 1/κ (4,), drawn back for `delay_s`."""
    lam, kappa, _ = gains(config).softened(delay_s)
    return 1.0 / lam + 1.0 / kappa


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
