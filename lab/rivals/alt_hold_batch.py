"""ArduSub's depth hold for many dives at once, in heave alone: what the search for its gains runs on.

The loop is that of `sim_bridge.modes.FlightControl._depth` (stick at rest) every 5 ms; the vehicle is its
heave: mass, drag, lag, dead band, PWM in whole µs, sea, tether and load. The figures of the full double
decide; a test shows that these agree with them.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from companion.records import Array, Setpoint, Z
from lab.batch.vehicle import ARMED_S
from lab.loop.scenarios import SETTLE_S
from sim_bridge.config import SimConfig
from sim_bridge.firmware.modes import (
    CLIMB_FILTER_HZ,
    MAX_ACCELERATION_M_S2,
    RISE_FILTER_HZ,
    SPEED_UP_M_S,
    THROTTLE_FILTER_HZ,
    smoothing,
)
from sim_bridge.physics.body import STEP_S
from sim_bridge.physics.environment import Environment
from sim_bridge.physics.plant import GRAVITY
from sim_bridge.physics.sensors import ACCEL_FILTER_DELAY_S
from sim_bridge.physics.thrusters import CURVE_N, CURVE_US

VERTICAL = 4
TICK_STEPS = 4
START_S = 3.2
KEPT_S = 0.1


def simulate(
    plants: Sequence[SimConfig],
    targets: Sequence[Callable[[float], Setpoint]],
    duration_s: float,
    seeds: Sequence[int],
    link_s: Array,
    gains: Mapping[str, Array | float],
) -> dict[str, Array]:
    """Return depth_rms_mm and chatter_n, (dives,); `link_s` (dives,) is how late its target comes."""
    rng, aims = np.random.default_rng((len(seeds), *seeds)), _Aims(targets)
    hull, thrusters = [plant.hull for plant in plants], [plant.thrusters for plant in plants]
    mass = np.array([one.mass_kg + one.added_mass[2] for one in hull])
    added = np.array([one.added_mass[2] for one in hull])
    linear, quadratic = (np.array([d[2] for d in ds]) for ds in zip(*_dampings(plants), strict=True))
    buoyancy = np.array([one.net_buoyancy_n for one in hull])
    displaced = np.array([one.mass_kg for one in hull]) + buoyancy / GRAVITY
    strength = VERTICAL * np.array([one.gain[0] for one in thrusters])
    follow = 1.0 - np.exp(-STEP_S / np.array([one.lag_s for one in thrusters]))
    curve = np.tile(np.array(CURVE_US, float), (len(plants), 1))
    curve[:, 5] = [-one.dead_band_us for one in thrusters]
    curve[:, 6] = -curve[:, 5]
    water = [
        Environment(p, STEP_S, np.random.default_rng(s).spawn(4)[0])
        for p, s in zip(plants, seeds, strict=True)
    ]
    sensors = plants[0].sensors
    slow = np.array([sensors.depth_slow_m, sensors.drift_m, sensors.climb_slow_m_s])[:, None]
    keep = np.exp(-STEP_S / np.array([sensors.slow_tau_s, sensors.drift_tau_s, sensors.slow_tau_s]))[:, None]
    noise = slow * rng.standard_normal((3, len(plants)))

    lates_s, which = np.unique(link_s, return_inverse=True)
    z = np.array([plant.initial.eta[2] for plant in plants])
    w, thrust, integral, lacking, excess, up = np.zeros((6, len(plants)))
    soft = [smoothing(hz, STEP_S) for hz in (CLIMB_FILTER_HZ, RISE_FILTER_HZ, THROTTLE_FILTER_HZ)]
    past = np.tile(z, (round(KEPT_S / STEP_S), 3, 1)) * np.array([1.0, 0.0, 0.0])[:, None]
    felt = round(ACCEL_FILTER_DELAY_S / STEP_S)
    late = [round(delay / STEP_S) for delay in (sensors.depth_delay_s, sensors.climb_delay_s)]
    squares, changes, count, last = np.zeros(len(plants)), np.zeros(len(plants)), 0, np.zeros(len(plants))
    for step in range(round(START_S / STEP_S), round(duration_s / STEP_S)):
        t_s = step * STEP_S
        if step % TICK_STEPS == 0:
            acting = [
                one.step(t_s, t_s - ARMED_S, 0.0, 0.0, depth) for one, depth in zip(water, z, strict=True)
            ]
            force, speed, acceleration = np.array([(f[2], flow[2], flow[5]) for f, flow in acting]).T
            wanted = np.choose(which, [aims.depths(t_s - late_s) for late_s in lates_s])
        noise = keep * noise + slow * np.sqrt(1.0 - keep**2) * rng.standard_normal(noise.shape)
        white = rng.standard_normal((2, len(plants)))
        depth = past[(step - late[0]) % len(past), 0] + noise[0] + noise[1] + sensors.depth_white_m * white[0]
        climb = -past[(step - late[1]) % len(past), 1] + noise[2] + sensors.climb_white_m_s * white[1]
        off, near = depth - wanted, MAX_ACCELERATION_M_S2 / gains["PSC_POSZ_P"] ** 2
        braking = np.sqrt(2.0 * MAX_ACCELERATION_M_S2 * np.maximum(np.abs(off) - 0.5 * near, 0.0))
        rate = np.where(np.abs(off) <= near, gains["PSC_POSZ_P"] * off, np.copysign(braking, off))
        rate = np.clip(rate, -SPEED_UP_M_S, SPEED_UP_M_S)
        lacking += soft[0] * (rate - climb - lacking)
        rise = -past[(step - felt) % len(past), 2]
        excess += soft[1] * (gains["PSC_VELZ_P"] * lacking - rise - excess)
        integral = np.clip(integral + 0.2 * gains["PSC_ACCZ_I"] * excess * STEP_S, -1.0, 1.0)
        up += soft[2] * (np.clip(0.2 * gains["PSC_ACCZ_P"] * excess + integral, -1.0, 1.0) - up)
        offset = np.trunc(-400.0 * up)
        static = np.array([np.interp(x, points, CURVE_N) for x, points in zip(offset, curve, strict=True)])
        thrust += follow * (strength * static - thrust)
        relative = w - speed
        push = thrust - buoyancy + force + (displaced + added) * acceleration
        w_dot = (push - (linear + quadratic * np.abs(relative)) * relative) / mass
        w = w + STEP_S * w_dot
        z = z + STEP_S * w
        past[(step + 1) % len(past)] = z, w, w_dot
        if step % TICK_STEPS == TICK_STEPS - 1 and t_s >= SETTLE_S:
            asked = VERTICAL * np.interp(offset, CURVE_US, CURVE_N)
            squares += (z - aims.depths(t_s + STEP_S)) ** 2
            changes += (asked - last) ** 2 if count else 0.0
            count, last = count + 1, asked
    return {
        "depth_rms_mm": 1e3 * np.sqrt(squares / count),
        "chatter_n": np.sqrt(changes / (count - 1)),
    }


class _Aims:
    """Where many dives should be; targets that several share are asked once."""

    def __init__(self, targets: Sequence[Callable[[float], Setpoint]]) -> None:
        self._different = list(dict.fromkeys(targets))
        index = {target: i for i, target in enumerate(self._different)}
        self._which = [index[target] for target in targets]

    def depths(self, t_s: float) -> Array:
        """Return the depths at a time, (dives,)."""
        return np.array([target(t_s).eta_d[Z] for target in self._different])[self._which]


def _dampings(plants: Sequence[SimConfig]) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    return [(plant.hull.linear_damping, plant.hull.quadratic_damping) for plant in plants]
