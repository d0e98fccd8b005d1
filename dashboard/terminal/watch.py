"""`holdfast watch`: vehicles in a terminal. `picture` draws what a `Feed` gathered, `main` loops."""

import argparse
import math
import sys
import time
from collections.abc import Sequence
from typing import Literal

import msgspec
from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from companion.telemetry import schemas as telemetry
from companion.telemetry.conditions import UNSAID, named
from companion.telemetry.glossary import (
    ENDPOINT,
    LINK_LOST,
    PAST,
    TO_DO,
    holder,
    on_engaging,
    silence,
    title,
    whole,
)
from companion.telemetry.modes import MODE_NAMES
from companion.telemetry.schemas import Dof, Event, Loop, State, Supervisor
from dashboard.arguments import add_connect
from dashboard.terminal.feed import Feed, Feeds
from dashboard.zenoh_client import Subscription
from holdfast.arguments import command_parser

EXAMPLES = """\
examples:
  holdfast watch                                 the vehicles that publish on this machine
  holdfast watch --connect laptop.json5          a vehicle on the network, by TLS: docs/telemetry.md, "Where"
  holdfast watch --name kelp --once              one snapshot of one vehicle
  holdfast watch --once --json                   for scripts

By default a companion listens on its own machine alone; a Zenoh configuration opens it by TLS. With a Zenoh
router on the vehicle and telemetry.mode = "client" in the companion's configuration, --connect
tcp/192.168.2.2:7447 reaches it too, without encryption. `holdfast dashboard` has maps and plots.
"""

PATIENCE_S = 5.0

_REFRESH_S = 0.125
_WIDTH = 80

_STYLES = {
    "IDLE": "white on grey23",
    "READY": "black on white",
    "ACTIVE": "bold white on blue",
    "RAMP_DOWN": "bold black on yellow",
    "HAND_OVER": "bold black on yellow",
    "PILOT": "bold black on yellow",
    "FAULT": "bold white on red",
}
_DOFS = {"x": "north", "y": "east", "z": "depth", "psi": "heading"}
_AGES = {"x": "position_age_s", "y": "position_age_s", "z": "depth_age_s", "psi": "attitude_age_s"}
_DASH = "–"

# --- The picture ------------------------------------------------------------------------------------------


def picture(feeds: Sequence[Feed], nobody: str, connect: str = ENDPOINT) -> RenderableType:
    """Draw one vehicle wholly, several as a line each; `nobody` where none is heard.

    Every colour has a word beside it; what is old is dim and says so.
    """
    if not feeds:
        return Panel(nobody, title="holdfast", title_align="left", box=box.ROUNDED)
    if len(feeds) > 1:
        body, heading = _fleet(feeds), Text.assemble(("holdfast", "bold"), f" {len(feeds)} vehicles")
        return Panel(body, title=heading, title_align="left", box=box.ROUNDED, width=_WIDTH)
    (feed,) = feeds
    loop = feed.get(Loop, "loop")
    parts = [_banner(feed, connect), Text(), _degrees_of_freedom(feed), Text()]
    parts += [_event(event, feed.now_s) for event in feed.events]
    if feed.trouble:
        parts.append(Text(feed.trouble, "italic"))
    age = f"{feed.age_s:.2f} s old{'' if feed.connected else ', not connected'}"
    return Panel(
        Group(*parts),
        title=Text.assemble(("holdfast", "bold"), f" {feed.vehicle}  {loop.version if loop else ''}"),
        title_align="left",
        subtitle=Text(f" STALE, {age} ", "reverse") if feed.stale else Text(f"live, {age}"),
        subtitle_align="right",
        box=box.ROUNDED,
        style="dim" if feed.stale else "",
        width=_WIDTH,
    )


def _fleet(feeds: Sequence[Feed]) -> RenderableType:
    table = _table("vehicle", "state", "depth", "heading", "motors", "battery", "data")
    for feed in feeds:
        supervisor, state = feed.get(Supervisor, "supervisor"), feed.get(State, "state")
        name = supervisor.state if supervisor else _DASH
        table.add_row(
            Text(feed.vehicle, "bold"),
            Text(f" {title(name)} ", "" if feed.stale else _STYLES.get(name, "")),
            _place(state.depth_m, "z") if state and "depth_m" not in state.absent else _DASH,
            _place(state.heading_rad, "psi") if state and "heading_rad" not in state.absent else _DASH,
            _armed(state) or _DASH,
            _volts(state),
            Text(f"STALE {feed.age_s:.0f} s", "reverse") if feed.stale else Text("live"),
            style="dim" if feed.stale else "",
        )
    events = [_event(feed.events[-1], feed.now_s, f"{feed.vehicle}: ") for feed in feeds if feed.events]
    return Group(table, *events, Text("one of them wholly: holdfast watch --name NAME", "dim"))


