"""`python -m lab.parity --firmware PATH`: asks both the same, and prints where they differ."""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console
from rich.progress import track
from rich.table import Table

from lab.loop.firmware import ORIGIN_DEG_E7, Firmware, FirmwareError, program
from lab.parity.answers import Near
from lab.parity.partner import Partner, SteppedVehicle
from lab.parity.questions import POSITIONED, SCENARIOS
from lab.parity.reasons import reason
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig, load_config
from sim_bridge.vehicle import Vehicle

REST_S = 34.0
"""Our stand-in rests so long before it is asked: the firmware has long booted by then."""


def main() -> int:
    """Run the scenarios against both; return 1 where answers differ."""
    parser = argparse.ArgumentParser(prog="python -m lab.parity", description=__doc__)
    parser.add_argument("--firmware", metavar="PATH", help="ArduSub's program; default: $HOLDFAST_ARDUSUB")
    parser.add_argument("--scenarios", nargs="+", choices=SCENARIOS, metavar="NAME", default=[*SCENARIOS])
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all answers to FILE")
    arguments = parser.parse_args()
    try:
        path = program(arguments.firmware)
    except FirmwareError as error:
        sys.stderr.write(f"lab.parity: {error}\n")
        return 2
    console = Console()
    everything, explained, unexplained = {}, 0, 0
    for name in track(arguments.scenarios, "asking both", console=console):
        config = plant(name)
        found = compare(name, path, config)
        everything[name] = {key: [str(answer) for answer in pair] for key, pair in found.items()}
        differences = {key: pair for key, pair in found.items() if not agree(*pair)}
        unknown = {key: pair for key, pair in differences.items() if not reason(name, key, config)}
        explained += len(differences) - len(unknown)
        unexplained += len(unknown)
        show(console, name, len(found), unknown)
    asked = sum(map(len, everything.values()))
    console.print(f"{asked} answers: {unexplained} differ, {explained} more for a known reason")
    if arguments.json:
        arguments.json.write_text(json.dumps(everything, indent=1), encoding="utf-8")
    return 1 if unexplained else 0


def compare(scenario: str, path: Path, config: SimConfig) -> dict[str, tuple[Any, Any]]:
    """Return the firmware's and our answer by name; None where one gave none."""
    with Firmware(path, config, seed=1) as firmware:
        theirs = answers(scenario, firmware)
    vehicle = Vehicle(config, seed=1)
    origin = mavlink.MAVLink_set_gps_global_origin_message(1, *ORIGIN_DEG_E7, 0)
    Partner(vehicle).ask(origin, REST_S)
    ours = answers(scenario, vehicle)
    return {name: (theirs.get(name), ours.get(name)) for name in dict.fromkeys([*theirs, *ours])}


def plant(scenario: str) -> SimConfig:
    """Return the vehicle that both are: the shipped Heavy in still water, with a DVL where it is needed."""
    still = ["current.enabled=false", "hull.net_buoyancy_n=0.0", "initial.eta=[0.0, 0.0, 3.0, 0.0, 0.0, 0.0]"]
    return load_config(DEFAULT_CONFIG, [*still, f"sensors.dvl={str(scenario in POSITIONED).lower()}"])


def answers(scenario: str, vehicle: SteppedVehicle) -> dict[str, Any]:
    """Return what a vehicle answers in a scenario."""
    partner = Partner(vehicle)
    partner.listen(2.0)
    return dict(SCENARIOS[scenario](partner))


def agree(theirs: Any, ours: Any) -> bool:
    """Tell whether two answers are the same, or near enough where one says how near."""
    if isinstance(theirs, Near) and isinstance(ours, Near):
        if math.isnan(theirs.value) or math.isnan(ours.value):
            return math.isnan(theirs.value) and math.isnan(ours.value)
        return bool(np.abs(theirs.value - ours.value) <= max(theirs.tolerance, ours.tolerance))
    return bool(theirs == ours)


def show(console: Console, name: str, asked: int, differences: dict[str, tuple[Any, Any]]) -> None:
    """Print a scenario's differences as a table."""
    table = Table(title=f"{name}: {len(differences)} of {asked} differ", title_justify="left")
    for column in ("asked", "ArduSub", "our stand-in"):
        table.add_column(column, overflow="fold")
    for key, (theirs, ours) in differences.items():
        table.add_row(key, readable(theirs), readable(ours))
    if differences:
        console.print(table)


def readable(answer: Any) -> str:
    """Return an answer as text."""
    if answer is None:
        return "-"
    return f"{answer.value:.6g}" if isinstance(answer, Near) else str(answer)


if __name__ == "__main__":
    sys.exit(main())
