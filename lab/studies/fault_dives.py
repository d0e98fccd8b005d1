"""`holdfast lab faults`: dives in which something breaks, and what must hold in every tick of each.

A dive's number is its seed: it draws a vehicle, a state to be in, one to three faults and sometimes an
operator who presses every button. What must hold stands in `lab.studies.promises` and `lab.studies.breaking`.

A prepared vehicle is forked for each of its dives, so that only what follows the fault is computed again.
With the real firmware each dive has a process of its own, and what cannot be done to it is left out:
ON_FIRMWARE.
"""

import argparse
import json
import os
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import isfinite, nan
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import RenderableType

from companion.records import Request, State
from lab.options import add_firmware, add_out, not_negative, positive
from lab.studies.breaking import (
    AFTER_S,
    FAULTS,
    ON_FIRMWARE,
    VARIANTS,
    Broken,
    Diving,
    draw,
)
from lab.studies.promises import PromiseBrokenError, promise
from lab.study import Row, Study, ruled

SLACK_S = 3.7
"""A fault among others may be seen later: heartbeats that get lost are missed after 3.5 s."""

STATES = (
    State.IDLE,
    State.READY,
    *[State.ACTIVE] * 6,
    State.RAMP_DOWN,
    State.HAND_OVER,
    State.PILOT,
    State.FAULT,
)

STATES_ON_FIRMWARE = tuple(state for state in STATES if state is not State.HAND_OVER)
"""Left out: HAND_OVER, which the dives begin with a leak."""


@dataclass(frozen=True)
class FaultCase:
    """What a dive's number draws."""

    number: int
    variant: int
    state: State
    faults: tuple[Broken, ...]
    fingers: bool


def case(number: int, *, firmware: bool = False) -> FaultCase:
    """Return what dive `number` draws, for our stand-in or the real firmware."""
    rng = np.random.default_rng((number, 4))
    group = number if firmware else number // 12
    states, known = (STATES_ON_FIRMWARE, ON_FIRMWARE) if firmware else (STATES, tuple(FAULTS))
    picked = np.random.default_rng((group, 5))
    kinds = rng.choice(list(known), size=1 if rng.random() < 0.5 else int(rng.integers(2, 4)), replace=False)
    return FaultCase(
        number,
        variant=int(picked.integers(len(VARIANTS))),
        state=states[int(picked.integers(len(states)))],
        faults=tuple(draw(str(kind), rng) for kind in kinds),
        fingers=bool(rng.random() < 0.25),
    )


def dive_group(numbers: Sequence[int], firmware: Path | None = None) -> list[Row]:
    """Prepare one vehicle in one state, and fork it for each of these dives.

    A `firmware` cannot be forked: it is started for each.
    """
    if firmware is not None:
        return [_dive_firmware(number, firmware) for number in numbers]
    first = case(numbers[0])
    prepared = Diving(first.variant, first.state)
    return [forked(prepared, case(number)) for number in numbers]


def _dive_firmware(number: int, firmware: Path) -> Row:
    """Dive once with the real firmware."""
    faulty = case(number, firmware=True)
    diving = Diving(faulty.variant, faulty.state, firmware)
    try:
        return dive(diving, faulty)
    finally:
        diving.close()


