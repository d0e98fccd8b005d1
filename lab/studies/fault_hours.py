"""`holdfast faults --hours N`: hours of virtual time in which something breaks again and again.

An hour's number is its seed. It draws a vehicle, and then faults: one begins, lasts, ends, and the operator
engages again. Every tick is held to account as in the other dives (`lab.studies.breaking`).
"""

import argparse
import os
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from math import isnan, nan
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import RenderableType
from rich.markup import escape

from companion.records import Request, Setpoint, State
from companion.telemetry.samples import encode
from lab.studies.breaking import AFTER_S, FAULTS, VARIANTS, Diving, PromiseBrokenError, draw, promise
from lab.studies.fault_dives import FaultDives
from lab.study import Row, Study, by, ruled
from lab.usage import memory_kb, slope

HOUR_S = 3600.0
WARM_UP_S = 600.0
"""The memory's slope counts from here."""
QUIET_S = (20.0, 100.0)
"""Between engaging again and the next fault."""
LASTS_S = (AFTER_S, 20.0)
ASK_S, GIVE_UP_S = 5.0, 60.0
"""The operator asks to engage so often and, if that does not help for so long, takes another vehicle."""

RELEASED_S = 30.0
"""So long before that he releases what is still handed over: after a tilt it lasts until somebody acts."""
ENCODE_TICKS = 5
RESTORED = {"FS_PILOT_INPUT": 2.0, "JS_GAIN_DEFAULT": 0.5, "JS_THR_GAIN": 1.0}


@dataclass
class Hour:
    """What became of one hour."""

    number: int
    vehicle: str
    simulated_s: float = 0.0
    active_s: float = 0.0
    faults: dict[str, int] = field(default_factory=dict)
    let_go: dict[str, int] = field(default_factory=dict)
    """How often ACTIVE ended, by the supervisor's reason."""
    broken: list[str] = field(default_factory=list)
    """Exceptions and promises that were not kept; a new vehicle follows each."""
    stuck: list[str] = field(default_factory=list)
    """After which fault it could not be engaged again, and why."""
    memory_kb_h: float = nan
    """Slope of what the process allocated, per simulated hour."""
    cpu_s: float = 0.0


class _Operator:
    """A dive, and somebody who breaks it, mends it and engages again."""

    def __init__(self, hour: Hour, seconds: float) -> None:
        self._hour, self._ends_s = hour, seconds
        self._rng = np.random.default_rng((hour.number, 7))
        self._variant = hour.number % len(VARIANTS)
        self._dive = Diving(self._variant, State.ACTIVE)
        self._was = State.ACTIVE
        self._fault = "engaging"
        self._memory: list[tuple[float, float]] = []

    def run(self) -> None:
        """Dive until the hour is over."""
        hour = self._hour
        while hour.simulated_s < self._ends_s:
            try:
                with np.errstate(all="ignore"):
                    self._wander()
                    self._break()
                    self._engage()
            except PromiseBrokenError as error:
                hour.broken.append(f"{self._fault}: {error}")
                self._was = State.FAULT
            except Exception:
                hour.broken.append(f"{self._fault}: {traceback.format_exc(limit=-3)}")
                self._was = State.FAULT
            if self._was is not State.ACTIVE and hour.simulated_s < self._ends_s:
                self._dive = Diving(self._variant, State.ACTIVE)
                self._was, self._fault = State.ACTIVE, "engaging"
        counted = [(at_s / HOUR_S, kb) for at_s, kb in self._memory if at_s >= WARM_UP_S]
        if len(counted) > 2:
            hour.memory_kb_h = slope([at for at, _ in counted], [kb for _, kb in counted]).slope

    def _wander(self) -> None:
        """Hold another place for a while."""
        draw = self._rng.uniform
        self._dive.engine.aim(Setpoint((nan, nan, draw(1.0, 8.0), draw(-3.0, 3.0))))
        self._pass(draw(*QUIET_S))

    def _break(self) -> None:
        """Let a fault begin, last and end. Whatever must end the steering does so in time."""
        broken = draw(str(self._rng.choice(list(FAULTS))), self._rng)
        self._fault = broken.kind
        self._hour.faults[broken.kind] = self._hour.faults.get(broken.kind, 0) + 1
        dive, at_s = self._dive, self._dive.t_s
        held = self._was is State.ACTIVE
        FAULTS[broken.kind].begin(dive, broken, self._rng)
        self._pass(AFTER_S)
        within_s = FAULTS[broken.kind].within_s(broken)
        if held and within_s is not None:
            took_s = dive.engine.last_thrust_s - at_s
            promise(took_s <= within_s + 0.02, f"still pushing {took_s:.2f} s later, not {within_s:.2f}")
        self._pass(self._rng.uniform(*LASTS_S) - AFTER_S)
        dive.engine.spoils.clear()
        dive.fault("clear")
        for name, value in RESTORED.items():
            dive.fault("parameter", value, parameter=name)
        if broken.kind == "depth jumps":
            dive.fault("depth_shifted", -broken.value)

    def _engage(self) -> None:
        """Ask until it holds again, or note why it does not."""
        dive, until_s = self._dive, self._dive.t_s + GIVE_UP_S
        while self._was is not State.ACTIVE:
            if dive.t_s > until_s:
                self._hour.stuck.append(f"{self._fault}: {dive.engine.verdict.reason}")
                return
            lasts = dive.engine.verdict.state is State.HAND_OVER and until_s - dive.t_s < RELEASED_S
            dive.loop.requests += [Request.STOP] if lasts else [Request.CLEAR_FAULT, Request.ENGAGE]
            self._pass(ASK_S)

    def _pass(self, seconds: float) -> None:
        """Let time pass, and note what ends the holding."""
        hour = self._hour
        for step in self._dive.loop.run(seconds):
            hour.simulated_s += 0.02
            verdict = step.sample.verdict
            hour.active_s += 0.02 * (verdict.state is State.ACTIVE)
            if self._was is State.ACTIVE and verdict.state is not State.ACTIVE:
                hour.let_go[verdict.reason] = hour.let_go.get(verdict.reason, 0) + 1
            self._was = verdict.state
            tick = step.sample.loop.tick
            if tick % ENCODE_TICKS == 0:
                encode(step.sample, "soak")
            if tick % 3000 == 0:
                self._memory.append((hour.simulated_s, memory_kb(os.getpid()).own))


