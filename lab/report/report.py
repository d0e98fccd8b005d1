"""`holdfast report`: the page after the dive, from its recording; or several dives beside each other."""

import io
import sys
from datetime import UTC, datetime
from pathlib import Path

from holdfast.child import bounded
from holdfast.command_line import command_parser, position
from holdfast.files import refuse_existing
from lab.report.figures import Phase, phases, warnings
from lab.report.log import load
from lab.report.page import lines, page
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


def main(argv: list[str]) -> int:
    """Run the command. Raises RefusedError where there is no dive to report."""
    parser = command_parser(
        "report",
        "Writes a report of a recorded dive, an HTML page and a picture: warnings, errors, thrust. "
        "Of several dives it writes one table and one picture.",
        EXAMPLES,
    )
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="recordings, MCAP")
    add("--join", action="store_true", help="the files are parts of one dive")
    add("--out", type=Path, metavar="DIR", help="folder of the report; default: beside the first file")
    add("--foxglove", type=Path, metavar="FILE", help="also write a copy with Foxglove's channels to FILE")
    origin = "of x and y, in degrees, for Foxglove's map"
    add("--origin", type=position, metavar="LAT,LON", help=origin)
    options = parser.parse_args(argv)
    dives = [options.files] if options.join else [[file] for file in options.files]
    if len(options.files) > 1 and options.foxglove:
        parser.error("--foxglove takes one file")
    logs = {files[0].stem: bounded(load, files, files) for files in dives}
    if len(logs) < len(dives):
        parser.error("two files have one name")
    found = {name: phases(log) for name, log in logs.items()}
    (name, first), *others = logs.items()
    began = datetime.fromtimestamp(first.began_ns / 1e9, UTC)
    if others:
        columns = {
            name: max(held, key=lambda phase: phase.end_s - phase.begin_s)
            for name, held in found.items()
            if held
        }
        if not columns:
            parser.error("no dive held anything, or was armed in one flight mode, for long enough")
        said = [f"{name}: {warning}" for name, log in logs.items() for warning in warnings(log)]
        shown = {name: (logs[name], phase) for name, phase in columns.items()}
        title, name = "Dives beside each other", "compared"
    else:
        columns = {f"phase {number}": phase for number, phase in enumerate(found[name], 1)}
        held = {dof: figures for phase in found[name] for dof, figures in phase.held.items()}
        said, shown = warnings(first), {name: (first, Phase("Holdfast", 0.0, first.duration_s + 1.0, held))}
        title = f"{first.vehicle}: the dive of {began:%Y-%m-%d %H:%M} UTC"
    stem = (options.out or options.files[0].parent) / name
    stem.parent.mkdir(parents=True, exist_ok=True)
    picture = io.BytesIO()
    draw(shown).savefig(picture, format="png")
    stem.with_suffix(".png").write_bytes(picture.getvalue())
    text = page(title, first.software, said, columns, picture.getvalue())
    stem.with_suffix(".html").write_text(text, encoding="utf-8")
    if options.foxglove:
        from lab.foxglove import convert

        refuse_existing(options.foxglove)
        convert(options.files[0], options.foxglove, options.origin)
    sys.stdout.write("\n".join([*lines(said, columns), f"page: {stem.with_suffix('.html')}", ""]))
    return 0
