"""What the demo shows in the terminal: frames of the dive, lines where there is no terminal, the table."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from lab.demo.timeline import DemoFigures

FULL_ERROR_MM = 40.0
FULL_THRUST_N = 100.0
FULL_DISTURBANCE_N = 40.0
WIDTH = 100
ROWS = 2
"""Lines of the error's history for each dive."""

_EIGHTHS = " ▁▂▃▄▅▆▇█"
NAMES = {"alt_hold": "ALT_HOLD", "off": "plain law", "on": "Holdfast"}
_STYLES = {"alt_hold": "bright_magenta", "off": "bright_yellow", "on": "bright_cyan"}
_MEANING = {
    "alt_hold": "what the pilot has today",
    "off": "Holdfast, its compensator off",
    "on": "Holdfast: it learns while it dives",
}
_LABEL = 10


@dataclass(frozen=True)
class Now:
    """The newest numbers, as they came over Zenoh. Thrust is positive down; disturbances positive up."""

    depth_m: float
    depth_desired_m: float
    heading_rad: float
    heading_desired_rad: float
    thrust_n: float
    saturated: bool
    disturbance_n: float
    d_hat_n: float

    @property
    def error_mm(self) -> float:
        """Depth minus reference."""
        return 1e3 * (self.depth_m - self.depth_desired_m)

    @property
    def heading_error_deg(self) -> float:
        """Heading minus reference, wrapped."""
        return math.degrees(math.remainder(self.heading_rad - self.heading_desired_rad, 2 * math.pi))


@dataclass(frozen=True)
class DemoView:
    """One moment of the demo. `errors` holds (time since arming in s, depth error in mm), per dive."""

    dive: str
    phase: str
    t_s: float
    end_s: float
    now: Now | None
    errors: Mapping[str, Sequence[tuple[float, float]]]
    marks: Mapping[str, float]
    """What happens when, in s since arming."""
    endpoint: str


def render(view: DemoView, width: int) -> RenderableType:
    """Draw a frame for a terminal of `width` columns."""
    width = min(width, WIDTH)
    inner = width - 4
    number = list(_MEANING).index(view.dive) + 1
    banner = Text.assemble(
        (f" {view.phase} ", f"bold black on {_STYLES[view.dive]}"), no_wrap=True, overflow="ellipsis"
    )
    clock = Table.grid(padding=(0, 1))
    clock.add_row(
        f"{max(0.0, view.t_s):4.1f} of {view.end_s:g} s",
        ProgressBar(total=view.end_s, completed=max(0.0, view.t_s), width=inner - 17),
    )
    return Panel(
        Group(
            banner,
            clock,
            Text(),
            _numbers(view.now, inner),
            Text(),
            Text(
                f"depth error, largest in each column's time; a full column is {FULL_ERROR_MM:.0f} mm", "dim"
            ),
            *(_history(name, view, inner) for name in _MEANING),
            _axis(view, inner),
        ),
        title=f"[bold]holdfast demo[/]  dive {number} of {len(_MEANING)}, {_MEANING[view.dive]}",
        title_align="left",
        subtitle=f"look in: holdfast watch --connect {view.endpoint}",
        subtitle_align="right",
        box=box.ROUNDED,
        width=width,
    )


def line(view: DemoView) -> str:
    """Say the same in one line, for a log."""
    head = f"{NAMES[view.dive]:<9} {max(0.0, view.t_s):5.1f} s  {view.phase:<42}"
    if view.now is None:
        return head.rstrip()
    now = view.now
    return (
        f"{head}  depth {now.depth_m:5.2f} m, error {now.error_mm:+6.1f} mm, heading error "
        f"{now.heading_error_deg:+5.2f}°, thrust {now.thrust_n:+4.0f} N, "
        f"pushed {now.disturbance_n:+4.0f} N, learnt {now.d_hat_n:+4.0f} N"
    )


def table(results: Mapping[str, DemoFigures], span: tuple[float, float], depth_m: float) -> Table:
    """Set the dives side by side."""
    return compared(
        f"Holding {depth_m:g} m, {span[0]:.1f} to {span[1]:.1f} s after arming",
        "Errors, thrust and disturbance are the simulator's truth.",
        results,
        {name: (NAMES[name], _STYLES[name]) for name in results},
        (
            ("depth error, RMS", "mm", "depth_rms_mm", 1),
            ("depth error about its mean, RMS", "mm", "depth_sd_mm", 1),
            ("depth error, peak", "mm", "depth_peak_mm", 1),
            ("heading error, RMS", "°", "heading_rms_deg", 3),
            ("heave thrust, RMS", "N", "thrust_rms_n", 1),
            ("heave chatter, RMS", "N/tick", "chatter_n", 2),
            ("disturbance about its mean, RMS", "N", "disturbance_rms_n", 1),
            ("its estimate's error, RMS", "N", "d_hat_error_rms_n", 1),
            ("depth error, going down, RMS", "mm", "way_down_rms_mm", 1),
            ("depth error, going down, peak", "mm", "way_down_peak_mm", 1),
        ),
    )


