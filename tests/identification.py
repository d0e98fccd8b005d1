"""The manoeuvre of `holdfast identify` with drawn vehicles: what is true beside what was found."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from msgspec.structs import replace

from companion.config import Config
from companion.core.allocation import FACTORS, PER_NEWTON
from companion.engine import Engine
from companion.identify.fit import Fit
from companion.identify.manoeuvre import EXCITATIONS, LEAD_S, ORDER, Manoeuvre
from companion.identify.manoeuvre import SETTLE_S as REST_S
from companion.identify.model import DELAY, LAG, LATER, LINEAR, MASS, QUADRATIC, WEIGHT
from companion.identify.samples import Sample, Streams
from companion.records import AXES, PSI, Array, Request, Setpoint, Y, Z
from lab.loop.lockstep import START_S, LinkDelay, Lockstep
from lab.loop.scenarios import ensemble
from sim_bridge.config import SimConfig
from sim_bridge.vehicle import Truth, Vehicle

AXIS_OF_BODY = (0, 1, 2, 5)
SHIFTS_S = np.arange(-0.02, 0.06, 0.0005)
DIFFERENCE = 5
LONGEST_S, SETTLE_S = 240.0, 0.5
DEPTH_M = 3.0


@dataclass
class LoggedVehicle:
    """A vehicle whose motors and motion are noted after each of its steps."""

    vehicle: Vehicle
    log: list[tuple[float, ...]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Step as it does."""
        self.step_s, self.time_s = self.vehicle.step_s, self.vehicle.time_s

    def open_link(self, link: int) -> None:
        """Declare a link."""
        self.vehicle.open_link(link)

    def step(self, datagrams: Sequence[tuple[int, bytes]] = ()) -> list[tuple[int, bytes]]:
        """Advance one step, and note what came of it."""
        out = self.vehicle.step(datagrams)
        truth, self.time_s = self.vehicle.truth(), self.vehicle.time_s
        self.log.append((self.time_s, *truth.eta.tolist(), *truth.motor_pwm))
        return out

    def truth(self) -> Truth:
        """Tell the present truth."""
        return self.vehicle.truth()


@dataclass(frozen=True)
class Compared:
    """One quantity of one axis: what it is, what was found, and the fit's standard deviation."""

    axis: str
    quantity: str
    true: float
    found: float
    sigma: float

    @property
    def error(self) -> float:
        """Relative error."""
        return self.found / self.true - 1.0 if self.true else math.inf


def drawn(base: SimConfig, seed: int) -> SimConfig:
    """Draw a vehicle of the bench's ensemble whose surge, sway and yaw are another's as well."""
    draw = np.random.default_rng((seed, 3)).uniform
    one = ensemble(base, seed)
    added, linear, quadratic = (
        list(values) for values in (one.hull.added_mass, one.hull.linear_damping, one.hull.quadratic_damping)
    )
    inertia = list(one.hull.inertia_kg_m2)
    for i in (0, 1, 5):
        added[i] *= draw(0.5, 1.5)
        linear[i] *= draw(0.5, 1.5)
        quadratic[i] *= draw(0.5, 1.5)
    inertia[2] *= draw(0.7, 1.5)
    hull = replace(
        one.hull,
        added_mass=tuple(added),
        linear_damping=tuple(linear),
        quadratic_damping=tuple(quadratic),
        inertia_kg_m2=tuple(inertia),
    )
    return replace(one, hull=hull, initial=replace(one.initial, eta=(0.0, 0.0, DEPTH_M, 0.0, 0.0, 0.0)))


def manoeuvred(plant: SimConfig, config: Config, seed: int) -> tuple[Manoeuvre, Array]:
    """Dive the manoeuvre; return it and the log of `LoggedVehicle`, a row each of the vehicle's steps."""
    engine, manoeuvre = Engine(config, Setpoint((math.nan,) * 4), arm=True), Manoeuvre()
    watched = LoggedVehicle(Vehicle(plant, seed))
    loop = Lockstep(watched, engine, LinkDelay(), seed, config.loop.rate_hz)
    loop.requests = [Request.ENGAGE]
    while not manoeuvre.done and watched.time_s < LONGEST_S:
        step = loop.tick()
        loop.requests += manoeuvre.step(engine, step.sample)
    list(loop.run(SETTLE_S))
    return manoeuvre, np.array(watched.log)


