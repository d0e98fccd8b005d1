"""`holdfast demo`: what each part of Holdfast is worth, beside ALT_HOLD, which the pilot has today.

Four dives in virtual time, with the same vehicle, water, path and load: the law alone, the law with the
observer's disturbance, Holdfast, and ALT_HOLD.
"""

import sys
import time  # noqa: TID251 - how long it took
from collections.abc import Mapping
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from holdfast import DONE, FAILED
from holdfast.command_line import command_parser
from lab.demo.demo_dives import (
    AUTOPILOT,
    NAMES,
    PARTS,
    DemoFigures,
    Tell,
    dive_alt_hold,
    dive_holdfast,
    figures,
    worth,
)
from lab.demo.story import Story
from lab.loop.dive import Dive
from lab.options import add_firmware, add_out, find_firmware, json_file
from lab.study import ruled

ABOUT = (
    "Shows what each part of Holdfast is worth: a simulated vehicle with a payload skid and weed in a motor "
    "keeps depth and heading in a current and waves, moves half a metre down and up again twice, and a load "
    "is hung on and dropped. The same dive is run five times, in virtual time: by the control law alone; by "
    "the law with the observer; by Holdfast, which adds the network; by ArduSub's depth hold, ALT_HOLD, with "
    "default and with tuned gains. With --firmware the dives are on the real ArduSub."
)
EXAMPLES = """\
examples:
  holdfast demo                           less than a minute; writes out/demo.png and out/demo.json
  holdfast demo --seed 7 --out out/seven  other waves and noise
  holdfast demo --firmware                the same dives on the real ArduSub
"""


def main(argv: list[str]) -> int:
    """Run the command: dive, print the table, write picture and figures; return its exit status."""
    parser = command_parser("demo", ABOUT, EXAMPLES)
    add_out(parser, "out")
    parser.add_argument("--json", metavar="FILE", type=json_file, help="write the figures to FILE instead")
    parser.add_argument("--seed", metavar="N", type=int, default=Story.seed, help="of waves and noise")
    add_firmware(parser)
    options = parser.parse_args(argv)
    find_firmware(options)
    from lab.demo.demo_picture import draw  # matplotlib takes a second

    story, console, about_mean = Story(seed=options.seed), Console(), options.firmware is not None
    began_s = time.monotonic()
    try:
        dives = _dive_all(story, options.firmware, console)
    except ValueError as error:
        sys.stderr.write(f"holdfast demo: {error}\n")
        return FAILED
    results = {name: figures(dive, story.phases, about_mean=about_mean) for name, dive in dives.items()}
    said = [
        worth("The observer", results["law"], results["observer"]),
        worth("The network", results["observer"], results["holdfast"]),
    ]
    console.print(table(results, story, about_mean=about_mean))
    console.print(*said, sep="\n", highlight=False)
    options.out.mkdir(parents=True, exist_ok=True)
    png, json = options.out / "demo.png", options.json or options.out / "demo.json"
    content: dict[str, object] = {**results, "worth": said, "phases_s": story.phases, "story": story}
    json.write_bytes(msgspec.json.format(msgspec.json.encode(content)) + b"\n")
    vehicle = "the real ArduSub (errors are about their mean)" if about_mean else "our simulator"
    draw(dives, results, story, said, vehicle).savefig(png)
    console.print(f"Picture: {png}   Figures: {json}   ({time.monotonic() - began_s:.0f} s)", highlight=False)
    return DONE


def _dive_all(story: Story, firmware: Path | None, console: Console) -> dict[str, Dive]:
    """Dive, with a line of progress for each dive; return the dives in the order of the table."""
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.0f} s")
    with Progress(*columns, TimeElapsedColumn(), console=console) as progress:

        def begin(name: str) -> Tell:
            task = progress.add_task(NAMES[name], total=story.end_s)
            return lambda t_s: progress.update(task, completed=t_s)

        parts = {name: dive_holdfast(story, part, firmware, begin(name)) for name, part in PARTS.items()}
        stock = {
            name: dive_alt_hold(story, parts["holdfast"], firmware, begin(name), gains)
            for name, gains in AUTOPILOT.items()
        }
    return {**stock, **parts}


def table(results: Mapping[str, DemoFigures], story: Story, *, about_mean: bool) -> Table:
    """Set the dives side by side."""
    about = ", of the depth about their mean" if about_mean else ""
    title = f"Errors, RMS, {story.waves_s:g} to {story.end_s:g} s after arming{about}"
    headings = ["", *("\n".join(NAMES[name].rsplit(" ", 1)) for name in results)]
    shown = ruled(title, *headings, left=1, caption="Errors are the simulator's truth.")
    every = results.values()
    for phase in story.phases:
        shown.add_row(f"depth, {phase}, mm", *(f"{result.phase_rms_mm[phase]:.1f}" for result in every))
    for name, unit, field, digits in (
        ("depth, all of these", "mm", "depth_rms_mm", 1),
        ("depth, largest", "mm", "depth_peak_mm", 1),
        ("heading", "°", "heading_rms_deg", 2),
        ("heave thrust", "N", "thrust_rms_n", 1),
        ("heave chatter", "N/tick", "chatter_n", 2),
    ):
        shown.add_row(f"{name}, {unit}", *(f"{getattr(result, field):.{digits}f}" for result in every))
    return shown
