"""`holdfast lab bench tank`: a real BlueROV2 Heavy as measured in a tank (config/sim-tank-heavy.toml)."""

from typing import ClassVar

import numpy as np
from msgspec.structs import replace

from lab.loop.scenarios import water
from lab.studies.unlike import DEPTH_M, NONE, RealDive, Situation, Unlike, hold, path
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config

TANK = DEFAULT_CONFIG.with_name("sim-tank-heavy.toml")


class Tank(Unlike):
    """The tank vehicle with the nominal preset, never identified, and with its own."""

    command = "lab bench tank"
    about = "Holds a real BlueROV2 Heavy as it was measured, without and with motors that start 0.16 s late."
    seeds = 10
    waters = ("calm", "waves", "path", "place")
    presets = ("heavy", "tank-heavy")
    starts_s = (0.0, 0.16)
    parts = (50.0, 100.0)
    goals: ClassVar = {
        (preset, name): {"depth_sd_mm": (NONE, depth_mm)}
        for preset in presets
        for name, depth_mm in (("calm", 4.5), ("waves", 4.5), ("path", 5.0))
    } | {
        ("heavy", "place"): {"place_rms_mm": (NONE, 40.0), "tilt_deg": (NONE, 10.0)},
        ("tank-heavy", "place"): {"place_rms_mm": (NONE, 25.0), "tilt_deg": (NONE, 8.0)},
    }

    def situation(self, case: RealDive) -> Situation:
        base = load_config(TANK)
        base = replace(base, thrusters=replace(base.thrusters, start_s=case.start_s))
        draw = np.random.default_rng((case.seed, 31)).uniform
        waves_m, period_s = draw(0.2, 0.4), draw(3.5, 5.0)
        if case.water != "place":
            waves_m = waves_m if case.water == "waves" else 0.0
            plant = water(
                base, depth_m=DEPTH_M, dvl=False, current_m_s=0.0, waves_m=waves_m, period_s=period_s
            )
            return Situation(plant, path if case.water == "path" else hold)
        return Situation(
            water(
                base,
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
