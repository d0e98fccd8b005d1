"""The page after the dive: one HTML file with everything in it. And the same for the terminal."""

import base64
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from html import escape

from lab.report.figures import AXES, DiveFigures, Phase, time_text
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
FIGURES = (
    ("held", "hold_s", "s", 1.0),
    ("RMS", "rms", "unit", 1.0),
    ("SD", "sd", "unit", 1.0),
    ("95 % within", "within", "unit", 1.0),
    ("peak", "peak", "unit", 1.0),
    ("moving, RMS", "moving_rms", "unit", 1.0),
    ("thrust, RMS", "thrust_rms", "force_unit", 1.0),
    ("saturated", "saturated", "%", 100.0),
)
"""Words, field of `Holding`, unit or field of `HeldAxis`, factor."""
ERRORS = """
<p>Errors are measured minus desired while the reference rested, from 3 s after engaging; <i>moving</i>:
while it did not. SD and <i>95 % within</i> are about the mean error. Thrust: by the thruster curve.</p>"""


def page(log: Log, figures: DiveFigures, picture: bytes) -> str:
    """Return the page of a dive; `picture` is a PNG."""
    began = datetime.fromtimestamp(log.began_ns / 1e9, UTC)
    about = log.metadata.get("holdfast", {})
    said = [
        f"{time_text(log.duration_s)} recorded",
        "depth unknown" if math.isnan(figures.depth_max_m) else f"down to {figures.depth_max_m:.1f} m",
        f"Holdfast {about.get('holdfast', 'of unknown version')}, {about.get('git', '')[:18]}",
    ]
    warnings = "".join(f"<li>{escape(warning)}</li>\n" for warning in figures.warnings)
    older = [[warning] for warning in figures.older]
    events = [[time_text(at_s), event.severity, event.kind, event.text] for at_s, event in log.events]
    config = [[part, key, value] for part, table in log.metadata.items() for key, value in table.items()]
    parts = (
        f"<p>{escape(', '.join(said))}.</p>",
        f"<h2>Warnings</h2>\n<ul>{warnings or '<li>none</li>'}</ul>",
        _folded(f"{len(older)} warnings before the recording began", older) if older else "",
        _image(picture),
        f"<h2>How well it was held</h2>\n{_table(table(figures.columns))}{ERRORS}",
        f"<h2>Events</h2>\n{_table(events)}",
        _folded("Configuration", config),
    )
    return _html(f"{log.vehicle}: the dive of {began:%Y-%m-%d %H:%M} UTC", parts)


def comparison(phases: Mapping[str, Phase], picture: bytes) -> str:
    """Return the page of several dives, of a phase of each."""
    return _html("Dives beside each other", (_table(table(phases)), ERRORS, _image(picture)))


def table(phases: Mapping[str, Phase]) -> list[list[str]]:
    """Return a table with a column for each phase; the first row is the head."""
    held = [{hold.dof: hold for hold in phase.held} for phase in phases.values()]
    rows = [
        ["", *phases],
        ["steered by", *(phase.mode for phase in phases.values())],
        ["from", *(time_text(phase.begin_s) for phase in phases.values())],
        ["to", *(time_text(phase.end_s) for phase in phases.values())],
    ]
    for dof, axis in AXES.items():
        if any(dof in one for one in held):
            for words, field, unit, factor in FIGURES:
                values = (factor * getattr(one.get(dof), field, math.nan) for one in held)
                rows.append(
                    [f"{axis.name}, {words}", *(_with(value, getattr(axis, unit, unit)) for value in values)]
                )
    return rows


def lines(figures: DiveFigures) -> Iterator[str]:
    """Give warnings and errors for the terminal."""
    yield from (f"* {warning}" for warning in figures.warnings)
    if figures.older:
        yield f"* {len(figures.older)} older warnings, from before the recording: on the page"
    yield from aligned(table(figures.columns))


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Give the lines of a table for the terminal."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for first, *cells in rows:
        yield "  ".join((first.ljust(widths[0]), *map(str.rjust, cells, widths[1:]))).rstrip()


def _html(title: str, parts: Iterable[str]) -> str:
    head = f'<!doctype html>\n<html lang="en"><meta charset="utf-8">\n<title>{escape(title)}</title>'
    return "\n".join((f"{head}<style>{STYLE}</style>", f"<h1>{escape(title)}</h1>", *parts, "</html>\n"))


def _image(picture: bytes) -> str:
    return f'<img alt="Each axis over time" src="data:image/png;base64,{base64.b64encode(picture).decode()}">'


def _folded(title: str, rows: Sequence[Sequence[str]]) -> str:
    return f"<details><summary>{title}</summary>{_table(rows)}</details>"


def _table(rows: Sequence[Sequence[str]]) -> str:
    cells = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<div><table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table></div>"


def _with(value: float, unit: str) -> str:
    digits = 3 if abs(value) < 0.1 else 2 if abs(value) < 10.0 else 1
    return "–" if math.isnan(value) else f"{value:.{digits}f} {unit}"
