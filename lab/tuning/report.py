"""`holdfast tune` in the terminal: a search for the rows of the bench, or for one's own vehicle."""

import argparse
import json
import os
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from companion.config import Config, ConfigError, load_config, vehicle_of
from lab.loop.scenarios import ensemble
from lab.pool import worker_pool
from lab.studies.competitors import DEFAULT, TUNED_FILE, WIDTH, Competitor, competitors, knobs_of, selected
from lab.tuning import search as tune
from lab.tuning.own_vehicle import around, nominal, write_config
from lab.tuning.search import Found, search
from sim_bridge.config import load_config as load_plant


def run(arguments: argparse.Namespace) -> int:
    """Search, print what was found and write it down."""
    own = not arguments.rows
    try:
        believed = nominal(load_plant(arguments.vehicle)) if own else {}
        settings = [f"{key}={value}" for key, value in believed.items()] + arguments.set
        config = load_config(arguments.config, settings)
        searched = [_own_row(config)] if own else selected(_searchable(arguments.rows, config), config)
    except (ConfigError, ValueError) as error:
        sys.stderr.write(f"holdfast tune: {error}\n")
        return 2
    job = partial(_job, arguments, settings, own)
    total = arguments.evaluations * len(searched)
    console = Console()
    with Progress(console=console) as progress:
        task = progress.add_task("searching", total=total)
        if len(searched) == 1:
            found = [job(searched[0].name, done=lambda count: progress.advance(task, count))]
        else:
            found = []
            with worker_pool(min(os.cpu_count() or 1, len(searched))) as pool:
                for result in pool.map(job, [row.name for row in searched]):
                    found.append(result)
                    progress.advance(task, arguments.evaluations)
        progress.update(task, completed=total)
    console.print(_table(searched, found))
    out = arguments.out or Path("out/tune") / ("companion.toml" if own else "tuned.toml")
    out.parent.mkdir(parents=True, exist_ok=True)
    if own:
        write_config(arguments.config, vehicle_of(config), found[0].values, out)
    else:
        out.write_text(_tuned_text(arguments, searched, found), encoding="utf-8")
    console.print(f"written: {out}", soft_wrap=True)
    console.print(next_step(out, [row.name for row in searched], own=own), soft_wrap=True)
    return 0


def next_step(out: Path, names: Sequence[str], *, own: bool) -> str:
    """Return the command that dives what was found."""
    if own:
        return (
            "Dive it: holdfast sim, and in a second terminal\n"
            f"  holdfast run --engage --arm --depth 3 --config {shlex.quote(str(out))}"
        )
    return (
        f"Dive it: copy it over {TUNED_FILE.relative_to(Path(__file__).parents[2])}, then\n"
        f"  holdfast bench dives --rows {shlex.join(names)}"
    )


def _job(
    arguments: argparse.Namespace,
    settings: Sequence[str],
    own: bool,
    name: str,
    done: Callable[[int], None] = lambda count: None,
) -> Found:
    """Search one row; runs in a process of its own."""
    config = load_config(arguments.config, settings)
    row = _own_row(config) if own else selected([name], config)[0]
    return search(
        row,
        lambda overrides: load_config(arguments.config, [*settings, *overrides]),
        load_plant(arguments.vehicle),
        evaluations=arguments.evaluations,
        seeds=arguments.seeds,
        vary=around if own else ensemble,
        done=done,
    )


def _own_row(config: Config) -> Competitor:
    """Return the configuration's own heave as a row: it starts where the file stands."""
    return replace(selected([DEFAULT], config)[0], title="your heave", knobs=knobs_of(config))


def _searchable(names: Sequence[str], config: Config) -> list[str]:
    every = [row.name for row in competitors(config) if row.knobs]
    fixed = {row.name for row in competitors(config) if not row.knobs} & set(names)
    if fixed:
        raise ValueError(f"{', '.join(sorted(fixed))}: nothing to search, it is what it is")
    return every if "all" in names else list(names)


def _table(rows: Sequence[Competitor], found: Sequence[Found]) -> Table:
    table = Table(title="What the search found (score: mean RMS in mm, chatter priced in)")
    for title in ("row", "score before", "score", "evaluations", "values"):
        table.add_column(title, justify="left" if title in ("row", "values") else "right")
    for row, one in zip(rows, found, strict=True):
        values = ", ".join(f"{key.split('.')[-1]} {value:g}" for key, value in one.values.items())
        table.add_row(row.title, f"{one.start_score:.2f}", f"{one.score:.2f}", str(one.evaluations), values)
    return table


def _tuned_text(arguments: argparse.Namespace, rows: Sequence[Competitor], found: Sequence[Found]) -> str:
    """Return values with the command, seeds and budget that produced them."""
    command = ["holdfast", "tune", *arguments.rows]
    command += ["--evaluations", str(arguments.evaluations), "--seeds", str(arguments.seeds)]
    command += [part for setting in arguments.set for part in ("--set", setting)]
    lines = [
        "# Gains of the bench's rows: one search for all, equal budget, equal width of bounds. Not by hand.",
        "",
        "[search]",
        f'command = "{shlex.join(command)}"',
        'optimiser = "CMA-ES (cma), seed 1"',
        f"evaluations_each = {max(one.evaluations for one in found)}",
        f'training_seeds = "0..{arguments.seeds - 1}"',
        f"cases = {json.dumps([str(case) for case in tune.CASES])}",
        f"dives_an_evaluation = {4 * arguments.seeds}",
        f"seconds_a_dive = {tune.TRAINING_S}",
        f"bounds_factor = {WIDTH}",
        "",
        "[score]  # mean RMS in mm over scenarios, chatter priced in",
        *(f'"{row.name}" = {one.score:.3f}' for row, one in zip(rows, found, strict=True)),
    ]
    for row, one in zip(rows, found, strict=True):
        lines += ["", f'[values."{row.name}"]', *_pairs(one.values)]
    return "\n".join(lines) + "\n"


def _pairs(values: Mapping[str, float]) -> list[str]:
    return [f'"{key}" = {value!r}' for key, value in values.items()]
