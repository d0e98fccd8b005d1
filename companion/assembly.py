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
from companion.control.tilt import ALARM_RAD, UNLEVELLED_ALARM_RAD, UNLEVELLED_N, TiltLimit
from companion.thrust import Thrusters
from companion.types import Array

OSCILLATION_SHARE = 0.12
"""Of an axis' largest force: faster demand than any sea's, above this RMS, is the loop's own swinging."""


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
        return TiltLimit(most_n, most_n, ALARM_RAD)
    return TiltLimit(UNLEVELLED_N, most_n, UNLEVELLED_ALARM_RAD)


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
    gains = Gains(
        lam=each(config, "lambda_per_s"),
        kappa=each(config, "kappa_per_s"),
        by_observer=np.array(["observer" in axis.compensator for axis in config.axes]),
        d_max=d_max,
        start_delay_s=config.network.start_delay_s,
        delay_s=config.delays.gains_bear_s,
    )
    limits = Limits(each(config, "max_rate"), each(config, "max_acceleration"))
    reference = ReferenceModel(limits, angular=np.array([False, False, False, True]))
    serving = [(serves, learners[name]) for name, serves in chosen.items() if serves.any()]
    swing = Oscillation(OSCILLATION_SHARE * each(config, "max_force"))
    return Controller(nominal, gains, reference, serving, swing)


LIVE = ("surge", "sway", "heave", "yaw", "supervisor")
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
