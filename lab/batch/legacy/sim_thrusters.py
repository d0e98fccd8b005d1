"""From motor PWM to a wrench: thrust curve, dead band, voltage, lag, gain, health and geometry.

A motor that is driven above 1500 pushes the vehicle along its direction. Directions and positions are those
for which ArduSub's mixing factors mean what they say: a positive forward, lateral, throttle (up), roll, pitch
or yaw demand pushes to +X, +Y, -Z, +K, +M, +N. A test per axis ties it to `mixer`.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_bridge.config import ThrusterConfig

CURVE_US = (-400, -300, -200, -100, -60, -28, 28, 60, 100, 200, 300, 400)
"""Offset from 1500 µs; the middle pair is the edge of the dead band."""
CURVE_N = (-39.9, -26.6, -14.1, -4.7, -1.8, 0.0, 0.0, 2.2, 5.9, 17.9, 33.5, 51.5)
"""Static thrust of a T200 at 16 V."""
CURVE_VOLTAGE_V = 16.0
FULL_SPAN_US, FULL_N = 400.0, 51.5
FULL_CURRENT_A = 24.0


def geometry(config: ThrusterConfig) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and unit directions of the thrusters, each (n, 3), body frame."""
    hx, hy, hz = config.horizontal_m
    vx, vy, vz = config.vertical_m
    c = math.sqrt(0.5)
    positions = [(hx, hy, hz), (hx, -hy, hz), (-hx, hy, hz), (-hx, -hy, hz)]
    directions = [(-c, c, 0.0), (-c, -c, 0.0), (c, c, 0.0), (c, -c, 0.0)]
    if config.frame == "vectored_6dof":
        positions += [(vx, vy, vz), (vx, -vy, vz), (-vx, vy, vz), (-vx, -vy, vz)]
    else:
        positions += [(vx, vy, vz), (vx, -vy, vz)]
    directions += [(0.0, 0.0, 1.0)] * (len(positions) - 4)
    return np.array(positions), np.array(directions)


class Thrusters:
    """State and equations of a set of n thrusters, for any leading shape of dives.

    `thrust_n` (..., n) is what each delivers now; `health` (..., n) scales it: 0 is a dead thruster.
    """

    def __init__(self, config: ThrusterConfig, shape: tuple[int, ...] = ()) -> None:
        positions, directions = geometry(config)
        self.count = len(positions)
        self.wrench_of_thrust = np.concatenate([directions, np.cross(positions, directions)], axis=1)
        """(n, 6): body wrench of one newton of each."""
        self.thrust_n = np.zeros((*shape, self.count))
        self.health = np.ones((*shape, self.count))
        self._gain = np.array(config.gain)
        self._lag_s = config.lag_s
        self._quadratic = config.curve == "quadratic"
        self._dead_band_us = config.dead_band_us
        self._curve_us = np.array(CURVE_US, dtype=np.float64)
        self._curve_us[[5, 6]] = (-config.dead_band_us, config.dead_band_us)
        self._curve_n = np.array(CURVE_N)

    def static_thrust(self, pwm: ArrayLike, voltage_v: ArrayLike) -> NDArray[np.float64]:
        """Steady thrust (N), (..., n), at motor PWM (..., n) in µs and a voltage (V) that broadcasts."""
        offset = np.asarray(pwm, dtype=np.float64) - 1500.0
        scale = (np.asarray(voltage_v) / CURVE_VOLTAGE_V) ** 2
        if self._quadratic:
            u = np.where(np.abs(offset) > self._dead_band_us, offset / FULL_SPAN_US, 0.0)
            newtons = FULL_N * u * np.abs(u)
        else:
            newtons = np.interp(offset, self._curve_us, self._curve_n)
        thrust: NDArray[np.float64] = newtons * self._gain * self.health * scale
        return thrust

    def step(self, static_thrust: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        """First-order lag towards `static_thrust` (..., n); returns the body wrench (..., 6)."""
        follow = 1.0 - math.exp(-dt / self._lag_s) if self._lag_s > 0.0 else 1.0
        self.thrust_n = self.thrust_n + follow * (static_thrust - self.thrust_n)
        return self.wrench()

    def wrench(self) -> NDArray[np.float64]:
        """Sum up the body wrench (..., 6) delivered now."""
        wrench: NDArray[np.float64] = self.thrust_n @ self.wrench_of_thrust
        return wrench

    def current_a(self) -> NDArray[np.float64]:
        """Battery current (A) of shape (...): about |thrust|^1.5, 24 A each at full thrust."""
        current: NDArray[np.float64] = np.sum((np.abs(self.thrust_n) / CURVE_N[-1]) ** 1.5, axis=-1)
        return FULL_CURRENT_A * current
