"""`holdfast lab faults`: dives in which something breaks, and what must hold in every tick of each.

A dive's number is its seed: it draws a vehicle, a state to be in, one to three faults and sometimes an
operator who presses every button. What must hold stands in `lab.studies.promises` and `lab.studies.breaking`.

A prepared vehicle is copied for each of its dives, so that only what follows the fault is computed again.
With the real firmware each dive has a process of its own, and what cannot be done to it is left out:
ON_FIRMWARE.
"""

import argparse
import json
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from itertools import groupby
from math import isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import RenderableType

from companion.records import Request, State
from lab.options import add_count, add_firmware, add_out
from lab.studies.breaking import (
    FAULTS,
    ON_FIRMWARE,
    STREAMS,
    VARIANTS,
    Broken,
    Diving,
    begin,
    prepared,
    within_s,
)
from lab.studies.promises import PromiseBrokenError, promise
from lab.study import Row, Study

AFTER_S = 4.0
SLACK_S = 3.7
"""A fault among others may be seen later: heartbeats that get lost are missed after 3.5 s."""
TOGETHER = 12
"""Dives that begin with the same vehicle in the same state."""

STATES = (
    *(State.IDLE, State.READY, *[State.ACTIVE] * 6),
    *(State.RAMP_DOWN, State.HAND_OVER, State.PILOT, State.FAULT),
)
STATES_ON_FIRMWARE = tuple(state for state in STATES if state is not State.HAND_OVER)
"""Left out: HAND_OVER, which the dives begin with a leak."""


class FaultDive(NamedTuple):
    """One dive; its number draws everything."""

    number: int


@dataclass(frozen=True)
class FaultCase:
    """What a dive's number draws."""

    number: int
    variant: str
    state: State
    faults: tuple[Broken, ...]
    fingers: bool


def case(number: int, *, firmware: bool = False) -> FaultCase:
    """Return what dive `number` draws, for our stand-in or the real firmware."""
    rng, group = np.random.default_rng((number, 4)), number if firmware else number // TOGETHER
    states, known = (STATES_ON_FIRMWARE, ON_FIRMWARE) if firmware else (STATES, tuple(FAULTS))
    picked = np.random.default_rng((group, 5))
    kinds = rng.choice(list(known), size=1 if rng.random() < 0.5 else int(rng.integers(2, 4)), replace=False)
    return FaultCase(
        number,
        variant=[*VARIANTS][int(picked.integers(len(VARIANTS)))],
        state=states[int(picked.integers(len(states)))],
        faults=tuple(_drawn(str(kind), rng) for kind in kinds),
        fingers=bool(rng.random() < 0.25),
    )


def _drawn(kind: str, rng: np.random.Generator) -> Broken:
    low, high = FAULTS[kind].value
    return Broken(
        kind,
        at_s=round(float(rng.uniform(0.0, 0.8)), 2),
        message=str(rng.choice(STREAMS)) if FAULTS[kind].on_stream else "",
        value=low if low == high else float(rng.uniform(low, high)),
    )


def dive_group(numbers: Sequence[int], firmware: Path | None = None) -> Iterator[Row]:
    """Dive these, which begin alike: from copies of one vehicle, or each with a `firmware` of its own."""
    faulty = [case(number, firmware=firmware is not None) for number in numbers]
    seed = [*VARIANTS].index(faulty[0].variant)
    if firmware is None:
        with prepared(faulty[0].variant, faulty[0].state, seed) as diving:
            yield from (dive(deepcopy(diving), one) for one in faulty)
        return
    for one in faulty:
        with prepared(one.variant, one.state, [*VARIANTS].index(one.variant), firmware) as diving:
            yield dive(diving, one)


