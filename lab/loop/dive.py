"""Run a vehicle through the full loop and measure it against the truth."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.arrays import Array
from companion.config import Config
from companion.core.bounds import wrap
from companion.engine import Engine
from companion.records import PSI, Request, Setpoint, State, X, Y, Z
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep, Step, SteppedVehicle
from lab.loop.scenarios import SETTLE_S, Scenario
from sim_bridge.physics.thrusters import (
    HEALTHY,
    ThrusterBank,
    each_motor,
    static_thrust,
    thrusters_of,
    wrench,
)
from sim_bridge.sim_config import SimConfig
from sim_bridge.vehicle import Truth, Vehicle

PHI, THETA, TRUE_PSI = 3, 4, 5
RECOVERED_M = 0.01
RECOVERED_FOR_S = 2.0
SMOOTHED_S = 0.5
FULL_US = 399.0
"""A motor whose PWM is so far from neutral gives all it has."""

SURVEYOR = 2
"""The link of whoever sets the EKF's origin."""

EXACT = LinkDelay()


@dataclass(frozen=True)
class Dive:
    """What was recorded, a row each tick: s since boot, m, rad, N.

    Rows of `reference` and `truth` are north, east, down and heading, of `force` what was asked for in
    surge, sway and heave. `believed` is the place as the companion estimates it, NaN without a companion; a
    reference without a place is NaN there.
    """

    t_s: Array
    reference: Array
    truth: Array
    tilt: Array
    believed: Array
    force: Array
    saturated: NDArray[np.bool_]
    active: NDArray[np.bool_]
    load_on: NDArray[np.bool_]

    def part(self, of: Any) -> "Dive":
        """Return the ticks that a slice or a mask names."""
        return Dive(*(getattr(self, column.name)[of] for column in fields(self)))

    def within(self, begin_s: float, end_s: float) -> "Dive":
        """Return the part between two times."""
        return self.part((self.t_s >= begin_s) & (self.t_s < end_s))

    @property
    def held(self) -> bool:
        """Whether it was steered in every tick."""
        return bool(self.active.all())

    @property
    def place_error_m(self) -> Array:
        """Return the horizontal distance from the reference."""
        return np.asarray(np.hypot(*self.error_m[:, :Z].T))

    @property
    def error_m(self) -> Array:
        """Return true − wanted: north, east and down."""
        return self.truth[:, :PSI] - self.reference[:, :PSI]

    @property
    def depth_error_m(self) -> Array:
        """Return true − wanted depth."""
        return self.error_m[:, Z]

    @property
    def heading_error_rad(self) -> Array:
        """Return true − wanted heading, within ±π."""
        return np.array([*map(wrap, (self.truth[:, PSI] - self.reference[:, PSI]).tolist())])

    def figures(self, since_s: float = SETTLE_S) -> dict[str, float]:
        """Return what is measured from a time on; NaN for a place without a reference or an estimate.

        RMS and largest distance from the place, RMS as the estimate believes it; RMS, mean, standard
        deviation and peak of the depth; of the heading RMS and deviation; largest tilt; share of the time in
        which a force was cut off; RMS of the thrust in heave, and of its change and that of the horizontal
        force in a tick; recovery from a load.
        """
        dive = self.part(self.t_s >= since_s)
        depth, heading = dive.depth_error_m, dive.heading_error_rad
        believed = np.hypot(*(dive.believed - dive.reference[:, :Z]).T)
        return figures_of(dive.error_m, dive.tilt, dive.force) | {
            "place_peak_mm": 1e3 * float(dive.place_error_m.max()),
            "believed_rms_mm": 1e3 * rms(believed),
            "depth_mean_mm": 1e3 * float(depth.mean()),
            "depth_sd_mm": 1e3 * float(depth.std()),
            "heading_rms_deg": math.degrees(rms(heading)),
            "heading_sd_deg": math.degrees(float(heading.std())),
            "saturated_percent": 100.0 * float(dive.saturated.mean()),
            "recovery_s": self.recovery_s(),
        }

    def recovery_s(self) -> float:
        """Return the time from the load's coming on to two seconds within ±1 cm, averaged over 0.5 s.

        NaN without a load; the rest of the dive if it never came to that.
        """
        if not self.load_on.any():
            return math.nan
        t_s = self.t_s[self.load_on]
        ticks = [round(span_s / (t_s[1] - t_s[0])) for span_s in (SMOOTHED_S, RECOVERED_FOR_S)]
        smooth = np.convolve(self.depth_error_m[self.load_on], np.full(ticks[0], 1.0 / ticks[0]), "valid")
        held = np.convolve(np.abs(smooth) <= RECOVERED_M, np.ones(ticks[1]), "valid") > ticks[1] - 0.5
        return float(t_s[np.argmax(held)] if held.any() else t_s[-1]) - float(t_s[0])


def figures_of(error_m: Array, tilt_rad: Array, force_n: Array) -> dict[str, float]:
    """Return what any dive is measured by, a row each tick: north, east, down; surge, sway, heave."""
    changes = np.diff(force_n, axis=0)
    return {
        "place_rms_mm": 1e3 * rms(np.hypot(error_m[:, X], error_m[:, Y])),
        "place_chatter_n": rms(np.hypot(changes[:, X], changes[:, Y])),
        "depth_rms_mm": 1e3 * rms(error_m[:, Z]),
        "depth_peak_mm": 1e3 * float(np.abs(error_m[:, Z]).max(initial=0.0)),
        "thrust_rms_n": rms(force_n[:, Z]),
        "chatter_n": rms(changes[:, Z]),
        "tilt_deg": math.degrees(float(tilt_rad.max(initial=0.0))),
    }


