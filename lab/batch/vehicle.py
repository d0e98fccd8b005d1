"""Many stand-in vehicles at once: the simulator's own plant and thrusters over arrays of shape (dives,).

The equations are `sim_bridge`'s. What is written here are the parts that exist there for one vehicle only:
noise, the sum over a sea's waves, a command's way to the motors, the sensors' past.

| as in the simulator                          | simpler here                                               |
|----------------------------------------------|------------------------------------------------------------|
| 6-DOF plant, RK2 every 5 ms, T200 curve, lag | water and noise change once a tick, not every 5 ms         |
| input loop's phase, drawn from the same seed | jitter counts by its mean; every frame arrives             |
| the same sea, wave by wave, for a seed       | roll, pitch noise and the battery's resistance are left out |
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from lab.batch.legacy.bounds import wrap
from lab.batch.legacy.factors import FACTORS
from lab.batch.legacy.records import Array
from lab.batch.legacy.sim_plant import Component, Components, Plant, rotation, state_of
from lab.batch.legacy.sim_thrusters import Thrusters
from sim_bridge.config import SimConfig
from sim_bridge.firmware.autopilot import INPUT_PERIOD_S
from sim_bridge.physics.body import STEP_S
from sim_bridge.physics.environment import Environment

ARMED_S, ENGAGED_S = 2.04, 3.04
"""When the full loop arms and engages, from boot: a batch begins engaged; its load counts from the arming."""

NORMALS = 13
SIGNALS = 8
BLOCK = 64
OVERRIDE_SPAN_US = 400.0
WIRE_PER_M = 1000.0
MIN_COS_SQUARED = 0.01
KNEE_US, DEAD_BAND_US = 60.0, 28.0
"""Of the measured curve (thrusters.CURVE_US): its first point beyond the dead band, and the dead band."""


@dataclass(frozen=True)
class Links:
    """Each dive's link, seconds: scalars or (dives,). The controller does not know of what is untold."""

    up_s: Array | float = 0.001
    down_s: Array | float = 0.001
    jitter_s: Array | float = 0.004
    untold_up_s: Array | float = 0.0
    untold_down_s: Array | float = 0.0


@dataclass(frozen=True)
class Timing:
    """Where the delays fall on the grid of ticks and steps, seconds, (dives,) each.

    `age_s` from a sample's sending to the tick that takes it, `to_motor_s` from a command to the motors; the
    rest is what the companion's meter makes of both (`companion.delay`), less what was not told.
    """

    age_s: Array
    to_motor_s: Array
    believed_age_s: Array
    telemetry_s: Array
    command_s: Array

    @classmethod
    def of(cls, links: Links, phase_steps: Array) -> "Timing":
        """Work it out; `phase_steps` (dives,) is when in a tick the autopilot reads its input, in steps."""
        zero = np.zeros(len(phase_steps))
        up_s = zero + links.up_s + 0.5 * np.asarray(links.jitter_s)
        down_s = zero + links.down_s + 0.5 * np.asarray(links.jitter_s)
        read_s = phase_steps * STEP_S
        sent_s = read_s + STEP_S
        age_s = _next(INPUT_PERIOD_S - sent_s, up_s)
        to_motor_s = _next(read_s, down_s)
        return cls(
            age_s=age_s,
            to_motor_s=to_motor_s,
            believed_age_s=age_s - links.untold_up_s,
            telemetry_s=up_s - links.untold_up_s,
            command_s=to_motor_s + STEP_S - links.untold_down_s,  # echoes carry the start of the step's time
        )


@dataclass(frozen=True)
class Readings:
    """What telemetry brings to a tick, (dives,) each: m and m/s down, rad and rad/s."""

    depth_m: Array
    sink_mps: Array
    heading_rad: Array
    heading_rate_radps: Array
    angles_rad: Array
    """Roll and pitch, (dives, 2)."""
    rates_radps: Array
    """Their body rates, (dives, 2)."""


