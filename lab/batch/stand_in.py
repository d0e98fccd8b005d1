"""The stand-in vehicle of one dive without MAVLink: the simulator's own equations, compiled with the loop.

The equations are `sim_bridge`'s. What is written here is what lies between them: a command's way to the
motors, the sensors' past, and what is drawn from the dive's seed.

| as in the simulator                          | simpler here                                               |
|----------------------------------------------|------------------------------------------------------------|
| 6-DOF plant, RK2 every 5 ms, thrusters, mixer | water and noise change once a tick, not every 5 ms        |
| input loop's phase, drawn from the same seed | jitter counts by its mean; every frame arrives             |
| the same sea, wave by wave, for a seed       | roll, pitch noise and the battery's resistance are left out |
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from companion.arrays import Array
from companion.core.attitude import angle_rates
from sim_bridge.firmware.input_loop import INPUT_PERIOD_S
from sim_bridge.firmware.mixer import mix_six_dof, mix_vectored
from sim_bridge.physics.body import STEP_S, Plant, plant_of
from sim_bridge.physics.ekf_height import HeightError
from sim_bridge.physics.environment import Environment
from sim_bridge.physics.plant import (
    NO_WRENCH,
    Six,
    State,
    Three,
    between,
    euler,
    ned_velocity,
    state_of,
)
from sim_bridge.physics.thrusters import HEALTHY, Eight, static_thrust
from sim_bridge.sim_config import Defects, SimConfig

ARMED_S, ENGAGED_S = 2.04, 3.04
"""When the full loop arms and engages, from boot: a dive begins engaged; its load counts from the arming."""

TICK_S = INPUT_PERIOD_S
STEPS = round(TICK_S / STEP_S)
"""Steps of the plant in a tick."""

NORMALS, OF_PLACE = 13, 6
"""Drawn for a tick by two streams; of the second are the place's slow noise, and its white."""
SLOW, SLOW_OF_PLACE = 9, 2
"""Of them slow noise: depth, climb, drift, heading, current north and east, tether north, east and down; and
place north and east."""
PLACE_TAU_S = 60.0

WIRE_PER_M = 1000.0
OVERRIDE_SPAN_US = 400.0

Rows: TypeAlias = np.ndarray[tuple[int, int], np.dtype[np.float64]]


@dataclass(frozen=True)
class Links:
    """Each dive's link, seconds: scalars or (dives,)."""

    up_s: Array | float = 0.001
    down_s: Array | float = 0.001
    jitter_s: Array | float = 0.004


class Timing(NamedTuple):
    """Where the delays of a dive fall on the grid of ticks and steps, seconds.

    `age_s` from a sample's sending to the tick that takes it, `to_motor_s` from a command to the motors; the
    rest is what the companion's meter makes of both (`companion.estimation.delay`).
    """

    age_s: float
    to_motor_s: float
    telemetry_s: float
    command_s: float


def timing(seed: int, up_s: float, down_s: float, jitter_s: float) -> Timing:
    """Work it out for a link; `seed` tells when in a tick the autopilot reads its input."""
    phase = int(np.random.default_rng(seed).spawn(4)[3].integers(0, STEPS))  # as the simulator
    up_s, down_s = up_s + 0.5 * jitter_s, down_s + 0.5 * jitter_s
    read_s = (-phase % STEPS) * STEP_S
    age_s = _next(TICK_S - (read_s + STEP_S), up_s)
    to_motor_s = _next(read_s, down_s)
    return Timing(
        age_s=age_s,
        to_motor_s=to_motor_s,
        telemetry_s=up_s,
        command_s=to_motor_s + STEP_S,  # echoes carry the start of the step's time
    )


def _next(first_s: float, after_s: float) -> float:
    """Return the first of `first_s` + whole ticks that is not before `after_s`."""
    return first_s + TICK_S * math.ceil(round((after_s - first_s) / TICK_S, 9))


