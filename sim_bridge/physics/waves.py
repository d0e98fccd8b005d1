"""Waves: a sum of seeded Airy waves of one direction (Fossen 8.2), JONSWAP or a single regular one.

| symbol | meaning | unit | equation |
|---|---|---|---|
| a, ω, φ | amplitude, frequency, phase of a wave | m, rad/s, rad | 8.2 |
| k, h | wave number, depth of the water | 1/m, m | ω² = g k tanh(k h) |
| s, z | place along the waves, depth below the calm surface | m | |
| θ | ω t − k s + φ | rad | |

    along = a ω cosh k(h − z) / sinh kh cos θ,  down = a ω sinh k(h − z) / sinh kh sin θ
    pressure = a cosh k(h − z) / cosh kh cos θ      (metres of water)

Over deep water all three decay with exp(−k z). Above the calm surface they are those of z = 0.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim_bridge.physics.plant import GRAVITY, Six
from sim_bridge.sim_config import Waves

NEWTON_STEPS = 12
DEEP_KH = 20.0
"""Above, tanh(k h) is 1 to the last digit of a double."""


class Sea:
    """The waves of one seed. Water of infinite depth is deep."""

    def __init__(self, config: Waves, rng: np.random.Generator, depth_m: float = math.inf) -> None:
        self.omega, self.amplitude = (
            _regular(config) if config.spectrum == "regular" else _jonswap(config, rng)
        )
        self.k = wave_number(self.omega, depth_m)
        self.phase = rng.uniform(0, 2 * math.pi, len(self.omega))
        direction = math.radians(config.direction_deg)
        self.north, self.east = math.cos(direction), math.sin(direction)
        self._depth_m = depth_m
        full = np.exp(-2.0 * self.k * depth_m)
        self._pressure = self.amplitude / (1.0 + full)
        speed = self.amplitude * self.omega * np.exp(1j * self.phase) / (1.0 - full)
        pressure = self._pressure * np.exp(1j * self.phase)
        self._along = np.stack([speed, speed * self.omega, pressure])
        self._down = self._along[:2]
        self.pressure_m = 0.0
        """Dynamic pressure where and when `flow` was asked last, as metres of water."""
        self._j_omega = 1j * self.omega

    def flow(self, t_s: float, x: float, y: float, z: float) -> Six:
        """Orbital velocity and acceleration of the water in NED (m/s, m/s²) at time t and place x, y, z.

        Each wave is a complex number, real along the sea, imaginary down: a ω exp(j θ − k z). The bottom
        mirrors it: exp(j θ − k (2 h − z)) adds to what is along, and takes from what is down.
        """
        along = x * self.north + y * self.east
        depth = min(max(z, 0.0), self._depth_m)
        waves = np.exp(self._j_omega * t_s - self.k * complex(depth, along))
        if self._depth_m == math.inf:
            velocity, acceleration, pressure = (self._along @ waves).tolist()
            down, d_down = velocity, acceleration
        else:
            mirrored = waves * np.exp(-2.0 * self.k * (self._depth_m - depth))
            velocity, acceleration, pressure = (self._along @ (waves + mirrored)).tolist()
            down, d_down = (self._down @ (waves - mirrored)).tolist()
        self.pressure_m = pressure.real
        return (
            velocity.real * self.north,
            velocity.real * self.east,
            down.imag,
            -acceleration.imag * self.north,
            -acceleration.imag * self.east,
            d_down.real,
        )

    def elevation(self, t_s: float, x: float, y: float, z: float) -> float:
        """Dynamic pressure as metres of water (up) at depth z; at z = 0 the surface elevation."""
        depth = min(max(z, 0.0), self._depth_m)
        angle = self.omega * t_s - self.k * (x * self.north + y * self.east) + self.phase
        decay = np.exp(-self.k * depth)
        if self._depth_m != math.inf:
            decay += np.exp(-self.k * (2.0 * self._depth_m - depth))
        return float(np.sum(self._pressure * decay * np.cos(angle)))


def wave_number(omega: NDArray[np.float64], depth_m: float) -> NDArray[np.float64]:
    """Solve ω² = g k tanh(k h) for k (1/m), by Newton's method."""
    deep = omega**2 / GRAVITY
    if depth_m == math.inf:
        return deep
    shallow = omega / math.sqrt(GRAVITY * depth_m)
    k = np.maximum(deep, shallow)
    for _ in range(NEWTON_STEPS):
        tanh = np.tanh(np.minimum(k * depth_m, DEEP_KH))
        k = k - (k * tanh - deep) / (tanh + k * depth_m * (1.0 - tanh**2))
    return np.asarray(k)


def _regular(config: Waves) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequency and amplitude of the one wave, each (1,)."""
    return np.array([2 * math.pi / config.period_s]), np.array([config.height_m / 2])


def _jonswap(config: Waves, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw the frequencies, one in each band; the amplitudes add up to the significant height."""
    omega_p = 2 * math.pi / config.period_s
    edges = np.linspace(0.6 * omega_p, 2.5 * omega_p, config.components + 1)
    width = np.diff(edges)
    omega = edges[:-1] + width * rng.random(config.components)
    sigma = np.where(omega <= omega_p, 0.07, 0.09)
    peak = config.gamma ** np.exp(-((omega - omega_p) ** 2) / (2 * (sigma * omega_p) ** 2))
    spectrum = omega**-5 * np.exp(-1.25 * (omega_p / omega) ** 4) * peak
    amplitude = np.sqrt(2 * spectrum * width)
    amplitude *= config.height_m / 4 / math.sqrt(float(np.sum(amplitude**2)) / 2)
    return omega, amplitude
