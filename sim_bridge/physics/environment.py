"""The water's doings: current, waves, tether, load and a scripted heave force. Seeded; NED; SI."""

import math

import numpy as np

from sim_bridge.config import Current, SimConfig, Waves
from sim_bridge.physics.plant import GRAVITY, STILL_WATER
from sim_bridge.physics.plant import Six as Flow
from sim_bridge.physics.plant import Three as Force


class OrnsteinUhlenbeck:
    """A stationary random signal of standard deviation sigma and correlation time tau; exact for any step."""

    def __init__(self, sigma: float, tau_s: float, step_s: float, rng: np.random.Generator) -> None:
        self._keep = math.exp(-step_s / tau_s)
        self._kick = sigma * math.sqrt(1.0 - self._keep**2)
        self._normals = rng
        self._block: list[float] = []
        self.value = sigma * float(rng.standard_normal())

    @property
    def varies(self) -> bool:
        """Whether it is not constant."""
        return self._kick != 0.0

    def step(self) -> float:
        """Draw the next value."""
        if self._kick == 0.0:
            return self.value
        if not self._block:
            self._block = self._normals.standard_normal(512).tolist()
        self.value = self._keep * self.value + self._kick * self._block.pop()
        return self.value


class JonswapSea:
    """A long-crested sea over deep water: a sum of seeded Airy waves (Fossen 8.2, JONSWAP spectrum)."""

    def __init__(self, config: Waves, rng: np.random.Generator) -> None:
        omega_p = 2 * math.pi / config.period_s
        edges = np.linspace(0.6 * omega_p, 2.5 * omega_p, config.components + 1)
        width = np.diff(edges)
        omega = edges[:-1] + width * rng.random(config.components)
        sigma = np.where(omega <= omega_p, 0.07, 0.09)
        peak = config.gamma ** np.exp(-((omega - omega_p) ** 2) / (2 * (sigma * omega_p) ** 2))
        spectrum = omega**-5 * np.exp(-1.25 * (omega_p / omega) ** 4) * peak
        amplitude = np.sqrt(2 * spectrum * width)
        amplitude *= config.height_m / 4 / math.sqrt(float(np.sum(amplitude**2)) / 2)
        self.omega = omega
        self.k = omega**2 / GRAVITY
        self.phase = rng.uniform(0, 2 * math.pi, config.components)
        self.amplitude = amplitude
        direction = math.radians(config.direction_deg)
        self.north, self.east = math.cos(direction), math.sin(direction)
        speed = amplitude * omega * np.exp(1j * self.phase)
        self._speeds = np.stack([speed, speed * omega])
        self._j_omega = 1j * omega

    def flow(self, t_s: float, x: float, y: float, z: float) -> Flow:
        """Orbital velocity and acceleration of the water in NED at time t and place x, y, z.

        Each wave is a complex number, real along the sea, imaginary down: a ω exp(j (ω t - k s + φ) - k z).
        """
        along = x * self.north + y * self.east
        waves = np.exp(self._j_omega * t_s - self.k * complex(max(z, 0.0), along))
        velocity, acceleration = (self._speeds @ waves).tolist()
        return (
            velocity.real * self.north,
            velocity.real * self.east,
            velocity.imag,
            -acceleration.imag * self.north,
            -acceleration.imag * self.east,
            acceleration.real,
        )

    def elevation(self, t_s: float, x: float, y: float, z: float) -> float:
        """Dynamic pressure as metres of water (up) at depth z; at z = 0 the surface elevation."""
        angle = self.omega * t_s - self.k * (x * self.north + y * self.east) + self.phase
        return float(np.sum(self.amplitude * np.exp(-self.k * max(z, 0.0)) * np.cos(angle)))


class SlowCurrent:
    """Constant horizontal current with a slow variation of each component; its acceleration is neglected."""

    def __init__(self, config: Current, step_s: float, rng: np.random.Generator) -> None:
        direction = math.radians(config.direction_deg)
        self._mean = (config.speed_m_s * math.cos(direction), config.speed_m_s * math.sin(direction))
        self._vary = [OrnsteinUhlenbeck(config.sigma_m_s, config.tau_s, step_s, rng) for _ in range(2)]

    def step(self) -> tuple[float, float]:
        """North and east velocity (m/s) of the water."""
        return self._mean[0] + self._vary[0].step(), self._mean[1] + self._vary[1].step()


class Environment:
    """All that the water and what hangs on the vehicle do to it."""

    def __init__(self, config: SimConfig, step_s: float, rng: np.random.Generator) -> None:
        rngs = rng.spawn(4)
        self.load_on = False
        self.sea = JonswapSea(config.waves, rngs[1]) if config.waves.enabled else None
        self._current = SlowCurrent(config.current, step_s, rngs[0]) if config.current.enabled else None
        self._load = config.load
        self._tether = config.tether
        self._pull = [
            OrnsteinUhlenbeck(sigma if config.tether.enabled else 0.0, config.tether.tau_s, step_s, rngs[2])
            for sigma in config.tether.sigma_n
        ]
        self._heave = config.heave_force
        self._heave_noise = OrnsteinUhlenbeck(self._heave.sigma_n, self._heave.tau_s, step_s, rngs[3])

    def step(self, t_s: float, since_arming_s: float, x: float, y: float, z: float) -> tuple[Force, Flow]:
        """Force at the centre of gravity (N) and flow (m/s, m/s²) for one step; both NED.

        Args:
            t_s: time of the simulation.
            since_arming_s: time since the first arming; negative before it.
            x: north (m).
            y: east (m).
            z: depth (m).

        """
        flow = self.sea.flow(t_s, x, y, z) if self.sea else STILL_WATER
        if self._current:
            v_north, v_east = self._current.step()
            flow = (flow[0] + v_north, flow[1] + v_east, flow[2], flow[3], flow[4], flow[5])
        fx = fy = fz = 0.0
        if self._tether.enabled:
            static = self._tether.pull_n
            north, east, down = self._pull
            fx, fy, fz = static[0] + north.step(), static[1] + east.step(), static[2] + down.step()
            fz += self._tether.heave_n_per_m * z
        load = self._load
        self.load_on = load.enabled and load.on_s <= since_arming_s < load.off_s
        if self.load_on:
            fz += load.weight_n
        if self._heave.enabled:
            heave = self._heave
            fz += heave.constant_n + self._heave_noise.step()
            fz += heave.sine_n * math.sin(2 * math.pi * t_s / heave.sine_period_s)
        return (fx, fy, fz), flow