def _event(event: Event, now_s: float, whose: str = "") -> Text:
    """Draw an event in one line, with its age."""
    style = {"fault": "bold red", "warning": "yellow"}.get(event.severity, "")
    line = Text(f"{max(0.0, now_s - event.t_s):4.0f} s ago  {whose}{event.severity}: {event.text}", style)
    line.truncate(_WIDTH - 4, overflow="ellipsis")
    return line


def _banner(feed: Feed, connect: str) -> RenderableType:
    """Draw who steers, why, and what to do; below it what the vehicle says of itself."""
    supervisor, state = feed.get(Supervisor, "supervisor"), feed.get(State, "state")
    known = state is not None and "armed" not in state.absent
    armed, mode = (state.armed, state.mode) if state and known else (None, None)
    lines: list[Text] = []
    if feed.stale:
        lines.append(Text(f" STALE: {PAST.format(feed.age_s)}. ", "reverse"))
    if feed.stale and supervisor:
        reason, remedy = silence(
            feed.vehicle, "", connected=feed.connected, state=supervisor.state, armed=armed
        )
        lines += [Text(reason, "bold"), Text(f"{TO_DO}: {remedy}")]
    elif supervisor:
        style, name = _STYLES.get(supervisor.state, "reverse"), title(supervisor.state)
        has = holder(
            supervisor.state,
            guidance=state.guidance if state else "",
            armed=armed,
            mode=mode,
            disarms_in_s=supervisor.disarms_in_s,
            system_status=state.system_status if state else 0,
        )
        if "LINK_LOST" in supervisor.conditions:
            style, name, has = _STYLES["FAULT"], LINK_LOST, name
        lines.append(Text.assemble((f"  {name}  ", style), f"  {has}, authority {supervisor.authority:.0%}"))
        unsaid = [
            condition.text
            for condition in named(supervisor.conditions) & ~UNSAID
            if condition.awaited not in supervisor.reason and condition.text not in supervisor.reason
        ]
        lines.append(Text("; ".join(filter(None, (supervisor.reason, ", ".join(unsaid)))), "dim"))
        if supervisor.remedy:
            lines.append(Text(f"{TO_DO}: {whole(supervisor.remedy, feed.vehicle, connect)}"))
        if state and state.pending:
            lines.append(Text(on_engaging(state.pending), "bold"))
    if state:
        named_mode = MODE_NAMES.get(state.mode, f"mode {state.mode}") if known else "mode unknown"
        lines.append(
            Text.assemble(
                (
                    f"{'was ' if feed.stale and known else ''}{_armed(state) or 'armed or not: unknown'}",
                    "bold",
                ),
                f" in {named_mode}   battery {_volts(state)}   stick gain ",
                f"{state.pilot_gain:.0%}" if known else _DASH,
            )
        )
    if state and round(state.depth_offset_m, 2):
        lines.append(Text(f"the autopilot's depth, whose zero moved, is {state.depth_offset_m:+.2f} m off"))
    return Group(*lines)


def _degrees_of_freedom(feed: Feed) -> Table:
    table = _table("", "is", "should be", "error", "learnt", "")
    loop = feed.get(Loop, "loop")
    for dof, name in _DOFS.items():
        record = feed.get(Dof, f"dof/{dof}")
        if record is None:
            continue
        known = not {"x", "e"} & set(record.absent)
        if not known and loop:
            age_s = getattr(loop, _AGES[dof])
            never = age_s >= telemetry.NEVER_S
            last = _DASH if never else _place(record.x, dof)
            silent = "never came" if never else f"STALE {age_s:.0f} s"
            table.add_row(name, last, _DASH, _DASH, _DASH, silent, style="dim" if never else "dim yellow")
        elif not record.engaged:
            place = _place(record.x, dof) if known else _DASH
            table.add_row(name, place, _DASH, _DASH, _DASH, "not held", style="dim")
        else:
            doing = "learning" if record.adapting else "held"
            table.add_row(
                Text(name, "bold"),
                _place(record.x, dof) if known else _DASH,
                _place(record.x_d, dof),
                _error(record.e, dof) if known else _DASH,
                f"{record.d_hat:+.1f} {record.tau_unit}",
                Text("SATURATED", "bold yellow") if record.saturated else doing,
            )
    return table


