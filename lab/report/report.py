"""`holdfast report`: the page after the dive, from its recording; or several dives beside each other."""

import io
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from holdfast.arguments import command_parser, position
from holdfast.files import refuse_existing
from holdfast.gate import bounded
from lab.options import json_file
from lab.report.figures import figures
from lab.report.log import load
from lab.report.page import aligned, comparison, lines, page, table
from lab.report.plot import beside, draw
from lab.tables import table_file, write_columns, write_json

EXAMPLES = """\
examples:
  holdfast report dives/kelp-20261121T101500Z.mcap      writes ...Z.html and ...Z.png beside it
  holdfast report dives/alt-hold.mcap dives/hold.mcap   the dives beside each other: out/compared.html
  holdfast report dives/kelp-20261121*.mcap --join      the files of one dive on one page
  holdfast report dives/kelp.mcap --ticks out/kelp.csv  also every number of every tick, as a table
  holdfast report dives/kelp.mcap --foxglove out/kelp.mcap --origin 47.40,8.55
                                                        also a copy that Foxglove shows in space

A dive that never engaged is reported by flight mode: record ALT_HOLD, then Holdfast, in the same water. The
command reads truncated files as far as they go. The HTML file contains everything, the picture included.
"""


def main(argv: list[str]) -> int:
    """Run the command. Raises RefusedError where there is no dive to report."""
    parser = command_parser(
        "report",
        "Writes a report of a recorded dive, an HTML page and a picture: warnings, errors, thrust, events. "
        "Of several dives it writes one table and one picture.",
        EXAMPLES,
    )
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="recordings, MCAP")
    add("--join", action="store_true", help="the files are parts of one dive")
    add("--out", type=Path, metavar="DIR", help="folder of the report; default: beside the first file")
    add("--json", type=json_file, metavar="FILE", help="also write all figures to FILE")
    add("--ticks", type=table_file, metavar="FILE", help="also write every number of every tick to FILE.csv")
    add("--foxglove", type=Path, metavar="FILE", help="also write a copy with Foxglove's channels to FILE")
    origin = "of x and y, in degrees, for Foxglove's map"
    add("--origin", type=position, metavar="LAT,LON", help=origin)
    options = parser.parse_args(argv)
    dives = [options.files] if options.join else [[file] for file in options.files]
    if len(options.files) > 1 and (options.foxglove or (options.ticks and not options.join)):
        parser.error("--ticks and --foxglove take one dive")
    logs = {files[0].stem: bounded(load, files, files) for files in dives}
    found = {name: figures(log) for name, log in logs.items()}
    folder = options.out or options.files[0].parent
    folder.mkdir(parents=True, exist_ok=True)
    if len(dives) > 1:
        longest = {name: phase for name in logs if (phase := found[name].longest)}
        if not longest:
            parser.error("no dive held anything, or was armed in one flight mode, for long enough")
        said, stem = list(aligned(table(longest))), folder / "compared"
        picture = _png(stem, beside({name: (logs[name], phase) for name, phase in longest.items()}))
        text = comparison(longest, picture)
    else:
        ((name, log),) = logs.items()
        said, stem = list(lines(found[name])), folder / name
        text = page(log, found[name], _png(stem, draw(log, found[name])))
    stem.with_suffix(".html").write_text(text, encoding="utf-8")
    if options.json:
        content: dict[str, Any] = {
            name: {"vehicle": log.vehicle, "began_utc_ns": log.began_ns, "duration_s": log.duration_s}
            | asdict(found[name])
            for name, log in logs.items()
        }
        write_json(options.json, content if len(content) > 1 else content.popitem()[1])
    if options.foxglove:
        from lab.foxglove import convert

        refuse_existing(options.foxglove)
        convert(options.files[0], options.foxglove, options.origin)
    if options.ticks:
        write_columns(options.ticks, next(iter(logs.values())).ticks())
    sys.stdout.write("\n".join([*said, f"page: {stem.with_suffix('.html')}", ""]))
    return 0


def _png(stem: Path, figure: Figure) -> bytes:
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    stem.with_suffix(".png").write_bytes(picture.getvalue())
    return picture.getvalue()
