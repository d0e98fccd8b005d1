"""`holdfast bench` of the process: bounds, subscribers, fleet, soak."""

import argparse
import json
import sys
from dataclasses import asdict

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from companion.config import load_config
from lab.operations.bounds import Bound, latency, process, virtual
from lab.operations.many_vehicles import fleet
from lab.operations.soak import soak
from lab.operations.subscribers import ROUNDS, NoReaderError, subscriber_bounds
from lab.study import provenance, ruled
from lab.tables import write_json
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant


def run(arguments: argparse.Namespace) -> int:
    """Run what was asked for; the exit status is 1 if a bound was not held."""
    console = Console()
    if arguments.what == "fleet":
        return fleet(arguments.vehicles, console)
    if arguments.what == "soak":
        return soak(arguments.minutes, console)
    plant, config = load_plant(DEFAULT_CONFIG), load_config(overrides=arguments.set)
    bounds: list[Bound] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        if arguments.what == "zenoh":
            task = progress.add_task("measuring subscribers", total=ROUNDS)
            try:
                bounds += subscriber_bounds(lambda: progress.advance(task))
            except NoReaderError as error:
                sys.stderr.write(f"holdfast bench: no figures: {error}\n")
                return 1
        else:
            task = progress.add_task("measuring the process", total=2)
            bounds += virtual(config, plant)
            progress.advance(task)
            bounds += [*process(), *latency()]
            progress.advance(task)
    console.print(_bounds(bounds))
    if arguments.json:
        of_dives = None if arguments.what else json.loads(arguments.json.read_text(encoding="utf-8"))
        content = of_dives or {"provenance": provenance(f"holdfast bench {arguments.what}")}
        each = [asdict(bound) | {"held": bound.held} for bound in bounds]
        write_json(arguments.json, content | {"bounds": each})
    return 0 if all(bound.held for bound in bounds) else 1


def _bounds(bounds: list[Bound]) -> Table:
    table = ruled("The process", "figure", "measured", "bound", "held")
    for bound in bounds:
        limit = "" if bound.limit is None else f"≤ {bound.limit:.3g} {bound.unit}"
        limit = limit if bound.at_least is None else f"≥ {bound.at_least:.3g} {bound.unit}"
        held = "" if not limit else "yes" if bound.held else "NO"
        table.add_row(bound.name, f"{bound.value:.3g} {bound.unit}", limit, held)
    return table
