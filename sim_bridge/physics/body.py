"""The vehicle's body in the water: thrusters, hull, sea, tether, load and battery, driven by motor PWM alone.

It knows no autopilot: `sim_bridge.vehicle` drives it with our stand-in firmware,
`sim_bridge.physics.json_physics` with the real one.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim_bridge.physics import plant, thrusters
from sim_bridge.physics.environment import Environment
from sim_bridge.physics.plant import NO_WRENCH, STILL_WATER, Body, Six, State, Three, state_of
from sim_bridge.physics.thrusters import HEALTHY, NEUTRAL_US, NO_THRUST, Eight, Starting, ThrusterBank
from sim_bridge.sim_config import SimConfig

STEP_S = 0.005
"""Longest step of the plant, and the period at which the sea and the tether change."""
HIGHEST_WAVE = 2.0
"""No trough is deeper than so many significant heights."""
MIN_VOLTAGE_V = 6.0
IDLE_CURRENT_A = 0.5


class Plant(NamedTuple):
    """A body with its thrusters, and the length of its steps."""

    body: Body
    thrusters: ThrusterBank
    step_s: float
    follow: float
    """What `thrusters.follow_of` gives for a step."""


class Motors(NamedTuple):
    """What the thrusters do at one moment."""

    starting: Starting
    bollard_n: Eight
    """What each would deliver in water that stands still."""
    thrust_n: Eight
    tau: Six


NOT_DRIVEN = Motors(thrusters.AT_REST, NO_THRUST, NO_THRUST, NO_WRENCH)


def plant_of(config: SimConfig, step_s: float) -> Plant:
    """Make the parameters of a configured vehicle."""
    fitted = thrusters.thrusters_of(config.thrusters)
    return Plant(plant.body_of(config.hull), fitted, step_s, thrusters.follow_of(fitted.lag_s, step_s))


def moved(
    hull: Plant, motors: Motors, state: State, static: Eight, force: Three, flow: Six, wet: float
) -> tuple[Motors, State, Six]:
    """One step of motors and body; return both, and nu' (body, at the middle of the step).

    `static` is the thrust (N) to which the motors' commands lead, `force` and `flow` are those of
    `plant.derivative`, and `wet` (0..1) is the part of the thrusters that is under water.
    """
    fitted, starting = hull.thrusters, motors.starting
    if fitted.start_s > 0.0:
        starting, static = thrusters.started(starting, static, fitted.start_s, hull.step_s)
    bollard_n = thrust_n = thrusters.lagged(motors.bollard_n, static, hull.follow)
    if fitted.free_speed_m_s > 0.0 or wet < 1.0:
        into = thrusters.inflow(fitted, plant.relative_velocity(state, flow))
        thrust_n = thrusters.in_water(bollard_n, into, fitted.free_speed_m_s, wet)
    tau = thrusters.wrench(fitted, thrust_n)
    state, nu_dot = plant.step(hull.body, state, tau, force, flow, hull.step_s)
    return Motors(starting, bollard_n, thrust_n, tau), state, nu_dot


class Physics:
    """One body, from the configured state on. The same configuration, seed and PWM give the same motion.

    `time_s` counts from its creation; the sea depends on it and on the seed alone, whatever the steps.
    """

    def __init__(self, config: SimConfig, seed: int) -> None:
        self.time_s = 0.0
        self.state: State = state_of(config.initial.eta, NO_WRENCH)
        """x, y, z (m, NED), unit quaternion body to NED, nu (m/s, rad/s, body)."""
        self.nu_dot: Six = NO_WRENCH
        """Acceleration in the middle of the last step (m/s², rad/s², body)."""
        self._motors = NOT_DRIVEN
        self.health: Eight = HEALTHY
        """Scales the thrust of each: 0 is a dead thruster."""
        self.stuck: dict[int, int] = {}
        """PWM (µs) of motors that do not obey, by index."""
        self.environment = Environment(config, STEP_S, np.random.default_rng(seed).spawn(1)[0])
        self.voltage_v = config.battery.voltage_v
        self.current_a = 0.0
        self.consumed_mah = 0.0
        self._config = config
        self._split(STEP_S)
        self._sea_steps = 0
        self.force: Three = (0.0, 0.0, 0.0)
        self.flow: Six = STILL_WATER
        self._driven: tuple[int, ...] = ()
        self._curve_n: dict[int, float] = {}
        """The thrust curve, by PWM (µs)."""
        self._static_thrust = NO_THRUST
        self._on_the_way: deque[tuple[float, tuple[int, ...]]] = deque()
        """When which PWM reaches the motors, where that takes time."""
        self._wave_height_m = HIGHEST_WAVE * config.waves.height_m if config.waves.enabled else 0.0

    @property
    def body(self) -> Body:
        """What the equations of motion know of it."""
        return self._hull.body

    @property
    def tau(self) -> Six:
        """Wrench of the thrusters (N, N·m, body)."""
        return self._motors.tau

    @property
    def thrust_n(self) -> Eight:
        """What each thruster delivers now; those that the frame does not have deliver nothing."""
        return self._motors.thrust_n

    @property
    def thrusters(self) -> int:
        """How many thrusters it has."""
        return self._hull.thrusters.number

    def step(self, pwm: Sequence[int], since_arming_s: float, dt_s: float = STEP_S) -> None:
        """Advance by `dt_s`, however long; `pwm` (µs) of more motors than there are is ignored.

        The load's timetable is `since_arming_s`, the time since the first arming, negative before it.
        """
        driven = tuple(pwm[: self.thrusters])
        if self._config.thrusters.delay_s:
            driven = self._delayed(driven)
        if self.stuck:
            driven = tuple(self.stuck.get(i, us) for i, us in enumerate(driven))
        if self._driven != driven:
            self._drive(driven)
        if self._split_s != dt_s:
            self._split(dt_s)
        for part in range(self._parts):
            time_s = self.time_s + part * self._hull.step_s
            if time_s > (self._sea_steps - 1e-6) * STEP_S:
                self.force, self.flow = self.environment.step(
                    self._sea_steps * STEP_S, since_arming_s, self.state
                )
                self._sea_steps += 1
            self._motors, self.state, self.nu_dot = moved(
                self._hull, self._motors, self.state, self._static_thrust, self.force, self.flow, self._wet()
            )
        self.time_s += dt_s

    def _delayed(self, pwm: tuple[int, ...]) -> tuple[int, ...]:
        waiting = self._on_the_way
        waiting.append((self.time_s + self._config.thrusters.delay_s, pwm))
        while len(waiting) > 1 and waiting[1][0] <= self.time_s + 1e-9:
            waiting.popleft()
        return waiting[0][1] if waiting[0][0] <= self.time_s + 1e-9 else (NEUTRAL_US,) * self.thrusters

    def _split(self, dt_s: float) -> None:
        """Part a time into steps of the plant."""
        self._split_s = dt_s
        self._parts = max(1, math.ceil(dt_s / STEP_S - 1e-6))
        self._hull = plant_of(self._config, dt_s / self._parts)

    def _wet(self) -> float:
        dry_height_m, (x, y, z) = self._config.thrusters.dry_height_m, self.state[:3]
        if not dry_height_m or z >= self._wave_height_m:
            return 1.0
        sea = self.environment.sea
        sunk_m = z + (sea.elevation(self.time_s, x, y, 0.0) if sea else 0.0)
        return min(1.0, max(0.0, 1.0 + sunk_m / dry_height_m))

    def _drive(self, pwm: tuple[int, ...]) -> None:
        """Put the motors' PWM (µs) in force."""
        self._driven = pwm
        known = self._curve_n
        for us in pwm:
            if us not in known:
                known[us] = thrusters.curve(self._hull.thrusters, float(us))
        a, b, c, d, e, f, g, h = (*(known[us] for us in pwm), 0.0, 0.0)[:8]
        self._static_thrust = thrusters.scaled(
            self._hull.thrusters, self.health, (a, b, c, d, e, f, g, h), self.voltage_v
        )

    def drain(self, source_v: float, dt_s: float) -> None:
        """Draw the current of the last `dt_s` from a battery whose open-circuit voltage is `source_v`."""
        self.current_a = IDLE_CURRENT_A + thrusters.current_a(self.thrust_n)
        self.voltage_v = max(MIN_VOLTAGE_V, source_v - self._config.battery.resistance_ohm * self.current_a)
        self.consumed_mah += self.current_a * 1000.0 * dt_s / 3600.0
        self._driven = ()

    def acceleration(self) -> tuple[float, float, float]:
        """Acceleration of the centre of gravity over the ground, in body axes (m/s²): nu' + omega × v."""
        u, v, w, p, q, r = self.state[7:]
        a, b, c = self.nu_dot[:3]
        return a + q * w - r * v, b + r * u - p * w, c + p * v - q * u
