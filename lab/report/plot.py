"""The picture after a dive: what was asked, how well it was held, with how much thrust."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from lab import style
from lab.report.figures import DiveFigures, error, true_error
from lab.report.log import Array, Columns, Log

SIZE_IN, DPI = (12.8, 9.6), 130
POINTS = 3000
COLOURS = {
    "IDLE": "0.90",
    "READY": "0.78",
    "ACTIVE": style.BLUE,
    "RAMP_DOWN": style.YELLOW,
    "PILOT": style.SKY,
    "FAULT": style.VERMILLION,
}
HATCHES = {"FAULT": "////", "PILOT": "....", "RAMP_DOWN": "xxxx"}
SEVERITY = {"warning": "v", "fault": "X"}
LIMIT = 1.25


def draw(log: Log, figures: DiveFigures) -> Figure:
    """Draw a dive on one page: states above, left what was held, right what it took."""
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.05)  # type: ignore[union-attr, call-arg]
    panels = figure.subplot_mosaic(
        [
            ["states", "states"],
            ["depth", "thrust"],
            ["depth error", "disturbance"],
            ["heading", "yaw"],
            ["heading error", "loop"],
        ],
        height_ratios=(0.28, 1.0, 1.0, 0.9, 0.9),
    )
    state, unit = log.keys["state"], _unit(log.duration_s)
    _states(panels["states"], log, unit)
    _depth(panels["depth"], log, state)
    _error(panels["depth error"], log, "z", "Depth error", "measured minus\ndesired (mm)")
    _heading(panels["heading"], log, state)
    _error(panels["heading error"], log, "psi", "Heading error", "measured minus\ndesired (°)")
    _thrust(panels["thrust"], log, "z", "heave_delivered_n", "Heave thrust", "delivered (N, + down)")
    _thrust(panels["yaw"], log, "psi", "yaw_delivered_nm", "Yaw moment", "delivered (N·m, + right)")
    _disturbance(panels["disturbance"], log)
    _loop(panels["loop"], log, figures)
    for name, panel in panels.items():
        panel.set_xlim(0.0, log.duration_s)
        _seconds(panel, unit)
        if name == "states":
            continue
        style.plain(panel)
        for phase in figures.phases:
            panel.axvspan(phase.begin_s, phase.end_s, color=style.WINDOW, linewidth=0, zorder=-10)
        for span in figures.faults:
            panel.axvline(span.begin_s, color=style.VERMILLION, linewidth=1.2, linestyle="--", zorder=-1)
        if name in ("heading error", "loop"):
            panel.set_xlabel(f"time since the recording began ({unit[1]})", fontsize=style.SMALL)
    figure.suptitle(_title(log, figures), fontsize=14, fontweight="bold")
    return figure


def _title(log: Log, figures: DiveFigures) -> str:
    held = [hold for phase in figures.phases for hold in phase.held if hold.dof == "z" and hold.hold_s > 0.0]
    if not held:
        return f"{log.vehicle}: {log.duration_s:.0f} s, never engaged"
    total_s = sum(hold.hold_s for hold in held)
    rms = np.sqrt(sum(hold.hold_s * hold.rms**2 for hold in held) / total_s)
    return f"{log.vehicle}: depth held {_clock(total_s)} within {rms:.1f} mm RMS"


def _states(panel: Axes, log: Log, unit: tuple[float, str]) -> None:
    """Draw the supervisor's states as a band with their names, and marks for what the pilot should know."""
    for span in log.spans:
        wide = max(span.end_s - span.begin_s, 0.002 * log.duration_s)
        panel.broken_barh(
            [(span.begin_s, wide)],
            (0.0, 1.0),
            facecolor=COLOURS.get(span.state, "0.5"),
            hatch=HATCHES.get(span.state, ""),
            edgecolor="white",
            linewidth=0.5,
        )
        if wide > 0.012 * log.duration_s * len(span.state):
            light = span.state in ("ACTIVE", "FAULT")
            panel.text(
                *(span.begin_s + wide / 2, 0.5, span.state.replace("_", " ")),
                ha="center",
                va="center",
                fontsize=8,
                fontweight="bold",
                color="white" if light else "black",
                bbox={
                    "boxstyle": "round,pad=0.15",
                    "linewidth": 0,
                    "facecolor": COLOURS.get(span.state, "0.5"),
                },
            )
    for severity, marker in SEVERITY.items():
        times = [at_s for at_s, event in log.events if event.severity == severity]
        panel.plot(
            times,
            [LIMIT] * len(times),
            marker,
            color=style.BLACK if severity == "fault" else style.VERMILLION,
            markersize=6,
            label=severity,
            linestyle="none",
        )
    panel.set_ylim(0.0, 1.6)
    panel.set_yticks([])
    panel.spines[["top", "right", "left"]].set_visible(False)
    panel.tick_params(labelsize=style.SMALL)
    known = {span.state for span in log.spans}
    handles: list[object] = [
        Patch(facecolor=COLOURS[name], hatch=HATCHES.get(name, ""), label=name.replace("_", " "))
        for name in COLOURS
        if name in known
    ]
    panel.legend(
        handles=[*handles, *panel.get_lines()],
        ncols=8,
        frameon=False,
        fontsize=8,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.95),
        borderaxespad=0.0,
    )
    panel.set_title("What it did", loc="left", fontweight="bold", fontsize=11)


