"""Thousands of dives without MAVLink bytes: for the tuning search.

The equations that steer are the vehicle's own, those of the plant the simulator's, compiled as they stand;
`companion` and `vehicle` beside this file hold what is left between, `loop` goes through a dive.
The figures of the full loop (`lab.loop.dive`) decide; a test shows that these agree with them.
"""

from collections.abc import Callable, Sequence

import numpy as np

from companion.arrays import Array
from companion.config import Config
from companion.records import Setpoint
from lab.batch.companion import companion_of
from lab.batch.compiled import cached, is_ours
from lab.batch.loop import dive
from lab.batch.stand_in import ENGAGED_S, TICK_S, Links, Rows, drawn, refuse, timing, vehicle_of
from lab.loop.dive import figures_of
from lab.loop.scenarios import SETTLE_S
from sim_bridge.sim_config import SimConfig


def simulate(
    config: Config | Sequence[Config],
    plants: Sequence[SimConfig],
    target: Callable[[float], Setpoint] | Sequence[Callable[[float], Setpoint]],
    duration_s: float,
    seeds: Sequence[int],
    links: Links | None = None,
    *,
    since_s: float = SETTLE_S,
) -> dict[str, Array]:
    """Dive once with each of `plants`, one after the other, and return figures, (dives,) each.

    Args:
        config: the companion's; one for all dives, or one for each.
        plants: a vehicle with its water for each dive, as `Scenario.plant` makes it.
        target: where a dive should be at each time (s) since boot; one for all, or one for each.
        duration_s: the time since boot at which it ends; a dive begins engaged, at ENGAGED_S.
        seeds: of each dive's sea, noise and the phase of its autopilot's input loop; as in the full loop.
        links: delays, known to the controller.
        since_s: figures count from here.

    Returns `Dive.figures`' place_rms_mm, depth_rms_mm, depth_peak_mm, thrust_rms_n and
    chatter_n, place_chatter_n (RMS change of the horizontal force in a tick), tilt_deg (largest), hidden_s
    (hidden delay that was found at the end) and lost_s (since boot; NaN if never lost).
    Raises ValueError for what only the full loop can do.

    """
    configs = [config] * len(plants) if isinstance(config, Config) else list(config)
    targets = [target] * len(plants) if callable(target) else list(target)
    ticks = round(duration_s / TICK_S) - round(ENGAGED_S / TICK_S)
    ends_s = ENGAGED_S + TICK_S * np.arange(1, ticks + 1)
    since = int(np.searchsorted(ends_s, since_s - 1e-9))
    wanted = {target: targets_of(target, ends_s.tolist()) for target in dict.fromkeys(targets)}
    links = links or Links()
    delays = [np.broadcast_to(delay_s, len(plants)) for delay_s in (links.up_s, links.down_s, links.jitter_s)]
    companions = {id(settings): companion_of(settings) for settings in configs}
    rows = []
    for i, (settings, plant, seed) in enumerate(zip(configs, plants, seeds, strict=True)):
        refuse(plant)
        at = timing(seed, *(float(values[i]) for values in delays))
        companion, aim, found = companions[id(settings)], wanted[targets[i]].copy(), np.zeros((ticks, 7))
        loop, vehicle = cached(dive, keeps=is_ours(companion.parameters)), vehicle_of(plant, at)
        held, hidden_s = loop(vehicle, drawn(plant, seed, ticks), companion, at, aim, found)
        lost_s = ENGAGED_S + held * TICK_S if held < ticks else np.nan
        aim[:, :2] = np.where(np.isnan(aim[:, :2]), vehicle.start[:2], aim[:, :2])
        place = found[:, :3] - aim[:, :3]
        tilt = np.arccos(np.clip(found[since:held, 3], -1.0, 1.0))
        figures = figures_of(place[since:held], tilt, found[since:held, 4:])
        figures["place_rms_mm"] = figures["place_rms_mm"] if vehicle.positioned else np.nan
        rows.append(figures | {"hidden_s": hidden_s, "lost_s": lost_s})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def targets_of(target: Callable[[float], Setpoint], times_s: list[float]) -> Rows:
    """Return a target as the loop takes it, (ticks, 12)."""
    wanted = [target(t_s) for t_s in times_s]
    return np.array([(*now.eta_d, *now.eta_d_dot, *now.eta_d_ddot) for now in wanted])
