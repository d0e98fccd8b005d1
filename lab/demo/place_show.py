"""`holdfast demo --dvl`: dives, prints the table, leaves picture and figures."""

import sys
import time  # noqa: TID251 - how long it took
from collections.abc import Callable
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

from lab.demo.place import NAMES, ROWS, PlaceFigures, PlaceStory, figures, rest, sail
from lab.demo.screen import compared
from lab.rivals.alt_hold import TICK_S

TELL_S = 20.0


def perform(story: PlaceStory, png: Path, json: Path) -> int:
    """Dive, print the table, write picture and figures; return the exit status."""
    from lab.demo.place_picture import draw

    began_s = time.monotonic()
    console = Console()

    def tell(phase: str, end_s: float) -> Callable[[float], None]:
        def at(t_s: float) -> None:
            if round(t_s / TICK_S) % round(TELL_S / TICK_S) == 0:
                console.print(f"{phase:<30} {t_s:5.0f} of {end_s:g} s, in virtual time", highlight=False)

        return at

    try:
        poshold = rest(story, tell("POSHOLD holds a place", story.path_s))
        holdfast = sail(story, tell("Holdfast, a place, then a path", story.end_s))
    except ValueError as error:
        sys.stderr.write(f"holdfast demo: {error}\n")
        return 1
    except KeyboardInterrupt:
        console.print("SIGINT: stopped, and nothing runs any more.")
        return 130
    parts = {
        "poshold": poshold.within(story.counts_s, story.path_s),
        "place": holdfast.within(story.counts_s, story.path_s),
        "path": holdfast.within(story.path_s, story.end_s),
    }
    results = {name: figures(part) for name, part in parts.items()}
    console.print(_table(results, story))
    content: dict[str, object] = {**results, "story": story}
    try:
        json.parent.mkdir(parents=True, exist_ok=True)
        json.write_bytes(msgspec.json.format(msgspec.json.encode(content)) + b"\n")
        draw(story, poshold, holdfast, results).savefig(png)
    except OSError as error:
        sys.stderr.write(f"holdfast demo: {error}\n")
        return 1
    console.print(f"Picture: {png}   Figures: {json}   ({time.monotonic() - began_s:.0f} s)", highlight=False)
    return 0


def _table(results: dict[str, PlaceFigures], story: PlaceStory) -> Table:
    return compared(
        f"At {story.depth_m:g} m, with a DVL, in {story.sea}",
        f"The simulator's truth. Places from {story.counts_s:g} to {story.path_s:g} s after boot; "
        "POSHOLD's errors are about its mean.\nThe path is a lemniscate of 3 × 1.5 m.",
        [(NAMES[name], "") for name in results],
        [
            (name, unit, [f"{getattr(result, field):.{digits}f}" for result in results.values()])
            for name, unit, field, digits in ROWS
        ],
    )
