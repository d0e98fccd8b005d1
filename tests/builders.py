"""Records and settings that several tests begin with."""

from typing import Any

from companion.records import ZERO, Ages, Delays, VehicleState
from companion.telemetry import schemas as telemetry

RESTING = VehicleState(
    t_s=10.0,
    boot_s=5.0,
    eta=ZERO,
    eta_dot=ZERO,
    ahead_s=0.1,
    eta_ahead=ZERO,
    eta_dot_ahead=ZERO,
    disturbance=ZERO,
    roll=0.0,
    pitch=0.0,
    p=0.0,
    q=0.0,
    armed=True,
    mode=19,
    system_status=4,
    voltage_v=16.0,
    pilot_gain=0.5,
    ages=Ages(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    delays=Delays(0.01, 0.01, True, True),
)
"""Armed, in MANUAL, at rest at the surface; all that can be known was just heard."""

STILL_SENSORS = dict.fromkeys(
    (
        *("depth_slow_m", "depth_white_m", "climb_slow_m_s", "climb_white_m_s", "drift_m"),
        *("attitude_slow_rad", "attitude_white_rad", "gyro_white_rad_s"),
        *("pressure_white_m", "dvl_drift_m", "dvl_white_m"),
    ),
    0.0,
)
"""The simulated sensors' noise, all of it off."""


def plan(**changes: Any) -> telemetry.Plan:
    """A path of two places in a fence."""
    values: dict[str, Any] = {"t_s": 12.0, "boot_s": 1.0, "number": 1, "name": "line", "fenced": True}
    values |= {"x_m": (-2.0, 2.0), "y_m": (1.0, 1.0), "depth_m": (5.0, 5.0)}
    values |= {"fence_north_m": (-9.0, 9.0), "fence_east_m": (-8.0, 8.0), "fence_depth_m": (0.0, 9.0)}
    return telemetry.Plan(**values | changes)


RECORDING = telemetry.Recorder(
    t_s=1.0,
    boot_s=1.0,
    recording=True,
    file="a.mcap",
    size_bytes=1,
    messages=2,
    dropped=0,
    free_bytes=3,
    said="ok",
)


def pulled(newtons):
    """A steady pull downwards."""
    return f"tether={{enabled=true, sigma_n=[0, 0, 0], pull_n=[0, 0, {newtons}]}}"
