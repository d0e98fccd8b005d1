"""Tuning for one's own vehicle: what its file says of it, how far that may be off, and the config so made."""

from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np

from companion.config import PRESET_KEY, VehicleFile, vehicle_text
from companion.config_text import with_values
from companion.telemetry import ranges
from holdfast import files, validation
from lab.loop.scenarios import varied
from sim_bridge.sim_config import SimConfig

LEAST_LAG_S, _ = validation.bounds(ranges.Lag) or (0.0, 0.0)
"""Thrusters that answer at once, as those of ArduSub's own simulated vehicle, are believed to lag by this."""

AXES = {"surge": 0, "sway": 1, "heave": 2, "yaw": 5}


def nominal(plant: SimConfig) -> dict[str, float | str]:
    """Return what the companion has to believe of this vehicle, as keys of its configuration."""
    hull = plant.hull
    believed: dict[str, float | str] = {
        "vehicle.frame": plant.thrusters.frame,
        "thrusters.lag_s": max(plant.thrusters.lag_s, LEAST_LAG_S),
        "thrusters.start_s": plant.thrusters.start_s,
        "thrusters.delay_s": plant.thrusters.delay_s,
    }
    for axis, i in AXES.items():
        inertia = hull.mass_kg if i < 3 else hull.inertia_kg_m2[2]
        believed[f"{axis}.mass"] = round(inertia + hull.added_mass[i], 4)
        believed[f"{axis}.linear_damping"] = hull.linear_damping[i]
        believed[f"{axis}.quadratic_damping"] = hull.quadratic_damping[i]
    return believed


def around(base: SimConfig, seed: int) -> SimConfig:
    """Draw a vehicle near `base`: heave mass, damping, weight, thrust, lag and dead band are never known."""
    draw = np.random.default_rng((seed, 1)).uniform
    hull, thrusters = base.hull, base.thrusters
    added_kg = max(0.0, (hull.mass_kg + hull.added_mass[2]) * draw(0.9, 1.1) - hull.mass_kg)
    linear = hull.linear_damping[2] * draw(0.5, 1.5)
    quadratic = hull.quadratic_damping[2] * draw(0.5, 1.5)
    strength = draw(0.8, 1.1)
    buoyancy_n = hull.net_buoyancy_n + draw(-2.0, 2.0)
    return varied(
        base,
        added_kg=added_kg,
        linear=linear,
        quadratic=quadratic,
        buoyancy_n=buoyancy_n,
        gain=tuple(strength * gain for gain in thrusters.gain),
        lag_s=thrusters.lag_s * draw(0.7, 1.3),
        dead_band_us=min(50.0, max(0.0, thrusters.dead_band_us + draw(-6.0, 6.0))),
    )


def vehicle_beside(out: Path) -> Path:
    """Return the file of the vehicle that a configuration names: mine-vehicle.toml beside mine.toml."""
    return out.with_name(f"{out.stem}-vehicle.toml")


def write_config(source: Path, vehicle: VehicleFile, gains: Mapping[str, float], out: Path) -> None:
    """Copy the companion's configuration with these gains in place of its own; comments stay.

    The vehicle goes into a file beside `out`, which names it (`vehicle_beside`); or into `out` itself if
    `source` holds its vehicle too. A key that the file does not have is added.
    """
    text = files.text(source)
    values: dict[str, float | str] = dict(gains)
    if "preset" in (table := files.toml(text).get("vehicle", {})) or not table:
        beside = vehicle_beside(out)
        values[PRESET_KEY] = beside.name
        about = (f"The vehicle for which `holdfast lab tune` searched the gains of {out.name} beside it.",)
        beside.write_text(vehicle_text(vehicle, about), encoding="utf-8")
    else:
        for section, keys in msgspec.to_builtins(vehicle).items():
            values |= {f"{section}.{key}": value for key, value in keys.items()}
    out.write_text(with_values(text, values), encoding="utf-8")
