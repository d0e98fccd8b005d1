"""A sonar that looks down: what it hears over the seabed, and what may be wrong with it."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from sim_bridge.physics.plant import State, down_axis
from sim_bridge.sim_config import Seabed, SensorConfig

LIMITS_M, WHITE_M, PERIOD_S = (0.3, 50.0), 0.01, 0.1
"""A Ping, assumed: least and largest range, noise, and time between two."""

STEEPEST_ECHO = 0.5
"""Cosine of the tilt from which it hears nothing. Assumed: a tilt of 60°."""


class RangeFault(NamedTuple):
    """What is wrong with it (`FAULT_KINDS`)."""

    false_m: float | None = None
    """NaN hears nothing; None is sound."""
    answers: float = 1.0
    scale: float = 1.0


class Rangefinder:
    """Tells a range every period, late by its delay; `range_m` is NaN for no echo."""

    def __init__(
        self, config: SensorConfig, step_s: float, rng: np.random.Generator, seabed: Seabed | None
    ) -> None:
        self.range_m = math.nan
        self.fault = RangeFault()
        self._rng = rng
        self._seabed = seabed if config.rangefinder else None
        self._echoes: deque[float] = deque()
        self._sound_m = math.nan
        self._steps = max(1, round(PERIOD_S / step_s))
        self._late = round(config.range_delay_s / (self._steps * step_s))

    def step(self, count: int, state: State) -> None:
        """Go on by one step, the `count`-th."""
        if self._seabed and count % self._steps == 0:
            self._echoes.append(self._echo(self._seabed, state))
            if len(self._echoes) > self._late:
                self.range_m = self._echoes.popleft()

    def _echo(self, seabed: Seabed, state: State) -> float:
        """Return the range along the hull's own down axis (m); NaN for no echo."""
        fault = self.fault
        if fault.false_m is not None:
            return fault.false_m
        down = down_axis(state)[2]
        if down < STEEPEST_ECHO:
            return math.nan
        range_m = (seabed.depth_at(state[0], state[1]) - state[2]) / down
        if fault.answers == 1.0 or math.isnan(self._sound_m):
            self._sound_m = range_m
        range_m = fault.scale * (self._sound_m + fault.answers * (range_m - self._sound_m))
        range_m += WHITE_M * float(self._rng.standard_normal())
        return range_m if LIMITS_M[0] <= range_m <= LIMITS_M[1] else math.nan
