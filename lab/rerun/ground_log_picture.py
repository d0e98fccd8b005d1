"""A telemetry log as Holdfast saw it: depth, heading, what was missed, and the supervisor's waiting."""

import numpy as np
from matplotlib.figure import Figure

from companion.records import Z
from lab import style
from lab.rerun.ground_log import Thoughts

MOST_CONDITIONS = 8


def draw(thoughts: Thoughts, title: str) -> Figure:
    """Draw depth, heading, innovations, and for how long each condition held."""
    figure = Figure(figsize=(12.8, 10.0), dpi=110, layout="constrained")
    depth, heading, missed, held = figure.subplots(4, 1, height_ratios=(3, 2, 2, 2))
    t_s = thoughts.t_s
    depth.plot(t_s, thoughts.depth_m, color=style.BLUE, linewidth=1.0)
    depth.invert_yaxis()
    style.name(depth, f"{title}: depth, as estimated", "m, down")
    heading.plot(
        t_s, np.degrees(thoughts.heading_rad) % 360.0, ".", color=style.BLUE, markersize=1.5, rasterized=True
    )
    heading.set_ylim(0.0, 360.0)
    style.name(heading, "Heading, as estimated", "°, clockwise from north")
    came = thoughts.innovation[:, Z] != 0.0
    missed.plot(
        t_s[came],
        1e3 * thoughts.innovation[came, Z],
        ".",
        color=style.VERMILLION,
        markersize=2.0,
        rasterized=True,
    )
    style.zero(missed)
    style.name(missed, "Depth, measured minus expected", "mm")
    worst = list(thoughts.held_s.items())[:MOST_CONDITIONS]
    held.barh([name for name, _ in worst], [seconds for _, seconds in worst], color=style.SKY)
    held.invert_yaxis()
    style.name(held, "For how long each condition held", "")
    held.set_xlabel("s", fontsize=style.SMALL)
    missed.set_xlabel("time since the first record (s)", fontsize=style.SMALL)
    for panel in (depth, heading, missed):
        panel.set_xlim(0.0, t_s[-1])
        panel.sharex(depth)
    for panel in (depth, heading, missed, held):
        style.plain(panel)
    return figure
