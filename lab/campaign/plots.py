"""The campaign's pictures: all dives and the worst of them; one dive replayed. Okabe-Ito colours."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from companion.records import Array
from lab.batch.loop import LOST_M
from lab.campaign.campaign import CampaignCase, CampaignRow
from lab.loop.dive import Dive
from lab.loop.scenarios import SETTLE_S
from lab.style import BLACK, BLUE, ORANGE, PRINTED, SKY, VERMILLION

LOOKS = {"held": (SKY, "."), "strays": (ORANGE, "^"), "lost": (VERMILLION, "x")}

Trace = tuple[Array, Array, Array]
"""Time (s), depth error (m) and heave thrust (N) of one dive, a number each tick."""


def replay_command(number: int) -> str:
    """Return what to type to see one dive again."""
    return f"holdfast campaign --replay {number}"


def draw_worst(
    file: Path,
    rows: Sequence[CampaignRow],
    inside: Sequence[tuple[CampaignRow, Trace]],
    outside: Sequence[tuple[CampaignRow, Trace]],
) -> None:
    """Draw depth RMS over delay for all dives, and the worst within and outside the envelope."""
    with plt.rc_context(PRINTED):
        figure = plt.figure(figsize=(10.5, 9.0))
        grid = figure.add_gridspec(4, 2, height_ratios=(1.25, 1, 1, 1))
        for column, within in enumerate((True, False)):
            axes = figure.add_subplot(grid[0, column])
            _scatter(axes, [row for row in rows if row.case.inside is within])
            axes.set_title("inside the envelope" if within else "outside the envelope", fontweight="bold")
            for line, (row, trace) in enumerate((inside, outside)[column]):
                _error(figure.add_subplot(grid[1 + line, column]), row, trace)
        figure.savefig(file)
        plt.close(figure)


def draw_replay(file: Path, case: CampaignCase, batch: Trace, full: Dive) -> None:
    """Draw one dive as the batch and as the full loop, MAVLink bytes and supervisor included, have it."""
    with plt.rc_context(PRINTED):
        figure, (upper, lower) = plt.subplots(2, 1, figsize=(8.6, 5.4), sharex=True)
        t_s, error_m, thrust_n = batch
        held = np.where(full.active, 1.0, np.nan)
        upper.plot(full.t_s, 1e3 * full.depth_error_m * held, color=BLACK, label="full loop, active")
        upper.plot(
            full.t_s, 1e3 * full.depth_error_m, color=BLACK, alpha=0.3, label="full loop, not steering"
        )
        upper.plot(t_s, 1e3 * error_m, color=VERMILLION, linestyle="--", label="batch")
        lower.plot(full.t_s, full.thrust_n, color=BLACK)
        lower.plot(t_s, thrust_n, color=VERMILLION, linestyle="--")
        upper.set_title(str(case), fontsize=9)
        upper.set_ylabel("depth error (mm)")
        lower.set_ylabel("heave thrust asked for (N)")
        lower.set_xlabel("time since boot (s)")
        upper.legend(loc="upper left")
        _limit(upper, np.concatenate([error_m, full.depth_error_m]))
        figure.savefig(file)
        plt.close(figure)


def _scatter(axes: Axes, rows: Sequence[CampaignRow]) -> None:
    for outcome, (colour, mark) in LOOKS.items():
        of_it = [row for row in rows if row.outcome == outcome]
        axes.plot(
            [row.case.delay_ms for row in of_it],
            [row.figures["depth_rms_mm"] for row in of_it],
            mark,
            color=colour,
            markersize=3 if outcome == "held" else 4,
            label=f"{outcome}: {len(of_it)}",
        )
    if rows:
        axes.set_yscale("log")
    axes.set_ylim(1.0, 5e4)
    axes.set_xlabel("delay of the link, both ways (ms)")
    axes.set_ylabel("depth error RMS (mm)")
    axes.legend(loc="upper left", ncols=3)


def _error(axes: Axes, row: CampaignRow, trace: Trace) -> None:
    t_s, error_m, _ = trace
    axes.plot(t_s, 1e3 * error_m, color=BLUE)
    axes.axvline(SETTLE_S, color=BLACK, linestyle=":", linewidth=0.8)
    axes.set_title(f"{row.case}\n$ {replay_command(row.case.number)}", fontsize=7, loc="left")
    axes.set_ylabel("depth error (mm)")
    axes.set_xlabel("time since boot (s)")
    _limit(axes, error_m)


def _limit(axes: Axes, error_m: Array) -> None:
    """Keep a lost vehicle from squeezing the rest."""
    if not np.nanmax(np.abs(error_m)) < LOST_M:
        axes.set_ylim(-1.1e3 * LOST_M, 1.1e3 * LOST_M)