class BatchVehicle(NamedTuple):
    """What the equations need to know of a dive's vehicle and water."""

    start: State
    hull: Plant
    six_dof: bool
    voltage_v: float
    to_motor_steps: int
    depth_back: float
    """How old the depth is that a tick takes in, in steps; likewise the climb, the attitude and the place."""
    climb_back: float
    barometer_back: float
    attitude_back: float
    place_back: float
    positioned: bool
    """Whether it has a DVL."""
    depth_scale: float
    white: tuple[float, float, float, float, float]
    """White noise of depth (m), climb (m/s), heading (rad), its rate (rad/s), place and velocity (m, m/s)."""
    current: tuple[float, float]
    """Mean velocity of the water, north and east (m/s)."""
    pull: Three
    load_n: float
    load_on_s: float
    load_off_s: float
    """The load's weight, and when it hangs, from the arming."""
    sea_way: tuple[float, float]
    """Where the waves go: cosines to north and east."""


class Drawn(NamedTuple):
    """What is drawn from a dive's seed, and how it is used."""

    normals: Rows
    """(ticks + 1, NORMALS + OF_PLACE): those for slow noise, then white."""
    slow: Rows
    """(3, all slow noise): σ, what it keeps of a tick, and what a new normal adds."""
    sea: Rows
    """(4, waves): ω a (m/s), ω (rad/s), k (1/m), phase (rad); no column in calm water."""


class Readings(NamedTuple):
    """What telemetry brings to a tick: m and m/s, NED, rad and rad/s; NaN for a place without a DVL."""

    north: float
    east: float
    north_rate: float
    east_rate: float
    depth: float
    sink: float
    roll: float
    pitch: float
    heading: float
    p: float
    q: float
    r: float
    heading_rate: float


def vehicle_of(config: SimConfig, at: Timing) -> BatchVehicle:
    """Make the parameters of a configured vehicle on a link."""
    sensors, current, tether, load = config.sensors, config.current, config.tether, config.load
    direction, way = math.radians(current.direction_deg), math.radians(config.waves.direction_deg)
    speed = current.speed_m_s if current.enabled else 0.0
    return BatchVehicle(
        start=state_of(config.initial.eta, NO_WRENCH),
        hull=plant_of(config, STEP_S),
        six_dof=config.thrusters.frame == "vectored_6dof",
        voltage_v=config.battery.voltage_v,
        to_motor_steps=round(at.to_motor_s / STEP_S) + math.ceil(config.thrusters.delay_s / STEP_S - 1e-6),
        depth_back=(at.age_s + sensors.depth_delay_s) / STEP_S,
        climb_back=(at.age_s + sensors.climb_delay_s) / STEP_S,
        barometer_back=sensors.barometer_late_s / STEP_S,
        attitude_back=(at.age_s + sensors.attitude_delay_s) / STEP_S,
        place_back=(at.age_s + sensors.dvl_delay_s) / STEP_S,
        positioned=sensors.dvl,
        depth_scale=sensors.depth_scale,
        white=(
            sensors.depth_white_m,
            sensors.climb_white_m_s,
            sensors.attitude_white_rad,
            sensors.gyro_white_rad_s,
            sensors.dvl_white_m,
        ),
        current=(speed * math.cos(direction), speed * math.sin(direction)),
        pull=tether.pull_n if tether.enabled else (0.0, 0.0, 0.0),
        load_n=load.weight_n if load.enabled else 0.0,
        load_on_s=load.on_s,
        load_off_s=load.off_s,
        sea_way=(math.cos(way), math.sin(way)),
    )


