"""`holdfast report`: the page after the dive, from its recording."""

import io
import sys
from dataclasses import asdict
from pathlib import Path

from holdfast.arguments import command_parser
from holdfast.gate import bounded
from lab.options import json_file
from lab.report.figures import figures
from lab.report.log import load
from lab.report.page import lines, page
from lab.report.plot import draw
from lab.tables import table_file, write_columns, write_json

EXAMPLES = """\
examples:
  holdfast report dives/kelp-20261121T101500Z.mcap     writes ...Z.html and ...Z.png beside it
  holdfast report dives/kelp-20261121*.mcap --out out  the files of one dive on one page
  holdfast report dives/kelp.mcap --ticks out/kelp.csv  also every number of every tick, as a table

The command reads truncated files as far as they go. The HTML file contains everything, the picture included.
"""


def main(argv: list[str]) -> int:
    """Run the command. Raises RefusedError where there is no dive to report."""
    parser = command_parser(
        "report",
        "Writes a report of a recorded dive, as one HTML page and a picture: warnings, control errors, "
        "thrust and chatter, states and events, the model that fits the dive, delays and loop.",
        EXAMPLES,
    )
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="recordings of one dive, MCAP")
    add("--out", type=Path, metavar="DIR", help="folder of the report; default: beside the first file")
    add("--json", type=json_file, metavar="FILE", help="also write all figures to FILE")
    add("--ticks", type=table_file, metavar="FILE", help="also write every number of every tick to FILE.csv")
    options = parser.parse_args(argv)
    log = bounded(load, options.files, options.files)
    found = figures(log)
    picture = io.BytesIO()
    draw(log, found).savefig(picture, format="png")
    stem = (options.out or options.files[0].parent) / options.files[0].stem
    stem.parent.mkdir(parents=True, exist_ok=True)
    stem.with_suffix(".png").write_bytes(picture.getvalue())
    stem.with_suffix(".html").write_text(page(log, found, picture.getvalue()), encoding="utf-8")
    if options.json:
        about = {"vehicle": log.vehicle, "began_utc_ns": log.began_ns, "duration_s": log.duration_s}
        write_json(options.json, about | asdict(found))
    if options.ticks:
        write_columns(options.ticks, log.ticks())
    sys.stdout.write("\n".join([*lines(found), f"page: {stem.with_suffix('.html')}", ""]))
    return 0
