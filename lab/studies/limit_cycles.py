"""What counts as a limit cycle of a dive, and how long the longest lasted.

A limit cycle is demand faster than SLOWEST_HZ whose RMS exceeds a share of the largest force and what the sea
asks at these frequencies.
"""

from collections.abc import Sequence

import numpy as np

from companion import assembly
from companion.config import Config
from companion.core.allocation import T200_VOLTAGE_V, delivered
from companion.records import Array, AxisCommand
from lab.loop.lockstep import Step

PLACES = ("north", "east", "depth", "heading", "roll", "pitch")
"""Of the demands."""

SHARE, SLOWEST_HZ, WINDOW_S, SEA_COUNTS, TICK_S = 0.12, 0.4, 1.25, 1.5, 0.02


def found(steps: Sequence[Step], config: Config, gains: Array) -> list[float]:
    """Return the longest limit cycle of each of PLACES, s.

    `gains` (4,) is how much more strongly than the model the vehicle answers in each degree of freedom.
    """
    thrusters, most = assembly.thrusters(config), config.levelling.max_axis
    tilts = delivered(thrusters, AxisCommand(roll=most, pitch=most), T200_VOLTAGE_V)[4:]
    largest = np.array([axis.max_force for axis in config.axes] + [*tilts])
    samples = [step.sample for step in steps]
    demand = np.array(
        [(*now.dofs.tau, *delivered(thrusters, now.command, now.state.voltage_v)[4:]) for now in samples]
    )
    sea = np.array([step.truth.disturbance for step in steps])[:, [0, 1, 2, 5]] / gains
    sea = np.hstack([sea, np.zeros((len(steps), 2))])
    longest: list[float] = cycles_s(np.clip(demand, -largest, largest), largest, sea).tolist()
    return longest


def cycles_s(demand: Array, largest: Array, sea: Array) -> Array:
    """Return the longest limit cycle (s) of each column of `demand` (ticks, n), N or N·m.

    `sea` (ticks, n) is what the water's doings ask for.
    """
    beyond = _moving_rms(demand) > SHARE * largest + SEA_COUNTS * _moving_rms(sea)
    longest = []
    for column in beyond.T:
        edges = np.flatnonzero(np.diff(np.concatenate(([0], column.astype(int), [0]))))
        longest.append(TICK_S * max(edges[1::2] - edges[::2], default=0))
    return np.array(longest)


def _moving_rms(signal: Array) -> Array:
    """Return the RMS over WINDOW_S of what of each column is faster than SLOWEST_HZ."""
    hz = np.fft.rfftfreq(len(signal), TICK_S)
    keep = np.clip((hz / SLOWEST_HZ - 0.9) / 0.2, 0.0, 1.0)
    fast = np.fft.irfft(keep[:, None] * np.fft.rfft(signal, axis=0), len(signal), axis=0)
    window = np.full(round(WINDOW_S / TICK_S), TICK_S / WINDOW_S)
    power: Array = np.array([np.convolve(column, window, "valid") for column in (fast**2).T]).T
    return np.sqrt(power)
