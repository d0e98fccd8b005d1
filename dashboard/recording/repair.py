"""`holdfast record --repair`: what can be read of a truncated recording, as a whole file beside it."""

from contextlib import suppress
from pathlib import Path

from dashboard.recording.mcap_file import Reader, Recording


def repair(source: Path) -> str:
    """Copy all readable samples of `source` to a new file with summary and index; say what became of it.

    `source` stays as it is. Raises ValueError for what is no recording, OSError from the disk, and
    FileExistsError where the repaired file is there already.
    """
    reader, target = Reader(source), source.with_suffix(".repaired.mcap")
    recording = Recording(target)
    try:
        for item in reader:
            with suppress(ValueError):  # no recording of ours has it
                recording.add(item)
        lost = {"lost_bytes": str(reader.lost_bytes), "broken_chunks": str(reader.broken_chunks)}
        for name, table in {**reader.metadata, "repaired": {"from": source.name, **lost}}.items():
            recording.describe(name, table)
        recording.close()
    except BaseException:
        recording.give_up()
        target.unlink()
        raise
    if reader.whole and not reader.broken_chunks:
        target.unlink()
        return "is whole; nothing to do"
    return (
        f"{recording.messages} samples are in {target}; {reader.lost_bytes} bytes at the end and "
        f"{reader.broken_chunks} broken chunks were lost"
    )