def drawn(config: SimConfig, seed: int, ticks: int) -> Drawn:
    """Draw what a dive of so many ticks meets."""
    sensors, current, tether = config.sensors, config.current, config.tether
    tau_s = np.array(
        (
            *(sensors.slow_tau_s, sensors.slow_tau_s, sensors.drift_tau_s, 5.0),
            *(current.tau_s, current.tau_s, tether.tau_s, tether.tau_s, tether.tau_s),
            *(PLACE_TAU_S, PLACE_TAU_S),
        )
    )
    sigma = np.array(
        (
            *(sensors.depth_slow_m, sensors.climb_slow_m_s, sensors.drift_m, sensors.attitude_slow_rad),
            *((current.sigma_m_s if current.enabled else 0.0,) * 2),
            *(tether.sigma_n if tether.enabled else (0.0, 0.0, 0.0)),
            *(sensors.dvl_drift_m, sensors.dvl_drift_m),
        )
    )
    keep = np.exp(-TICK_S / tau_s)
    normals = np.random.default_rng((seed, 3)).standard_normal((ticks + 1, NORMALS))
    of_place = np.random.default_rng((seed, 5)).standard_normal((ticks + 1, OF_PLACE))
    normals = np.hstack(
        (normals[:, :SLOW], of_place[:, :SLOW_OF_PLACE], normals[:, SLOW:], of_place[:, SLOW_OF_PLACE:])
    )
    sea = np.zeros((4, 0))
    if config.waves.enabled:
        waves = Environment(config, STEP_S, np.random.default_rng(seed).spawn(4)[0]).sea
        assert waves is not None
        sea = np.stack([waves.amplitude * waves.omega, waves.omega, waves.k, waves.phase])
    return Drawn(normals, np.stack([sigma, keep, sigma * np.sqrt(1.0 - keep**2)]), sea)


def go_on_slow(drawn: Drawn, slow: Rows, tick: int) -> None:
    """Bring slow noise, (1, all of it), on by a tick to this one; tick 0 begins."""
    for i in range(slow.shape[1]):
        keep, add = (0.0, drawn.slow[0, i]) if tick == 0 else (drawn.slow[1, i], drawn.slow[2, i])
        slow[0, i] = keep * slow[0, i] + add * drawn.normals[tick, i]


def refuse(config: SimConfig) -> None:
    """Raise ValueError for what only the full loop can do."""
    sensors = config.sensors
    if config.thrusters.dry_height_m:
        raise ValueError("thrusters that lose thrust at the surface need the full loop")
    if config.faults or sensors.wave_pressure:
        raise ValueError("faults and wave pressure need the full loop")
    if sensors.usbl.enabled or sensors.dvl_by_mavlink or sensors.dvl_reports.enabled:
        raise ValueError("a USBL, and a DVL that speaks MAVLink or reports singly, need the full loop")
    defects = (sensors.depth_defects, sensors.attitude_defects, sensors.dvl_defects)
    if config.steel.enabled or any(one != Defects() for one in defects):
        raise ValueError("steel and defects of instruments need the full loop")
    if config.seabed.enabled or config.cable.enabled or config.current.profile or config.current.turn_deg_s:
        raise ValueError(
            "a seabed, a cable, and a current that varies with depth or turns need the full loop"
        )


def motors(vehicle: BatchVehicle, axes: Six) -> Eight:
    """Return the steady thrust (N) for axes on the wire: surge, sway, heave, yaw, roll, pitch."""
    surge, sway, heave, yaw, roll, pitch = axes
    demand = (roll, pitch, yaw, -heave, surge, sway)
    a, b, c, d, e, f, g, h = mix_six_dof(demand) if vehicle.six_dof else mix_vectored(demand)
    pwm = _pwm(a), _pwm(b), _pwm(c), _pwm(d), _pwm(e), _pwm(f), _pwm(g), _pwm(h)
    return static_thrust(vehicle.hull.thrusters, HEALTHY, pwm, vehicle.voltage_v)


def _pwm(demand: float) -> int:
    return math.floor(1500.0 + 400.0 * demand)


