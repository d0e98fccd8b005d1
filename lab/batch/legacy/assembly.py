"""Thrusters and levelling of the array form (companion.assembly)."""

import numpy as np

from companion.config import Config
from lab.batch.legacy.allocation import Thrusters
from lab.batch.legacy.levelling import Levelling
from lab.batch.legacy.records import Array


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


def each(config: Config, key: str) -> Array:
    """Return one key of all four axes, (4,): surge, sway, heave, yaw."""
    return np.array([getattr(axis, key) for axis in config.axes])
