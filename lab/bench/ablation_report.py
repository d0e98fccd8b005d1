"""`holdfast bench ablation` in the terminal: two tables and a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from lab import style
from lab.bench.ablation import (
    BENCH_LINKS,
    HEADLINES,
    AblationResult,
    count,
    parts,
    parts_on_firmware,
    wrong_models,
)
from lab.bench.bench import FIRST_SEED, SCENARIOS, interval
from lab.bench.floor import CHATTER_N
from sim_bridge.config import SimConfig

EARNED = 0.20
"""The share by which the network has to beat the observer alone, to earn its place there."""


def report(
    console: Console,
    base: SimConfig,
    settings: Sequence[str],
    seeds: int,
    out: Path,
    firmware: Path | None = None,
) -> list[AblationResult]:
    """Dive both questions, print their tables, draw their picture; return all results.

    With the real `firmware` only the headline rows of the first question, and no picture.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        total = count(settings) if firmware is None else len(HEADLINES) * len(BENCH_LINKS)
        task = progress.add_task("diving variants", total=total)

        def done() -> None:
            progress.advance(task)

        if firmware is not None:
            less = parts_on_firmware(base, settings, seeds, firmware, done)
            console.print(_table(f"The real firmware: mean of four scenarios × {seeds} vehicles, mm", less))
            return less
        less = parts(base, settings, seeds, done)
        wrong = wrong_models(base, settings, seeds, done)
    console.print(_table(f"One part less: mean depth RMS of four scenarios × {seeds} vehicles, mm", less))
    console.print(_table(f"Where the model is wrong: mean of {seeds} vehicles, mm", wrong))
    for line in verdicts(wrong):
        console.print(line)
    console.print(f"picture: {_draw(less, wrong, out)}", soft_wrap=True)
    return [*less, *wrong]


def verdicts(results: Sequence[AblationResult]) -> list[str]:
    """Say of each case whether the network earned EARNED over the observer alone, with the interval."""
    lines = []
    for case in dict.fromkeys(result.case for result in results):
        of = {result.variant: result for result in results if result.case == case}
        best = min(("network", "network+observer"), key=lambda name: of[name].rms_mm)
        share = (1.0 - of[best].each_mm / of["observer"].each_mm).mean(0)
        low, high = interval(share)
        said = "earns its place" if low >= EARNED else "does not earn 20 %"
        between = "" if share.size < 2 else f" ({low:+.0%}..{high:+.0%})"
        lines.append(f"{case}: {best} against observer {share.mean():+.0%}{between}: {said}")
    return lines


def as_records(results: Sequence[AblationResult]) -> list[dict[str, Any]]:
    """Return flat records, one a dive."""
    return [
        {
            "variant": one.variant,
            "case": one.case,
            "scenario": SCENARIOS[i] if len(one.each_mm) == len(SCENARIOS) else one.case,
            "seed": FIRST_SEED + j,
            "depth_rms_mm": float(rms_mm),
        }
        for one in results
        for i, each_mm in enumerate(one.each_mm)
        for j, rms_mm in enumerate(each_mm)
    ]


def _table(title: str, results: Sequence[AblationResult]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1))
    table.add_column("")
    cases = list(dict.fromkeys(result.case for result in results))
    for case in cases:
        table.add_column(case, justify="right")
    of = {(result.variant, result.case): result for result in results}
    for variant in dict.fromkeys(result.variant for result in results):
        table.add_row(variant, *(_cell(of[variant, case]) for case in cases))
    table.caption = f"! chatter above {CHATTER_N} N a tick"
    return table


def _cell(result: AblationResult) -> str:
    lost = f" ({result.lost} lost)" if result.lost else ""
    return f"{result.rms_mm:.2f}" + ("!" if result.chatter_n > CHATTER_N else "") + lost


def _draw(less: Sequence[AblationResult], wrong: Sequence[AblationResult], out: Path) -> Path:
    out.mkdir(parents=True, exist_ok=True)
    figure, panels = plt.subplots(1, 2, figsize=(13.0, 4.8), layout="constrained")
    colours = (style.BLUE, style.VERMILLION, style.GREEN, style.SKY, style.BLACK)
    markers = "oDs^v"
    titles = ("shipped default, one part less", "wrong models: which compensator")
    for panel, results, title in zip(panels, (less, wrong), titles, strict=True):
        names = list(dict.fromkeys(result.variant for result in results))
        for i, case in enumerate(dict.fromkeys(result.case for result in results)):
            of = {result.variant: result.rms_mm for result in results if result.case == case}
            rms = [min(of[name], 1000.0) for name in names]
            panel.plot(
                rms, np.arange(len(names)), markers[i], color=colours[i], label=case, markerfacecolor="none"
            )
        panel.set_yticks(range(len(names)), names)
        panel.invert_yaxis()
        panel.set_xscale("log")
        panel.set_xlabel("depth error, RMS (mm)")
        panel.xaxis.set_major_formatter(mpl.ticker.StrMethodFormatter("{x:g}"))
        panel.xaxis.set_minor_formatter(mpl.ticker.StrMethodFormatter("{x:g}"))
        panel.legend(fontsize=style.SMALL, frameon=False)
        panel.set_title(title, loc="left", fontweight="bold", fontsize=11)
        style.plain(panel)
    path = out / "ablation.png"
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return path
