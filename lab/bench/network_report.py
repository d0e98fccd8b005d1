"""`holdfast bench network` in the terminal: what was searched, and a table for each degree of freedom."""

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from companion.config import Config
from lab.bench.network import AXES, LEARNERS, OBSERVER, UNITS, Outcome, Variant, cases, count, mean, study
from sim_bridge.config import SimConfig


def report(console: Console, base: SimConfig, settings: Sequence[str], seeds: int) -> list[Outcome]:
    """Search and dive; print the tables; return the dives that judge."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("searching rates, then judging", total=count(seeds))
        found, outcomes = study(base, settings, seeds, lambda: progress.advance(task))
    console.print(_rates(found, {name: variant.config(settings) for name, variant in found.items()}))
    for i, axis in enumerate(AXES):
        console.print(_judged(axis, i, outcomes, found))
    if lost := sum(one.lost for one in outcomes):
        console.print(f"{lost} of {len(outcomes)} dives were given up.")
    return outcomes


def as_records(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Return flat records, one a dive and axis."""
    return [
        {
            "learner": one.variant.learner,
            "case": one.case,
            "seed": one.seed,
            "axis": axis,
            "rms": one.rms[i],
            "chatter": one.chatter[i],
            "lost": one.lost,
        }
        for one in outcomes
        for i, axis in enumerate(AXES)
    ]


def _rates(found: dict[str, Variant], configs: dict[str, Config]) -> Table:
    table = _table("Found: learning rate, and the time m kappa/K in s", "learner", AXES)
    for learner in LEARNERS:
        both = zip(configs[learner].axes, found[learner].settling_s, strict=True)
        table.add_row(learner, *(f"{axis.learning_rate:g} ({settling_s:g})" for axis, settling_s in both))
    return table


def _judged(axis: str, i: int, outcomes: Sequence[Outcome], found: dict[str, Variant]) -> Table:
    title = f"{axis}: RMS error, {UNITS[i]}; each learner beside the observer, over the observer alone"
    table = _table(title, "case", (OBSERVER, *LEARNERS))
    for case in cases():
        alone = mean(outcomes, Variant(OBSERVER), case, i)
        ratios = [mean(outcomes, found[learner], case, i) / alone for learner in LEARNERS]
        table.add_row(case, f"{alone:.3g}", *(f"{100.0 * (ratio - 1.0):+.1f} %" for ratio in ratios))
    return table


def _table(title: str, first: str, others: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1))
    table.add_column(first)
    for name in others:
        table.add_column(name, justify="right")
    return table
