"""`holdfast report`: the page after the dive, from its recording; or several dives beside each other."""

import base64
import io
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path

from holdfast.child import bounded
from holdfast.command_line import command_parser, position
from holdfast.files import refuse_existing
from lab.report.figures import AXES, Phase, phases, warnings
from lab.report.log import load
from lab.report.plot import draw

EXAMPLES = """\
examples:
  holdfast report dives/kelp-20261121T101500Z.mcap      writes ...Z.html and ...Z.png beside it
  holdfast report dives/alt-hold.mcap dives/hold.mcap   the dives beside each other: dives/compared.html
  holdfast report dives/kelp-20261121*.mcap --join      the files of one dive on one page
  holdfast report dives/kelp.mcap --foxglove out/kelp.mcap --origin 47.40,8.55
                                                        also a copy that Foxglove shows in space

A dive that never engaged is reported by flight mode: record ALT_HOLD, then Holdfast, in the same water.
"""

STYLE = """
:root { color-scheme: light dark }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 1.5rem auto; padding: 0 1rem }
div { overflow-x: auto } img { width: 100%; min-width: 760px; background: #fff; border-radius: 4px }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
td { padding: .25rem .8rem .25rem 0; border-bottom: 1px solid #8884 }
ul { border-left: 3px solid #D55E00; padding-left: 1.6rem } li { margin: .35rem 0 }
"""
ERRORS = """Errors are measured minus desired while the reference rested, from 3 s after engaging;
<i>moving</i>: while it did not. SD and <i>95 % within</i> are about the mean error."""


def main(argv: list[str]) -> int:
    """Run the command. Raises RefusedError where there is no dive to report."""
    parser = command_parser(
        "report",
        "Writes an HTML page and a picture of a recorded dive, or of several: warnings, errors, thrust.",
        EXAMPLES,
    )
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="recordings, MCAP")
    add("--join", action="store_true", help="the files are parts of one dive")
    add("--out", type=Path, metavar="DIR", help="folder of the report; default: beside the first file")
    add("--foxglove", type=Path, metavar="FILE", help="also write a copy with Foxglove's channels to FILE")
    add("--origin", type=position, metavar="LAT,LON", help="of x and y, degrees, for Foxglove's map")
    options = parser.parse_args(argv)
    if len(options.files) > 1 and options.foxglove:
        parser.error("--foxglove takes one file")
    dives = [options.files] if options.join else [[file] for file in options.files]
    logs = {files[0].stem: bounded(load, files, files) for files in dives}
    if len(logs) < len(dives):
        parser.error("two files have one name")
    (name, log), *others = logs.items()
    found = {dive: phases(one) for dive, one in logs.items()}
    said = [f"{dive}: {text}" if others else text for dive, one in logs.items() for text in warnings(one)]
    if others:
        title, name = "Dives beside each other", "compared"
        columns = {dive: max(held, key=Phase.duration_s) for dive, held in found.items() if held}
        if not columns:
            parser.error("no dive held anything, or was armed in one flight mode, for long enough")
        shown = {dive: (logs[dive], phase) for dive, phase in columns.items()}
    else:
        began = datetime.fromtimestamp(log.began_ns / 1e9, UTC)
        title = f"{log.vehicle}: the dive of {began:%Y-%m-%d %H:%M} UTC"
        columns = {f"phase {number}": phase for number, phase in enumerate(found[name], 1)}
        held = {dof: figures for phase in found[name] for dof, figures in phase.held.items()}
        shown = {name: (log, Phase("Holdfast", 0.0, log.duration_s + 1.0, held))}
    stem = (options.out or options.files[0].parent) / name
    stem.parent.mkdir(parents=True, exist_ok=True)
    picture = io.BytesIO()
    draw(shown).savefig(picture, format="png")
    stem.with_suffix(".png").write_bytes(picture.getvalue())
    text = page(title, log.software, said, columns, picture.getvalue())
    stem.with_suffix(".html").write_text(text, encoding="utf-8")
    if options.foxglove:
        from lab.foxglove import convert

        refuse_existing(options.foxglove)
        convert(options.files[0], options.foxglove, options.origin)
    sys.stdout.write("\n".join([*lines(said, columns), f"page: {stem.with_suffix('.html')}", ""]))
    return 0


def page(title: str, about: str, said: Sequence[str], columns: Mapping[str, Phase], picture: bytes) -> str:
    """Return the page; `picture` is a PNG."""
    warned = "".join(f"<li>{escape(text)}</li>\n" for text in said) or "<li>none</li>"
    cells = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in table(columns))
    rows = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{escape(title)}</title>
<style>{STYLE}</style>
<h1>{escape(title)}</h1>
<p>{escape(about)}</p>
<h2>Warnings</h2>
<ul>{warned}</ul>
<div><img alt="Each axis over time" src="data:image/png;base64,{base64.b64encode(picture).decode()}"></div>
<h2>How well it was held</h2>
<div><table>{rows}</table></div>
<p>{ERRORS}</p>
</html>
"""


def table(columns: Mapping[str, Phase]) -> list[list[str]]:
    """Return a table with a column for each phase; the first row is the head."""
    rows = [
        ["", *columns],
        ["steered by", *(phase.mode for phase in columns.values())],
        ["time", *(f"{phase.begin_s:.1f} to {phase.end_s:.1f} s" for phase in columns.values())],
    ]
    for dof, axis in AXES.items():
        held = [phase.held.get(dof, {}) for phase in columns.values()]
        for words in next(filter(None, held), {}):
            unit = {"saturated": "%", "thrust, RMS": axis.force_unit}.get(words, axis.unit)
            rows.append([f"{axis.name}, {words}", *(_with(one.get(words, math.nan), unit) for one in held)])
    return rows


def lines(said: Sequence[str], columns: Mapping[str, Phase]) -> Iterator[str]:
    """Give warnings and table for the terminal."""
    yield from (f"* {text}" for text in said)
    rows = table(columns)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for first, *cells in rows:
        yield "  ".join((first.ljust(widths[0]), *map(str.rjust, cells, widths[1:]))).rstrip()


def _with(value: float, unit: str) -> str:
    digits = 3 if abs(value) < 0.1 else 2 if abs(value) < 10.0 else 1
    return "–" if math.isnan(value) else f"{value:.{digits}f} {unit}"