def water(vehicle: BatchVehicle, sea: Rows, slow: Rows, t_s: float, state: State) -> tuple[Three, Six]:
    """Return force (N) and flow (m/s, m/s²) of the tick from `t_s` on, NED; `slow` (1, SLOW) as it is now."""
    x, y, z = state[0], state[1], state[2]
    north, east = vehicle.sea_way
    along, down, d_along, d_down = orbital(sea, t_s + 0.5 * TICK_S, x * north + y * east, z)
    flow = (
        vehicle.current[0] + slow[0, 4] + along * north,
        vehicle.current[1] + slow[0, 5] + along * east,
        down,
        d_along * north,
        d_along * east,
        d_down,
    )
    armed_s = t_s - ARMED_S
    load_n = vehicle.load_n if vehicle.load_on_s <= armed_s < vehicle.load_off_s else 0.0
    pull = vehicle.pull
    return (pull[0] + slow[0, 6], pull[1] + slow[0, 7], pull[2] + slow[0, 8] + load_n), flow


def orbital(sea: Rows, t_s: float, s: float, z: float) -> tuple[float, float, float, float]:
    """Velocity and acceleration of the water, each along the sea and down, s metres along the sea."""
    along, down, d_along, d_down = 0.0, 0.0, 0.0, 0.0
    depth = max(z, 0.0)
    for i in range(sea.shape[1]):
        omega, k = sea[1, i], sea[2, i]
        angle = omega * t_s - k * s + sea[3, i]
        speed = sea[0, i] * math.exp(-k * depth)
        in_phase, quadrature = speed * math.cos(angle), speed * math.sin(angle)
        along += in_phase
        down += quadrature
        d_along -= omega * quadrature
        d_down += omega * in_phase
    return along, down, d_along, d_down


def remember(past: Rows, step: int, state: State) -> None:
    """Write the state after `step` steps into the ring `past` (steps, 13)."""
    for i, value in enumerate(state):
        past[step % len(past), i] = value


def recall(past: Rows, back: float) -> State:
    """Return the state at a time between two steps, counted in steps."""
    whole = math.floor(back)
    newer, older = _row(past, math.ceil(back)), _row(past, whole)
    return between(newer, older, math.ceil(back) - back)


def _row(past: Rows, step: int) -> State:
    s = past[step % len(past)]
    return s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8], s[9], s[10], s[11], s[12]


def read(
    vehicle: BatchVehicle, past: Rows, height: HeightError, slow: Rows, normals: Rows, tick: int
) -> Readings:
    """Return what the telemetry reports that a tick takes in."""
    steps = STEPS * tick
    white = vehicle.white
    north = east = north_rate = east_rate = math.nan
    if vehicle.positioned:
        place = recall(past, steps - vehicle.place_back)
        velocity = ned_velocity(place)
        north = place[0] + slow[0, 9] + white[4] * normals[tick, 15]
        east = place[1] + slow[0, 10] + white[4] * normals[tick, 16]
        north_rate = velocity[0] + white[4] * normals[tick, 17]
        east_rate = velocity[1] + white[4] * normals[tick, 18]
    was = recall(past, steps - vehicle.depth_back)
    motion = recall(past, steps - vehicle.climb_back)
    attitude = recall(past, steps - vehicle.attitude_back)
    depth = (
        vehicle.depth_scale * (was[2] + height.depth_m)
        + slow[0, 0]
        + slow[0, 2]
        + white[0] * normals[tick, 11]
    )
    sink = (
        vehicle.depth_scale * (ned_velocity(motion)[2] + height.sink_m_s)
        + slow[0, 1]
        + white[1] * normals[tick, 12]
    )
    roll, pitch, yaw = euler(attitude)
    p, q, r = attitude[10], attitude[11], attitude[12]
    _, _, rate = angle_rates(roll, pitch, p, q, r)
    return Readings(
        north,
        east,
        north_rate,
        east_rate,
        math.floor(WIRE_PER_M * depth + 0.5) / WIRE_PER_M,
        sink,
        roll,
        pitch,
        yaw + slow[0, 3] + white[2] * normals[tick, 13],
        p,
        q,
        r,
        rate + white[3] * normals[tick, 14],
    )
