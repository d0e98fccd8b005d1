"""The LQG floor: how well depth can be held at all with this telemetry, thruster, sea and delay.

Computed for the very vehicle, sea and link of a dive. The floor's controller knows

- the vehicle: mass, damping (linearised at the speeds of the scenario), lag, thrust gain and dead band (both
  undone exactly), and nothing saturates;
- the delay, to the step, and the path it has to follow, for ever ahead: both cost it nothing;
- the sensors: slow and white noise of depth and climb, the drift, the millimetre of relative_alt;
- the spectrum of its disturbance: the sea's as SLICES lightly damped oscillators, each with its slice of the
  JONSWAP spectrum; the tether's as the Ornstein-Uhlenbeck process that it is. Not the sea or the pull itself.

and it is ready for a load at any time, in every scenario, because nobody tells it which one it dives: a force
that wanders by LOAD_N² in LOAD_PERIOD_S. Without that the best one could do in calm water is nothing at all.
Its gain is the one that moves the command by at most CHATTER_N a tick (RMS) in what it is ready for. What is
then reported is the error in the noise of the dive itself, which has no such wandering force, plus the answer
to the dive's load. So it is a floor for those that are as ready: who steers more softly than 3.5 N a tick can
be a little below it in calm water, where there is nothing to be ready for.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.records import Array
from lab.batch.stand_in import timing
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import SETTLE_S, Scenario
from lab.studies.lqg import LQG, Plant
from sim_bridge.config import SimConfig, Waves
from sim_bridge.physics.plant import GRAVITY

CHATTER_N = 3.5
TICK_S = 0.02
LOAD_N, LOAD_PERIOD_S, FORGOTTEN_S = 15.0, 40.0, 1000.0
SLICES = 10
Z, W, F, LOAD = range(4)
NOTHING: tuple[Array, Array, Array] = (np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0))
"""A disturbance that there is not: A, Q and its output row."""

DEPTH_STEP_M = 1e-3


@dataclass(frozen=True)
class Floor:
    """What is reached: RMS of depth error (mm) and of the command's change (N a tick)."""

    depth_rms_mm: float
    chatter_n: float


def floor(scenario: Scenario, base: SimConfig, link: LinkDelay) -> Floor:
    """Return the floor of one dive."""
    config = scenario.plant(base, scenario.seed)
    ready = _plant(config, scenario, wandering=True)
    truth = _plant(config, scenario, wandering=False)
    controller = LQG(ready, loop_delay_s(scenario.seed, link) + config.sensors.depth_delay_s, TICK_S)
    K = controller.tuned(ready, CHATTER_N)
    rms_m, chatter_n = controller.reached(truth, K)
    span_s = scenario.duration_s - SETTLE_S
    if config.load.enabled:
        answer = controller.step_response(K, LOAD, config.load.weight_n, span_s)
        rms_m = math.sqrt(rms_m**2 + float(answer @ answer) * TICK_S / span_s)
    return Floor(1e3 * rms_m, chatter_n)


def loop_delay_s(seed: int, link: LinkDelay) -> float:
    """Return the time from a sample's leaving to the motors' answer: link, input loop and ticks."""
    at = timing(seed, link.up_s, link.down_s, link.jitter_s)
    return at.age_s + at.to_motor_s


