"""`holdfast faults --thrusters`: each motor dies, weakens or sticks in a held dive, in waves and current."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from rich.console import RenderableType

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, State, Z
from lab.loop.dive import PHI, THETA, TRUE_PSI
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import DEPTH_M, ensemble
from lab.studies.fault_dives import FaultDives
from lab.study import Row, by, ruled
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant
from sim_bridge.fault_kinds import Fault

FAILS_S, ENDS_S = 20.0, 80.0
AFTER_S = 10.0
"""The depth's RMS counts from so long after the motor failed."""

DEAD, WEAK, STUCK = "dead", "at 40 %", "stuck at 1650"
FAILURES = {DEAD: ("thruster", 0.0), WEAK: ("thruster", 0.4), STUCK: ("thruster_stuck", 1650.0)}
"""Kind of the fault and its value: share of the thrust, µs."""

HEAVY, SIX = 8, 6
FILES = {HEAVY: DEFAULT_CONFIG, SIX: DEFAULT_CONFIG.with_name("sim-bluerov2.toml")}
FRAMES = {HEAVY: "vectored_6dof", SIX: "vectored"}


class MotorFailure(NamedTuple):
    """One dive in which a motor fails; motor 0 is none."""

    motors: int
    motor: int
    failure: str
    seed: int


def plant(motors: int, seed: int) -> SimConfig:
    """Draw a vehicle of so many motors, waves and a current."""
    draw = np.random.default_rng((seed, 8)).uniform
    drawn = load_plant(FILES[motors])
    if motors == HEAVY:
        drawn = ensemble(drawn, seed)
    return replace(
        drawn,
        initial=replace(drawn.initial, eta=(0.0, 0.0, DEPTH_M, 0.0, 0.0, 0.0)),
        waves=replace(drawn.waves, enabled=True, height_m=draw(0.2, 0.4), period_s=draw(3.5, 5.0)),
        current=replace(
            drawn.current, enabled=True, speed_m_s=draw(0.1, 0.5), direction_deg=draw(0.0, 360.0)
        ),
    )


def dive(case: MotorFailure, firmware: Path | None = None) -> Row:
    """Hold depth and heading while a motor fails. `found_s` is NaN where none was found dead."""
    motors, motor, failure, seed = case
    config = load_config(overrides=(f'vehicle.frame="{FRAMES[motors]}"',))
    engine = Engine(config, Setpoint((math.nan, math.nan, DEPTH_M, 0.0)), arm=True)
    with vehicle_of(plant(motors, seed), seed, firmware) as vehicle:
        if motor:
            kind, value = FAILURES[failure]
            vehicle.inject(Fault(kind=kind, at_s=FAILS_S, thruster=motor, value=value))
        loop = Lockstep(vehicle, engine, LinkDelay(), seed)
        loop.requests = [Request.ENGAGE]
        steps = list(loop.run(ENDS_S))
    found = next((step for step in steps if step.sample.state.dead_motor), None)
    since = [step for step in steps if step.t_s >= FAILS_S]
    eta = np.array([step.truth.eta for step in since])
    depth_mm = 1e3 * (eta[:, Z] - DEPTH_M)
    late = np.array([step.t_s >= FAILS_S + AFTER_S for step in since])
    ended = since[-1].sample.verdict.state
    return {
        "found": found.sample.state.dead_motor if found else 0,
        "found_s": found.t_s - FAILS_S if found else math.nan,
        "ended": "held" if ended is State.ACTIVE else str(ended),
        "rms_mm": float(np.sqrt(np.mean(depth_mm[late] ** 2))),
        "peak_mm": float(np.abs(depth_mm).max()),
        "heading_deg": float(np.degrees(np.abs(np.unwrap(eta[:, TRUE_PSI]))).max()),
        "tilt_deg": float(np.degrees(np.abs(eta[:, [PHI, THETA]])).max()),
    }


class MotorFailures(FaultDives):
    """Every motor of both frames with every failure, and none."""

    command = "faults thrusters"

    def journal(self, out: Path) -> Path:
        return out.with_name("thrusters.jsonl")

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
            table.add_row(
                f"{motor} of {motors} {failure}" if motor else f"none of {motors}",
                str(len(found_s)),
                f"{np.median(found_s):.1f}, {max(found_s):.1f}" if found_s else "",
                str(sum(row["ended"] == "held" for row in some)),
                *(f"{max(row[key] for row in some):.0f}" for key in ("rms_mm", "peak_mm")),
                *(f"{max(row[key] for row in some):.1f}" for key in ("heading_deg", "tilt_deg")),
            )
        yield table
        for row in filter(_is_wrong, rows):
            motor, motors = row["motor"], row["motors"]
            what = f"{motor} of {motors} was {row['failure']}" if motor else f"none of {motors} was dead"
            yield f"[red]motor {row['found']} was found dead[/red]: {what}"

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a motor was wrongly found dead."""
        return any(map(_is_wrong, rows))


def _is_wrong(row: Row) -> bool:
    """Return whether another motor than the one that failed was found; a stuck one may be found dead too."""
    failed = 0 if row["failure"] == WEAK else row["motor"]
    return row["found"] not in (0, failed) or row["found_s"] < 0.0