class Vehicles:
    """The truth of many dives. `tick` advances by one tick, `read` gives what the sensors report."""

    def __init__(
        self, configs: Sequence[SimConfig], seeds: Sequence[int], links: Links, tick_s: float
    ) -> None:
        """Put every vehicle at its initial place.

        Raises ValueError where `configs` differ in what has to be one (frame and geometry), or ask for what
        only the full simulator has.
        """
        _refuse(configs, tick_s)
        dives = len(configs)
        self._dives, self._tick_s = dives, tick_s
        self._steps = round(tick_s / STEP_S)
        self._every = np.arange(dives)
        phases = [int(np.random.default_rng(seed).spawn(4)[3].integers(0, self._steps)) for seed in seeds]
        self.timing = Timing.of(links, -np.array(phases) % self._steps)
        self.voltage_v = np.array([config.battery.voltage_v for config in configs])[:, None]

        hulls = [config.hull for config in configs]
        self._plant = Plant(
            _column([hull.mass_kg for hull in hulls]),
            _columns([hull.inertia_kg_m2 for hull in hulls]),
            _columns([hull.added_mass for hull in hulls]),
            _columns([hull.linear_damping for hull in hulls]),
            _columns([hull.quadratic_damping for hull in hulls]),
            _column([hull.net_buoyancy_n for hull in hulls]),
            _column([hull.centre_of_buoyancy_up_m for hull in hulls]),
            _column([hull.height_m for hull in hulls]),
        )
        frame = configs[0].thrusters.frame
        nominal = replace(configs[0].thrusters, gain=(1.0,), dead_band_us=DEAD_BAND_US)
        self._thrusters = Thrusters(nominal, (dives,))
        count = self._thrusters.count
        self._thrusters.health[:] = [np.broadcast_to(config.thrusters.gain, count) for config in configs]
        lags_s = np.array([config.thrusters.lag_s for config in configs])
        self._follow = (1.0 - np.exp(-STEP_S / lags_s))[:, None]
        self._dead_band_us = np.array([config.thrusters.dead_band_us for config in configs])[:, None]
        self._mix = np.array(FACTORS[frame], float)[:, [4, 5, 3, 2, 0, 1]] * (1.0, 1.0, -1.0, 1.0, 1.0, 1.0)

        start = np.array([config.initial.eta for config in configs])
        self._state: Components = [
            np.ascontiguousarray(part) for part in state_of(start, np.zeros((dives, 6)))
        ]
        self._water = _Water(configs, seeds, tick_s)
        self._set_up_delays(configs)

    def _set_up_delays(self, configs: Sequence[SimConfig]) -> None:
        """Lay out the commands on their way and the past that the sensors still report."""
        steps, timing = self._steps, self.timing
        to_motor = np.rint(timing.to_motor_s / STEP_S).astype(int)
        back = -((np.arange(steps)[:, None] - to_motor) // steps)  # ticks ago, of the newest that is in force
        self._switches = [np.flatnonzero((to_motor - step) % steps == 0) for step in range(steps)]
        self._back = [back[step, which] for step, which in enumerate(self._switches)]
        self._flying = np.zeros((int(back.max()) + 1, self._dives, self._thrusters.count))
        self._static = np.zeros((self._dives, self._thrusters.count))

        sensors = [config.sensors for config in configs]
        own_s = [(s.depth_delay_s, s.climb_delay_s, *[s.attitude_delay_s] * 6) for s in sensors]
        self._whole, self._part = np.divmod((timing.age_s + np.array(own_s).T) / STEP_S, 1.0)
        self._whole = self._whole.astype(int)
        self._past = np.empty((int(self._whole.max()) + 2, SIGNALS, self._dives))
        self._see(self._past[0])
        self._past[:] = self._past[0]
        self._tick = self._step = 0

    def tick(self, t_s: float, axes: Array) -> None:
        """Advance from `t_s` by one tick; `axes` (dives, 4..6), on the wire's grid, leave at its start."""
        mix = self._mix[:, : axes.shape[-1]]
        offset = np.rint(OVERRIDE_SPAN_US * np.clip(axes @ mix.T, -1.0, 1.0))
        flying, thrusters = self._flying, self._thrusters
        flying[self._tick % len(flying)] = thrusters.static_thrust(
            1500.0 + _on_nominal_curve(offset, self._dead_band_us), self.voltage_v
        )
        force, flow = self._water.act(t_s, *self._state[:3])
        for which, back in zip(self._switches, self._back, strict=True):
            self._static[which] = flying[(self._tick - back) % len(flying), which]
            thrusters.thrust_n = thrusters.thrust_n + self._follow * (self._static - thrusters.thrust_n)
            tau = np.ascontiguousarray(thrusters.wrench().T)
            self._state, _ = self._plant.step(self._state, list(tau), force, flow, STEP_S)
            self._step += 1
            self._see(self._past[self._step % len(self._past)])
        self._tick += 1

    def read(self) -> Readings:
        """Return what the telemetry that the present tick takes in reports."""
        past = self._past
        signals = np.arange(SIGNALS)[:, None]
        newer = past[(self._step - self._whole) % len(past), signals, self._every]
        older = past[(self._step - self._whole - 1) % len(past), signals, self._every]
        turn = older - newer
        turn[2] = wrap(turn[2])
        seen = newer + self._part * turn
        depth, sink, heading, rate = self._water.noise()
        return Readings(
            np.trunc(WIRE_PER_M * (self._water.depth_scale * seen[0] + depth)) / WIRE_PER_M,
            self._water.depth_scale * seen[1] + sink,
            seen[2] + heading,
            seen[3] + rate,
            seen[4:6].T,
            seen[6:8].T,
        )

    @property
    def depth_m(self) -> Array:
        """True depth, (dives,)."""
        return np.asarray(self._state[2])

    @property
    def heading_rad(self) -> Array:
        """True heading, (dives,)."""
        return np.asarray(self._past[self._step % len(self._past), 2])

    @property
    def upright(self) -> Array:
        """Cosine of the tilt, (dives,)."""
        return np.asarray(rotation(self._state)[8])

    def _see(self, seen: Array) -> None:
        """Write depth and heading with their rates, roll, pitch and theirs into `seen` (SIGNALS, dives)."""
        r11, _, _, r21, _, _, r31, r32, r33 = rotation(self._state)
        u, v, w, p, q, r = self._state[7:]
        seen[0] = self._state[2]
        seen[1] = r31 * u + r32 * v + r33 * w
        seen[2] = np.arctan2(r21, r11)
        seen[3] = (q * r32 + r * r33) / np.maximum(r32 * r32 + r33 * r33, MIN_COS_SQUARED)
        seen[4] = np.arctan2(r32, r33)
        seen[5] = -np.arcsin(np.clip(r31, -1.0, 1.0))
        seen[6], seen[7] = p, q


class _Water:
    """Waves, current, tether and load, and the sensors' noise: all that is drawn, from each dive's seed."""

    def __init__(self, configs: Sequence[SimConfig], seeds: Sequence[int], tick_s: float) -> None:
        self._tick_s = tick_s
        self._rngs = [np.random.default_rng((seed, 3)) for seed in seeds]
        self._normals = np.empty((0, NORMALS, len(seeds)))
        sensors = [config.sensors for config in configs]
        currents, tethers = [config.current for config in configs], [config.tether for config in configs]
        tau_s = np.array(
            [
                (s.slow_tau_s, s.slow_tau_s, s.drift_tau_s, 5.0, c.tau_s, c.tau_s, t.tau_s, t.tau_s, t.tau_s)
                for s, c, t in zip(sensors, currents, tethers, strict=True)
            ]
        ).T
        sigma = np.array(
            [
                (
                    *(s.depth_slow_m, s.climb_slow_m_s, s.drift_m, s.attitude_slow_rad),
                    *((c.sigma_m_s if c.enabled else 0.0,) * 2),
                    *(t.sigma_n if t.enabled else (0.0, 0.0, 0.0)),
                )
                for s, c, t in zip(sensors, currents, tethers, strict=True)
            ]
        ).T
        self._keep = np.exp(-tick_s / tau_s)
        self._kick = sigma * np.sqrt(1.0 - self._keep**2)
        self._white = np.array(
            [(s.depth_white_m, s.climb_white_m_s, s.attitude_white_rad, s.gyro_white_rad_s) for s in sensors]
        ).T
        self.depth_scale = np.array([s.depth_scale for s in sensors])
        direction = np.radians([c.direction_deg for c in currents])
        speed = np.array([c.speed_m_s * c.enabled for c in currents])
        self._current = speed * np.stack([np.cos(direction), np.sin(direction)])
        self._pull = np.array([t.pull_n if t.enabled else (0.0, 0.0, 0.0) for t in tethers]).T
        self._pull_per_m = np.array([t.heave_n_per_m * t.enabled for t in tethers])
        loads = [config.load for config in configs]
        self._load = np.array([(load.weight_n * load.enabled, load.on_s, load.off_s) for load in loads]).T
        rough = [i for i, config in enumerate(configs) if config.waves.enabled]
        self._rough = np.array(rough, int)
        self._seas = _Seas([configs[i] for i in rough], [seeds[i] for i in rough]) if rough else None
        self._slow = sigma * self._next_normals()[:9]

    def act(
        self, t_s: float, x: Component, y: Component, z: Component
    ) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Return force (N) and flow (m/s, m/s²) of one tick, NED, components of shape (dives,)."""
        normals = self._next_normals()
        self._drawn = normals[9:]
        self._slow = self._keep * self._slow + self._kick * normals[:9]
        flow = np.zeros((6, len(x)))
        flow[:2] = self._current + self._slow[4:6]
        if self._seas is not None:
            rough = self._rough
            flow[:, rough] += self._seas.flow(t_s + 0.5 * self._tick_s, x[rough], y[rough], z[rough])
        force = self._pull + self._slow[6:9]
        weight_n, on_s, off_s = self._load
        hung = (t_s - ARMED_S >= on_s) & (t_s - ARMED_S < off_s)
        return (force[0], force[1], force[2] + self._pull_per_m * z + weight_n * hung), tuple(flow)

    def noise(self) -> Array:
        """Return what telemetry adds to depth, sink rate, heading and its rate, (4, dives)."""
        noise: Array = self._white * self._drawn
        noise[0] += self._slow[0] + self._slow[2]
        noise[1] += self._slow[1]
        noise[2] += self._slow[3]
        return noise

    def _next_normals(self) -> Array:
        """Return (NORMALS, dives), each dive's from its own generator: a batch draws as a single does."""
        if not len(self._normals):
            drawn = [rng.standard_normal((BLOCK, NORMALS)) for rng in self._rngs]
            self._normals = np.ascontiguousarray(np.stack(drawn, axis=-1))
        now: Array = self._normals[0]
        self._normals = self._normals[1:]
        return now


class _Seas:
    """The simulator's seas, summed up for many dives: `environment.JonswapSea.flow`, wave by wave."""

    def __init__(self, configs: Sequence[SimConfig], seeds: Sequence[int]) -> None:
        seas = [
            Environment(config, STEP_S, np.random.default_rng(seed).spawn(4)[0]).sea
            for config, seed in zip(configs, seeds, strict=True)
        ]
        waves = max(config.waves.components for config in configs)

        def stacked(name: str) -> Array:
            rows = [getattr(sea, name) for sea in seas]
            return np.array([np.pad(row, (0, waves - len(row))) for row in rows]).T

        self._a, self._omega, self._k, self._phase = (
            stacked(name) for name in ("amplitude", "omega", "k", "phase")
        )
        direction = np.radians([config.waves.direction_deg for config in configs])
        self._north, self._east = np.cos(direction), np.sin(direction)

    def flow(self, t_s: float, x: Array, y: Array, z: Array) -> Array:
        """Orbital velocity and acceleration of the water in NED, (6, dives).

        Sines and exponentials in single precision: five times as fast, and off by 3e-5 of a wave.
        """
        angle = self._omega * t_s - self._k * (x * self._north + y * self._east) + self._phase
        turned = (angle % (2.0 * np.pi)).astype(np.float32)
        fade = np.exp((-self._k * np.maximum(z, 0.0)).astype(np.float32))
        speed = self._a * self._omega * fade
        in_phase, quadrature = speed * np.cos(turned), speed * np.sin(turned)
        along, down = in_phase.sum(0), quadrature.sum(0)
        d_along, d_down = -(self._omega * quadrature).sum(0), (self._omega * in_phase).sum(0)
        north, east = self._north, self._east
        return np.stack([along * north, along * east, down, d_along * north, d_along * east, d_down])


def _on_nominal_curve(offset_us: Array, dead_band_us: Array) -> Array:
    """Return the offset at which the measured curve pushes as a thruster of another dead band does here."""
    beyond = (np.abs(offset_us) - dead_band_us) * ((KNEE_US - DEAD_BAND_US) / (KNEE_US - dead_band_us))
    near = np.copysign(np.maximum(beyond, 0.0) + DEAD_BAND_US, offset_us)
    return np.where(np.abs(offset_us) < KNEE_US, near, offset_us)


def _refuse(configs: Sequence[SimConfig], tick_s: float) -> None:
    """Raise ValueError for what a batch cannot do."""
    if abs(tick_s - INPUT_PERIOD_S) > 1e-9:
        raise ValueError(
            f"a batch ticks as the autopilot's input loop does, in {INPUT_PERIOD_S} s: not {tick_s}"
        )
    first = configs[0].thrusters
    shape = (first.frame, first.horizontal_m, first.vertical_m)
    for config in configs:
        thrusters, sensors = config.thrusters, config.sensors
        if (thrusters.frame, thrusters.horizontal_m, thrusters.vertical_m) != shape:
            raise ValueError("the vehicles of a batch need one frame and geometry: make a batch of each")
        if thrusters.curve != "t200" or thrusters.lag_s == 0.0:
            raise ValueError("thrusters without lag, or of another curve than t200, need the full loop")
        if config.faults or config.heave_force.enabled or sensors.dvl or sensors.wave_pressure:
            raise ValueError("faults, scripted heave forces, a DVL and wave pressure need the full loop")


def _next(first_s: Array, after_s: Array) -> Array:
    """Return the first of `first_s` + whole ticks that is not before `after_s`; both (dives,)."""
    return first_s + INPUT_PERIOD_S * np.ceil(np.round((after_s - first_s) / INPUT_PERIOD_S, 9))


def _column(values: Sequence[float]) -> Array:
    return np.array(values, float)


def _columns(rows: Sequence[Sequence[float]]) -> list[Array]:
    return [np.ascontiguousarray(column) for column in np.array(rows, float).T]
