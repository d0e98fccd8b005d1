"""`holdfast faults --thrusters`: each motor dies, weakens or sticks in a held dive, in waves and current."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from rich.console import Console
from rich.table import Table

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, State, Z
from lab.loop.dive import PHI, THETA, TRUE_PSI
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import DEPTH_M, ensemble
from lab.pool import worker_pool
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


class ThrusterRow(NamedTuple):
    """What became of a dive in which a motor failed; `found_s` is NaN where none was found dead."""

    motors: int
    motor: int
    failure: str
    found: int
    found_s: float
    ended: str
    rms_mm: float
    peak_mm: float
    heading_deg: float
    tilt_deg: float


def plant(motors: int, seed: int) -> SimConfig:
    """Draw a vehicle of so many motors, waves and a current."""
    draw = np.random.default_rng((seed, 8)).uniform
    one = load_plant(FILES[motors])
    if motors == HEAVY:
        one = ensemble(one, seed)
    return replace(
        one,
        initial=replace(one.initial, eta=(0.0, 0.0, DEPTH_M, 0.0, 0.0, 0.0)),
        waves=replace(one.waves, enabled=True, height_m=draw(0.2, 0.4), period_s=draw(3.5, 5.0)),
        current=replace(one.current, enabled=True, speed_m_s=draw(0.1, 0.5), direction_deg=draw(0.0, 360.0)),
    )


def dive(motors: int, motor: int, failure: str, seed: int, firmware: Path | None) -> ThrusterRow:
    """Hold depth and heading while `motor` fails; 0 for none."""
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
    return ThrusterRow(
        motors,
        motor,
        failure,
        found.sample.state.dead_motor if found else 0,
        found.t_s - FAILS_S if found else math.nan,
        "held" if ended is State.ACTIVE else str(ended),
        float(np.sqrt(np.mean(depth_mm[late] ** 2))),
        float(np.abs(depth_mm).max()),
        float(np.degrees(np.abs(np.unwrap(eta[:, TRUE_PSI]))).max()),
        float(np.degrees(np.abs(eta[:, [PHI, THETA]])).max()),
    )


def main(console: Console, seeds: range, workers: int, firmware: Path | None) -> int:
    """Dive with each motor of both frames failing, and with none; 1 if a motor was wrongly found dead.

    One that is stuck may be found dead too: its demand does nothing.
    """
    cases = [
        (motors, motor, failure, seed)
        for motors in FRAMES
        for failure in FAILURES
        for motor in range(0 if failure == DEAD else 1, motors + 1)
        for seed in seeds
    ]
    with worker_pool(workers, start="spawn") as pool:
        jobs = [pool.submit(dive, *one, firmware) for one in cases]
        rows = [job.result() for job in jobs]
    console.print(_table(rows, len(seeds)))
    wrong = [row for row in rows if _is_wrong(row)]
    for row in wrong:
        what = (
            f"{row.motor} of {row.motors} was {row.failure}"
            if row.motor
            else f"none of {row.motors} was dead"
        )
        console.print(f"[red]motor {row.found} was found dead[/red]: {what}")
    return 1 if wrong else 0


def _is_wrong(row: ThrusterRow) -> bool:
    failed = 0 if row.failure == WEAK else row.motor
    return row.found not in (0, failed) or row.found_s < 0.0


def _table(rows: list[ThrusterRow], count: int) -> Table:
    table = Table(
        title=f"{count} dives for each motor that fails: depth RMS from {AFTER_S:g} s on, the rest at most"
    )
    for title in ("motor", "found", "after s", "held", "RMS mm", "peak mm", "heading °", "tilt °"):
        table.add_column(title, justify="right")
    for motors, motor, failure in dict.fromkeys((row.motors, row.motor, row.failure) for row in rows):
        of_it = [row for row in rows if (row.motors, row.motor, row.failure) == (motors, motor, failure)]
        found_s = [row.found_s for row in of_it if row.found]
        worst = [max(column) for column in zip(*(row[6:] for row in of_it), strict=True)]
        table.add_row(
            f"{motor} of {motors} {failure}" if motor else f"none of {motors}",
            str(len(found_s)),
            f"{np.median(found_s):.1f}, {max(found_s):.1f}" if found_s else "",
            str(sum(row.ended == "held" for row in of_it)),
            *(f"{figure:.0f}" for figure in worst[:2]),
            *(f"{figure:.1f}" for figure in worst[2:]),
        )
    return table
