"""A dive in waves in virtual time, on any installation: `images.py` gives it to the Python of an image.

Prints as JSON how well the depth was held, and the processor time of the engine's ticks.
"""

import json
import sys
import time
from typing import Any

import numpy as np

import holdfast  # noqa: F401  # makes the packages inside an installed wheel importable
from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint
from lab.loop.lockstep import LinkDelay, Lockstep
from sim_bridge.commands import vehicle_file
from sim_bridge.sim_config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

DEPTH_M = 3.0
SETTLE_S, END_S = 15.0, 45.0
SEED = 5


class TimedEngine(Engine):
    """An engine that notes the processor time of each tick, s."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.ticks_s: list[float] = []

    def step(self, *arguments: Any, **options: Any) -> Any:
        """Tick."""
        before_s = time.process_time()
        sent = super().step(*arguments, **options)
        self.ticks_s.append(time.process_time() - before_s)
        return sent


def main() -> None:
    """Dive."""
    nan = float("nan")
    engine = TimedEngine(load_config(), Setpoint((nan, nan, DEPTH_M, nan)), arm=True)
    plant = load_plant(vehicle_file("heavy"), ["waves.enabled=true"])
    loop = Lockstep(Vehicle(plant, SEED), engine, LinkDelay(), SEED)
    loop.requests = [Request.ENGAGE]
    depths_m = [step.truth.eta[2] for step in loop.run(END_S) if step.t_s >= SETTLE_S]
    ticks_ms = 1e3 * np.array(engine.ticks_s[len(engine.ticks_s) // 3 :])
    found = {
        "error_mm": 1e3 * float(np.abs(np.array(depths_m) - DEPTH_M).mean()),
        "depth_sd_mm": 1e3 * float(np.std(depths_m)),
        "tick_ms": float(np.median(ticks_ms)),
        "tick95_ms": float(np.percentile(ticks_ms, 95)),
    }
    sys.stdout.write(json.dumps(found) + "\n")


main()