def rms(x: Array) -> float:
    """Return the root of the mean square, 0 of none."""
    return float(np.sqrt(np.sum(x * x) / max(len(x), 1)))


@contextmanager
def engaging(
    config: Config,
    plant: SimConfig,
    setpoint: Setpoint,
    seed: int,
    link: LinkDelay = EXACT,
    firmware: Path | None = None,
    *,
    surveyed: bool = False,
    engine: Callable[..., Engine] = Engine,
) -> Iterator[Lockstep]:
    """Give a vehicle and its companion in virtual time; the companion is asked to engage.

    The real `firmware` takes the place of our stand-in. Where `surveyed`, the EKF is told its origin.
    """
    with vehicle_of(plant, seed, firmware, surveyed=surveyed) as vehicle:
        if surveyed:
            survey(vehicle)
        loop = Lockstep(vehicle, engine(config, setpoint, arm=True), link, seed, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        yield loop


def dive(
    scenario: Scenario, config: Config, plant: SimConfig, link: LinkDelay, firmware: Path | None = None
) -> Dive:
    """Dive `scenario`; `plant` is the base that the scenario disturbs. Errors count from its target.

    A place that the target leaves open is where it engaged.
    """
    plant, seed = scenario.plant(plant, scenario.seed), scenario.seed
    positioned = plant.sensors.positioned
    with engaging(config, plant, scenario.target(0.0), seed, link, firmware, surveyed=positioned) as loop:
        steps = list(loop.run(scenario.duration_s, scenario.target))
    dived = recorded(steps)
    wanted = np.array([scenario.target(step.t_s).eta_d for step in steps])
    here = dived.truth[np.argmax(dived.active), :Z] if dived.active.any() else math.nan
    wanted[:, :Z] = np.where(np.isnan(wanted[:, :Z]), here, wanted[:, :Z]) if positioned else math.nan
    return replace(dived, reference=wanted)


def recorded(steps: Sequence[Step]) -> Dive:
    """Make a Dive of its ticks; errors count from the companion's own reference."""
    samples = [step.sample for step in steps]
    return Dive(
        t_s=np.array([step.t_s for step in steps]),
        reference=np.array([sample.eta_d for sample in samples]),
        **_true([step.truth for step in steps]),
        believed=np.array([sample.state.eta[:Z] for sample in samples]),
        force=np.array([sample.delivered[:PSI] for sample in samples]),
        saturated=np.array([any(sample.dofs.saturated) for sample in samples]),
        active=np.array([sample.verdict.state is State.ACTIVE for sample in samples]),
    )


def by_autopilot(truths: Sequence[Truth], plant: SimConfig, mode: int, reference: Array) -> Dive:
    """Make a Dive of what the autopilot steered by itself in this flight mode.

    The force is what `plant`'s thrusters would make of the motors' PWM without lag.
    """
    nominal = thrusters_of(plant.thrusters)
    return Dive(
        t_s=np.array([truth.t_s for truth in truths]),
        reference=reference,
        **_true(truths),
        believed=np.full((len(truths), 2), math.nan),
        force=np.array([commanded(truth, nominal) for truth in truths]),
        saturated=np.abs(np.array([truth.motor_pwm for truth in truths]) - 1500.0).max(1) > FULL_US,
        active=np.array([truth.armed and truth.mode == mode for truth in truths]),
    )


def commanded(truth: Truth, nominal: ThrusterBank) -> tuple[float, float, float]:
    """Return surge, sway and heave (N) that the motors' PWM asks of thrusters without lag."""
    surge, sway, heave, *_ = wrench(
        nominal, static_thrust(nominal, HEALTHY, each_motor(truth.motor_pwm), truth.voltage_v)
    )
    return surge, sway, heave


def _true(truths: Sequence[Truth]) -> dict[str, Any]:
    eta = np.array([truth.eta for truth in truths])
    return {
        "truth": eta[:, [X, Y, Z, TRUE_PSI]],
        "tilt": tilt_rad(eta),
        "load_on": np.array([truth.load_on for truth in truths]),
    }


def survey(vehicle: SteppedVehicle) -> None:
    """Tell our simulated vehicle where on earth it is: without an origin its EKF gives no position."""
    if isinstance(vehicle, Vehicle):
        vehicle.open_link(SURVEYOR)
        send_origin(vehicle, SURVEYOR)


def send_origin(vehicle: SteppedVehicle, link: int) -> None:
    """Tell a vehicle, as a ground station on `link`, where on earth its EKF began: POSHOLD asks for it."""
    station = mavlink.MAVLink(None, 255, mavlink.MAV_COMP_ID_MISSIONPLANNER)
    origin = mavlink.MAVLink_set_gps_global_origin_message(1, 473977418, 85455939, 0)
    vehicle.step([(link, origin.pack(station))])


def tilt_rad(eta: Array) -> Array:
    """Return the angle between the vehicle's vertical and the water's, of true poses, a row each."""
    tilt: Array = np.arccos(np.cos(eta[:, PHI]) * np.cos(eta[:, THETA]))
    return tilt
