"""Dives as data: a plant drawn from an ensemble, a disturbance, a setpoint over time, a duration.

docs/results.md ("Vehicles and scenarios") describes the ensemble and the four scenarios. The plant is the
simulator's, never the companion's nominal model.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from companion.records import Setpoint
from sim_bridge.config import SimConfig

DEPTH_M = 2.5
SETTLE_S = 12.0
"""From boot: arming takes 3 s, then the dive to its place; nothing is measured before."""

DROP_S = 20.0
"""When the load comes on, from the first arming; it stays."""


@dataclass(frozen=True)
class Scenario:
    """One dive: `plant` makes its vehicle from a base and a seed, `target` its setpoint at each time (s)."""

    name: str
    plant: Callable[[SimConfig, int], SimConfig]
    target: Callable[[float], Setpoint]
    duration_s: float
    seed: int = 0


def hold(depth_m: float = DEPTH_M, heading_rad: float = 0.0) -> Callable[[float], Setpoint]:
    """Stay at one depth and heading; x and y stay where they are when engaged."""
    setpoint = Setpoint((math.nan, math.nan, depth_m, heading_rad))
    return lambda t_s: setpoint


def trajectory(t_s: float) -> Setpoint:
    """Follow the paper's path 0.5 (1 − cos 0.1πt) for 60 s, then 0.25 (1 − cos 2πt/6), below DEPTH_M."""
    t_s -= SETTLE_S
    amplitude, omega = (0.5, 0.1 * math.pi) if t_s < 60.0 else (0.25, math.pi / 3.0)
    phase = omega * max(t_s, 0.0) if t_s < 60.0 else omega * (t_s - 60.0)
    z_m, z_dot, z_ddot = raised_cosine(phase, amplitude, omega)
    ahead = (0.0, 0.0, z_ddot if t_s >= 0.0 else 0.0, 0.0)
    return Setpoint((math.nan, math.nan, DEPTH_M + z_m, 0.0), (0.0, 0.0, z_dot, 0.0), ahead)


def raised_cosine(phase: float, amplitude_m: float, omega_radps: float) -> tuple[float, float, float]:
    """Return a (1 − cos φ) (m), its rate (m/s) and its acceleration (m/s²)."""
    return (
        amplitude_m * (1.0 - math.cos(phase)),
        amplitude_m * omega_radps * math.sin(phase),
        amplitude_m * omega_radps**2 * math.cos(phase),
    )


def ensemble(base: SimConfig, seed: int) -> SimConfig:
    """Draw a vehicle: heave mass, damping, buoyancy, thrust, lag and dead band vary (docs/results.md)."""
    draw = np.random.default_rng((seed, 1)).uniform
    hull, thrusters = base.hull, base.thrusters
    added = list(hull.added_mass)
    linear, quadratic = list(hull.linear_damping), list(hull.quadratic_damping)
    added[2] = draw(26.0, 32.0) - hull.mass_kg
    linear[2] = draw(5.0, 33.0)
    quadratic[2] = draw(37.0, 190.0)
    return replace(
        base,
        hull=replace(
            hull,
            added_mass=tuple(added),
            linear_damping=tuple(linear),
            quadratic_damping=tuple(quadratic),
            net_buoyancy_n=draw(0.0, 4.0),
        ),
        thrusters=replace(
            thrusters,
            gain=(draw(0.8, 1.1),),
            lag_s=draw(0.1, 0.2),
            dead_band_us=28.0 + draw(-6.0, 6.0),
        ),
        current=replace(base.current, enabled=False),
        initial=replace(base.initial, eta=(0.0, 0.0, DEPTH_M, 0.0, 0.0, 0.0)),
    )


def positioned(plant: SimConfig) -> SimConfig:
    """Give a vehicle a DVL without drift, so that the error of its place is the loop's, and a current."""
    return replace(
        plant,
        sensors=replace(plant.sensors, dvl=True, dvl_drift_m=0.0),
        current=replace(plant.current, enabled=True),
    )


def _waves(base: SimConfig, seed: int) -> SimConfig:
    draw = np.random.default_rng((seed, 2)).uniform
    return replace(
        base,
        waves=replace(base.waves, enabled=True, height_m=draw(0.2, 0.4), period_s=draw(3.5, 5.0)),
        initial=replace(base.initial, eta=(0.0, 0.0, DEPTH_M, 0.0, 0.0, 0.0)),
    )


def _tether(base: SimConfig, seed: int) -> SimConfig:
    return replace(base, tether=replace(base.tether, enabled=True, sigma_n=(0.0, 0.0, 2.0), tau_s=2.0))


def _load(base: SimConfig, seed: int) -> SimConfig:
    weight_n = np.random.default_rng((seed, 2)).uniform(10.0, 20.0)
    return replace(base, load=replace(base.load, enabled=True, weight_n=weight_n, on_s=DROP_S, off_s=1e4))


def four(seed: int, vary: Callable[[SimConfig, int], SimConfig] = ensemble) -> tuple[Scenario, ...]:
    """Return the waves, trajectory, load and calm dives of one seed, each of a vehicle that `vary` draws."""

    def drawn(disturb: Callable[[SimConfig, int], SimConfig]) -> Callable[[SimConfig, int], SimConfig]:
        return lambda base, seed: disturb(vary(base, seed), seed)

    return (
        Scenario("waves", drawn(_waves), hold(), SETTLE_S + 60.0, seed),
        Scenario("path", drawn(_tether), trajectory, SETTLE_S + 84.0, seed),
        Scenario("load", drawn(_load), hold(), SETTLE_S + 40.0, seed),
        Scenario("calm", drawn(lambda base, seed: base), hold(), SETTLE_S + 40.0, seed),
    )