def compared(
    title: str,
    caption: str,
    results: Mapping[str, object],
    columns: Mapping[str, tuple[str, str]],
    rows: Sequence[tuple[str, str, str, int]],
) -> Table:
    """Set results side by side: heading and style of each, and of each row title, unit, field and digits."""
    grid = Table(
        title=title,
        title_justify="left",
        caption=caption,
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        title_style="bold",
    )
    grid.add_column("", no_wrap=True)
    grid.add_column("", style="dim")
    for name in results:
        heading, style = columns[name]
        grid.add_column(heading, no_wrap=True, justify="right", style=style)
    for name, unit, field, digits in rows:
        values = [getattr(result, field) for result in results.values()]
        grid.add_row(name, unit, *("–" if value is None else f"{value:.{digits}f}" for value in values))
    return grid


def _numbers(now: Now | None, inner: int) -> Table:
    grid = Table.grid(padding=(0, 1))
    grid.add_column(style="dim", width=_LABEL - 1)
    grid.add_column(justify="right", width=11)
    grid.add_column(no_wrap=True)
    half = (inner - 44) // 2
    if now is None:
        for name in ("depth", "error", "heading", "thrust", "pushed", "learnt"):
            grid.add_row(name, "–", "")
        return grid
    wanted = f"wanted {now.depth_desired_m:.3f} m"
    degrees, wanted_deg = (math.degrees(angle) % 360 for angle in (now.heading_rad, now.heading_desired_rad))
    grid.add_row("depth", f"{now.depth_m:.3f} m", wanted)
    grid.add_row("error", f"{now.error_mm:+.1f} mm", _gauge(now.error_mm, FULL_ERROR_MM, half, "mm"))
    grid.add_row(
        "heading", f"{degrees:.1f}°", f"wanted {wanted_deg:.1f}°, error {now.heading_error_deg:+.2f}°"
    )
    thrust = _gauge(now.thrust_n, FULL_THRUST_N, half, "SATURATED" if now.saturated else "N down")
    grid.add_row("thrust", f"{now.thrust_n:+.1f} N", thrust)
    grid.add_row(
        "pushed",
        f"{now.disturbance_n:+.1f} N",
        _gauge(now.disturbance_n, FULL_DISTURBANCE_N, half, "N up, true"),
    )
    grid.add_row(
        "learnt", f"{now.d_hat_n:+.1f} N", _gauge(now.d_hat_n, FULL_DISTURBANCE_N, half, "N up, learnt")
    )
    return grid


def _gauge(value: float, full: float, half: int, unit: str) -> Text:
    """Draw -full..full from the middle outwards."""
    cells = min(half, round(half * abs(value) / full))
    left, right = ("·" * half, "█" * cells + "·" * (half - cells))
    if value < 0:
        left, right = right[::-1], "·" * half
    return Text.assemble(left, ("│", "bold"), right, (f" ±{full:.0f} {unit}", "dim"))


def _history(name: str, view: DemoView, inner: int) -> Text:
    """Draw |error| over the dive, `ROWS` lines high."""
    columns = inner - _LABEL
    peaks = [-1.0] * columns
    for t_s, error_mm in view.errors.get(name, ()):
        if 0.0 <= t_s < view.end_s:
            column = int(columns * t_s / view.end_s)
            peaks[column] = max(peaks[column], abs(error_mm))
    lines: list[Text] = []
    for row in reversed(range(ROWS)):
        cells = ""
        for peak in peaks:
            eighths = math.ceil(8 * ROWS * peak / FULL_ERROR_MM) - 8 * row
            cells += _EIGHTHS[max(0, min(8, eighths))] if peak >= 0 else ("·" if row == 0 else " ")
        label = NAMES[name] if row == 0 else ""
        lines.append(Text.assemble((f"{label:<{_LABEL}}", "bold"), (cells, _STYLES[name])))
    return Text("\n").join(lines)


def _axis(view: DemoView, inner: int) -> Text:
    columns = inner - _LABEL
    cells = [" "] * columns
    for name, t_s in view.marks.items():
        begin = int(columns * t_s / view.end_s)
        for offset, letter in enumerate(f"▲{name}"):
            if begin + offset < columns:
                cells[begin + offset] = letter
    return Text(" " * _LABEL + "".join(cells), "dim")