def soak_hour(number: int, seconds: float = HOUR_S) -> Hour:
    """Dive hour `number`."""
    hour = Hour(number, VARIANTS[number % len(VARIANTS)][0])
    begun_s = time.process_time()
    _Operator(hour, seconds).run()
    hour.cpu_s = time.process_time() - begun_s
    return hour


class NumberedHour(NamedTuple):
    """One hour."""

    number: int


class FaultHours(Study[NumberedHour]):
    """So many hours; a longer run continues the file."""

    command = FaultDives.command
    about = FaultDives.about
    unit = "hours"
    recipe = ()
    keeps_rows = True

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        FaultDives.options(parser)

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._hours: int = arguments.hours

    def journal(self, out: Path) -> Path:
        return out

    def cases(self) -> Sequence[NumberedHour]:
        return [NumberedHour(number) for number in range(self._hours)]

    def dive(self, cases: Sequence[NumberedHour]) -> Iterator[Row]:
        return (asdict(soak_hour(case.number)) for case in cases)

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether an hour broke a promise or could not be engaged again."""
        return any(row["broken"] or row["stuck"] for row in rows)

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return what became of the hours, by vehicle, and why it let go."""
        total_s = sum(row["simulated_s"] for row in rows)
        columns = "vehicle", "hours", "held on", "faults", "let go", "broken", "stuck", "memory kB/h"
        table = ruled(f"{total_s / HOUR_S:.1f} simulated hours", *columns)
        for (name,), some in by(rows, "vehicle").items():
            simulated_s = sum(row["simulated_s"] for row in some)
            slopes = [row["memory_kb_h"] for row in some if not isnan(row["memory_kb_h"])]
            table.add_row(
                name,
                f"{simulated_s / HOUR_S:.1f}",
                f"{sum(row['active_s'] for row in some) / simulated_s:.1%}",
                *(str(sum(sum(row[key].values()) for row in some)) for key in ("faults", "let_go")),
                *(str(sum(len(row[key]) for row in some)) for key in ("broken", "stuck")),
                f"{np.median(slopes):.0f}" if slopes else "",
            )
        yield table
        let_go = Counter[str]()
        for row in rows:
            let_go.update(row["let_go"])
        lines = ["let go, by reason:", *(f"{count:5} x {reason}" for reason, count in let_go.most_common())]
        lines += [f"hour {row['number']}: BROKEN: {said}" for row in rows for said in row["broken"]]
        lines += [
            f"hour {row['number']}: not engaged again after {said}" for row in rows for said in row["stuck"]
        ]
        lines.append(f"processor time {sum(row['cpu_s'] for row in rows) / 60.0:.0f} min")
        yield escape("\n".join(lines))
