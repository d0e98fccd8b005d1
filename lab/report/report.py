"""`holdfast report`: the page after the dive, from its recording."""

import io
import sys
from pathlib import Path

from matplotlib.figure import Figure

from holdfast.arguments import command_parser
from lab.report import foxglove
from lab.report.above import draw_above
from lab.report.advice import advice
from lab.report.figures import figures
from lab.report.log import load
from lab.report.numbers import as_json, held_records, ticks
from lab.report.page import lines, page
from lab.report.plot import draw
from lab.tables import add_files, table_file, write_columns, write_json, write_table

EXAMPLES = """\
examples:
  holdfast report dives/kelp-20261121T101500Z.mcap     writes ...Z.html and ...Z.png beside it
  holdfast report dives/kelp-20261121*.mcap --out out  the files of one dive on one page
  holdfast report dives/kelp.mcap --ticks out/kelp.csv  also every number of every tick, as a table
  holdfast report dives/kelp.mcap --foxglove pose.mcap  also a copy with poses for Foxglove's 3D panel

The command reads truncated files too. The HTML file contains everything, the picture included.
"""


def main(argv: list[str]) -> int:
    """Run the command; returns 1 where there is no dive to report."""
    parser = command_parser(
        "report",
        "Writes a report of a recorded dive, as one HTML page and a picture: control errors, states, events "
        "and faults, thrust and chatter, delays and loop, the model that fits the dive, and advice.",
        EXAMPLES,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings of one dive, MCAP")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the report; default: beside the first file"
    )
    add_files(parser, row="engaged interval and axis")
    parser.add_argument(
        "--ticks",
        type=table_file,
        metavar="FILE",
        help="also write every number of every tick to FILE.csv or FILE.parquet",
    )
    parser.add_argument(
        "--foxglove",
        type=Path,
        metavar="FILE",
        help="also write a copy of the dive with poses that Foxglove can draw; FILE must be new",
    )
    options = parser.parse_args(argv)
    try:
        log = load(options.files)
        found = figures(log)
        said = advice(log, found)
        picture = _png(draw(log, found))
        above = draw_above(log)
        stem = (options.out or options.files[0].parent) / options.files[0].stem
        stem.parent.mkdir(parents=True, exist_ok=True)
        stem.with_suffix(".png").write_bytes(picture)
        html = page(log, found, said, picture, None if above is None else _png(above))
        stem.with_suffix(".html").write_text(html, encoding="utf-8")
        if options.json:
            write_json(options.json, as_json(log, found, said))
        if options.table:
            write_table(options.table, held_records(log, found))
        if options.ticks:
            write_columns(options.ticks, ticks(log))
        if options.foxglove:
            foxglove.write(options.files, options.foxglove)
    except ValueError as error:
        sys.stderr.write(f"holdfast report: {error}\n")
        return 2
    sys.stdout.write("\n".join([*lines(found, said), f"page: {stem.with_suffix('.html')}", ""]))
    return 0


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
