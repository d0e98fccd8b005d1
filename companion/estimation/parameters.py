"""What the configuration says to the observers and to the watch over the thrusters."""

from msgspec.structs import replace

from companion.config import Config
from companion.core import thruster_watch
from companion.core.allocation import Thrusters
from companion.core.model_learner import Tables
from companion.core.observer import INTERVALS, ObserverParameters, ObserverTable
from companion.core.positioning import Model
from companion.core.vehicle_model import DISTURBANCE_RATIO, MOST_LAG_S, MOST_LOG_GAIN
from companion.estimation.observer_design import Noise, observer_parameters, observer_table, table_in_steps
from companion.records import Z
from companion.steps import Steps

TYPICAL_RATE = 0.1
"""m/s, rad/s: the rate at which the drag is taken for the Kalman gain."""

QUIET_N = 1.0
"""Disturbance noise, N/√s, of the observer that looks for hidden delay: it leans on the model."""


def model_tables(config: Config, model: Model) -> list[Tables]:
    """Return the observers of each degree of freedom, by gain and lag."""
    found = []
    for dof, axis in enumerate(config.axes):
        one, two, three, four = (
            table_of(config, model, dof, axis.disturbance_noise, interval) for interval in INTERVALS
        )
        here = table_of(config, model, dof, DISTURBANCE_RATIO * axis.disturbance_noise, 1)
        found.append(Tables((one, two, three, four), here))
    return found


def thruster_watch_parameters(config: Config, thrusters: Thrusters) -> thruster_watch.Parameters:
    """Return what the watch over the thrusters needs."""
    levelling = config.levelling
    return thruster_watch.Parameters(
        thrusters,
        levelling.roll_inertia,
        levelling.pitch_inertia,
        config.yaw.mass,
        config.thrusters.lag_s,
    )


def hidden_delay_parameters(config: Config, model: Model) -> ObserverParameters:
    """Return the parameters of the observer that looks for hidden delay."""
    drag = model.d1[Z] + TYPICAL_RATE * model.d2[Z]
    tick_s = 1.0 / config.loop.rate_hz
    return observer_parameters(model.m[Z], drag, config.thrusters.lag_s, noise(config, Z, QUIET_N), tick_s)


def table_of(config: Config, model: Model, dof: int, disturbance: float, interval: int) -> ObserverTable:
    """Return a degree of freedom's observers that expect so much `disturbance` noise."""
    return observer_table(*_vehicle(config, model, dof, disturbance), MOST_LOG_GAIN, MOST_LAG_S, interval)


def tables_in_steps(config: Config, model: Model, dof: int) -> Steps[None]:
    """Make a degree of freedom's tables; `model_tables` then takes no time."""
    for ratio, interval in ((DISTURBANCE_RATIO, 1), *((1.0, interval) for interval in INTERVALS)):
        vehicle = _vehicle(config, model, dof, ratio * config.axes[dof].disturbance_noise)
        yield from table_in_steps(*vehicle, MOST_LOG_GAIN, MOST_LAG_S, interval)


def _vehicle(
    config: Config, model: Model, dof: int, disturbance: float
) -> tuple[float, float, float, Noise, float]:
    """Return inertia, drag, lag of the thrust, noises and interval of the tick."""
    drag = model.d1[dof] + TYPICAL_RATE * model.d2[dof]
    noises = noise(config, dof, disturbance)
    return model.m[dof], drag, config.thrusters.lag_s, noises, 1.0 / config.loop.rate_hz


def noise_of(config: Config) -> tuple[float, float]:
    """Return the white noise of depth (m) and heading (rad)."""
    return config.heave.position_noise, config.yaw.position_noise


def with_noise(config: Config, depth: float, heading: float) -> Config:
    """Return the configuration with other white noise of depth (m) and heading (rad)."""
    heave, yaw = config.heave, config.yaw
    return replace(
        config, heave=replace(heave, position_noise=depth), yaw=replace(yaw, position_noise=heading)
    )


def noise(config: Config, dof: int, disturbance: float) -> Noise:
    """Return the noises of a degree of freedom that expects so much `disturbance` noise."""
    axis = config.axes[dof]
    return Noise(
        position=axis.position_noise,
        rate=axis.rate_noise,
        position_slow=axis.position_noise_slow,
        rate_slow=axis.rate_noise_slow,
        disturbance=disturbance,
        slow_time_s=config.delays.slow_noise_s,
    )
