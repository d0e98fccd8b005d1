"""What happens in the demo's dives: the vehicle, its water, where it should be, and what is measured when."""

import math
from dataclasses import dataclass

from msgspec.structs import replace

from companion.records import Setpoint
from lab.loop.scenarios import water
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import SimConfig
from sim_bridge.sim_config import load_config as load_plant

VEHICLE_FILE = DEFAULT_CONFIG.with_name("sim-heavy-skid.toml")
WEEDY_MOTOR = 5
STEPS = 4
"""The path goes down and up again twice."""


@dataclass(frozen=True)
class Story:
    """One dive; times in s since arming. The same seed gives the same sea and the same noise."""

    seed: int = 1
    depth_m: float = 5.0
    heading_deg: float = 45.0
    current_m_s: float = 0.3
    wave_height_m: float = 0.3
    wave_period_s: float = 5.0
    weed: float = 0.5
    """What weed leaves of the thrust of one vertical motor."""
    step_m: float = 0.5
    load_n: float = 12.0
    waves_s: float = 5.0
    """Time from which on errors count."""
    path_s: float = 12.0
    load_on_s: float = 28.0
    load_off_s: float = 34.0
    end_s: float = 40.0

    @property
    def heading_rad(self) -> float:
        """The heading that is held."""
        return math.radians(self.heading_deg)

    @property
    def phases(self) -> dict[str, tuple[float, float]]:
        """Begin and end of each part that is measured."""
        return {
            "waves": (self.waves_s, self.path_s),
            "path": (self.path_s, self.load_on_s),
            "load hung on": (self.load_on_s, self.load_off_s),
            "load dropped": (self.load_off_s, self.end_s),
        }

    @property
    def words(self) -> str:
        """The vehicle and its water."""
        return (
            "A BlueROV2 Heavy with a payload skid and weed in a vertical motor; Holdfast's model has "
            f"neither. {self.current_m_s:g} m/s of current, {self.wave_height_m:g} m waves of "
            f"{self.wave_period_s:g} s."
        )

    def depth_m_at(self, t_s: float) -> float:
        """Return the depth that is asked for."""
        step = math.floor(STEPS * (t_s - self.path_s) / (self.load_on_s - self.path_s))
        return self.depth_m + (self.step_m if step in range(0, STEPS, 2) else 0.0)

    def setpoint(self, depth_m: float) -> Setpoint:
        """Return this depth and the heading; the place is free."""
        return Setpoint((math.nan, math.nan, depth_m, self.heading_rad))

    def plant(self) -> SimConfig:
        """Return the vehicle in its water."""
        gain = [1.0] * 8
        gain[WEEDY_MOTOR - 1] = self.weed
        base = load_plant(VEHICLE_FILE)
        rough = water(
            replace(base, thrusters=replace(base.thrusters, gain=tuple(gain))),
            current_m_s=self.current_m_s,
            waves_m=self.wave_height_m,
            period_s=self.wave_period_s,
            load_n=self.load_n,
        )
        return replace(
            rough,
            initial=replace(base.initial, eta=(0.0, 0.0, self.depth_m, 0.0, 0.0, self.heading_rad)),
            load=replace(rough.load, on_s=self.load_on_s, off_s=self.load_off_s),
        )
