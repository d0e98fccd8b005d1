"""Vehicles that are unlike the model, each in its water: drawn from a seed."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from companion.records import Setpoint
from lab.loop.dive import EXACT
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import SETTLE_S, up_and_down, water
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import SimConfig, load_config

DEPTH_M = 2.0
TANK = DEFAULT_CONFIG.with_name("sim-tank-heavy.toml")
LATE_S = 0.16
"""How much later its motors start in half of its dives, s."""


def hold(t_s: float) -> Setpoint:
    """Stay where it began."""
    return Setpoint((0.0, 0.0, DEPTH_M, 0.0))


def path(t_s: float) -> Setpoint:
    """Follow 0.25 (1 − cos 2πt/6) m below DEPTH_M; place and heading stay."""
    return up_and_down(t_s - SETTLE_S, 0.25, math.pi / 3.0, DEPTH_M, (0.0, 0.0))


@dataclass(frozen=True)
class Trial:
    """One dive: the vehicle in its water, the setpoint over time, and the link."""

    plant: SimConfig
    target: Callable[[float], Setpoint] = hold
    link: LinkDelay = EXACT


def rough(seed: int) -> Trial:
    """Draw a vehicle between the published models and the tank's, in current, waves and a jerking tether."""
    base, draw = load_config(DEFAULT_CONFIG), np.random.default_rng((seed, 32)).uniform
    hull, thrusters = base.hull, base.thrusters
    share = float(np.exp(draw(math.log(0.4), math.log(1.1))))
    damping = np.exp(draw(math.log(0.6), math.log(1.2), 6))
    linear, quadratic = (8.0, 6.0, 19.0, 0.1, 0.8, 0.1), (95.0, 130.0, 113.0, 1.2, 0.5, 1.0)
    drawn = replace(
        base,
        hull=replace(
            hull,
            added_mass=tuple(np.multiply(hull.added_mass, draw(0.7, 1.2, 6)).tolist()),
            linear_damping=tuple(np.multiply(linear, share * damping * draw(0.5, 2.0, 6)).tolist()),
            quadratic_damping=tuple(np.multiply(quadratic, share * damping).tolist()),
            net_buoyancy_n=draw(0.0, 4.0),
            coriolis_share=(draw(0.3, 1.0), draw(0.3, 1.0), draw(0.0, 1.0)),
        ),
        thrusters=replace(
            thrusters,
            gain=(share,),
            lag_s=draw(0.05, 0.2),
            start_s=draw(0.0, 0.25),
            horizontal_m=(*thrusters.horizontal_m[:2], draw(0.0, 0.1)),
        ),
    )
    return Trial(
        water(
            drawn,
            depth_m=DEPTH_M,
            dvl=True,
            current_m_s=draw(0.05, 0.3),
            current_deg=draw(0.0, 360.0),
            waves_m=draw(0.1, 0.4),
            period_s=draw(3.5, 6.0),
            waves_deg=draw(0.0, 360.0),
            tether_n=(draw(0.0, 6.0) * share,) * 3,
            tether_s=0.7,
        )
    )


def axes(seed: int) -> Trial:
    """Draw 1/3 to 3 times the thrust on each axis, another lag, hidden delay, and a link."""
    base, draw = load_config(DEFAULT_CONFIG), np.random.default_rng((seed, 33)).uniform
    surge, sway, heave, yaw = (3.0 ** draw(-1.0, 1.0) for _ in range(4))
    hidden_s, half_s = draw(0.0, 0.04), 0.5 * draw(0.0, 0.15)
    gains, lag_s = (surge, sway, heave, 1.0, 1.0, yaw), draw(0.0, 0.3)
    drawn = later(replace(base, thrusters=replace(base.thrusters, axis_gain=gains, lag_s=lag_s)), hidden_s)
    plant = water(drawn, depth_m=DEPTH_M, dvl=True, current_m_s=0.0)
    return Trial(plant, link=LinkDelay(up_s=0.001 + half_s, down_s=0.001 + half_s))