def compare(plant: SimConfig, manoeuvre: Manoeuvre, found: Fit, log: Array) -> Iterator[Compared]:
    """Say what is true beside what was found, in forces of T200 thrusters."""
    hull = plant.hull
    yield Compared("all", "lag_s", plant.thrusters.lag_s, *found.sum_of(LAG))
    for dof in (dof for dof in manoeuvre.moved if found.axes[dof]):
        i, name, strength = AXIS_OF_BODY[dof], AXES[dof], _strength(plant, dof)
        begin_s = _begin_s(manoeuvre, dof)
        inertia = (hull.mass_kg if i < 3 else hull.inertia_kg_m2[2]) + hull.added_mass[i]
        yield Compared(name, "mass", inertia / strength, *found.sum_of(MASS + dof))
        rates = _rates(manoeuvre, dof, begin_s)
        speed = float(np.quantile(np.abs([one.values[-1] for one in rates]), 0.95))
        drag = (hull.linear_damping[i] + hull.quadratic_damping[i] * speed) * speed
        yield Compared(name, f"damping at {speed:.2f}", drag / strength, *found.damping_at(dof, speed))
        for number, values in ((LINEAR, hull.linear_damping), (QUADRATIC, hull.quadratic_damping)):
            what = "linear damping" if number == LINEAR else "quadratic damping"
            yield Compared(name, what, values[i] / strength, *found.sum_of(number + dof))
        if dof in (PSI, Z):
            late = (DELAY, LATER) if dof == Z else (DELAY,)
            delay_s = _motor_delay_s(plant, manoeuvre.samples, begin_s, log) + _rate_age_s(dof, rates, log)
            yield Compared(name, "delay_s", delay_s, *found.sum_of(*late))
            true_s = plant.thrusters.lag_s + delay_s
            yield Compared(name, "lag + delay, s", true_s, *found.sum_of(LAG, *late))
        if dof == Z:
            weight, sigma = found.sum_of(WEIGHT)
            yield Compared(name, "buoyancy_n", hull.net_buoyancy_n / strength, -weight, sigma)


def _rates(manoeuvre: Manoeuvre, dof: int, begin_s: float) -> list[Sample]:
    """Return the rate of an axis while it moved; surge and sway along and across the heading of then."""
    samples = manoeuvre.samples
    if dof in (PSI, Z):
        rates = samples.rates if dof == PSI else samples.down
    else:
        heading = next(one.values[-1] for one in samples.attitude if one.t_s >= begin_s)
        course = heading + (0.5 * math.pi if dof == Y else 0.0)
        along = np.array([one.values for one in samples.level]) @ (math.cos(course), math.sin(course))
        rates = [Sample(one.t_s, (rate,)) for one, rate in zip(samples.level, along.tolist(), strict=True)]
    return [one for one in rates if 0.0 <= one.t_s - begin_s < EXCITATIONS[dof].lasts_s]


def _begin_s(manoeuvre: Manoeuvre, dof: int) -> float:
    """Return when an axis began to move, on the engine's clock."""
    before = [one for one in ORDER if one in manoeuvre.moved]
    before = before[: before.index(dof)]
    lasts_s = sum(REST_S + LEAD_S + EXCITATIONS[one].lasts_s for one in before)
    return manoeuvre.samples.sticks[0].t_s + lasts_s + REST_S + LEAD_S


def _strength(plant: SimConfig, dof: int) -> float:
    """Return what a newton that the controller asks for really gives, with the right curve."""
    thrusters = plant.thrusters
    shares = np.abs(np.array(FACTORS[thrusters.frame])[:, dof])
    gains = np.array(thrusters.gain * len(shares) if len(thrusters.gain) == 1 else thrusters.gain)
    lever = math.sqrt(0.5) * sum(thrusters.horizontal_m[:2]) / PER_NEWTON[PSI] if dof == PSI else 1.0
    return float(gains @ shares / shares.sum()) * lever


def _motor_delay_s(plant: SimConfig, samples: Streams, begin_s: float, log: Array) -> float:
    """Return how long after a command was sent the motors had it.

    Half a step less: the simulator lets the thrust at the end of a step act during all of it.
    """
    factors = np.array(FACTORS[plant.thrusters.frame])
    demands = np.array([one.values for one in samples.sticks]) @ factors.T
    sent_s = np.array([one.t_s for one in samples.sticks]) - START_S
    step_s = log[1, 0] - log[0, 0]
    grid_s = np.arange(begin_s - START_S, begin_s - START_S + 10.0, 0.0005)
    had = log[np.searchsorted(log[:, 0] - step_s, grid_s, "right") - 1, 7:]
    shifts_s, misses = SHIFTS_S[SHIFTS_S >= 0.0], []
    for shift_s in shifts_s:
        asked = demands[np.searchsorted(sent_s, grid_s - shift_s, "right") - 1]
        misses.append(float(np.mean((1500.0 + 400.0 * asked - had[:, : asked.shape[1]]) ** 2)))
    return float(shifts_s[np.isclose(misses, min(misses))].mean() - 0.5 * step_s)


def _rate_age_s(dof: int, rates: Sequence[Sample], log: Array) -> float:
    """Return how old a rate of heave or yaw is at its stamp, on our clock: the shift that makes it the truth.

    Changes over DIFFERENCE samples are compared: they hold little of the sensors' slow noise.
    """
    values = np.array([one.values[-1] for one in rates])
    at_s = np.array([one.t_s for one in rates]) - START_S
    true = np.gradient(np.unwrap(log[:, 1 + AXIS_OF_BODY[dof]]), log[:, 0])
    misses = []
    for shift_s in SHIFTS_S:
        miss = values - np.interp(at_s - shift_s, log[:, 0], true)
        misses.append(float(np.std(miss[DIFFERENCE:] - miss[:-DIFFERENCE])))
    return float(SHIFTS_S[int(np.argmin(misses))])
