"""The demo's picture: two dives in, one figure out."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from lab import style
from lab.demo.dive import Array, DemoDive, DemoFigures, spans
from lab.style import SMALL

# Dashes tell the two dives apart once more.
COLOURS = {"off": style.VERMILLION, "on": style.BLUE}
DASHES = {"off": (4.0, 1.5), "on": (1.0, 0.0)}
TRUE, SATURATED = style.BLACK, style.YELLOW
LABELS = {"off": "compensator off", "on": "compensator on"}
SIZE_IN, DPI = (12.8, 7.2), 150

ROWS = (
    ("depth error, RMS", "depth_rms_mm", "{:.1f} mm"),
    ("depth error, peak", "depth_peak_mm", "{:.1f} mm"),
    ("on the way down, RMS", "way_down_rms_mm", "{:.1f} mm"),
    ("heading error, RMS", "heading_rms_deg", "{:.2f}°"),
    ("heave thrust, RMS", "thrust_rms_n", "{:.1f} N"),
    ("chatter, RMS a tick", "chatter_n", "{:.2f} N"),
)


def draw(
    dives: Mapping[str, DemoDive],
    results: Mapping[str, DemoFigures],
    span: tuple[float, float],
    conditions: str,
) -> Figure:
    """Draw depth, errors, thrust and disturbance of the dives `off` and `on` over the time since arming.

    `span` is the window of `results`, in s since arming; `conditions` tells what disturbed the dives.
    """
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.06)  # type: ignore[union-attr, call-arg]
    axes = figure.subplots(3, 2, height_ratios=(1.0, 1.3, 0.9))
    (depth, thrust), (error, disturbance), (heading, numbers) = axes
    _depth(depth, dives)
    _error(error, dives)
    _heading(heading, dives)
    _thrust(thrust, dives)
    _disturbance(disturbance, dives)
    _numbers(numbers, results, span)
    for panel in (depth, error, heading, thrust, disturbance):
        _frame(panel, dives["on"], span)
    for panel in (heading, disturbance):
        panel.set_xlabel("time since arming (s)", fontsize=SMALL)
    off, on = results["off"], results["on"]
    figure.suptitle(
        f"On the way down {on.way_down_rms_mm:.1f} mm RMS with the learning compensator, "
        f"{off.way_down_rms_mm:.1f} without; holding {on.depth_rms_mm:.1f} and {off.depth_rms_mm:.1f}",
        fontsize=14,
        fontweight="bold",
    )
    figure.supxlabel(
        f"Simulated BlueROV2 Heavy, the same sea twice: {conditions}. Grey: the window of the table.",
        fontsize=SMALL,
        color="0.35",
    )
    return figure


def _depth(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    for name, dive in dives.items():
        _line(panel, name, dive.t_s, dive.depth_m)
    reference = dives["on"]
    panel.plot(
        reference.t_s, reference.depth_desired_m, color=TRUE, linewidth=1.2, linestyle=":", label="reference"
    )
    panel.invert_yaxis()
    style.name(panel, "Depth", "depth (m)")
    panel.legend(frameon=False, loc="upper right", fontsize=SMALL)


def _error(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    for name, dive in dives.items():
        _line(panel, name, dive.t_s, 1e3 * dive.depth_error_m)
    style.zero(panel)
    style.name(panel, "Depth error", "true depth minus\nreference (mm)")
    panel.legend(frameon=False, loc="lower right", fontsize=SMALL)


def _heading(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    for name, dive in dives.items():
        _line(panel, name, dive.t_s, np.degrees(dive.heading_error_rad))
    style.zero(panel)
    style.name(panel, "Heading error", "true heading minus\nreference (°)")


def _thrust(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    """Draw the command; where heave saturates shade the lower half for `off`, the upper one for `on`."""
    for name, dive in dives.items():
        _line(panel, name, dive.command_t_s, dive.command_n, width=1.0)
        half = 0.5 * list(dives).index(name)
        for begin_s, end_s in spans(dive.d_hat_t_s, dive.saturated):
            panel.axvspan(begin_s, end_s, half, half + 0.5, color=SATURATED, linewidth=0, zorder=-5)
    style.zero(panel)
    style.name(panel, "Heave thrust", "command (N, + down)")
    if any(dive.saturated.any() for dive in dives.values()):
        share = ", ".join(f"{name} {100 * dive.saturated.mean():.1f} %" for name, dive in dives.items())
        handle, text = Patch(color=SATURATED), f"saturated ({share})"
    else:
        handle, text = Patch(visible=False), "never saturated"
    panel.legend([handle], [text], frameon=False, loc="upper right", fontsize=SMALL)


def _disturbance(panel: Axes, dives: Mapping[str, DemoDive]) -> None:
    on = dives["on"]
    panel.plot(on.t_s, on.disturbance_n, color=TRUE, linewidth=3.5, alpha=0.3, label="true $d$")
    for name, dive in dives.items():
        _line(panel, name, dive.d_hat_t_s, dive.d_hat_n, label=rf"$\hat d$, {LABELS[name]}")
    style.zero(panel)
    style.name(panel, "Heave disturbance", "disturbance (N, + up)")
    panel.legend(frameon=False, loc="upper right", fontsize=SMALL)
    panel.text(
        *(0.99, 0.03, r"on the way down $\hat d$ also makes up for damping that the nominal model lacks"),
        transform=panel.transAxes,
        ha="right",
        fontsize=8,
        color="0.35",
    )


def _numbers(panel: Axes, results: Mapping[str, DemoFigures], span: tuple[float, float]) -> None:
    panel.axis("off")
    panel.set_title(
        f"Holding depth, {span[0]:.1f} to {span[1]:.1f} s", loc="left", fontweight="bold", fontsize=11
    )
    table = panel.table(
        [[text.format(getattr(result, field)) for result in results.values()] for _, field, text in ROWS],
        rowLabels=[name for name, _, _ in ROWS],
        colLabels=list(results),
        bbox=Bbox.from_bounds(0.36, 0.0, 0.6, 1.0),
        edges="horizontal",
    )
    table.auto_set_font_size(False)
    table.set_fontsize(10)
    for cell in table.get_celld().values():
        cell.set_edgecolor("0.8")
    for index, name in enumerate(results):
        table[0, index].get_text().set(color=COLOURS[name], fontweight="bold")


def _line(
    panel: Axes, name: str, t_s: Array, values: Array, width: float = 1.7, label: str | None = None
) -> None:
    panel.plot(
        t_s,
        values,
        color=COLOURS[name],
        linewidth=width,
        dashes=DASHES[name],
        label=LABELS[name] if label is None else label,
    )


def _frame(panel: Axes, dive: DemoDive, span: tuple[float, float]) -> None:
    """Mark the window and the load's coming and going."""
    panel.axvspan(*span, color=style.WINDOW, linewidth=0, zorder=-10)
    for begin_s, end_s in spans(dive.t_s, dive.load_on):
        for t_s, text in ((begin_s, "load on"), (end_s, "load off")):
            panel.axvline(t_s, color=style.EVENT, linewidth=1.0, linestyle="-.", zorder=-1)
            panel.text(
                *(t_s, 1.015, text),
                transform=panel.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=8,
                color="0.35",
            )
    panel.set_xlim(0.0, float(dive.t_s[-1]))
    style.plain(panel)
