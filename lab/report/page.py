"""The page after the dive: one HTML file with everything in it."""

import base64
import math
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from html import escape

from lab.report.figures import AXES, LOOP, DiveFigures, Holding
from lab.report.log import Log

STYLE = """
:root { color-scheme: light dark }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 1.5rem auto; padding: 0 1rem }
h1 { font-size: 1.5rem; margin: 0 } h2 { font-size: 1.1rem; margin: 1.8rem 0 .4rem }
p, th { opacity: .7 } p { margin: .2rem 0 1rem } div { overflow-x: auto }
img { width: 100%; background: #fff; border-radius: 4px }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { padding: .25rem .8rem .25rem 0; text-align: left; border-bottom: 1px solid #8884 }
th { font-weight: 600 } details td { white-space: pre-wrap; vertical-align: top }
ul { border-left: 3px solid #D55E00; padding-left: 1.6rem } li { margin: .35rem 0 }
"""
HELD = (
    *("phase", "from", "for", "", "held", "RMS", "p95", "peak", "bias", "moving"),
    *("thrust, RMS", "mean", "chatter", "saturated", "ended"),
)
ERRORS = """
<p>Errors are measured minus desired, while the reference rested, from 3 s after engaging; <i>moving</i> is
the RMS while it did not. Thrust is that of the thruster curve; chatter is its RMS change a tick.</p>"""


def page(log: Log, figures: DiveFigures, picture: bytes) -> str:
    """Return the page; `picture` is a PNG."""
    began = datetime.fromtimestamp(log.began_ns / 1e9, UTC)
    about = log.metadata.get("holdfast", {})
    title = f"{log.vehicle}: the dive of {began:%Y-%m-%d %H:%M} UTC"
    said = [
        f"{_time(log.duration_s)} recorded, engaged {len(figures.phases)} times",
        "depth unknown" if math.isnan(figures.depth_max_m) else f"down to {figures.depth_max_m:.1f} m",
        *([f"battery down to {figures.voltage_min_v:.1f} V"] if figures.voltage_min_v > 0.0 else []),
        f"Holdfast {about.get('holdfast', 'of unknown version')}",
        about.get("git", "revision unknown")[:18],
    ]
    warnings = "".join(f"<li>{escape(warning)}</li>\n" for warning in figures.warnings)
    image = base64.b64encode(picture).decode()
    config = ((part, key, value) for part, table in log.metadata.items() for key, value in table.items())
    return "\n".join(
        (
            '<!doctype html>\n<html lang="en"><meta charset="utf-8">',
            f"<title>{escape(title)}</title><style>{STYLE}</style>",
            f"<h1>{escape(title)}</h1>\n<p>{escape(', '.join(said))}.</p>",
            f"<h2>Warnings</h2>\n<ul>{warnings or '<li>none</li>'}</ul>",
            f'<img alt="States and each axis over time" src="data:image/png;base64,{image}">',
            f"<h2>How well it was held</h2>\n{_rows(HELD, _held(figures))}{ERRORS}",
            *(f"<h2>{name}</h2>\n{_rows(head, rows)}" for name, head, rows in _tables(log, figures)),
            f"<details><summary>Configuration</summary>{_rows(('', '', ''), config)}</details></html>\n",
        )
    )


def _tables(log: Log, figures: DiveFigures) -> Iterator[tuple[str, Sequence[str], Iterable[Sequence[str]]]]:
    states = (
        (
            _time(span.begin_s),
            span.state,
            _time(span.end_s - span.begin_s),
            span.reason,
            _words(span.conditions),
        )
        for span in log.spans
    )
    yield "States", ("at", "state", "for", "because", "conditions seen"), states
    events = ((_time(at_s), event.severity, event.kind, event.text) for at_s, event in log.events)
    yield "Events", ("at", "severity", "kind", "what"), events
    loop = ((LOOP[column][0], *map(_number, values)) for column, values in figures.loop.items())
    yield "Loop and link", ("", "median", "p99", "worst"), loop


def lines(figures: DiveFigures) -> Iterator[str]:
    """Give warnings and errors for the terminal."""
    yield from (f"* {warning}" for warning in figures.warnings)
    for phase in figures.phases:
        yield f"phase {phase.number}, {_time(phase.begin_s)} to {_time(phase.end_s)}, ended: {phase.ended}"
        for hold in phase.held:
            cells = zip(HELD[3:-1], _row(hold), strict=True)
            yield "  " + ", ".join(f"{name} {cell}".strip() for name, cell in cells)


def _held(figures: DiveFigures) -> Iterator[Sequence[str]]:
    for phase in figures.phases:
        first = (str(phase.number), _time(phase.begin_s), _time(phase.end_s - phase.begin_s))
        for i, hold in enumerate(phase.held):
            yield (*(first if i == 0 else ("", "", "")), *_row(hold), phase.ended if i == 0 else "")


def _row(hold: Holding) -> Iterator[str]:
    axis = AXES[hold.dof]
    yield from (axis.name, _time(hold.hold_s))
    for value in (hold.rms, hold.p95, hold.peak, hold.bias, hold.moving_rms):
        yield _with(value, axis.unit)
    for value in (hold.thrust_rms, hold.thrust_mean, hold.chatter):
        yield _with(value, axis.force_unit)
    yield f"{hold.saturated:.1%}"


def _rows(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = "\n".join(_cells("td", row) for row in rows)
    return f"<div><table>{_cells('th', head)}\n{body}\n</table></div>" if body else "<p>None.</p>"


def _cells(tag: str, row: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in row)}</tr>"


def _words(conditions: Sequence[str]) -> str:
    return ", ".join(conditions).lower().replace("_", " ")


def _time(seconds: float) -> str:
    minutes, rest = divmod(seconds, 60.0)
    return f"{seconds:.1f} s" if seconds < 60.0 else f"{minutes:.0f} min {rest:02.0f} s"


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}" if abs(value) < 10.0 else f"{value:.1f}"


def _with(value: float, unit: str) -> str:
    return "–" if math.isnan(value) else f"{_number(value)} {unit}"
