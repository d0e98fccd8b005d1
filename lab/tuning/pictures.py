"""The pictures of docs/tuning.md: one vehicle in one sea with gains that are right, too low and too high.

`python -m lab.tuning.pictures` dives the nominal BlueROV2 Heavy in waves with the full loop and 40 ms of
link, and writes docs/images/tuning-gains.png.
"""

import math
import sys
from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot as plt

from companion.config import load_config
from companion.records import Setpoint
from lab import style
from lab.loop.dive import Dive, dive
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import DEPTH_M, SETTLE_S, Scenario
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

PICTURE = Path(__file__).parents[2] / "docs" / "images" / "tuning-gains.png"
SEA = ("waves.enabled=true", "current.enabled=false", f"initial.eta=[0.0, 0.0, {DEPTH_M}, 0.0, 0.0, 0.0]")
LINK = LinkDelay(up_s=0.02, down_s=0.02)
STEP_AT_S, STEP_M, LASTS_S, SEED = 30.0, 0.5, 45.0, 3
CASES = {
    "as shipped": (),
    "too low": ("heave.lambda_per_s=1.0", "heave.kappa_per_s=1.5"),
    "too high": (
        "heave.lambda_per_s=9.5",
        "heave.kappa_per_s=18.0",
        "heave.disturbance_noise=30.0",
        "delays.gains_bear_s=1.0",
    ),
}
"""Overrides of the companion's configuration."""


def target(t_s: float) -> Setpoint:
    """Hold DEPTH_M, and from STEP_AT_S on STEP_M below it."""
    return Setpoint((math.nan, math.nan, DEPTH_M + STEP_M * (t_s >= STEP_AT_S), 0.0))


def dived(overrides: tuple[str, ...]) -> Dive:
    """Dive one of CASES."""
    scenario = Scenario("gains", lambda base, _: base, target, LASTS_S, SEED)
    return dive(scenario, load_config(overrides=overrides), load_plant(DEFAULT_CONFIG, SEA), LINK)


def draw(dives: dict[str, Dive], path: Path) -> None:
    """Draw the true depth error and the thrust of each dive."""
    with mpl.rc_context(style.PRINTED):
        figure, panels = plt.subplots(2, len(dives), figsize=(9.5, 4.2), sharex=True, sharey="row")
        for (name, one), (above, below) in zip(dives.items(), panels.T, strict=True):
            seen = one.t_s >= SETTLE_S
            figures = one.figures()
            above.plot(one.t_s[seen], 1e3 * one.depth_error_m[seen], color=style.BLUE)
            below.plot(one.t_s[seen], one.thrust_n[seen], color=style.VERMILLION, linewidth=0.7)
            above.set_title(name, loc="left", fontweight="bold")
            below.set_title(f"chatter {figures['chatter_n']:.1f} N a tick", loc="left", fontsize=style.SMALL)
            below.set_xlabel("time (s)")
        panels[0][0].set_ylabel("depth error (mm)")
        panels[0][0].set_ylim(-120, 120)
        panels[1][0].set_ylabel("heave thrust (N)")
        figure.savefig(path)
        plt.close(figure)


def main() -> int:
    """Dive and draw."""
    dives = {name: dived(overrides) for name, overrides in CASES.items()}
    draw(dives, PICTURE)
    for name, one in dives.items():
        held = one.figures()
        sys.stdout.write(
            f"{name}: RMS {held['depth_rms_mm']:.1f} mm, chatter {held['chatter_n']:.1f} N a tick\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
