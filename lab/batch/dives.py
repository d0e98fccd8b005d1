"""Thousands of dives at once, without MAVLink bytes: for the tuning search and the campaigns.

Every line that steers and every line of the plant is the one that runs on the vehicle and in the simulator,
over arrays with a leading dimension of dives; `batch_engine` and `batch_vehicle` hold what is left between.
The figures of the full loop (`lab.dive`) decide; a test shows that these agree with them.
"""

from collections.abc import Callable, Sequence

import numpy as np

from companion.config import Config
from companion.records import Setpoint
from lab.batch.engine import Engines
from lab.batch.legacy import records
from lab.batch.legacy.bounds import wrap
from lab.batch.legacy.records import PSI, Array, Z
from lab.batch.legacy.rival_law import Law
from lab.batch.vehicle import ENGAGED_S, Links, Vehicles
from lab.loop.scenarios import SETTLE_S, Scenario
from sim_bridge.config import SimConfig

TAIL_S = 10.0
LOST_M = 5.0
"""A dive that is further than this from where it should be is given up: its figures stop there."""


def simulate(
    config: Config | Sequence[Config],
    plants: Sequence[SimConfig],
    target: Callable[[float], Setpoint | records.Setpoint],
    duration_s: float,
    seeds: Sequence[int],
    links: Links | None = None,
    *,
    since_s: float = SETTLE_S,
    watch: Callable[[float, Array, Array], None] | None = None,
    rival: Law | None = None,
) -> dict[str, Array]:
    """Dive once with each of `plants` and return figures, (dives,) each.

    Args:
        config: the companion's; one for all dives, or one for each (they may differ in axes and lead_s).
        plants: a vehicle with its water for each dive (one frame and geometry), as `Scenario.plant` makes it.
        target: where all dives should be at each time (s) since boot; arrays (4,) or (dives, 4).
        duration_s: the time since boot at which it ends; a batch begins engaged, at ENGAGED_S.
        seeds: of each dive's sea, noise and the phase of its autopilot's input loop; as in the full loop.
        links: delays, known to the controller except for what `untold_*` says.
        since_s: figures count from here.
        rival: takes the law's place in heave; its gains are scalars or (dives,).
        watch: called each tick with the time, depth error (m) and thrust asked for in heave (N), (dives,).

    Returns `Dive.figures`' depth_rms_mm, depth_peak_mm, heading_rms_deg, thrust_rms_n, chatter_n, and
    tail_rms_mm (depth RMS of the last TAIL_S), tilt_deg (largest) and lost_s (since boot; NaN if never lost).
    A dive's figures do not depend on the others of its batch. A few hundred dives and more are efficient.

    """
    configs = [config] * len(plants) if isinstance(config, Config) else list(config)
    vehicles = Vehicles(plants, seeds, links or Links(), 1.0 / configs[0].loop.rate_hz)
    engines = Engines(configs, vehicles.timing, vehicles.voltage_v, rival)
    figures = _Figures(len(plants))
    tick_s = 1.0 / configs[0].loop.rate_hz
    first, last = round(ENGAGED_S / tick_s), round(duration_s / tick_s)
    axes = np.zeros((len(plants), engines.axes))
    with np.errstate(all="ignore"):  # a lost vehicle may overflow; its figures have stopped by then
        for tick in range(first, last):
            t_s = tick * tick_s
            vehicles.tick(t_s, axes)
            readings = vehicles.read()
            if tick == first:
                engines.start(readings)
            now = _arrays(target(t_s + tick_s))
            axes = engines.step(now, readings)
            wanted = now.eta_d
            depth_error = vehicles.depth_m - wanted[..., Z]
            figures.check(t_s, depth_error)
            if t_s + tick_s >= since_s:
                heading_error = wrap(vehicles.heading_rad - wanted[..., PSI])
                tail = t_s + tick_s > duration_s - TAIL_S
                figures.add(depth_error, heading_error, engines.pushed[:, Z], vehicles.upright, tail)
            if watch is not None:
                watch(t_s + tick_s, depth_error, engines.pushed[:, Z])
    return figures.result()


def simulate_scenarios(
    config: Config | Sequence[Config],
    scenarios: Sequence[Scenario],
    base: SimConfig,
    links: Links | None = None,
) -> dict[str, Array]:
    """Dive scenarios that share one path and duration (one name of `scenarios.four`, many seeds)."""
    plants = [scenario.plant(base, scenario.seed) for scenario in scenarios]
    seeds = [scenario.seed for scenario in scenarios]
    return simulate(config, plants, scenarios[0].target, scenarios[0].duration_s, seeds, links)


def _arrays(wanted: Setpoint | records.Setpoint) -> records.Setpoint:
    return records.Setpoint(*map(np.asarray, (wanted.eta_d, wanted.eta_d_dot, wanted.eta_d_ddot)))


class _Figures:
    """Sums that make the figures, so that memory does not grow with time."""

    def __init__(self, dives: int) -> None:
        self._depth, self._heading, self._thrust, self._change, self._tail = np.zeros((5, dives))
        self._peak, self._count, self._tail_count = np.zeros((3, dives))
        self._upright = np.ones(dives)
        self._last_thrust: Array | None = None
        self.lost_s = np.full(dives, np.nan)

    def check(self, t_s: float, depth_error: Array) -> None:
        """Give up the dives that are lost."""
        lost = ~(np.abs(depth_error) < LOST_M) & np.isnan(self.lost_s)
        self.lost_s[lost] = t_s

    def add(
        self, depth_error: Array, heading_error: Array, thrust: Array, upright: Array, tail: bool
    ) -> None:
        """Take in one tick."""
        on = np.isnan(self.lost_s)
        depth = np.where(on, depth_error, 0.0)
        self._depth += depth**2
        self._heading += np.where(on, heading_error, 0.0) ** 2
        self._thrust += np.where(on, thrust, 0.0) ** 2
        if self._last_thrust is not None:
            self._change += np.where(on, thrust - self._last_thrust, 0.0) ** 2
        self._last_thrust = thrust
        self._peak = np.maximum(self._peak, np.abs(depth))
        self._upright = np.minimum(self._upright, np.where(on, upright, 1.0))
        self._count += on
        if tail:
            self._tail += depth**2
            self._tail_count += on

    def result(self) -> dict[str, Array]:
        """Return the figures, (dives,) each."""
        count = np.maximum(self._count, 1.0)
        return {
            "depth_rms_mm": 1e3 * np.sqrt(self._depth / count),
            "depth_peak_mm": 1e3 * self._peak,
            "heading_rms_deg": np.degrees(np.sqrt(self._heading / count)),
            "thrust_rms_n": np.sqrt(self._thrust / count),
            "chatter_n": np.sqrt(self._change / np.maximum(count - 1.0, 1.0)),
            "tail_rms_mm": 1e3 * np.sqrt(self._tail / np.maximum(self._tail_count, 1.0)),
            "tilt_deg": np.degrees(np.arccos(np.clip(self._upright, -1.0, 1.0))),
            "lost_s": self.lost_s,
        }
