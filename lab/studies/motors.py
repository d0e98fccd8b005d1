"""`holdfast lab faults --thrusters`: each motor dies, weakens or sticks in a dive, in waves and current."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from rich.console import RenderableType

from companion.config import load_config
from companion.records import Setpoint
from lab.loop.dive import engaging, recorded
from lab.loop.scenarios import DEPTH_M, ensemble, water
from lab.studies.fault_dives import FaultDives
from lab.study import Row, by, ruled
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant
from sim_bridge.fault_kinds import Fault

FAILS_S, ENDS_S, AFTER_S = 20.0, 80.0, 10.0
"""The motor fails, the dive ends; the depth's RMS counts from so long after the failure."""

DEAD, WEAK, STUCK = "dead", "at 40 %", "stuck at 1650"
FAILURES = {DEAD: ("thruster", 0.0), WEAK: ("thruster", 0.4), STUCK: ("thruster_stuck", 1650.0)}
"""Kind of the fault and its value: share of the thrust, µs."""

HEAVY, SIX = 8, 6
FRAMES = {HEAVY: "vectored_6dof", SIX: "vectored"}


class MotorFailure(NamedTuple):
    """One dive in which a motor fails; motor 0 is none."""

    motors: int
    motor: int
    failure: str
    seed: int


def plant(case: MotorFailure) -> SimConfig:
    """Draw a vehicle whose motor fails, waves and a current."""
    draw = np.random.default_rng((case.seed, 8)).uniform
    if case.motors == HEAVY:
        drawn = ensemble(load_plant(DEFAULT_CONFIG), case.seed)
    else:
        drawn = load_plant(DEFAULT_CONFIG.with_name("sim-bluerov2.toml"))
    kind, value = FAILURES[case.failure]
    fails = Fault(kind=kind, at_s=FAILS_S, thruster=case.motor, value=value)
    return water(
        replace(drawn, faults=(fails,) if case.motor else ()),
        depth_m=DEPTH_M,
        waves_m=draw(0.2, 0.4),
        period_s=draw(3.5, 5.0),
        current_m_s=draw(0.1, 0.5),
        current_deg=draw(0.0, 360.0),
    )


def dive(case: MotorFailure, firmware: Path | None = None) -> Row:
    """Hold depth and heading while a motor fails. `found_s` is NaN where none was found dead."""
    config = load_config(overrides=(f'vehicle.frame="{FRAMES[case.motors]}"',))
    here = Setpoint((math.nan, math.nan, DEPTH_M, 0.0))
    with engaging(config, plant(case), here, case.seed, firmware=firmware) as loop:
        steps = list(loop.run(ENDS_S))
    found = next((step for step in steps if step.sample.state.dead_motor), None)
    since = recorded(steps).within(FAILS_S, math.inf)
    return {
        "found": found.sample.state.dead_motor if found else 0,
        "found_s": found.t_s - FAILS_S if found else math.nan,
        "ended": "held" if since.active[-1] else str(steps[-1].sample.verdict.state),
        "rms_mm": since.figures(FAILS_S + AFTER_S)["depth_rms_mm"],
        "peak_mm": since.figures()["depth_peak_mm"],
        "heading_deg": float(np.degrees(np.abs(np.unwrap(since.truth[:, 3]))).max()),
        "tilt_deg": since.figures()["tilt_deg"],
    }


class MotorFailures(FaultDives):
    """Every motor of both frames with every failure, and none."""

    command = "lab faults thrusters"

    def cases(self) -> Sequence[Any]:
        return [
            MotorFailure(motors, motor, failure, seed)
            for motors in FRAMES
            for failure in FAILURES
            for motor in range(0 if failure == DEAD else 1, motors + 1)
            for seed in self._numbers
        ]

    def groups(self, cases: Sequence[Any]) -> Sequence[Sequence[Any]]:
        return [[case] for case in cases]

    def dive(self, cases: Sequence[Any]) -> list[Row]:
        return [dive(case, self._firmware) for case in cases]

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return a line for each motor, and who was wrongly found dead."""
        table = ruled(
            f"{len(self._numbers)} dives for each motor that fails: RMS from {AFTER_S:g} s on, else at most",
            "motor", "found", "after s", "held", "RMS mm", "peak mm", "heading °", "tilt °",
        )  # fmt: skip
        for (motors, motor, failure), some in by(rows, "motors", "motor", "failure").items():
            found_s = [row["found_s"] for row in some if row["found"]]
            most = (max(row[key] for row in some) for key in ("rms_mm", "peak_mm", "heading_deg", "tilt_deg"))
            table.add_row(
                f"{motor} of {motors} {failure}" if motor else f"none of {motors}",
                str(len(found_s)),
                f"{max(found_s):.1f}" if found_s else "",
                str(sum(row["ended"] == "held" for row in some)),
                *(f"{value:.1f}" for value in most),
            )
        yield table
        for row in filter(_is_wrong, rows):
            failed = f"{row['motor']} of {row['motors']} had failed"
            yield f"[red]motor {row['found']} was found dead[/red]: {failed}"

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a motor was wrongly found dead."""
        return any(map(_is_wrong, rows))


def _is_wrong(row: Row) -> bool:
    """Return whether another motor than the one that failed was found; a stuck one may be found dead too."""
    failed = 0 if row["failure"] == WEAK else row["motor"]
    return row["found"] not in (0, failed) or row["found_s"] < 0.0
