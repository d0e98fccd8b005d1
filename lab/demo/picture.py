"""The demo's picture: three dives in, one figure out."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from lab import style
from lab.demo.screen import NAMES
from lab.demo.timeline import Array, DemoDive, DemoFigures, spans
from lab.style import SMALL

# Dashes and widths tell the dives apart once more.
COLOURS = {"alt_hold": style.VERMILLION, "off": style.GREEN, "on": style.BLUE}
DASHES = {"alt_hold": (4.0, 1.5), "off": (1.2, 1.2), "on": (1.0, 0.0)}
TRUE, SATURATED = style.BLACK, style.YELLOW
LABELS = {
    "alt_hold": "ALT_HOLD, what the pilot has today",
    "off": "plain law, compensator off",
    "on": "Holdfast",
}
SIZE_IN, DPI = (12.8, 7.2), 150
MEASURES = {"depth_rms_mm": "RMS", "depth_sd_mm": "RMS about the mean"}

ROWS = (
    ("depth error, RMS", "depth_rms_mm", "{:.1f} mm"),
    ("about its mean", "depth_sd_mm", "{:.1f} mm"),
    ("depth error, peak", "depth_peak_mm", "{:.1f} mm"),
    ("heading error, RMS", "heading_rms_deg", "{:.2f}°"),
    ("heave thrust, RMS", "thrust_rms_n", "{:.1f} N"),
    ("chatter, RMS a tick", "chatter_n", "{:.2f} N"),
    ("way down, RMS", "way_down_rms_mm", "{:.1f} mm"),
)


def draw(
    dives: Mapping[str, DemoDive],
    results: Mapping[str, DemoFigures],
    span: tuple[float, float],
    task: str,
    caption: str,
    measure: str = "depth_rms_mm",
) -> Figure:
    """Draw the dives `alt_hold`, `off` and `on` over the time since arming.

    `span` is the window of `results`, in s since arming; ALT_HOLD is drawn inside it. `task` tells what the
    vehicle had to do, `caption` how the picture was made. `measure`, one of MEASURES, stands in the title.
    """
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.1, h_pad=0.08)  # type: ignore[union-attr, call-arg]  # a constrained layout
    grid = figure.add_gridspec(2, 12, height_ratios=(1.35, 1.0))
    error, numbers = figure.add_subplot(grid[0, :8]), figure.add_subplot(grid[0, 8:])
    depth, heading, thrust, disturbance = (figure.add_subplot(grid[1, i : i + 3]) for i in (0, 3, 6, 9))
    held = {name: _within(dive, span) if name == "alt_hold" else dive for name, dive in dives.items()}
    shown_mm = {name: getattr(result, measure) for name, result in results.items()}
    _error(error, held, shown_mm)
    _numbers(numbers, results, span)
    _depth(depth, held)
    _heading(heading, held)
    _thrust(thrust, held)
    _disturbance(disturbance, held)
    for panel in (error, depth, heading, thrust, disturbance):
        _frame(panel, dives["on"], span)
        panel.set_xlabel("time since arming (s)", fontsize=SMALL)
    _name_load(error, dives["on"])
    figure.suptitle(
        f"Holdfast keeps the depth to {shown_mm['on']:.1f} mm {MEASURES[measure]}, "
        f"ArduSub's ALT_HOLD to {shown_mm['alt_hold']:.0f} mm\n{task}",
        fontsize=15,
        fontweight="bold",
    )
    figure.supxlabel(caption, fontsize=SMALL, color="0.35")
    return figure


def _depth(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    for name, dive in dives.items():
        _line(panel, name, dive.t_s, dive.depth_m)
    reference = dives["on"]
    (line,) = panel.plot(
        reference.t_s, reference.depth_desired_m, color=TRUE, linewidth=1.2, linestyle=":", label="reference"
    )
    panel.invert_yaxis()
    style.name(panel, "Depth", "depth (m)")
    panel.legend(handles=[line], frameon=False, loc="upper right", fontsize=SMALL)


def _error(panel: Axes, dives: Mapping[str, DemoDive], shown_mm: Mapping[str, float]) -> None:
    for name, dive in dives.items():
        label = f"{LABELS[name]}: {shown_mm[name]:.1f} mm"
        _line(panel, name, dive.t_s, 1e3 * dive.depth_error_m, label=label)
    style.zero(panel)
    style.name(panel, "Depth error", "true depth minus reference (mm)")
    panel.legend(frameon=False, loc="upper left", fontsize=11)


def _heading(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    for name, dive in dives.items():
        _line(panel, name, dive.t_s, np.degrees(dive.heading_error_rad))
    style.zero(panel)
    style.name(panel, "Heading error", "true minus reference (°)")


def _thrust(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    """Draw the command; where heave saturates shade the lower half for `off`, the upper one for `on`."""
    for name, dive in dives.items():
        _line(panel, name, dive.command_t_s, dive.command_n, width=1.0)
    learning = {name: dives[name] for name in ("off", "on")}
    for half, dive in zip((0.0, 0.5), learning.values(), strict=True):
        for begin_s, end_s in spans(dive.d_hat_t_s, dive.saturated):
            panel.axvspan(begin_s, end_s, half, half + 0.5, color=SATURATED, linewidth=0, zorder=-5)
    style.zero(panel)
    style.name(panel, "Heave thrust", "command (N, + down)")
    if any(dive.saturated.any() for dive in learning.values()):
        share = ", ".join(f"{name} {100 * dive.saturated.mean():.1f} %" for name, dive in learning.items())
        panel.legend(
            [Patch(color=SATURATED)],
            [f"saturated ({share})"],
            frameon=False,
            loc="upper right",
            fontsize=SMALL,
        )


def _disturbance(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    on = dives["on"]
    panel.plot(on.t_s, on.disturbance_n, color=TRUE, linewidth=3.5, alpha=0.3, label="true")
    _line(panel, "on", on.d_hat_t_s, on.d_hat_n, label="learnt")
    style.zero(panel)
    style.name(panel, "Heave disturbance", "force (N, + up)")
    panel.legend(frameon=False, loc="upper right", fontsize=SMALL)


def _numbers(panel: Axes, results: Mapping[str, DemoFigures], span: tuple[float, float]) -> None:
    panel.axis("off")
    panel.set_title(
        f"Holding, {span[0]:.1f} to {span[1]:.1f} s (grey)", x=0.0, ha="left", fontweight="bold", fontsize=11
    )
    style.table(
        panel,
        [[_cell(text, getattr(result, field)) for result in results.values()] for _, field, text in ROWS],
        [name for name, _, _ in ROWS],
        {NAMES[name]: COLOURS[name] for name in results},
        Bbox.from_bounds(0.31, 0.0, 0.69, 1.0),
        9.5,
    )


def _cell(text: str, value: float | None) -> str:
    return "–" if value is None else text.format(value)


def _line(
    panel: Axes, name: str, t_s: Array, values: Array, width: float = 1.7, label: str | None = None
) -> None:
    panel.plot(t_s, values, color=COLOURS[name], linewidth=width, dashes=DASHES[name], label=label)


def _frame(panel: Axes, dive: DemoDive, span: tuple[float, float]) -> None:
    """Mark the window and the load's coming and going."""
    panel.axvspan(*span, color=style.WINDOW, linewidth=0, zorder=-10)
    for t_s in _load_s(dive):
        panel.axvline(t_s, color=style.EVENT, linewidth=1.0, linestyle="-.", zorder=-1)
    panel.set_xlim(0.0, float(dive.t_s[-1]))
    style.plain(panel)


def _name_load(panel: Axes, dive: DemoDive) -> None:
    """Say what the marks of the load are."""
    for index, t_s in enumerate(_load_s(dive)):
        panel.text(
            *(t_s, 1.01, ("load on", "load off")[index % 2]),
            transform=panel.get_xaxis_transform(),
            ha="center",
            va="bottom",
            fontsize=SMALL,
            color="0.35",
        )


def _load_s(dive: DemoDive) -> list[float]:
    """Return the times at which the load comes and goes, in turn."""
    return [t_s for span in spans(dive.t_s, dive.load_on) for t_s in span]


def _within(dive: DemoDive, span: tuple[float, float]) -> DemoDive:
    """Leave out of a dive of ALT_HOLD what is outside `span`."""
    seen = (dive.t_s >= span[0]) & (dive.t_s <= span[1])
    return replace(
        dive,
        t_s=dive.t_s[seen],
        depth_m=dive.depth_m[seen],
        depth_error_m=dive.depth_error_m[seen],
        heading_error_rad=dive.heading_error_rad[seen],
        command_t_s=dive.command_t_s[seen],
        command_n=dive.command_n[seen],
    )
