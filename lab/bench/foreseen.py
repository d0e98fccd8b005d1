"""What could the best learner of the waves gain in depth? The LQG floor beside that of one who foresees them.

python -m lab.bench.foreseen [VEHICLES]

Who foresees every wave cancels it exactly, and keeps the noise of the sensors, the delay and the readiness
for a load, as the floor has them: no learner of the disturbance, narrow-band or not, does better.
"""

import sys

import numpy as np

from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import four
from lab.studies.floor import floor
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config

VEHICLES = 60
LATER_S = 0.04
LINKS = {
    "nominal delay": LinkDelay(),
    "+80 ms": LinkDelay(LinkDelay.up_s + LATER_S, LinkDelay.down_s + LATER_S),
}


def main(vehicles: int) -> None:
    """Print both floors, mean RMS in mm, and what lies between."""
    base = load_config(DEFAULT_CONFIG)
    for name, link in LINKS.items():
        waves = [four(seed)[0] for seed in range(vehicles)]
        as_is, best = (
            float(np.mean([floor(one, base, link, foreseen=foreseen).depth_rms_mm for one in waves]))
            for foreseen in (False, True)
        )
        less = 100.0 * (best / as_is - 1.0)
        sys.stdout.write(f"{name}: floor {as_is:.2f} mm, waves foreseen {best:.2f} mm ({less:+.1f} %)\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else VEHICLES)
