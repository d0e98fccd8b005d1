"""`holdfast recover`: what is left of a cut recording, as a whole file."""

import sys
from contextlib import suppress
from itertools import chain
from pathlib import Path

from dashboard.recording.mcap_file import Reader, Recording
from holdfast.arguments import command_parser

EXAMPLES = """\
examples:
  holdfast recover dives/kelp-20261121T101500Z.mcap     writes ...Z.recovered.mcap beside it
  holdfast recover --in-place dives/*.mcap              replaces each truncated file by the repaired one

A power cut, kill -9 or a full disk truncates a recording. `holdfast report`, `replay` and `rerun` read
truncated files too; Foxglove and Lichtblick need the index that this command writes.
"""


def recover(source: Path, target: Path) -> tuple[int, Reader]:
    """Write all that can be read of `source` to `target`; return how many samples, and how `source` was.

    Raises ValueError for what is no recording, OSError from the disk, FileExistsError for a target that is
    there.
    """
    reader = Reader(source)
    samples = iter(reader)
    first = next(samples, None)
    recording = Recording(target)
    try:
        for item in chain([first] if first else [], samples):
            with suppress(ValueError):  # no recording of ours has it
                recording.add(item)
        lost = {"lost_bytes": str(reader.lost_bytes), "broken_chunks": str(reader.broken_chunks)}
        for name, table in {**reader.metadata, "recovered": {"from": source.name, **lost}}.items():
            recording.describe(name, table)
        recording.close()
    except BaseException:
        target.unlink(missing_ok=True)
        raise
    return recording.messages, reader


def main(argv: list[str]) -> int:
    """Run the command; returns 1 if a file could not be repaired."""
    parser = command_parser(
        "recover",
        "Repairs truncated recordings: copies all readable samples to a new file with summary "
        "and index. The original file stays unchanged.",
        EXAMPLES,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings, MCAP")
    parser.add_argument("--in-place", action="store_true", help="replace the truncated file")
    options = parser.parse_args(argv)
    status = 0
    for source in options.files:
        try:
            sys.stdout.write(f"{source}: {_repair(source, options.in_place)}\n")
        except ValueError as error:
            sys.stderr.write(f"holdfast recover: {error}\n")
            status = 2
        except OSError as error:  # the other files may be there
            sys.stderr.write(f"holdfast recover: {error.filename}: {error.strerror}\n")
            status = 2
    return status


def _repair(source: Path, in_place: bool) -> str:
    reader = Reader(source)
    for _ in reader:
        pass
    if reader.whole and not reader.broken_chunks:
        return "is whole; nothing to do"
    target = source.with_suffix(".recovered.mcap")
    count, reader = recover(source, target)
    if in_place:
        target.replace(source)
    lost = f"{reader.lost_bytes} bytes at the end and {reader.broken_chunks} broken chunks were lost"
    return f"{count} samples, {lost}; now {'whole' if in_place else f'in {target}'}"
