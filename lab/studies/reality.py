"""`holdfast lab bench reality`: vehicles that are unlike the model.

| scenario    | vehicle                                                                              |
|-------------|--------------------------------------------------------------------------------------|
| rough       | drawn between the published models and the tank's; four degrees of freedom at once   |
| axes        | a gain of its own on each axis, 1/3 to 3, other lags, and delays that no stamp shows |
| light-waves | 0.4 of the inertia and thrusters without lag; its depth alone, in waves              |
| light-path  | the same vehicle on a path                                                           |
"""

import math
from typing import ClassVar

import numpy as np
from msgspec.structs import replace

from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import water
from lab.studies.unlike import DEPTH_M, NONE, RealDive, Situation, Unlike, hold, path
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig, load_config


def rough(seed: int) -> SimConfig:
    """Draw a vehicle between the published models and the tank's, in current, waves and a jerking tether."""
    base, draw = load_config(DEFAULT_CONFIG), np.random.default_rng((seed, 32)).uniform
    hull, thrusters = base.hull, base.thrusters
    share = float(np.exp(draw(math.log(0.4), math.log(1.1))))
    damping = np.exp(draw(math.log(0.6), math.log(1.2), 6))
    drawn = replace(
        base,
        hull=replace(
            hull,
            added_mass=tuple(np.multiply(hull.added_mass, draw(0.7, 1.2, 6)).tolist()),
            linear_damping=tuple(
                np.multiply((8.0, 6.0, 19.0, 0.1, 0.8, 0.1), share * damping * draw(0.5, 2.0, 6)).tolist()
            ),
            quadratic_damping=tuple(
                np.multiply((95.0, 130.0, 113.0, 1.2, 0.5, 1.0), share * damping).tolist()
            ),
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
    return water(
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


def axes(seed: int) -> Situation:
    """Draw a vehicle that answers differently on each axis, and a link."""
    base, draw = load_config(DEFAULT_CONFIG), np.random.default_rng((seed, 33)).uniform
    surge, sway, heave, yaw = (3.0 ** draw(-1.0, 1.0) for _ in range(4))
    hidden_s, half_s = draw(0.0, 0.04), 0.5 * draw(0.0, 0.15)
    gains, lag_s = (surge, sway, heave, 1.0, 1.0, yaw), draw(0.0, 0.3)
    drawn = later(replace(base, thrusters=replace(base.thrusters, axis_gain=gains, lag_s=lag_s)), hidden_s)
    plant = water(drawn, depth_m=DEPTH_M, dvl=True, current_m_s=0.0)
    return Situation(plant, link=LinkDelay(up_s=0.001 + half_s, down_s=0.001 + half_s))


def later(plant: SimConfig, hidden_s: float) -> SimConfig:
    """Return a vehicle whose depth and attitude are so much older than any stamp shows."""
    sensors = plant.sensors
    return replace(
        plant,
        sensors=replace(
            sensors,
            depth_delay_s=sensors.depth_delay_s + hidden_s,
            climb_delay_s=sensors.climb_delay_s + hidden_s,
            attitude_delay_s=sensors.attitude_delay_s + hidden_s,
        ),
    )


def light(seed: int, *, rough: bool) -> SimConfig:
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
    waves_m = draw(0.2, 0.4) if rough else 0.0
    return water(drawn, depth_m=DEPTH_M, dvl=False, current_m_s=0.0, waves_m=waves_m, period_s=draw(3.5, 5.0))


class Reality(Unlike):
    """Vehicles between the published models and the tank's, with a gain on each axis, and light ones."""

    command = "lab bench reality"
    about = (
        "Holds vehicles between the published models and a real one, in four degrees of freedom at once; "
        "with --scenarios also those with a gain of its own on each axis, or light ones."
    )
    seeds = 60
    waters: ClassVar[tuple[str, ...]] = ("rough", "axes", "light-waves", "light-path")
    default_waters = ("rough",)
    goals: ClassVar = {
        ("heavy", "rough"): {
            "depth_sd_mm": (NONE, 5.0, NONE),
            "place_rms_mm": (NONE, 40.0, NONE),
            "tilt_deg": (NONE, 12.0, NONE),
        },
        ("heavy", "axes"): {"depth_sd_mm": (4.0, 6.0, 9.0), "heading_rms_deg": (0.1, 0.5, 1.5)},
        ("heavy", "light-waves"): {"depth_sd_mm": (7.0, NONE, NONE)},
        ("heavy", "light-path"): {"depth_sd_mm": (7.0, NONE, NONE)},
    }

    def situation(self, case: RealDive) -> Situation:
        if case.water == "axes":
            return axes(case.seed)
        if case.water == "rough":
            return Situation(rough(case.seed))
        moves = case.water == "light-path"
        return Situation(light(case.seed, rough=not moves), path if moves else hold)
