"""Run a scenario through the full loop and measure it against the truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.config import Config
from companion.control.bounds import wrap
from companion.engine import Engine
from companion.types import PSI, Request, State, Z
from lab.lockstep import Link, Lockstep
from lab.scenarios import SETTLE_S, Scenario
from sim_bridge.config import SimConfig
from sim_bridge.vehicle import Vehicle

PHI, THETA, TRUE_PSI = 3, 4, 5


@dataclass(frozen=True)
class Dive:
    """What was recorded, a row each tick: m, rad, N; errors are true − wanted."""

    t_s: NDArray[np.float64]
    depth_error_m: NDArray[np.float64]
    heading_error_rad: NDArray[np.float64]
    thrust_n: NDArray[np.float64]
    active: NDArray[np.bool_]

    def figures(self, since_s: float = SETTLE_S) -> dict[str, float]:
        """Return depth error RMS and peak (mm), heading RMS (°), thrust RMS (N), chatter (N a tick)."""
        on = self.t_s >= since_s
        depth, heading, thrust = self.depth_error_m[on], self.heading_error_rad[on], self.thrust_n[on]
        return {
            "depth_rms_mm": 1e3 * _rms(depth),
            "depth_peak_mm": 1e3 * float(np.abs(depth).max()),
            "heading_rms_deg": float(np.degrees(_rms(heading))),
            "thrust_rms_n": _rms(thrust),
            "chatter_n": _rms(np.diff(thrust)),
        }


def dive(scenario: Scenario, config: Config, plant: SimConfig, link: Link) -> Dive:
    """Dive `scenario` with the companion's real engine; `plant` is the base that the scenario disturbs."""
    vehicle = Vehicle(scenario.plant(plant, scenario.seed), scenario.seed)
    engine = Engine(config, scenario.target(0.0), arm=True)
    loop = Lockstep(vehicle, engine, link, scenario.seed, config.loop.rate_hz)
    loop.requests = [Request.ENGAGE]
    rows = []
    for step in loop.run(scenario.duration_s, scenario.target):
        wanted = scenario.target(step.t_s).eta_d
        eta = step.truth.eta
        active = step.sample.verdict.state is State.ACTIVE
        thrust_n = step.sample.delivered.tau[Z]
        rows.append((step.t_s, eta[Z] - wanted[Z], eta[TRUE_PSI] - wanted[PSI], thrust_n, active))
    t_s, depth, heading, thrust, active_column = np.array(rows).T
    return Dive(t_s, depth, wrap(heading), thrust, active_column.astype(bool))


def _rms(x: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(x * x)))
