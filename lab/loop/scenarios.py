"""Dives as data: a plant drawn from an ensemble, a disturbance, a setpoint over time, a duration.

docs/results.md ("Vehicles and scenarios") describes the ensemble and the four scenarios. The plant is the
simulator's, never the companion's nominal model.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import msgspec
import numpy as np
from msgspec.structs import replace

from companion.records import Setpoint
from sim_bridge.physics.plant import Three
from sim_bridge.sim_config import SimConfig

R = TypeVar("R", bound=msgspec.Struct)

DEPTH_M = 2.5
SETTLE_S = 12.0
"""Time from boot until errors count: arming takes 3 s, then the dive to its place."""

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
    if t_s < 60.0:
        return up_and_down(t_s, 0.5, 0.1 * math.pi, DEPTH_M)
    return up_and_down(t_s - 60.0, 0.25, math.pi / 3.0, DEPTH_M)


def up_and_down(
    t_s: float,
    amplitude_m: float,
    omega_radps: float,
    depth_m: float,
    place: tuple[float, float] = (math.nan, math.nan),
) -> Setpoint:
    """Follow a (1 − cos ωt) below a depth, from 0 s on; before, rest there. Place and heading stay."""
    phase = omega_radps * max(t_s, 0.0)
    z_m = amplitude_m * (1.0 - math.cos(phase))
    z_dot = amplitude_m * omega_radps * math.sin(phase)
    z_ddot = amplitude_m * omega_radps**2 * math.cos(phase) if t_s >= 0.0 else 0.0
    return Setpoint((*place, depth_m + z_m, 0.0), (0.0, 0.0, z_dot, 0.0), (0.0, 0.0, z_ddot, 0.0))


def water(
    vehicle: SimConfig,
    *,
    depth_m: float | None = None,
    dvl: bool | None = None,
    current_m_s: float | None = None,
    current_deg: float | None = None,
    turn_deg_s: float | None = None,
    waves_m: float | None = None,
    period_s: float | None = None,
    waves_deg: float | None = None,
    tether_n: Three | None = None,
    tether_s: float | None = None,
    load_n: float | None = None,
) -> SimConfig:
    """Return a vehicle in other water; what is not given stays, and a size of zero switches it off.

    Args:
        vehicle: and the water that it has.
        depth_m: where it starts, level, heading north.
        dvl: whether it has a DVL.
        current_m_s: speed of the current.
        current_deg: where it flows to.
        turn_deg_s: how fast that turns.
        waves_m: significant height.
        period_s: their peak period.
        waves_deg: where they go.
        tether_n: σ of the tether's pull on each axis.
        tether_s: how long that pull is correlated.
        load_n: a weight, which comes on at DROP_S and stays.

    """
    hangs = {} if load_n is None else {"on_s": DROP_S, "off_s": 1e4}
    pulls = None if tether_n is None else max(tether_n)
    return replace(
        vehicle,
        initial=_with(vehicle.initial, eta=None if depth_m is None else (0.0, 0.0, depth_m, 0.0, 0.0, 0.0)),
        sensors=_with(vehicle.sensors, dvl=dvl),
        current=_with(
            vehicle.current,
            enabled=_there(current_m_s),
            speed_m_s=current_m_s or None,
            direction_deg=current_deg,
            turn_deg_s=turn_deg_s,
        ),
        waves=_with(
            vehicle.waves,
            enabled=_there(waves_m),
            height_m=waves_m or None,
            period_s=period_s,
            direction_deg=waves_deg,
        ),
        tether=_with(
            vehicle.tether,
            enabled=_there(pulls),
            sigma_n=tether_n if pulls else None,
            tau_s=tether_s,
        ),
        load=_with(vehicle.load, enabled=_there(load_n), weight_n=load_n or None, **hangs),
    )


def _with(record: R, **values: object) -> R:
    return replace(record, **{key: value for key, value in values.items() if value is not None})


def _there(size: float | None) -> bool | None:
    return None if size is None else size > 0.0


def ensemble(base: SimConfig, seed: int) -> SimConfig:
    """Draw a vehicle: heave mass, damping, buoyancy, thrust, lag and dead band vary (docs/results.md)."""
    draw = np.random.default_rng((seed, 1)).uniform
    of_heave = {
        "added_mass": draw(26.0, 32.0) - base.hull.mass_kg,
        "linear_damping": draw(5.0, 33.0),
        "quadratic_damping": draw(37.0, 190.0),
    }
    before = {name: getattr(base.hull, name) for name in of_heave}
    changed = {name: (*six[:2], of_heave[name], *six[3:]) for name, six in before.items()}
    hull = replace(base.hull, net_buoyancy_n=draw(0.0, 4.0), **changed)
    gain, lag_s, dead_band_us = (draw(0.8, 1.1),), draw(0.1, 0.2), 28.0 + draw(-6.0, 6.0)
    thrusters = replace(base.thrusters, gain=gain, lag_s=lag_s, dead_band_us=dead_band_us)
    return water(replace(base, hull=hull, thrusters=thrusters), depth_m=DEPTH_M, current_m_s=0.0)


def positioned(plant: SimConfig) -> SimConfig:
    """Give a vehicle a DVL without drift, so that the error of its place is the loop's, and a current."""
    return replace(
        plant,
        sensors=replace(plant.sensors, dvl=True, dvl_drift_m=0.0),
        current=replace(plant.current, enabled=True),
    )


def _waves(base: SimConfig, seed: int) -> SimConfig:
    draw = np.random.default_rng((seed, 2)).uniform
    return water(base, depth_m=DEPTH_M, waves_m=draw(0.2, 0.4), period_s=draw(3.5, 5.0))


def _tether(base: SimConfig, seed: int) -> SimConfig:
    return water(base, tether_n=(0.0, 0.0, 2.0), tether_s=2.0)


def _load(base: SimConfig, seed: int) -> SimConfig:
    return water(base, load_n=np.random.default_rng((seed, 2)).uniform(10.0, 20.0))


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
