"""The page after the dive, one HTML file with everything in it, and the same for the terminal."""

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from lab.report.figures import AXES, Phase

STYLE = """
:root { color-scheme: light dark }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 1.5rem auto; padding: 0 1rem }
div { overflow-x: auto } img { width: 100%; background: #fff; border-radius: 4px }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
td { padding: .25rem .8rem .25rem 0; border-bottom: 1px solid #8884 }
ul { border-left: 3px solid #D55E00; padding-left: 1.6rem } li { margin: .35rem 0 }
"""
ERRORS = """
<p>Errors are measured minus desired while the reference rested, from 3 s after engaging; <i>moving</i>:
while it did not. SD and <i>95 % within</i> are about the mean error. Thrust: by the thruster curve.</p>"""


def page(title: str, about: str, warnings: Sequence[str], phases: Mapping[str, Phase], picture: bytes) -> str:
    """Return the page; `picture` is a PNG."""
    said = "".join(f"<li>{escape(warning)}</li>\n" for warning in warnings)
    cells = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in table(phases))
    rows = "".join(f"<tr>{row}</tr>" for row in cells)
    parts = (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8">\n<title>{escape(title)}</title>',
        f"<style>{STYLE}</style>\n<h1>{escape(title)}</h1>\n<p>{escape(about)}</p>",
        f"<h2>Warnings</h2>\n<ul>{said or '<li>none</li>'}</ul>",
        f'<img alt="Each axis over time" src="data:image/png;base64,{base64.b64encode(picture).decode()}">',
        f"<h2>How well it was held</h2>\n<div><table>{rows}</table></div>",
        f"{ERRORS}\n</html>\n",
    )
    return "\n".join(parts)


def table(phases: Mapping[str, Phase]) -> list[list[str]]:
    """Return a table with a column for each phase; the first row is the head."""
    rows = [
        ["", *phases],
        ["steered by", *(phase.mode for phase in phases.values())],
        ["from", *(f"{phase.begin_s:.1f} s" for phase in phases.values())],
        ["to", *(f"{phase.end_s:.1f} s" for phase in phases.values())],
    ]
    for dof, axis in AXES.items():
        held = [phase.held.get(dof, {}) for phase in phases.values()]
        for words in next(filter(None, held), {}):
            unit = {"held": "s", "saturated": "%", "thrust, RMS": axis.force_unit}.get(words, axis.unit)
            rows.append([f"{axis.name}, {words}", *(_with(one.get(words, math.nan), unit) for one in held)])
    return rows


def lines(warnings: Sequence[str], phases: Mapping[str, Phase]) -> Iterator[str]:
    """Give warnings and table for the terminal."""
    yield from (f"* {warning}" for warning in warnings)
    rows = table(phases)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for first, *cells in rows:
        yield "  ".join((first.ljust(widths[0]), *map(str.rjust, cells, widths[1:]))).rstrip()


def _with(value: float, unit: str) -> str:
    digits = 3 if abs(value) < 0.1 else 2 if abs(value) < 10.0 else 1
    return "–" if math.isnan(value) else f"{value:.{digits}f} {unit}"
