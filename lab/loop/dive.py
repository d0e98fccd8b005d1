"""Run a scenario through the full loop and measure it against the truth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import Config
from companion.control.bounds import wrap
from companion.engine import Engine
from companion.records import PSI, Request, State, Vector, X, Y, Z
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep, SteppedVehicle
from lab.loop.scenarios import SETTLE_S, Scenario
from sim_bridge.config import SimConfig
from sim_bridge.vehicle import Vehicle

PHI, THETA, TRUE_PSI = 3, 4, 5
RECOVERED_M = 0.01
RECOVERED_FOR_S = 2.0
SMOOTHED_S = 0.5
FIGURES = (
    "place_rms_mm",
    "depth_rms_mm",
    "depth_mean_mm",
    "depth_sd_mm",
    "depth_peak_mm",
    "heading_rms_deg",
    "heading_sd_deg",
    "thrust_rms_n",
    "chatter_n",
    "recovery_s",
)
"""RMS of the horizontal distance from its place, NaN without a position; RMS, mean, standard deviation, peak;
RMS of thrust and of its change in a tick; recovery from a load."""

SURVEYOR = 2
"""The link of whoever sets the EKF's origin."""


@dataclass(frozen=True)
class Dive:
    """What was recorded, a row each tick: m, rad, N; errors are true − wanted."""

    t_s: NDArray[np.float64]
    place_error_m: NDArray[np.float64]
    depth_error_m: NDArray[np.float64]
    heading_error_rad: NDArray[np.float64]
    thrust_n: NDArray[np.float64]
    active: NDArray[np.bool_]
    load_on: NDArray[np.bool_]

    def figures(self, since_s: float = SETTLE_S) -> dict[str, float]:
        """Return FIGURES; a load took `recovery_s` to be held, NaN without one."""
        on = self.t_s >= since_s
        depth, heading, thrust = self.depth_error_m[on], self.heading_error_rad[on], self.thrust_n[on]
        figures = (
            1e3 * _rms(self.place_error_m[on]),
            1e3 * _rms(depth),
            1e3 * float(depth.mean()),
            1e3 * float(depth.std()),
            1e3 * float(np.abs(depth).max()),
            float(np.degrees(_rms(heading))),
            float(np.degrees(heading.std())),
            _rms(thrust),
            _rms(np.diff(thrust)),
            self.recovery_s(),
        )
        return dict(zip(FIGURES, figures, strict=True))

    def recovery_s(self) -> float:
        """Return the time from the load's coming on to two seconds within ±1 cm, averaged over 0.5 s.

        NaN without a load; the rest of the dive if it never came to that.
        """
        if not self.load_on.any():
            return float("nan")
        t_s = self.t_s[self.load_on]
        ticks = [round(span_s / (t_s[1] - t_s[0])) for span_s in (SMOOTHED_S, RECOVERED_FOR_S)]
        smooth = np.convolve(self.depth_error_m[self.load_on], np.full(ticks[0], 1.0 / ticks[0]), "valid")
        held = np.convolve(np.abs(smooth) <= RECOVERED_M, np.ones(ticks[1]), "valid") > ticks[1] - 0.5
        return float(t_s[np.argmax(held)] if held.any() else t_s[-1]) - float(t_s[0])


def dive(
    scenario: Scenario,
    config: Config,
    plant: SimConfig,
    link: LinkDelay,
    firmware: Path | None = None,
) -> Dive:
    """Dive `scenario` with the companion's real engine; `plant` is the base that the scenario disturbs.

    The real `firmware` takes the place of our stand-in.
    """
    engine, plant = Engine(config, scenario.target(0.0), arm=True), scenario.plant(plant, scenario.seed)
    rows, engaged_at = [], (math.nan, math.nan)
    with vehicle_of(plant, scenario.seed, firmware) as vehicle:
        if plant.sensors.positioned:
            survey(vehicle)
        loop = Lockstep(vehicle, engine, link, scenario.seed, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        for step in loop.run(scenario.duration_s, scenario.target):
            wanted = scenario.target(step.t_s).eta_d
            eta = step.truth.eta
            active = step.sample.verdict.state is State.ACTIVE
            if active and math.isnan(engaged_at[X]):
                engaged_at = (eta[X], eta[Y])
            place_m = _distance_m(eta, wanted, engaged_at) if plant.sensors.positioned else math.nan
            thrust_n = step.sample.delivered.tau[Z]
            depth_m, heading_rad = eta[Z] - wanted[Z], eta[TRUE_PSI] - wanted[PSI]
            rows.append((step.t_s, place_m, depth_m, heading_rad, thrust_n, active, step.truth.load_on))
    return recorded(rows)


def recorded(rows: Sequence[tuple[float, float, float, float, float, bool, bool]]) -> Dive:
    """Make a Dive of a row each tick: time, errors of place, depth and heading (any turn), thrust, flags."""
    t_s, place, depth, heading, thrust, active, load = np.array(rows).T
    heading = np.array([*map(wrap, heading.tolist())])
    return Dive(t_s, place, depth, heading, thrust, active.astype(bool), load.astype(bool))


def _distance_m(eta: NDArray[np.float64], wanted: Vector, engaged_at: tuple[float, float]) -> float:
    """Return the horizontal distance from where it should be: where it engaged, if no place is named."""
    north, east = (there if math.isnan(x) else x for x, there in zip(wanted[:Z], engaged_at, strict=True))
    return math.hypot(eta[X] - north, eta[Y] - east)


def _rms(x: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(x * x)))


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


def tilt_rad(eta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle between the vehicle's vertical and the water's, of true poses, a row each."""
    tilt: NDArray[np.float64] = np.arccos(np.cos(eta[:, PHI]) * np.cos(eta[:, THETA]))
    return tilt
