"""What acts from outside: current, waves, seabed, tether and load. Seeded; NED; SI."""

import math
from bisect import bisect_right

import numpy as np

from sim_bridge.physics.cable import CableChain
from sim_bridge.physics.plant import STILL_WATER, State, ned_velocity
from sim_bridge.physics.plant import Six as Flow
from sim_bridge.physics.plant import Three as Force
from sim_bridge.physics.waves import Sea
from sim_bridge.sim_config import CurrentConfig, Seabed, SimConfig


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


class WaterCurrent:
    """A horizontal current that may vary with depth and time; its acceleration is neglected.

    The mean turns at its rate and is scaled by the profile; a slow random variation adds to each component.
    """

    def __init__(self, config: CurrentConfig, step_s: float, rng: np.random.Generator) -> None:
        self._speed_m_s = config.speed_m_s
        self._direction = math.radians(config.direction_deg)
        self._turn_rad_s = math.radians(config.turn_deg_s)
        self._depths_m = [depth for depth, _ in config.profile]
        self._parts = [part for _, part in config.profile]
        self._mean = self._heading(0.0)
        self._vary = [OrnsteinUhlenbeck(config.sigma_m_s, config.tau_s, step_s, rng) for _ in range(2)]

    def step(self, t_s: float) -> None:
        """Go on to time t."""
        if self._turn_rad_s:
            self._mean = self._heading(t_s)
        for component in self._vary:
            component.step()

    def velocity(self, z: float) -> tuple[float, float]:
        """North and east velocity (m/s) of the water at depth z."""
        north, east = self._mean
        if self._parts:
            part = self._part(z)
            north, east = part * north, part * east
        return north + self._vary[0].value, east + self._vary[1].value

    def _part(self, z: float) -> float:
        """Return the profile at depth z: straight between rows. NumPy takes longer on one number."""
        below = bisect_right(self._depths_m, z)
        if below == 0 or below == len(self._parts):
            return self._parts[max(0, below - 1)]
        upper, lower = self._depths_m[below - 1 : below + 1]
        return self._parts[below - 1] + (z - upper) / (lower - upper) * (
            self._parts[below] - self._parts[below - 1]
        )

    def _heading(self, t_s: float) -> tuple[float, float]:
        direction = self._direction + self._turn_rad_s * t_s
        return self._speed_m_s * math.cos(direction), self._speed_m_s * math.sin(direction)


class SeabedContact:
    """The seabed under the hull: a spring and a damper that only push, and Coulomb friction."""

    SLIP_M_S = 0.05
    """Friction grows up to this speed: at rest the hull creeps instead of sticking."""

    def __init__(self, config: Seabed, hull_height_m: float) -> None:
        self._config = config
        self._half_m = 0.5 * hull_height_m

    def push(self, state: State) -> Force:
        """Force on the hull (N, NED)."""
        sunk_m = state[2] + self._half_m - self._config.depth_at(state[0], state[1])
        if sunk_m <= 0.0:
            return 0.0, 0.0, 0.0
        config = self._config
        north, east, down = ned_velocity(state)
        normal_n = max(0.0, config.stiffness_n_per_m * sunk_m + config.damping_n_s_per_m * down)
        drag = config.friction * normal_n / max(math.hypot(north, east), self.SLIP_M_S)
        return -drag * north, -drag * east, -normal_n


def _at_rest(_: float) -> tuple[float, float]:
    return 0.0, 0.0


class Environment:
    """All that the water and what hangs on the vehicle do to it."""

    def __init__(self, config: SimConfig, step_s: float, rng: np.random.Generator) -> None:
        rngs = rng.spawn(3)
        self.load_on = False
        self._ground = SeabedContact(config.seabed, config.hull.height_m) if config.seabed.enabled else None
        depth_m = config.seabed.depth_m if config.seabed.enabled else math.inf
        self.sea = Sea(config.waves, rngs[1], depth_m) if config.waves.enabled else None
        self._current = WaterCurrent(config.current, step_s, rngs[0]) if config.current.enabled else None
        x, y, z = config.initial.eta[:3]
        self._cable = CableChain(config.cable, step_s, (x, y, z), depth_m) if config.cable.enabled else None
        self._load = config.load
        self._tether = config.tether
        self._pull = [
            OrnsteinUhlenbeck(sigma if config.tether.enabled else 0.0, config.tether.tau_s, step_s, rngs[2])
            for sigma in config.tether.sigma_n
        ]

    def step(self, t_s: float, since_arming_s: float, state: State) -> tuple[Force, Flow]:
        """Force at the centre of gravity (N) and flow (m/s, m/s²) for one step; both NED.

        `since_arming_s` is the time since the first arming, negative before it.
        """
        x, y, z = state[:3]
        flow = self.sea.flow(t_s, x, y, z) if self.sea else STILL_WATER
        if self._current:
            self._current.step(t_s)
            v_north, v_east = self._current.velocity(z)
            flow = (flow[0] + v_north, flow[1] + v_east, flow[2], flow[3], flow[4], flow[5])
        fx = fy = fz = 0.0
        if self._tether.enabled:
            static = self._tether.pull_n
            north, east, down = self._pull
            fx, fy, fz = static[0] + north.step(), static[1] + east.step(), static[2] + down.step()
        load = self._load
        self.load_on = load.enabled and load.on_s <= since_arming_s < load.off_s
        if self.load_on:
            fz += load.weight_n
        if self._cable:
            pull = self._cable.pull(
                state[:3], ned_velocity(state), self._current.velocity if self._current else _at_rest
            )
            fx, fy, fz = fx + pull[0], fy + pull[1], fz + pull[2]
        if self._ground:
            push = self._ground.push(state)
            fx, fy, fz = fx + push[0], fy + push[1], fz + push[2]
        return (fx, fy, fz), flow
