"""What the vehicle's motion shows around it: the ground, the current, and whether the heading is right."""

import math

import msgspec

from companion.config import Config
from companion.core.attitude import angle_rates
from companion.core.observers import Estimates
from companion.core.positioning import Model
from companion.estimation.estimator import Sensed
from companion.estimation.ground import Grounds
from companion.estimation.heading_watch import HeadingWatch, HeaveWatch
from companion.estimation.water import Water
from companion.records import PSI, ZERO, Current, Ground, HeadingCheck, Vector, VehicleModel, X, Y, Z

LEVEL_COS = math.cos(math.radians(45.0))
"""Tilted by more, a vehicle is not moved up and down by its vertical thrust."""


class Around(msgspec.Struct, frozen=True):
    """What was found."""

    ground: Ground
    current: Current
    heading_check: HeadingCheck
    heave_opposed: bool


class Surroundings:
    """Finds ground, current and heading: call `step` once a tick."""

    def __init__(self, config: Config, model: Model) -> None:
        self._range_s = config.delays.range_s
        self._tick_s = 1.0 / config.loop.rate_hz
        self.retune(config, model)
        self._restart()

    def retune(self, config: Config, model: Model) -> None:
        """Go on with another model."""
        self._model, self._position_s = model, config.surge.sensor_delay_s

    def _restart(self) -> None:
        self._ground, self._water = Grounds(self._range_s), Water()
        self._heading, self._heave = HeadingWatch(), HeaveWatch()

    @property
    def drift(self) -> complex:
        """The error of the EKF's velocity, m/s: north + i east."""
        return self._water.drift

    def trust_heading(self) -> None:
        """Forget what was reported of the heading: the operator engages again."""
        self._heading.restart()

    def step(
        self,
        sensed: Sensed,
        motion: Estimates,
        model: VehicleModel,
        delivered: Vector = ZERO,
        *,
        whole: bool = True,
        heaves: bool = False,
    ) -> Around:
        """Take a tick; `delivered` is the body wrench of the last command, N and N·m.

        `whole` tells that no motor is known to fail, `heaves` that heave is ours, with any authority.
        """
        if sensed.restarted:
            self._restart()
        inputs, tick_s = sensed.inputs, self._tick_s
        stale, learns, (roll, pitch, *_) = inputs.stale, inputs.learns, inputs.attitude
        *_, turning = angle_rates(*inputs.attitude)
        placed = not (stale[X] or stale[Y] or stale[PSI])
        tilt_cos = math.nan if stale[PSI] or stale[Z] else math.cos(roll) * math.cos(pitch)
        self._heading.turn(inputs.positions[PSI][0], turning, tick_s, learns[PSI] and not stale[PSI])
        self._heading.push(
            complex(inputs.rates[X][0], inputs.rates[Y][0]),
            motion.eta[PSI],
            delivered,
            self._model,
            model,
            sensed.delays.total_s + self._position_s,
            tick_s,
            sensed.held and whole and placed,
        )
        seen = learns[X] and learns[Y] and placed
        return Around(
            ground=self._ground.step(
                inputs.now_s, sensed.ranges, motion.eta[Z], tilt_cos, inputs.telemetry_s
            ),
            current=self._water.step(self._model, motion, model.dof_gain, tick_s, seen, sensed.still),
            heading_check=self._heading.check,
            heave_opposed=self._heave.step(
                inputs.rates[Z][0],
                delivered[Z],
                self._model,
                model,
                sensed.delays.total_s,
                tick_s,
                heaves and tilt_cos > LEVEL_COS,
            ),
        )