def _table(*headings: str) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim", pad_edge=False)
    for heading in headings:
        right = heading in ("is", "should be", "error", "learnt", "depth", "heading")
        justify: Literal["left", "right"] = "right" if right else "left"
        table.add_column(heading, justify=justify, min_width=9 if right else 7, no_wrap=True)
    return table


def _armed(state: State | None) -> str:
    """Return whether the motors may turn; "" where nobody knows."""
    if state is None or "armed" in state.absent:
        return ""
    return "ARMED" if state.armed else "disarmed"


def _volts(state: State | None) -> str:
    return f"{state.voltage_v:.1f} V" if state and "voltage_v" not in state.absent else _DASH


def _place(value: float, dof: str) -> str:
    return f"{math.degrees(value) % 360:.1f}°" if dof == "psi" else f"{value:.3f} m"


def _error(value: float, dof: str) -> str:
    return f"{math.degrees(value):+.2f}°" if dof == "psi" else f"{1000 * value:+.0f} mm"


# --- The command ------------------------------------------------------------------------------------------


def main(argv: list[str]) -> int:
    """Run the command; returns 1 when nothing came in time."""
    options = _parser().parse_args(argv)
    console = Console()
    try:
        with Subscription(f"holdfast/{options.name or '*'}/**", options.connect) as seen:
            if console.is_terminal and not (options.once or options.json):
                return _live(options, seen, console)
            return _once(options, seen, console)
    except ValueError as error:
        sys.stderr.write(f"holdfast watch: {error}\n")
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "watch",
        "Shows the state of a vehicle in the terminal, live over Zenoh; with several vehicles "
        "one line for each. Ctrl-C ends it. If the output is not a terminal, it prints one snapshot.",
        EXAMPLES,
    )
    parser.add_argument("--name", default="", metavar="NAME", help="show only this vehicle, wholly")
    add_connect(parser)
    parser.add_argument(
        "--once",
        action="store_true",
        help=f"print one snapshot; status 1 if nothing comes in {PATIENCE_S:.0f} s",
    )
    parser.add_argument("--json", action="store_true", help="the same as JSON: the newest record of each key")
    return parser


def _nobody(options: argparse.Namespace, seen: Subscription) -> str:
    return "\n".join(silence(options.name, options.connect, connected=seen.connected))


def _once(options: argparse.Namespace, seen: Subscription, console: Console) -> int:
    feeds, deadline_s = Feeds(), time.monotonic() + PATIENCE_S
    while not feeds.complete and time.monotonic() < deadline_s:
        feeds.take([*seen.last(), *seen.take()], time.monotonic())  # a replay keeps nothing
        time.sleep(0.02)
    shown = feeds.look(time.monotonic(), connected=seen.connected)
    if not shown:
        sys.stderr.write(f"holdfast watch: {_nobody(options, seen)}\n")
        return 1
    if options.json:
        vehicles = [figures_of(feed) for feed in shown]
        figures = vehicles[0] if len(vehicles) == 1 else {"vehicles": vehicles}
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(figures)).decode() + "\n")
    else:
        console.print(picture(shown, "", options.connect))
    return 0


def _live(options: argparse.Namespace, seen: Subscription, console: Console) -> int:
    feeds = Feeds()
    with Live(console=console, screen=True, auto_refresh=False) as live:
        try:
            while True:
                now_s = time.monotonic()
                feeds.take(seen.take(), now_s)
                shown = feeds.look(now_s, connected=seen.connected)
                nobody = _nobody(options, seen)
                live.update(picture(shown, nobody, options.connect), refresh=True)
                time.sleep(_REFRESH_S)
        except KeyboardInterrupt:
            return 0 if feeds else 1


def figures_of(feed: Feed) -> dict[str, object]:
    """Return the newest record of each key, as `--json` prints it."""
    latest = {tail: msgspec.to_builtins(record) for tail, record in sorted(feed.latest.items())}
    return {"vehicle": feed.vehicle, "age_s": feed.age_s, **latest}
