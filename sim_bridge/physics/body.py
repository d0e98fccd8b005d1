"""The vehicle's body in the water: thrusters, hull, sea, tether, load and battery, driven by motor PWM alone.

It knows no autopilot: `sim_bridge.vehicle` drives it with our stand-in firmware, `sim_bridge.json_physics`
with the real one.
"""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from sim_bridge.config import SimConfig
from sim_bridge.physics import plant, thrusters
from sim_bridge.physics.environment import Environment
from sim_bridge.physics.plant import NO_WRENCH, STILL_WATER, Six, State, Three, state_of
from sim_bridge.physics.thrusters import HEALTHY, NO_THRUST, Eight

STEP_S = 0.005
"""Longest step of the plant, and the period at which the sea and the tether change."""
HIGHEST_WAVE = 2.0
"""No trough is deeper than so many significant heights."""
MIN_VOLTAGE_V = 6.0
IDLE_CURRENT_A = 0.5


class Physics:
    """One body, from the configured state on. The same configuration, seed and PWM give the same motion.

    `time_s` counts from its creation; the sea depends on it and on the seed alone, whatever the steps.
    """

    def __init__(self, config: SimConfig, seed: int) -> None:
        self.time_s = 0.0
        self.state: State = state_of(config.initial.eta, NO_WRENCH)
        """x, y, z (m, NED), unit quaternion body to NED, nu (m/s, rad/s, body)."""
        self.nu_dot: Six = NO_WRENCH
        """In the middle of the last step (m/s², rad/s², body)."""
        self.tau: Six = NO_WRENCH
        """Wrench of the thrusters (N, N·m, body)."""
        self.thrust_n: Eight = NO_THRUST
        """What each thruster delivers now; those that the frame does not have deliver nothing."""
        self.health: Eight = HEALTHY
        """Scales the thrust of each: 0 is a dead thruster."""
        self.stuck: dict[int, int] = {}
        """PWM (µs) of motors that do not obey, by index."""
        self.environment = Environment(config, STEP_S, np.random.default_rng(seed).spawn(1)[0])
        self.voltage_v = config.battery.voltage_v
        self.current_a = 0.0
        self.consumed_mah = 0.0
        self._battery = config.battery
        self.body = plant.body_of(config.hull)
        self._thrusters = thrusters.thrusters_of(config.thrusters)
        self._sea_steps = 0
        self.force: Three = (0.0, 0.0, 0.0)
        self.flow: Six = STILL_WATER
        self._driven: tuple[int, ...] = ()
        self._split(STEP_S)
        self._curve_n: dict[int, float] = {}
        """The thrust curve, by PWM (µs)."""
        self._static_thrust = self._bollard_n = NO_THRUST
        self._starting = thrusters.AT_REST
        self._on_the_way: deque[tuple[float, tuple[int, ...]]] = deque()
        """When which PWM reaches the motors, where that takes time."""
        self._thruster_config = config.thrusters
        self._wave_height_m = HIGHEST_WAVE * config.waves.height_m if config.waves.enabled else 0.0
        self._loses_thrust = bool(config.thrusters.free_speed_m_s or config.thrusters.dry_height_m)

    @property
    def thrusters(self) -> int:
        """How many thrusters it has."""
        return self._thrusters.number

    def step(self, pwm: Sequence[int], since_arming_s: float, dt_s: float = STEP_S) -> None:
        """Advance by `dt_s`, however long.

        Args:
            pwm: of each motor, µs; what exceeds the number of thrusters is ignored.
            since_arming_s: time since the first arming, negative before it; the load's timetable.
            dt_s: time to advance (s).

        """
        driven = tuple(pwm[: self.thrusters])
        if self._thruster_config.delay_s:
            driven = self._delayed(driven)
        if self.stuck:
            driven = tuple(self.stuck.get(i, us) for i, us in enumerate(driven))
        if self._driven != driven:
            self._drive(driven)
        if self._split_s != dt_s:
            self._split(dt_s)
        parts, part_s, follow, start_s = (
            self._parts,
            self._part_s,
            self._follow,
            self._thruster_config.start_s,
        )
        for part in range(parts):
            time_s = self.time_s + part * part_s
            if time_s > (self._sea_steps - 1e-6) * STEP_S:
                self.force, self.flow = self.environment.step(
                    self._sea_steps * STEP_S, since_arming_s, self.state
                )
                self._sea_steps += 1
            static = self._static_thrust
            if start_s:
                self._starting, static = thrusters.started(self._starting, static, start_s, part_s)
            self._bollard_n = thrusters.lagged(self._bollard_n, static, follow)
            self.thrust_n = self._left_in_water() if self._loses_thrust else self._bollard_n
            self.tau = thrusters.wrench(self._thrusters, self.thrust_n)
            self.state, self.nu_dot = plant.step(
                self.body, self.state, self.tau, self.force, self.flow, part_s
            )
        self.time_s += dt_s

    def _delayed(self, pwm: tuple[int, ...]) -> tuple[int, ...]:
        """Return the PWM that reaches the motors now."""
        waiting = self._on_the_way
        waiting.append((self.time_s + self._thruster_config.delay_s, pwm))
        while len(waiting) > 1 and waiting[1][0] <= self.time_s + 1e-9:
            waiting.popleft()
        return waiting[0][1] if waiting[0][0] <= self.time_s + 1e-9 else (1500,) * self.thrusters

    def _split(self, dt_s: float) -> None:
        """Part a time into steps of the plant."""
        self._split_s = dt_s
        self._parts = max(1, math.ceil(dt_s / STEP_S - 1e-6))
        self._part_s = dt_s / self._parts
        self._follow = thrusters.follow_of(self._thrusters.lag_s, self._part_s)

    def _left_in_water(self) -> Eight:
        """Return what inflow and the surface leave of the thrust."""
        config, wet = self._thruster_config, 1.0
        x, y, z = self.state[:3]
        if config.dry_height_m and z < self._wave_height_m:
            sea = self.environment.sea
            sunk_m = z + (sea.elevation(self.time_s, x, y, 0.0) if sea else 0.0)
            wet = min(1.0, max(0.0, 1.0 + sunk_m / config.dry_height_m))
        into = thrusters.inflow(self._thrusters, plant.relative_velocity(self.state, self.flow))
        return thrusters.in_water(self._bollard_n, into, config.free_speed_m_s, wet)

    def _drive(self, pwm: tuple[int, ...]) -> None:
        """Put the motors' PWM (µs) in force."""
        self._driven = pwm
        known = self._curve_n
        for us in pwm:
            if us not in known:
                known[us] = thrusters.curve(self._thrusters, float(us))
        a, b, c, d, e, f, g, h = (*(known[us] for us in pwm), 0.0, 0.0)[:8]
        self._static_thrust = thrusters.scaled(
            self._thrusters, self.health, (a, b, c, d, e, f, g, h), self.voltage_v
        )

    def drain(self, source_v: float, dt_s: float) -> None:
        """Draw the current of the last `dt_s` from a battery whose open-circuit voltage is `source_v`."""
        self.current_a = IDLE_CURRENT_A + thrusters.current_a(self.thrust_n)
        self.voltage_v = max(MIN_VOLTAGE_V, source_v - self._battery.resistance_ohm * self.current_a)
        self.consumed_mah += self.current_a * 1000.0 * dt_s / 3600.0
        self._driven = ()

    def acceleration(self) -> tuple[float, float, float]:
        """Acceleration of the centre of gravity over the ground, in body axes (m/s²): nu' + omega × v."""
        u, v, w, p, q, r = self.state[7:]
        a, b, c = self.nu_dot[:3]
        return a + q * w - r * v, b + r * u - p * w, c + p * v - q * u
