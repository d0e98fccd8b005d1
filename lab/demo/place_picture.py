"""The picture of `holdfast demo --dvl`: a place and a path, seen from above."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.transforms import Bbox

from lab import style
from lab.demo.place import NAMES, ROWS, PlaceFigures, PlaceStory
from lab.studies.courses import Track
from lab.style import SMALL

SIZE_IN, DPI = (12.8, 7.2), 150
RING_M = 0.1
SHOWN_FROM_S = 10.0
COLOURS = {"poshold": style.VERMILLION, "place": style.BLUE, "path": style.GREEN}


def draw(story: PlaceStory, poshold: Track, holdfast: Track, results: Mapping[str, PlaceFigures]) -> Figure:
    """Draw both dives; `results` are the figures of their parts."""
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.1, h_pad=0.08)  # type: ignore[union-attr, call-arg]  # a constrained layout
    grid = figure.add_gridspec(2, 12, height_ratios=(1.9, 1.0))
    place, path, numbers = (figure.add_subplot(grid[0, i : i + 4]) for i in (0, 4, 8))
    distance, depth = figure.add_subplot(grid[1, :7]), figure.add_subplot(grid[1, 7:])
    held = {
        "poshold": poshold.within(story.counts_s, story.path_s),
        "place": holdfast.within(story.counts_s, story.path_s),
    }
    _place(place, story, held)
    _path(path, holdfast.within(story.path_s, story.end_s))
    _numbers(numbers, results)
    begin_s = min(SHOWN_FROM_S, story.counts_s)
    dives = {"poshold": poshold, "place": holdfast}
    for name, dive in dives.items():
        on = dive.t_s > begin_s
        distance.plot(dive.t_s[on], 1e3 * dive.place_error_m[on], color=COLOURS[name], linewidth=1.4)
        error_mm = 1e3 * (dive.truth - dive.reference)[on, 2]
        depth.plot(dive.t_s[on], error_mm, color=COLOURS[name], linewidth=1.4)
    style.name(distance, "Distance from where it should be", "mm")
    style.name(depth, "Depth error", "true minus reference (mm)")
    distance.set_ylim(0.0, 1.6 * results["poshold"].place_peak_mm)
    worst_mm = 1.2e3 * float(np.abs((held["poshold"].truth - held["poshold"].reference)[:, 2]).max())
    depth.set_ylim(-worst_mm, worst_mm)
    for panel in (distance, depth):
        panel.axvspan(story.counts_s, story.path_s, color=style.WINDOW, linewidth=0, zorder=-10)
        panel.axvline(story.path_s, color=style.EVENT, linewidth=1.0, linestyle="-.")
        panel.set_xlim(begin_s, story.end_s)
        panel.set_xlabel("time since boot (s)", fontsize=SMALL)
        style.plain(panel)
    distance.text(
        story.path_s, 0.93, " path begins", transform=distance.get_xaxis_transform(), fontsize=SMALL
    )
    figure.suptitle(
        f"Holdfast keeps its place to {results['place'].place_rms_mm:.0f} mm RMS, "
        f"ArduSub's POSHOLD to {results['poshold'].place_rms_mm:.0f} mm\n"
        f"in {story.sea}",
        fontsize=15,
        fontweight="bold",
    )
    figure.supxlabel(
        f"Simulated BlueROV2 Heavy with a DVL, {story.depth_m:g} m deep; vehicle, sea and noise are the same "
        "twice. POSHOLD (our simulator's copy of it, default gains, sticks at rest) is drawn about its mean\n"
        "of the grey window, so no constant error counts. The DVL's own drift of 20 mm north and east is in "
        "all errors.",
        fontsize=SMALL,
        color="0.35",
    )
    return figure


def _place(panel: Axes, story: PlaceStory, held: Mapping[str, Track]) -> None:
    """Draw where the vehicle was, from the place that it should keep."""
    for name, dive in held.items():
        north, east = (dive.truth - dive.reference)[:, :2].T
        panel.plot(east, north, color=COLOURS[name], linewidth=1.1, label=NAMES[name].partition(",")[0])
    panel.plot(0.0, 0.0, "+", color=style.BLACK, markersize=12)
    panel.add_patch(Circle((0.0, 0.0), RING_M, fill=False, linestyle=":", edgecolor="0.4"))
    panel.text(
        0.0, -RING_M, f"{RING_M:g} m", fontsize=SMALL, color="0.4", ha="center", va="top", clip_on=True
    )
    most = 1.45 * max(float(dive.place_error_m.max()) for dive in held.values())
    for t_s in (story.counts_s, story.path_s):
        north, east = (0.35 * most * part / story.current_m_s for part in story.current_m_s_at(t_s))
        at = (-0.75 * most, 0.45 * most)
        panel.annotate(
            "",
            (at[0] + east, at[1] + north),
            at,
            arrowprops={"arrowstyle": "-|>", "color": style.SKY, "linewidth": 2.0},
        )
        panel.text(
            at[0] + 1.15 * east,
            at[1] + 1.15 * north,
            f"{t_s:g} s",
            fontsize=SMALL,
            color=style.SKY,
            ha="center",
        )
    panel.text(-0.95 * most, 0.92 * most, "current", fontsize=SMALL, color=style.SKY)
    panel.set_xlim(-most, most)
    panel.set_ylim(-most, most)
    panel.set_aspect("equal")
    _from_above(panel, f"A place, {story.path_s - story.counts_s:g} s")
    panel.legend(frameon=False, loc="lower right", fontsize=SMALL)


def _path(panel: Axes, dive: Track) -> None:
    panel.plot(dive.reference[:, 1], dive.reference[:, 0], color="0.6", linewidth=3.5, label="reference")
    panel.plot(dive.truth[:, 1], dive.truth[:, 0], color=COLOURS["path"], linewidth=1.2, label="Holdfast")
    panel.margins(0.12)
    panel.set_aspect("equal", adjustable="datalim")
    _from_above(panel, "A path, 3 × 1.5 m")
    panel.legend(frameon=False, loc="lower center", ncols=2, fontsize=SMALL)


def _from_above(panel: Axes, title: str) -> None:
    panel.set_xlabel("east (m)", fontsize=SMALL)
    style.name(panel, f"{title}, from above", "north (m)")
    style.plain(panel)


def _numbers(panel: Axes, results: Mapping[str, PlaceFigures]) -> None:
    panel.axis("off")
    panel.set_title("True errors (grey: the place's)", x=0.0, ha="left", fontweight="bold", fontsize=11)
    style.table(
        panel,
        [
            [f"{getattr(result, field):.{digits}f} {unit}" for result in results.values()]
            for _, unit, field, digits in ROWS
        ],
        [title for title, *_ in ROWS],
        {NAMES[name].replace(", ", ",\n"): COLOURS[name] for name in results},
        Bbox.from_bounds(0.3, 0.15, 0.76, 0.8),
    )