def _depth(panel: Axes, log: Log, state: Columns) -> None:
    _line(panel, state.at_s, state["depth_m"], style.BLUE, "measured", 1.6)
    _line(panel, *_engaged(log, state, "depth_desired_m"), style.BLACK, "desired", 1.2, ":")
    panel.invert_yaxis()
    style.name(panel, "Depth", "depth (m)")
    _legend(panel)


def _heading(panel: Axes, log: Log, state: Columns) -> None:
    measured = np.degrees(np.unwrap(np.nan_to_num(state["heading_rad"])))
    wanted_at_s, wanted = _engaged(log, state, "heading_desired_rad")
    apart = np.degrees(np.nan_to_num(wanted)) - np.interp(wanted_at_s, state.at_s, measured)
    _line(panel, state.at_s, measured, style.BLUE, "measured", 1.6)
    near = np.degrees(wanted) - 360.0 * np.round(apart / 360.0)
    _line(panel, wanted_at_s, near, style.BLACK, "desired", 1.2, ":")
    style.name(panel, "Heading", "heading (°)")
    _legend(panel)


def _error(panel: Axes, log: Log, dof: str, title: str, unit: str) -> None:
    """Draw the error while engaged; the axis is that of holding, so that a step does not flatten it."""
    shown: list[Array] = []
    for span in log.spans:
        if span.state != "ACTIVE":
            continue
        state = log.keys["state"].between(span.begin_s, span.end_s)
        if state.at_s.size < 2:
            continue
        first = not shown
        true = true_error(log, state, dof)
        if true is not None:
            label = "true, less its mean" if first else ""
            _line(panel, state.at_s, true, style.BLACK, label, 2.2, alpha=0.35)
        _line(panel, state.at_s, error(state, dof), style.BLUE, "measured" if first else "", 0.9)
        shown += [error(state, dof)] if true is None else [error(state, dof), true]
    style.zero(panel)
    style.name(panel, title, unit)
    if shown:
        every = np.abs(np.concatenate(shown))
        panel.set_ylim(*(np.array([-1.0, 1.0]) * LIMIT * max(float(np.nanpercentile(every, 99.5)), 1e-3)))
        _legend(panel)


def _thrust(panel: Axes, log: Log, dof: str, column: str, title: str, unit: str) -> None:
    command, law = log.keys["command"], log.keys[f"dof/{dof}"]
    _line(panel, command.at_s, command[column], style.BLUE, "", 0.9)
    saturated = law["saturated"] * law["engaged"] > 0.0
    for begin_s, end_s in _runs(law.at_s, saturated, 0.003 * log.duration_s):
        panel.axvspan(begin_s, end_s, color=style.YELLOW, linewidth=0, zorder=-5)
    style.zero(panel)
    style.name(panel, title, unit)
    held = law["engaged"] > 0.0
    share = float(saturated[held].mean()) if held.any() else 0.0
    text = f"saturated ({share:.1%} of the held time)" if share else "never saturated"
    handle = Patch(color=style.YELLOW) if share else Patch(visible=False)
    _legend(panel, [handle], [text])


def _disturbance(panel: Axes, log: Log) -> None:
    law = log.keys["dof/z"]
    if log.truth is not None:
        # The paper's sign: a pull down is a negative d.
        truth = log.truth
        _line(panel, truth.at_s, -truth["heave_disturbance_n"], style.BLACK, "true $d$", 2.8, alpha=0.3)
    held = law["engaged"] > 0.0
    _line(panel, law.at_s, np.where(held, law["d_hat"], np.nan), style.BLUE, r"$\hat d$ compensated", 1.2)
    observed = np.where(held, law["d_observer"], np.nan)
    _line(panel, law.at_s, observed, style.GREEN, "$d$ of the observer", 0.9, "--")
    style.zero(panel)
    style.name(panel, "Heave disturbance", "force (N, + up)")
    _legend(panel)


