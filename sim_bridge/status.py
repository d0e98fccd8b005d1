"""The line that `holdfast sim` keeps up to date on a terminal."""

import math
from collections.abc import Sequence

from sim_bridge.firmware.modes import NAMES
from sim_bridge.vehicle import Truth

MAX_WIDTH = 200


def status_line(truth: Truth, current_a: float, faults: Sequence[str], clients: int) -> str:
    """Return true depth and heading, mode, battery, faults that hold and number of clients, in one line."""
    eta = truth.eta
    mode = NAMES.get(truth.mode, "?")
    return "  ".join(
        (
            f"{truth.t_s:7.1f} s",
            f"depth {eta[2]:6.2f} m",
            f"heading {round(math.degrees(eta[5]), 1) % 360.0:5.1f}°",
            f"{mode} {'armed' if truth.armed else 'disarmed'}",
            f"{truth.voltage_v:.1f} V {current_a:.1f} A",
            f"faults: {', '.join(faults) or 'none'}",
            f"clients: {clients}",
        )
    )[:MAX_WIDTH]
