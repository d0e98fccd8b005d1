"""Recorded dives that prove a restructuring: `python -m tests.tools.golden record DIR`, later `check DIR`.

`record` dives with the engine of today and stores all that it took and gave. `check` feeds the same bytes to
the engine of then and compares every byte that it sends. The files belong to one machine: NumPy may round
differently on another.
"""

import argparse
import hashlib
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import msgspec
import numpy as np

from companion.mavlink.signing import Signing
from companion.records import Setpoint, vector
from companion.telemetry.schemas import Raw
from lab.rerun.rerun import Tape, configured, rerun


class Tick(Raw, frozen=True, kw_only=True):
    """A tick before which a script may have set a target: places, rates and accelerations, 12 numbers."""

    setpoint: list[float] | None = None


def aim(engine, tick):
    """Set the target of a tick, if it has one."""
    if tick.setpoint is not None:
        engine.aim(Setpoint(*(vector(tick.setpoint[i : i + 4]) for i in (0, 4, 8))))


def signing():
    """Return what a signed dive begins with; its vehicle has the passphrase "kelp"."""
    return Signing(hashlib.sha256(b"kelp").digest(), 25, 1_795_000_000.0)


def check(file):
    """Feed a stored dive to today's engine; return whether each byte is the same, and its line and notes."""
    tape = Tape(msgspec.msgpack.decode(file.read_bytes(), type=list[Tick]), {})
    config = configured(tape)
    with np.errstate(all="ignore"):
        outcome = rerun(tape, config, signing=signing() if config.link.signing_key_file else None, aim=aim)
    different = outcome.different
    first = str(different[0]) if different else ""
    line = f"{file.stem:20}{len(tape.ticks):7}{len(different):11}{first:>8}{outcome.wall_s:9.1f}"
    return not different, line, tape.notes


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("record", "check"))
    parser.add_argument("folder", type=Path, metavar="DIR")
    options = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        if options.what == "record":
            from tests.tools import golden_dives

            options.folder.mkdir(parents=True, exist_ok=True)
            dives = golden_dives.DIVES
            lines = pool.map(golden_dives.record, dives, [options.folder] * len(dives))
            sys.stdout.writelines(f"{line}\n" for line in lines)
            return 0
        files = sorted(options.folder.glob("*.msgpack"))
        if not files:
            parser.error(f"no dives in {options.folder}")
        sys.stdout.write(f"{'dive':20}{'ticks':>7}{'different':>11}{'first':>8}{'wall, s':>9}\n")
        bad, notes = 0, {}
        for same, line, noted in pool.map(check, files):
            sys.stdout.write(f"{line}\n")
            bad += not same
            notes |= dict.fromkeys(noted)
    sys.stdout.writelines(f"note: {note}\n" for note in notes)
    sys.stdout.write(f"{bad} of {len(files)} dives differ\n" if bad else "every byte is the same\n")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