def later(plant: SimConfig, hidden_s: float) -> SimConfig:
    """Return a vehicle whose depth and attitude are so much older than any stamp shows."""
    delays = ("depth_delay_s", "climb_delay_s", "attitude_delay_s")
    older = {name: getattr(plant.sensors, name) + hidden_s for name in delays}
    return replace(plant, sensors=replace(plant.sensors, **older))


def light(seed: int, *, moves: bool) -> Trial:
    """Draw the water of a vehicle with 0.4 of the inertia, and thrusters without lag."""
    base, draw = load_config(DEFAULT_CONFIG), np.random.default_rng((seed, 34)).uniform
    hull = base.hull
    drawn = replace(
        base,
        hull=replace(
            hull,
            mass_kg=0.4 * hull.mass_kg,
            inertia_kg_m2=tuple(0.4 * inertia for inertia in hull.inertia_kg_m2),
            added_mass=tuple(0.4 * added for added in hull.added_mass),
            centre_of_buoyancy_up_m=hull.centre_of_buoyancy_up_m / 0.4,
        ),
        thrusters=replace(base.thrusters, lag_s=0.0),
    )
    waves_m = 0.0 if moves else draw(0.2, 0.4)
    plant = water(
        drawn, depth_m=DEPTH_M, dvl=False, current_m_s=0.0, waves_m=waves_m, period_s=draw(3.5, 5.0)
    )
    return Trial(plant, path if moves else hold)


def tank(seed: int, sea: str, *, late: bool) -> Trial:
    """Draw the water of the Heavy that was measured in a tank, "calm", "waves", "path" or "place"."""
    base = load_config(TANK)
    return _in_a_sea(
        replace(base, thrusters=replace(base.thrusters, start_s=LATE_S if late else 0.0)), seed, sea
    )


def delayed(seed: int, sea: str) -> Trial:
    """Draw the water of the nominal vehicle behind 50 ms of delay each way, which are measured."""
    trial = _in_a_sea(load_config(DEFAULT_CONFIG), seed, sea)
    return Trial(trial.plant, trial.target, LinkDelay(up_s=0.051, down_s=0.051))


def slow(seed: int, sea: str) -> Trial:
    """Draw the water of a vehicle like the one of `data/osl`: inertia × 3, drag × 1.6, motors 0.15 s late."""
    base = load_config(DEFAULT_CONFIG)
    hull, thrusters = base.hull, base.thrusters
    drag = {
        name: tuple(np.multiply(getattr(hull, name), 1.6 / 3.0).tolist())
        for name in ("linear_damping", "quadratic_damping")
    }
    weak = replace(thrusters, gain=tuple(np.divide(thrusters.gain, 3.0).tolist()), start_s=0.15)
    return _in_a_sea(replace(base, hull=replace(hull, **drag), thrusters=weak), seed, sea)


def _in_a_sea(vehicle: SimConfig, seed: int, sea: str) -> Trial:
    """Draw the water of a vehicle, "calm", "waves", "path" or "place"."""
    draw = np.random.default_rng((seed, 31)).uniform
    waves_m, period_s = draw(0.2, 0.4), draw(3.5, 5.0)
    if sea != "place":
        waves_m *= sea == "waves"
        still = water(
            vehicle, depth_m=DEPTH_M, dvl=False, current_m_s=0.0, waves_m=waves_m, period_s=period_s
        )
        return Trial(still, path if sea == "path" else hold)
    return Trial(
        water(
            vehicle,
            depth_m=DEPTH_M,
            dvl=True,
            current_m_s=0.3,
            current_deg=draw(0.0, 360.0),
            waves_m=waves_m,
            period_s=period_s,
            waves_deg=draw(0.0, 360.0),
            tether_n=(2.0, 2.0, 2.0),
            tether_s=0.7,
        )
    )