def dive(diving: Diving, faulty: FaultCase) -> Row:
    """Break what the case says, and hold every tick to account.

    `broken` is the promise that was not kept, or empty; `neutral_s` the time from the first fault to the last
    thrust, NaN if it held on or never pushed.
    """
    rng, since_s, broken = np.random.default_rng((faulty.number, 6)), diving.t_s, ""
    pending, begun = sorted(faulty.faults, key=lambda fault: fault.at_s), list[tuple[float, Broken]]()
    try:
        with np.errstate(all="ignore"):
            for tick in range(round(AFTER_S * 50)):
                while pending and pending[0].at_s <= tick / 50:
                    begun.append((diving.t_s, pending.pop(0)))
                    begin(diving, begun[-1][1], rng)
                if faulty.fingers and rng.random() < 0.05:
                    diving.loop.requests.append(Request(int(rng.integers(1, 4))))
                diving.run(0.02)
            _in_time(diving, faulty, begun)
    except PromiseBrokenError as error:
        broken = str(error)
    except Exception:
        broken = "raised: " + traceback.format_exc().strip().splitlines()[-1]
    ended, thrust_s = diving.engine.verdict.state, diving.engine.promises.last_thrust_s
    pushed = thrust_s > since_s and ended is not State.ACTIVE
    return {
        "kinds": [fault.kind for fault in faulty.faults],
        "state": str(faulty.state),
        "ended": str(ended),
        "neutral_s": thrust_s - begun[0][0] if begun and pushed else nan,
        "broken": broken,
    }


def _in_time(diving: Diving, faulty: FaultCase, begun: Sequence[tuple[float, Broken]]) -> None:
    """Check that whatever had to end the steering did; whoever engaged again since is another matter."""
    if faulty.fingers or faulty.state is not State.ACTIVE:
        return
    for at_s, fault in begun:
        within = within_s(fault)
        if within is not None:
            allowed_s = within + (SLACK_S if len(begun) > 1 else 0.02)
            took_s = diving.engine.promises.last_thrust_s - at_s
            said = f"{fault.kind}: still pushing {took_s:.2f} s later, not {allowed_s:.2f}"
            promise(took_s <= allowed_s, said)


class FaultDives(Study[FaultDive]):
    """The dives of a range of numbers."""

    command = "lab faults"
    about = (
        "Injects a fault into every simulated dive (in bytes, telemetry, autopilot, process or vehicle), in "
        "every state, in virtual time, and checks the promises of the supervisor in every tick. The number "
        "of a dive is its seed."
    )
    recipe = ("firmware",)

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_count(parser, "--dives", 2000, "dives")
        add_count(parser, "--first", 0, "number of the first dive", least=0)
        add_out(parser, "out/faults")
        add_firmware(parser)

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._numbers = range(arguments.first, arguments.first + arguments.dives)
        self._firmware: Path | None = arguments.firmware

    def cases(self) -> Sequence[FaultDive]:
        return [FaultDive(number) for number in self._numbers]

    def groups(self, cases: Sequence[FaultDive]) -> Sequence[Sequence[FaultDive]]:
        return [[*group] for _, group in groupby(cases, lambda faulty: faulty.number // TOGETHER)]

    def dive(self, cases: Sequence[FaultDive]) -> Iterator[Row]:
        return dive_group([faulty.number for faulty in cases], self._firmware)

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        yield from super().tables(rows)
        states = Counter(row["state"] for row in rows)
        yield "Begun in " + ", ".join(f"{state} {count}" for state, count in states.most_common())
        bad = [row for row in rows if row["broken"]]
        for row in bad:
            faulty = case(row["number"], firmware=self._firmware is not None)
            yield f"[red]{row['broken']}[/red]: {json.dumps(asdict(faulty))}"
        yield f"{len(rows)} dives of {AFTER_S:g} s after the state was reached; {len(bad)} broke a promise."

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        lines = []
        for kind in FAULTS:
            of_it = [row for row in rows if kind in row["kinds"]]
            active = [row for row in of_it if row["state"] == "ACTIVE"]
            held = sum(row["ended"] == "ACTIVE" for row in active)
            alone = (row["neutral_s"] for row in active if row["kinds"] == [kind])
            times = sorted(filter(isfinite, alone))
            worst = (f"{times[len(times) // 2]:.2f}", f"{times[-1]:.2f}") if times else ("", "")
            broken = sum(bool(row["broken"]) for row in of_it)
            lines.append([kind, *map(str, (len(of_it), held, len(active) - held)), *worst, str(broken)])
        columns = [
            "fault",
            "dives",
            "held on",
            "released",
            "neutral after s, median",
            "worst",
            "promises broken",
        ]
        return {"columns": columns, "rows": lines}

    def failed(self, rows: Sequence[Row]) -> bool:
        return any(row["broken"] for row in rows)
