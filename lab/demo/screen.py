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

from lab.demo.story import Story
from lab.demo.timeline import DemoFigures

FULL_ERROR_MM = 20.0
FULL_THRUST_N = 100.0
FULL_DISTURBANCE_N = 40.0
WIDTH = 100

_EIGHTHS = " ▁▂▃▄▅▆▇█"
NAMES = {
    "alt_hold": "ALT_HOLD",
    "law": "law",
    "observer": "law + observer",
    "holdfast": "Holdfast",
    "live": "live",
}
_STYLES = {
    "alt_hold": "bright_magenta",
    "law": "bright_yellow",
    "observer": "bright_green",
    "holdfast": "bright_cyan",
    "live": "bright_cyan",
}
_MEANING = {
    "live": "Holdfast in real time",
    "law": "the control law alone",
    "observer": "the law and its observer",
    "holdfast": "Holdfast: law, observer, network",
    "alt_hold": "what the pilot has today",
}
"""In the order of the dives."""
_LABEL = 15


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
                f"depth error, largest in each column's time; a full column: {FULL_ERROR_MM:.0f} mm",
                "dim",
            ),
            *(_history(name, view, inner) for name in _MEANING),
            _axis(view, inner),
        ),
        title=f"[bold]holdfast demo[/]  dive {number} of {len(_MEANING)}, {_MEANING[view.dive]}",
        title_align="left",
        subtitle=f"look in: holdfast watch --connect {view.endpoint}" if view.endpoint else None,
        subtitle_align="right",
        box=box.ROUNDED,
        width=width,
    )


def line(view: DemoView) -> str:
    """Say the same in one line, for a log."""
    head = f"{NAMES[view.dive]:<14} {max(0.0, view.t_s):5.1f} s  {view.phase:<42}"
    if view.now is None:
        return head.rstrip()
    now = view.now
    return (
        f"{head}  depth {now.depth_m:5.2f} m, error {now.error_mm:+6.1f} mm, heading error "
        f"{now.heading_error_deg:+5.2f}°, thrust {now.thrust_n:+4.0f} N, "
        f"pushed {now.disturbance_n:+4.0f} N, learnt {now.d_hat_n:+4.0f} N"
    )


def table(results: Mapping[str, DemoFigures], story: Story, *, about_mean: bool) -> Table:
    """Set the dives side by side."""
    every = results.values()
    rows = [
        (f"depth, {phase}", "mm", [f"{result.phase_rms_mm[phase]:.1f}" for result in every])
        for phase in story.phases
    ]
    whole = "depth_sd_mm" if about_mean else "depth_rms_mm"
    rows += [
        (name, unit, [f"{getattr(result, field):.{digits}f}" for result in every])
        for name, unit, field, digits in (
            ("depth, all of these", "mm", whole, 1),
            ("depth, largest", "mm", "depth_peak_mm", 1),
            ("heading", "°", "heading_rms_deg", 2),
            ("heave thrust", "N", "thrust_rms_n", 1),
            ("heave chatter", "N/tick", "chatter_n", 2),
        )
    ]
    about = ", of the depth about their mean" if about_mean else ""
    return compared(
        f"Errors, RMS, {story.waves_s:g} to {story.end_s:g} s after arming{about}",
        "Errors and thrust are the simulator's truth. Live: Holdfast in real time.",
        [(NAMES[name], _STYLES[name]) for name in results],
        rows,
    )


def compared(
    title: str,
    caption: str,
    columns: Sequence[tuple[str, str]],
    rows: Sequence[tuple[str, str, Sequence[str]]],
) -> Table:
    """Set results side by side: heading and style of each, and of each row title, unit and cells."""
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
    for heading, style in columns:
        grid.add_column(heading, justify="right", style=style)
    for name, unit, cells in rows:
        grid.add_row(name, unit, *cells)
    return grid


def _numbers(now: Now | None, inner: int) -> Table:
    grid = Table.grid(padding=(0, 1))
    grid.add_column(style="dim", width=9)
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
    """Draw |error| over the dive."""
    columns = inner - _LABEL
    peaks = [-1.0] * columns
    for t_s, error_mm in view.errors.get(name, ()):
        if 0.0 <= t_s < view.end_s:
            column = int(columns * t_s / view.end_s)
            peaks[column] = max(peaks[column], abs(error_mm))
    cells = "".join(
        "·" if peak < 0 else _EIGHTHS[min(8, math.ceil(8 * peak / FULL_ERROR_MM))] for peak in peaks
    )
    return Text.assemble((f"{NAMES[name]:<{_LABEL}}", "bold"), (cells, _STYLES[name]))


def _axis(view: DemoView, inner: int) -> Text:
    columns = inner - _LABEL
    cells = [" "] * columns
    for name, t_s in view.marks.items():
        begin = int(columns * t_s / view.end_s)
        for offset, letter in enumerate(f"▲{name}"):
            if begin + offset < columns:
                cells[begin + offset] = letter
    return Text(" " * _LABEL + "".join(cells), "dim")