def _loop(panel: Axes, log: Log, figures: DiveFigures) -> None:
    loop = log.keys["loop"]
    for column, scale, colour, label, dash in (
        ("telemetry_delay_s", 1e3, style.GREEN, "telemetry delay", "--"),
        ("command_delay_s", 1e3, style.VERMILLION, "command delay", "-."),
    ):
        _line(panel, loop.at_s, scale * loop[column], colour, label, 1.2, dash)
    at_s, late = _peaks(loop.at_s, loop["lateness_ms"])
    panel.plot(at_s, late, color=style.BLUE, linewidth=0.9, label="lateness, peaks")
    top = max(
        float(np.nanmax(1e3 * loop["command_delay_s"])),
        float(np.nanmax(1e3 * loop["telemetry_delay_s"])),
        3.0 * figures.loop.lateness_p99_ms,
    )
    panel.set_ylim(min(0.0, 1.2e3 * float(np.nanmin(loop["telemetry_delay_s"]))), 1.1 * top)
    style.name(panel, "Loop", "ms")
    _legend(panel)


def _legend(panel: Axes, *handles_and_labels: list[Patch] | list[str]) -> None:
    """Put the legend beside the title, where no line can be."""
    panel.legend(
        *handles_and_labels,
        ncols=3,
        frameon=False,
        fontsize=style.SMALL,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.99),
        borderaxespad=0.0,
        borderpad=0.2,
        columnspacing=1.2,
    )


def _engaged(log: Log, state: Columns, name: str) -> tuple[Array, Array]:
    """Return a column, NaN while nothing is held."""
    on = np.zeros(state.at_s.size, bool)
    for span in log.spans:
        if span.state == "ACTIVE":
            on |= (state.at_s >= span.begin_s) & (state.at_s < span.end_s)
    return state.at_s, np.where(on, state[name], np.nan)


def _line(
    panel: Axes,
    at_s: Array,
    values: Array,
    colour: str,
    label: str,
    width: float,
    dash: str = "-",
    alpha: float = 1.0,
) -> None:
    x, y = thinned(at_s, values)
    panel.plot(x, y, color=colour, linewidth=width, linestyle=dash, alpha=alpha, label=label or "_nolegend_")


def thinned(at_s: Array, values: Array) -> tuple[Array, Array]:
    """Return at most about POINTS points that look the same: of each stretch its least and its greatest."""
    if at_s.size <= 2 * POINTS:
        return at_s, values
    length = at_s.size // POINTS
    count = at_s.size // length
    x = at_s[: count * length].reshape(count, length)
    y = values[: count * length].reshape(count, length)
    low, high = np.nan_to_num(y, nan=np.inf).argmin(1), np.nan_to_num(y, nan=-np.inf).argmax(1)
    pick = np.sort(np.column_stack((low, high)), axis=1)
    rows = np.arange(count)[:, None]
    return x[rows, pick].ravel(), y[rows, pick].ravel()


def _peaks(at_s: Array, values: Array) -> tuple[Array, Array]:
    """Return the greatest of each of some 300 stretches."""
    length = max(1, at_s.size // 300)
    count = at_s.size // length
    cut = count * length
    return at_s[:cut].reshape(count, length)[:, 0], values[:cut].reshape(count, length).max(1)


def _runs(at_s: Array, on: np.ndarray, least_s: float) -> list[tuple[float, float]]:
    edges = np.diff(np.concatenate(([0], on.astype(int), [0])))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [
        (float(at_s[i]), max(float(at_s[j]), float(at_s[i]) + least_s))
        for i, j in zip(begins, ends, strict=True)
    ]


def _unit(duration_s: float) -> tuple[float, str]:
    return (60.0, "min") if duration_s > 600.0 else (1.0, "s")


def _seconds(panel: Axes, unit: tuple[float, str]) -> None:
    scale = unit[0]
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / scale:g}"))
    if scale > 1.0:
        limit = panel.get_xlim()[1]
        step = next(s for s in (60, 120, 300, 600, 900, 1800, 3600, 7200, 1e9) if limit / s <= 12)
        panel.set_xticks(np.arange(0.0, limit, step))
    else:
        panel.xaxis.set_major_locator(MaxNLocator(8))


def _clock(duration_s: float) -> str:
    return f"{duration_s:.0f} s" if duration_s < 120.0 else f"{duration_s / 60.0:.0f} min"
