"""`holdfast rerun`: a recorded dive once more through today's engine, or a ground station's .tlog."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from companion.config import load_config
from companion.predive.table import show
from dashboard.recording.mcap_file import Reader
from holdfast.arguments import command_parser
from lab.logs import readers, telemetry_log
from lab.logs.dive_log import LogError
from lab.options import add_settings
from lab.rerun import differences, ground_log, ground_log_picture, log_frames
from lab.rerun.rerun import configured, load, report, rerun

EXAMPLES = """\
examples:
  holdfast run --set telemetry.raw=true          together with `holdfast record`: then the dive can be rerun
  holdfast rerun dives/kelp-*.mcap               the files of one dive, in any order
  holdfast rerun FILE --set heave.kappa_per_s=8  the commands that other gains would have given
  holdfast rerun FILE.tlog                       how Holdfast would have judged a dive without it
  holdfast rerun FILE.BIN                        the same from any log that `holdfast identify --from` reads

Exit status: 0 every byte is the same, 1 some bytes differ, 2 the dive cannot be rerun.
"""
FOREIGN = (".tlog", ".bin", ".csv", ".bag", ".db3")


def main(argv: list[str]) -> int:
    """Run the command."""
    parser = command_parser(
        "rerun",
        "Runs a recorded dive through the present code: the same datagrams, configuration, requests and "
        "retunes. It compares the bytes that the engine sends with the recorded ones. From the .tlog of a "
        "ground station, or another log, it prints the states, their reasons and the pre-dive list.",
        EXAMPLES,
    )
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="files of one dive, or other logs"
    )
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="use FILE instead of the recorded configuration"
    )
    add_settings(parser)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/rerun.png"),
        metavar="FILE",
        help="the plot, drawn if something differs; default %(default)s",
    )
    options = parser.parse_args(argv)
    try:
        if any(map(_is_foreign, options.files)):
            return _think(options.files, options.set, options.out)
        tape = load(options.files)
        config = configured(tape, options.set, options.config)
        changed = bool(options.set or options.config)
        retuned = sum(raw.config is not None for raw in tape.ticks)
        if changed and retuned:
            tape.notes.append(
                f"{retuned} retunes of the dive were left out, for the configuration is another"
            )
        outcome = rerun(tape, config, follow=not changed)
    except (ValueError, KeyError) as error:
        sys.stderr.write(f"holdfast rerun: {error}\n")
        return 2
    sys.stdout.write("\n".join(report(tape, outcome)) + "\n")
    if not outcome.different:
        return 0
    if np.nan_to_num(outcome.was - outcome.now).any():
        options.out.parent.mkdir(parents=True, exist_ok=True)
        differences.draw(outcome).savefig(options.out)
        sys.stdout.write(f"the difference over time: {options.out}\n")
    return 1


def _is_foreign(file: Path) -> bool:
    """Tell whether a file is a log of somebody else's: by its suffix, or BlueOS' topics."""
    if file.is_dir() or file.suffix.lower() in FOREIGN:
        return True
    first = next(iter(Reader(file)), None)
    return first is not None and first.key.startswith("mavlink/")


def _records(file: Path, overrides: Sequence[str]) -> Iterator[telemetry_log.TlogRecord]:
    if file.suffix == ".tlog":
        return telemetry_log.read(file)
    frame = load_config(overrides=overrides).vehicle.frame
    try:
        return log_frames.frames_of(readers.read(file, frame), frame)
    except LogError as error:
        raise LogError(f"{file}: {error}") from error


def _think(files: Sequence[Path], overrides: Sequence[str], out: Path) -> int:
    """Say and draw what Holdfast would have thought of telemetry logs, one after the other."""
    out.parent.mkdir(parents=True, exist_ok=True)
    for file in files:
        thoughts = ground_log.think(_records(file, overrides), overrides)
        if file.suffix != ".tlog":
            thoughts.notes.append(log_frames.NOTE)
        picture = out.with_stem(file.stem) if len(files) > 1 else out
        ground_log_picture.draw(thoughts, file.name).savefig(picture)
        sys.stdout.write("\n".join([f"{file.name}:", *ground_log.lines(thoughts), ""]))
        show(thoughts.checked, [f"picture: {picture}"])
    return 0