def forked(prepared: Diving, faulty: FaultCase) -> Row:
    """Dive once in a child process, so that `prepared` stays as it is."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        with os.fdopen(writing, "w") as pipe:
            json.dump(dive(prepared, faulty), pipe)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        said = pipe.read()
    os.waitpid(child, 0)
    if said:
        row: Row = json.loads(said)
        return row
    return _row(faulty, "", nan, "the process died")


def dive(dive: Diving, faulty: FaultCase) -> Row:
    """Break what the case says, and hold every tick to account."""
    rng = np.random.default_rng((faulty.number, 6))
    since_s, broken = dive.t_s, ""
    pending = sorted(faulty.faults, key=lambda fault: fault.at_s)
    begun: list[tuple[float, Broken]] = []
    try:
        with np.errstate(all="ignore"):
            for tick in range(round(AFTER_S * 50)):
                while pending and pending[0].at_s <= tick / 50:
                    begun.append((dive.t_s, pending[0]))
                    FAULTS[pending[0].kind].begin(dive, pending.pop(0), rng)
                if faulty.fingers and rng.random() < 0.05:
                    dive.loop.requests.append(Request(int(rng.integers(1, 4))))
                dive.run(0.02)
            _in_time(dive, faulty, begun)
    except PromiseBrokenError as error:
        broken = str(error)
    except Exception:
        broken = "raised: " + traceback.format_exc().strip().splitlines()[-1]
    ended, thrust_s = dive.engine.verdict.state, dive.engine.promises.last_thrust_s
    pushed = thrust_s > since_s and ended is not State.ACTIVE
    return _row(faulty, ended, thrust_s - begun[0][0] if begun and pushed else nan, broken)


def _row(faulty: FaultCase, ended: str, neutral_s: float, broken: str) -> Row:
    """Return the result: `broken` is the promise that was not kept, or empty.

    `neutral_s` is the time from the first fault to the last thrust, NaN if it held on or never pushed.
    """
    return {
        "kinds": [fault.kind for fault in faulty.faults],
        "state": str(faulty.state),
        "ended": str(ended),
        "neutral_s": neutral_s,
        "broken": broken,
    }


def _in_time(dive: Diving, faulty: FaultCase, begun: Sequence[tuple[float, Broken]]) -> None:
    """Check that whatever had to end the steering did; whoever engaged again since is another matter."""
    if faulty.fingers or faulty.state is not State.ACTIVE:
        return
    for at_s, fault in begun:
        within_s = FAULTS[fault.kind].within_s(fault)
        if within_s is None:
            continue
        allowed_s = within_s + (SLACK_S if len(begun) > 1 else 0.02)
        took_s = dive.engine.promises.last_thrust_s - at_s
        promise(took_s <= allowed_s, f"{fault.kind}: still pushing {took_s:.2f} s later, not {allowed_s:.2f}")


class FaultDive(NamedTuple):
    """One dive; its number draws everything."""

    number: int


class FaultDives(Study[FaultDive]):
    """The dives of a range of numbers."""

    command = "lab faults"
    about = (
        "Injects a fault into every simulated dive (in bytes, telemetry, autopilot, process or vehicle), in "
        "every state, in virtual time, and checks the promises of the supervisor in every tick. The number "
        "of a dive is its seed."
    )
    recipe = ("firmware",)
    forks = True

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add the range of numbers."""
        parser.add_argument("--dives", type=positive, default=2000, metavar="N", help="default %(default)s")
        parser.add_argument(
            "--first", type=not_negative, default=0, metavar="ID", help="number of the first dive; default 0"
        )
        add_out(parser, "out/faults")
        add_firmware(parser)

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._numbers = range(arguments.first, arguments.first + arguments.dives)
        self._firmware: Path | None = arguments.firmware

    def cases(self) -> Sequence[FaultDive]:
        return [FaultDive(number) for number in self._numbers]

    def groups(self, cases: Sequence[FaultDive]) -> Sequence[Sequence[FaultDive]]:
        """Put together what shares a vehicle and a state."""
        together: dict[int, list[FaultDive]] = {}
        for faulty in cases:
            together.setdefault(faulty.number // 12, []).append(faulty)
        return [*together.values()]

    def dive(self, cases: Sequence[FaultDive]) -> list[Row]:
        return dive_group([faulty.number for faulty in cases], self._firmware)

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return what became of each kind of fault, and every promise that was not kept."""
        table = ruled(
            f"{len(rows)} dives by what broke in them, alone or among others",
            "fault", "dives", "held on", "let go", "neutral after s, median", "worst", "promises broken",
        )  # fmt: skip
        for kind in FAULTS:
            of_it = [row for row in rows if kind in row["kinds"]]
            if not of_it:
                continue
            active = [row for row in of_it if row["state"] == "ACTIVE"]
            alone = (row["neutral_s"] for row in active if row["kinds"] == [kind])
            times = sorted(filter(isfinite, alone))
            held = sum(row["ended"] == "ACTIVE" for row in active)
            table.add_row(
                kind,
                *map(str, (len(of_it), held, len(active) - held)),
                *((f"{times[len(times) // 2]:.2f}", f"{times[-1]:.2f}") if times else ("", "")),
                str(sum(bool(row["broken"]) for row in of_it)),
            )
        yield table
        states = Counter(row["state"] for row in rows)
        yield "Begun in " + ", ".join(f"{state} {count}" for state, count in states.most_common())
        bad = [row for row in rows if row["broken"]]
        for row in bad:
            faulty = case(row["number"], firmware=self._firmware is not None)
            yield f"[red]{row['broken']}[/red]: {VARIANTS[faulty.variant][0]}, {json.dumps(asdict(faulty))}"
        yield f"{len(rows)} dives of {AFTER_S:g} s after the state was reached; {len(bad)} broke a promise."

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a promise was broken."""
        return any(row["broken"] for row in rows)
