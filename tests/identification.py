"""The manoeuvre of `holdfast identify` with drawn vehicles: what is true beside what was found."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from msgspec.structs import replace

from companion.arrays import Array
from companion.config import Config
from companion.core.allocation import FACTORS, PER_NEWTON
from companion.engine import Engine
from companion.identify.fit import Fit
from companion.identify.manoeuvre import EXCITATIONS, LEAD_S, ORDER, Manoeuvre
from companion.identify.manoeuvre import SETTLE_S as REST_S
from companion.identify.model import LAG, LINEAR, MASS, QUADRATIC, WEIGHT
from companion.identify.sample_table import in_order
from companion.records import AXES, PSI, Request, Setpoint, Y, Z
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import ensemble
from sim_bridge.sim_config import SimConfig
from sim_bridge.vehicle import Truth, Vehicle

AXIS_OF_BODY = (0, 1, 2, 5)
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
        asks = manoeuvre.step(engine, step.sample)
        loop.requests, loop.excitation = [*asks.requests], asks.excitation
    list(loop.run(SETTLE_S))
    return manoeuvre, np.array(watched.log)


def compare(plant: SimConfig, manoeuvre: Manoeuvre, found: Fit) -> Iterator[Compared]:
    """Say what is true beside what was found, in forces of T200 thrusters."""
    hull = plant.hull
    yield Compared("all", "lag_s", plant.thrusters.lag_s, *found.sum_of(LAG))
    for dof in (dof for dof in manoeuvre.moved if found.axes[dof]):
        i, name, strength = AXIS_OF_BODY[dof], AXES[dof], _strength(plant, dof)
        begin_s = _begin_s(manoeuvre, dof)
        inertia = (hull.mass_kg if i < 3 else hull.inertia_kg_m2[2]) + hull.added_mass[i]
        yield Compared(name, "mass", inertia / strength, *found.sum_of(MASS + dof))
        speed = float(np.quantile(np.abs(_rates(manoeuvre, dof, begin_s)), 0.95))
        drag = (hull.linear_damping[i] + hull.quadratic_damping[i] * speed) * speed
        yield Compared(name, f"damping at {speed:.2f}", drag / strength, *found.damping_at(dof, speed))
        for number, values in ((LINEAR, hull.linear_damping), (QUADRATIC, hull.quadratic_damping)):
            what = "linear damping" if number == LINEAR else "quadratic damping"
            yield Compared(name, what, values[i] / strength, *found.sum_of(number + dof))
        if dof == Z:
            weight, sigma = found.sum_of(WEIGHT)
            yield Compared(name, "buoyancy_n", hull.net_buoyancy_n / strength, -weight, sigma)


def _rates(manoeuvre: Manoeuvre, dof: int, begin_s: float) -> Array:
    """Return the rate of an axis while it moved; surge and sway along and across the heading of then."""
    streams = manoeuvre.streams
    t_s, *values = in_order((streams.level, streams.level, streams.down, streams.rates)[dof]).T
    rate = values[-1]
    if dof not in (PSI, Z):
        heading = next(row[-1] for row in streams.attitude if row[0] >= begin_s)
        course = heading + (0.5 * math.pi if dof == Y else 0.0)
        rate = values[0] * math.cos(course) + values[1] * math.sin(course)
    return np.asarray(rate[(t_s >= begin_s) & (t_s - begin_s < EXCITATIONS[dof].lasts_s)])


def _begin_s(manoeuvre: Manoeuvre, dof: int) -> float:
    """Return when an axis began to move, on the engine's clock."""
    before = [one for one in ORDER if one in manoeuvre.moved]
    before = before[: before.index(dof)]
    lasts_s = sum(REST_S + LEAD_S + EXCITATIONS[one].lasts_s for one in before)
    return float(manoeuvre.streams.sticks[0][0]) + lasts_s + REST_S + LEAD_S


def _strength(plant: SimConfig, dof: int) -> float:
    """Return what a newton that the controller asks for really gives, with the right curve."""
    thrusters = plant.thrusters
    shares = np.abs(np.array(FACTORS[thrusters.frame])[:, dof])
    gains = np.array(thrusters.gain * len(shares) if len(thrusters.gain) == 1 else thrusters.gain)
    lever = math.sqrt(0.5) * sum(thrusters.horizontal_m[:2]) / PER_NEWTON[PSI] if dof == PSI else 1.0
    return float(gains @ shares / shares.sum()) * lever
