"""The vehicle's body in the water: thrusters, hull, sea, tether, load and battery, driven by motor PWM alone.

It knows no autopilot: `sim_bridge.vehicle` drives it with our stand-in firmware, `sim_bridge.json_physics`
with the real one.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_bridge.config import SimConfig
from sim_bridge.physics.environment import Environment, Flow, Force
from sim_bridge.physics.plant import Plant, euler, state_of
from sim_bridge.physics.thrusters import Thrusters

STEP_S = 0.005
"""Longest step of the plant, and the period at which the sea and the tether change."""
MIN_VOLTAGE_V = 6.0
IDLE_CURRENT_A = 0.5


class Physics:
    """One body, from the configured state on. The same configuration, seed and PWM give the same motion.

    `time_s` counts from its creation; the sea depends on it and on the seed alone, whatever the steps.
    """

    def __init__(self, config: SimConfig, seed: int) -> None:
        self.time_s = 0.0
        self.state: tuple[float, ...] = state_of(config.initial.eta, np.zeros(6))
        """x, y, z (m, NED), unit quaternion body to NED, nu (m/s, rad/s, body)."""
        self.nu_dot: tuple[float, ...] = (0.0,) * 6
        """In the middle of the last step (m/s², rad/s², body)."""
        self.tau: tuple[float, ...] = (0.0,) * 6
        """Wrench of the thrusters (N, N·m, body)."""
        self.thrusters = Thrusters(config.thrusters)
        self.environment = Environment(config, STEP_S, np.random.default_rng(seed).spawn(1)[0])
        self.voltage_v = config.battery.voltage_v
        self.current_a = 0.0
        self.consumed_mah = 0.0
        self._battery = config.battery
        self._plant = Plant.of(config.hull)
        self._sea_steps = 0
        self._force: Force = (0.0, 0.0, 0.0)
        self._flow: Flow = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._driven: list[int] = []
        self._static_thrust = np.zeros(self.thrusters.count)

    def step(self, pwm: Sequence[int], since_arming_s: float, dt_s: float = STEP_S) -> None:
        """Advance by `dt_s`, however long.

        Args:
            pwm: of each motor, µs; what exceeds the number of thrusters is ignored.
            since_arming_s: time since the first arming, negative before it; the load's timetable.
            dt_s: time to advance (s).

        """
        thrusters = self.thrusters
        driven = list(pwm[: thrusters.count])
        if self._driven != driven:
            self._driven = driven
            self._static_thrust = thrusters.static_thrust(driven, self.voltage_v)
        parts = max(1, math.ceil(dt_s / STEP_S - 1e-6))
        for part in range(parts):
            time_s = self.time_s + part * dt_s / parts
            if time_s > (self._sea_steps - 1e-6) * STEP_S:
                x, y, z = self.state[:3]
                self._force, self._flow = self.environment.step(
                    self._sea_steps * STEP_S, since_arming_s, x, y, z
                )
                self._sea_steps += 1
            self.tau = tuple(thrusters.step(self._static_thrust, dt_s / parts).tolist())
            self.state, self.nu_dot = self._plant.step(
                self.state, self.tau, self._force, self._flow, dt_s / parts
            )
        self.time_s += dt_s

    def drain(self, source_v: float, dt_s: float) -> None:
        """Draw the current of the last `dt_s` from a battery whose open-circuit voltage is `source_v`."""
        self.current_a = IDLE_CURRENT_A + float(self.thrusters.current_a())
        self.voltage_v = max(MIN_VOLTAGE_V, source_v - self._battery.resistance_ohm * self.current_a)
        self.consumed_mah += self.current_a * 1000.0 * dt_s / 3600.0
        self._driven = []

    def eta(self) -> NDArray[np.float64]:
        """(6,) x, y, z (m, NED), phi, theta, psi (rad)."""
        return np.array([*self.state[:3], *euler(self.state)])

    def disturbance(self) -> NDArray[np.float64]:
        """(6,) all that acts besides the thrusters and still water: see `Plant.disturbance`."""
        return np.array(self._plant.disturbance(self.state, self._force, self._flow))

    def acceleration(self) -> tuple[float, float, float]:
        """Acceleration of the centre of gravity over the ground, in body axes (m/s²): nu' + omega × v."""
        u, v, w, p, q, r = self.state[7:]
        a, b, c = self.nu_dot[:3]
        return a + q * w - r * v, b + r * u - p * w, c + p * v - q * u
