"""What a late barometer does to the height of ArduSub's EKF: its vertical channel, linear.

docs/ardusub.md, "The height of the EKF". The accelerometer tells the motion exactly. The barometer's depth,
which is older than the EKF allows for, draws the estimate to where the vehicle was. Of u, how much deeper the
barometer reads than the vehicle is:

| filter (the EKF: third order)                 | output predictor (EK3_TAU_OUTPUT)  |
|-----------------------------------------------|------------------------------------|
| z' = w + K1 (u − z)                           | told_z' = told_w + (z − told_z)/τ  |
| w' = b + K2 (u − z), b' = K3 (u − z)          | told_w' = (w − told_w)/τ           |
"""

from typing import NamedTuple

K1, K2, K3 = 1.73, 1.64, 0.43
"""Per s, s² and s³: fitted to what SIM_BARO_DELAY changes on 4.7 at periods of 2 to 10 s."""
TAU_S = 0.25
"""EK3_TAU_OUTPUT's default."""


class HeightError(NamedTuple):
    """Estimate less truth: depths (m, down), rates (m/s, down) and an acceleration (m/s², down)."""

    depth_m: float
    """Told: relative_alt."""
    sink_m_s: float
    """Told: VFR_HUD.climb."""
    z: float
    w: float
    b: float


NO_HEIGHT_ERROR = HeightError(0.0, 0.0, 0.0, 0.0, 0.0)


def drawn_off(error: HeightError, deeper_m: float, dt_s: float) -> HeightError:
    """Return the errors after a time in which the barometer reads deeper than the vehicle is."""
    told_z, told_w, z, w, b = error
    behind = deeper_m - z
    return HeightError(
        depth_m=told_z + dt_s * (told_w + (z - told_z) / TAU_S),
        sink_m_s=told_w + dt_s * (w - told_w) / TAU_S,
        z=z + dt_s * (w + K1 * behind),
        w=w + dt_s * (b + K2 * behind),
        b=b + dt_s * K3 * behind,
    )
