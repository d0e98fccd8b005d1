"""The demo's picture: dives in, one figure out."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.arrays import Array
from companion.records import Z
from lab import style
from lab.demo.demo_dives import NAMES, PARTS, DemoFigures
from lab.demo.story import Story
from lab.loop.dive import Dive
from lab.style import SMALL

LINES: dict[str, tuple[str, tuple[float, ...]]] = {
    "alt_hold": (style.VERMILLION, (4.0, 1.5)),
    "alt_hold_tuned": (style.SKY, (2.5, 1.0)),
    "law": (style.ORANGE, (1.2, 1.2)),
    "observer": (style.GREEN, (5.0, 1.2, 1.2, 1.2)),
    "holdfast": (style.BLUE, (1.0, 0.0)),
}
"""Colours, and dashes, which tell the dives apart once more."""
SIZE_IN, DPI = (12.8, 7.6), 150


def draw(
    dives: Mapping[str, Dive],
    results: Mapping[str, DemoFigures],
    story: Story,
    said: Sequence[str],
    vehicle: str,
) -> Figure:
    """Draw the dives of `vehicle` and their errors; `said` is what the parts of Holdfast are worth."""
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.1, h_pad=0.08)  # type: ignore[union-attr, call-arg]  # a constrained layout
    grid = figure.add_gridspec(2, 12, height_ratios=(1.0, 1.25))
    depth, bars = figure.add_subplot(grid[0, :6]), figure.add_subplot(grid[0, 6:])
    error = figure.add_subplot(grid[1, :])
    _depth(depth, dives)
    _bars(bars, results, story)
    _error(error, dives, story)
    for panel in (depth, error):
        _frame(panel, story)
    held = {name: result.depth_rms_mm for name, result in results.items()}
    figure.suptitle(
        f"Depth error, mm RMS: ALT_HOLD {held['alt_hold']:.0f} (default gains), "
        f"{held['alt_hold_tuned']:.0f} (tuned), "
        f"law {held['law']:.1f}, law + observer {held['observer']:.1f}, Holdfast {held['holdfast']:.1f}\n",
        fontsize=14,
        fontweight="bold",
    )
    figure.text(0.5, 0.955, "\n".join(said), ha="center", va="top", fontsize=11)
    caption = (
        f"{story.words}\nVehicle, water, path and load are the same in each dive, in virtual time with "
        f"{vehicle}. ALT_HOLD gets the same path."
    )
    figure.supxlabel(caption, fontsize=SMALL, color="0.35")
    return figure


def _depth(panel: Axes, dives: Mapping[str, Dive]) -> None:
    for name in ("alt_hold", "holdfast"):
        _line(panel, name, dives[name].t_s, dives[name].truth[:, Z])
    wanted = dives["holdfast"]
    panel.plot(wanted.t_s, wanted.reference[:, Z], ":", color=style.BLACK, linewidth=1.2, label="reference")
    panel.invert_yaxis()
    style.name(panel, "Depth", "depth (m)", pad=18.0)
    panel.legend(frameon=False, loc="lower left", fontsize=SMALL)


def _bars(panel: Axes, results: Mapping[str, DemoFigures], story: Story) -> None:
    """Draw the errors of all five in each phase; the scale is logarithmic, ALT_HOLD's are much larger."""
    width = 0.17
    for index, name in enumerate(NAMES):
        values = [results[name].phase_rms_mm[phase] for phase in story.phases]
        places = np.arange(len(values)) + width * (index - 2.0)
        bars = panel.bar(places, values, width, color=LINES[name][0], label=NAMES[name])
        panel.bar_label(bars, fmt="%.1f", fontsize=7)
    panel.set_yscale("log")
    panel.set_yticks([1, 10, 100, 1000], ["1", "10", "100", "1000"])
    panel.set_ylim(1.0, 2000.0)
    panel.set_xticks(range(len(story.phases)), [*story.phases])
    style.name(panel, "Depth error in each phase", "RMS (mm), logarithmic")
    style.plain(panel)
    panel.legend(frameon=False, loc="upper right", fontsize=SMALL, ncols=3, columnspacing=1.0)


def _error(panel: Axes, dives: Mapping[str, Dive], story: Story) -> None:
    """Draw the errors of Holdfast and of its parts; ALT_HOLD's would leave the panel."""
    for name in PARTS:
        _line(panel, name, dives[name].t_s, 1e3 * dives[name].depth_error_m)
    style.zero(panel)
    style.name(panel, "Depth error, without ALT_HOLD", "true depth minus reference (mm)", pad=18.0)
    panel.set_xlabel("time since arming (s)", fontsize=SMALL)
    panel.legend(frameon=False, loc="upper left", fontsize=SMALL, ncols=3)


def _line(panel: Axes, name: str, t_s: Array, values: Array) -> None:
    colour, dashes = LINES[name]
    panel.plot(t_s, values, color=colour, linewidth=1.5, dashes=dashes, label=NAMES[name])


def _frame(panel: Axes, story: Story) -> None:
    """Name the phases, and mark where they begin."""
    for name, (begin_s, end_s) in story.phases.items():
        panel.axvline(begin_s, color=style.EVENT, linewidth=1.0, linestyle="-.", zorder=-1)
        panel.text(
            *(0.5 * (begin_s + end_s), 1.01, name),
            transform=panel.get_xaxis_transform(),
            ha="center",
            va="bottom",
            fontsize=SMALL,
            color="0.35",
        )
    panel.set_xlim(story.waves_s, story.end_s)
    style.plain(panel)