def _plant(config: SimConfig, scenario: Scenario, *, wandering: bool) -> Plant:
    """Return heave, what pushes it and what its sensors add: z, w, f, load, disturbance, slow noises."""
    hull, sensors = config.hull, config.sensors
    mass = hull.mass_kg + hull.added_mass[2]
    pushes, drag = _disturbance(config, scenario)
    n = 4 + len(pushes[0]) + 3
    A, B, Q = np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
    A[Z, W] = 1.0
    A[W, W], A[W, F], A[W, LOAD] = -drag / mass, 1.0 / mass, 1.0 / mass
    A[F, F], B[F] = -1.0 / config.thrusters.lag_s, 1.0 / config.thrusters.lag_s
    A[LOAD, LOAD] = -1.0 / FORGOTTEN_S
    Q[LOAD, LOAD] = LOAD_N**2 / LOAD_PERIOD_S * wandering
    own = slice(4, n - 3)
    A[own, own], Q[own, own], A[W, own] = pushes[0], pushes[1], pushes[2] / mass
    noises = (
        (sensors.depth_slow_m, sensors.slow_tau_s),
        (sensors.drift_m, sensors.drift_tau_s),
        (sensors.climb_slow_m_s, sensors.slow_tau_s),
    )
    for i, (sigma, tau_s) in enumerate(noises, n - 3):
        A[i, i], Q[i, i] = -1.0 / tau_s, 2.0 * sigma**2 / tau_s
    C = np.zeros((2, n))
    C[0, [Z, n - 3, n - 2]] = C[1, [W, n - 1]] = 1.0
    R = np.diag([sensors.depth_white_m**2 + DEPTH_STEP_M**2 / 12.0, sensors.climb_white_m_s**2])
    return Plant(A, B, Q, C, R)


def _disturbance(config: SimConfig, scenario: Scenario) -> tuple[tuple[Array, Array, Array], float]:
    """Return A, Q and the row that makes a force (N, down) of the disturbance's states, and the drag (N s/m).

    The drag is linearised where it is felt: at the water's RMS speed in waves (Borgman), along the path.
    """
    linear, quadratic = config.hull.linear_damping[2], config.hull.quadratic_damping[2]
    times = np.arange(SETTLE_S, scenario.duration_s, TICK_S)
    speed = np.mean([abs(scenario.target(float(t_s)).eta_d_dot[2]) for t_s in times])
    if config.waves.enabled:
        omega, amplitude = sea_speed(config.waves, config.initial.eta[2])
        drag = linear + quadratic * math.sqrt(8.0 / math.pi) * math.sqrt(0.5 * float(amplitude @ amplitude))
        displaced = config.hull.mass_kg + config.hull.net_buoyancy_n / GRAVITY
        force = amplitude * np.hypot(omega * (displaced + config.hull.added_mass[2]), drag)
        return _oscillators(omega, force), drag
    drag = linear + 2.0 * quadratic * float(speed)
    if config.tether.enabled:
        sigma, tau_s = config.tether.sigma_n[2], config.tether.tau_s
        return (np.array([[-1.0 / tau_s]]), np.array([[2.0 * sigma**2 / tau_s]]), np.ones(1)), drag
    return NOTHING, drag


def sea_speed(waves: Waves, depth_m: float) -> tuple[Array, Array]:
    """Return the frequencies (rad/s) of SLICES of the JONSWAP sea and the water's speed (m/s) at depth."""
    peak = 2.0 * math.pi / waves.period_s
    fine = np.linspace(0.6 * peak, 2.5 * peak, 40 * SLICES)
    width = np.where(fine <= peak, 0.07, 0.09)
    bump = waves.gamma ** np.exp(-((fine - peak) ** 2) / (2.0 * (width * peak) ** 2))
    energy = fine**-5 * np.exp(-1.25 * (peak / fine) ** 4) * bump
    energy *= (waves.height_m / 4.0) ** 2 / energy.sum()
    energy *= fine**2 * np.exp(-2.0 * fine**2 / GRAVITY * depth_m)
    slices = energy.reshape(SLICES, -1).sum(1)
    centre = (energy * fine).reshape(SLICES, -1).sum(1) / slices
    return centre, np.sqrt(2.0 * slices)


def _oscillators(omega: Array, amplitude: Array) -> tuple[Array, Array, Array]:
    """Return A, Q and the output row of narrow-band noises, each damped by half the way to its neighbours."""
    width = np.gradient(omega)
    A, Q = np.zeros((2 * len(omega), 2 * len(omega))), np.zeros((2 * len(omega), 2 * len(omega)))
    for i, (turn, damping, variance) in enumerate(zip(omega, 0.5 * width, 0.5 * amplitude**2, strict=True)):
        pair = slice(2 * i, 2 * i + 2)
        A[pair, pair] = [[-damping, turn], [-turn, -damping]]
        Q[pair, pair] = 2.0 * damping * variance * np.eye(2)
    return A, Q, np.tile((1.0, 0.0), len(omega))
