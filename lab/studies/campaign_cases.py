"""The dives of `holdfast lab campaign`: vehicle, link and sea drawn from a number, and where each must hold.

A dive's number is its seed: number 4711 is the same dive on any machine and in any batch.
Published sets of the vehicle are varied beyond what was measured; `ENVELOPE` says where every dive must hold.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from companion.config import Config
from lab.loop.scenarios import DEPTH_M, ensemble, water
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import SimConfig, load_config

HEAVY, BLUEROV2, ENSEMBLE = "heavy", "bluerov2", "ensemble"
VEHICLES = (HEAVY, BLUEROV2, ENSEMBLE)
DISTURBANCES = ("calm", "waves", "tether", "load", "current", "all")

ENVELOPE = (
    "every published set of the vehicle; damping 0.5 to 1.5 and mass 1 to 1.3 times the set's",
    "thrust 0.7 to 1.1 times the measured curve; a link of 20 to 150 ms, which the companion measures",
    "waves Hs 0.2 to 0.4 m, a tether of σ 1 to 4 N, a load of 5 to 20 N, a current of 0.1 to 0.5 m/s, or all",
    "any one horizontal thruster dead; a vertical one only in calm water or a current, or of eight at a "
    "tether: a load or waves may turn the vehicle over before the dead one is found",
    "on the six-thruster BlueROV2 one disturbance at a time: all at once, one dive in fifty or so turned it "
    "over, for it has only 2 N·m to right it",
)
"""Where every dive must hold; `CampaignCase.inside` says the same."""


class CampaignCase(NamedTuple):
    """One dive. Factors multiply what the set says; `delay_ms` is the link's, both ways together, each half.

    `dead` is the number of a thruster that does not push, or 0. Disturbances are zero where there is none:
    significant height (m) and peak period (s) of the waves, σ (N) of the tether, weight (N) of the load,
    speed (m/s) and direction (°) of the current.
    """

    number: int
    vehicle: str
    disturbance: str
    damping: float
    mass: float
    thrust: float
    delay_ms: float
    dead: int
    wave_height_m: float
    wave_period_s: float
    tether_n: float
    load_n: float
    current_m_s: float
    current_deg: float

    @property
    def dead_motor(self) -> str:
        """Which kind of thruster is dead: none, horizontal or vertical."""
        return "vertical" if self.dead > 4 else "horizontal" if self.dead else "none"

    @property
    def inside(self) -> bool:
        """Whether the dive lies within ENVELOPE."""
        weak = ("calm", "current") if self.vehicle == BLUEROV2 else ("calm", "current", "tether")
        if self.dead_motor == "vertical" and self.disturbance not in weak:
            return False
        return not (self.vehicle == BLUEROV2 and self.disturbance == "all")

    def __str__(self) -> str:
        """Say it in a line."""
        dead = f", thruster {self.dead} dead" if self.dead else ""
        return (
            f"{self.number}: {self.vehicle}, {self.disturbance}, damping ×{self.damping:.2f}, mass "
            f"×{self.mass:.2f}, thrust ×{self.thrust:.2f}, {self.delay_ms:.0f} ms{dead}"
        )


def case(number: int) -> CampaignCase:
    """Draw the dive of this number: vehicles and disturbances in turn, the rest uniform."""
    draw = np.random.default_rng((number, 4)).uniform
    vehicle = VEHICLES[number % 3]
    disturbance = DISTURBANCES[number // 3 % 6]
    motors = 6 if vehicle == BLUEROV2 else 8
    damping, mass, thrust, delay_ms = draw(0.5, 1.5), draw(1.0, 1.3), draw(0.7, 1.1), draw(20.0, 150.0)
    dead = int(draw(1.0, motors + 1.0)) if draw(0.0, 1.0) < 0.5 else 0
    height_m, period_s, tether_n = draw(0.2, 0.4), draw(3.5, 5.0), draw(1.0, 4.0)
    load_n, current_m_s, current_deg = draw(5.0, 20.0), draw(0.1, 0.5), draw(0.0, 360.0)

    def there(name: str) -> bool:
        return disturbance in (name, "all")

    return CampaignCase(
        number=number,
        vehicle=vehicle,
        disturbance=disturbance,
        damping=round(damping, 4),
        mass=round(mass, 4),
        thrust=round(thrust, 4),
        delay_ms=round(delay_ms, 1),
        dead=dead,
        wave_height_m=round(height_m, 3) * there("waves"),
        wave_period_s=round(period_s, 3) * there("waves"),
        tether_n=round(tether_n, 2) * there("tether"),
        load_n=round(load_n, 2) * there("load"),
        current_m_s=round(current_m_s, 3) * there("current"),
        current_deg=round(current_deg, 1) * there("current"),
    )


def plant(case: CampaignCase) -> SimConfig:
    """Build the dive's vehicle and water."""
    base = _base(case.vehicle)
    if case.vehicle == ENSEMBLE:
        base = ensemble(base, case.number)
    hull, thrusters = base.hull, base.thrusters
    gain = [case.thrust] * (6 if thrusters.frame == "vectored" else 8)
    if case.dead:
        gain[case.dead - 1] = 0.0
    drawn = replace(
        base,
        hull=replace(
            hull,
            mass_kg=hull.mass_kg * case.mass,
            inertia_kg_m2=tuple(inertia * case.mass for inertia in hull.inertia_kg_m2),
            linear_damping=tuple(damping * case.damping for damping in hull.linear_damping),
            quadratic_damping=tuple(damping * case.damping for damping in hull.quadratic_damping),
        ),
        thrusters=replace(thrusters, gain=tuple(gain)),
        battery=replace(base.battery, resistance_ohm=0.0),
    )
    return water(
        drawn,
        depth_m=DEPTH_M,
        dvl=True,
        current_m_s=case.current_m_s,
        current_deg=case.current_deg,
        waves_m=case.wave_height_m,
        period_s=case.wave_period_s or None,
        tether_n=(0.5 * case.tether_n, 0.5 * case.tether_n, case.tether_n),
        load_n=case.load_n,
    )


def configured(config: Config, vehicle: str) -> Config:
    """Return the companion's configuration for a vehicle: its frame and nothing else is made to fit."""
    frame = _base(vehicle).thrusters.frame
    return replace(config, vehicle=replace(config.vehicle, frame=frame))


@cache
def _base(vehicle: str) -> SimConfig:
    name = "sim-bluerov2.toml" if vehicle == BLUEROV2 else "sim.toml"
    return load_config(Path(DEFAULT_CONFIG).with_name(name))
