"""`holdfast watch`: vehicles in a terminal. `picture` draws what came, `main` loops."""

import argparse
import math
import sys
import time
from collections.abc import Iterator
from typing import Literal, NamedTuple

import msgspec
from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from companion.telemetry import schemas as telemetry
from companion.telemetry.glossary import (
    LINK_LOST,
    PAST,
    TO_DO,
    UNSAID,
    named,
    on_engaging,
    silence,
    title,
    whole,
)
from companion.telemetry.modes import MODE_NAMES
from companion.telemetry.schemas import ENDPOINT, Dof, Event, State, Supervisor, printable
from dashboard.arguments import PATIENCE_S, WHERE, add_connect
from dashboard.heard_vehicles import Fleet, Vehicle
from dashboard.zenoh_client import Subscription
from holdfast.command_line import command_parser

EXAMPLES = f"""\
examples:
  holdfast watch                                 the vehicles that publish on this machine
  holdfast watch --connect laptop.json5          a vehicle on the network, by TLS
  holdfast watch kelp --once                     one snapshot of one vehicle
  holdfast watch --once --json                   for scripts

{WHERE}`holdfast dashboard` has maps and plots.
"""

STALE_S = 0.5  # as the page: 25 ticks

_REFRESH_S = 0.125  # what an eye follows
_WIDTH = 80
_EVENTS = 2  # so that all fits 24 lines

_STYLES = dict.fromkeys(("RAMP_DOWN", "HAND_OVER", "PILOT"), "bold black on yellow") | {
    "IDLE": "white on grey23",
    "READY": "black on white",
    "ACTIVE": "bold white on blue",
    "FAULT": "bold white on red",
}
_DOFS = {"x": "north", "y": "east", "z": "depth", "psi": "heading"}
_AGES = {"x": "position_age_s", "y": "position_age_s", "z": "depth_age_s", "psi": "attitude_age_s"}
_DASH = "–"

# --- The picture ------------------------------------------------------------------------------------------


class Look(NamedTuple):
    """Who was heard, and when they are looked at: a monotonic clock of this machine."""

    fleet: Fleet[Vehicle]
    now_s: float
    connected: bool = True
    endpoint: str = ENDPOINT

    @property
    def vehicles(self) -> list[Vehicle]:
        """Those that published something, by name."""
        return [vehicle for _, vehicle in sorted(self.fleet.vehicles.items()) if vehicle.latest]

    def stale(self, vehicle: Vehicle) -> bool:
        """Whether what is known is the past."""
        return vehicle.age_s(self.now_s) > STALE_S


def picture(look: Look, nobody: str = "") -> RenderableType:
    """Draw one vehicle wholly, several as a line each; `nobody` where none is heard.

    Every colour has a word beside it; what is old is dim and says so.
    """
    vehicles = look.vehicles
    if not vehicles:
        return Panel(nobody, title="holdfast", title_align="left", box=box.ROUNDED)
    if len(vehicles) > 1:
        heading = Text.assemble(("holdfast", "bold"), f" {len(vehicles)} vehicles")
        return Panel(_fleet(look), title=heading, title_align="left", box=box.ROUNDED, width=_WIDTH)
    (vehicle,) = vehicles
    age_s, stale, loop = vehicle.age_s(look.now_s), look.stale(vehicle), vehicle.loop
    parts = [*_banner(vehicle, look), Text(), _degrees_of_freedom(vehicle), Text()]
    parts += [_event(event, vehicle, look) for event in list(vehicle.events)[-_EVENTS:]]
    if look.fleet.trouble:
        parts.append(Text(look.fleet.trouble, "italic"))
    age = f"{age_s:.2f} s old{'' if look.connected else ', not connected'}"
    name = f" {printable(vehicle.name)}  {loop.version if loop else ''}"
    return Panel(
        Group(*parts),
        title=Text.assemble(("holdfast", "bold"), name),
        title_align="left",
        subtitle=Text(f" STALE, {age} ", "reverse") if stale else Text(f"live, {age}"),
        subtitle_align="right",
        box=box.ROUNDED,
        style="dim" if stale else "",
        width=_WIDTH,
    )


def _fleet(look: Look) -> RenderableType:
    table = _table("vehicle", "state", "depth", "heading", "motors", "battery", "data")
    for vehicle in look.vehicles:
        stale, state, name = look.stale(vehicle), vehicle.state, vehicle.supervised or _DASH
        table.add_row(
            Text(printable(vehicle.name), "bold"),
            Text(f" {title(name)} ", "" if stale else _STYLES.get(name, "")),
            _place(state.depth_m, "z") if state and "depth_m" not in state.absent else _DASH,
            _place(state.heading_rad, "psi") if state and "heading_rad" not in state.absent else _DASH,
            _armed(vehicle) or _DASH,
            _volts(state),
            Text(f"STALE {vehicle.age_s(look.now_s):.0f} s", "reverse") if stale else Text("live"),
            style="dim" if stale else "",
        )
    events = [
        _event(vehicle.events[-1], vehicle, look, f"{printable(vehicle.name)}: ")
        for vehicle in look.vehicles
        if vehicle.events
    ]
    return Group(table, *events, Text("one of them wholly: holdfast watch VEHICLE", "dim"))


def _event(event: Event, vehicle: Vehicle, look: Look, whose: str = "") -> Text:
    """Draw an event in one line, with its age."""
    style = {"fault": "bold red", "warning": "yellow"}.get(event.severity, "")
    ago_s = max(0.0, vehicle.t_s + vehicle.age_s(look.now_s) - event.t_s)
    line = Text(f"{ago_s:4.0f} s ago  {whose}{event.severity}: {event.text}", style)
    line.truncate(_WIDTH - 4, overflow="ellipsis")
    return line


def _banner(vehicle: Vehicle, look: Look) -> Iterator[RenderableType]:
    """Draw who steers, why, and what to do; below it what the vehicle says of itself."""
    state, stale = vehicle.state, look.stale(vehicle)
    if stale:
        yield Text(f" STALE: {PAST.format(vehicle.age_s(look.now_s))}. ", "reverse")
    if stale and vehicle.supervisor:
        reason, remedy = vehicle.silence("", connected=look.connected)
        yield Text(printable(reason), "bold")
        yield Text(f"{TO_DO}: {remedy}")
    elif vehicle.supervisor:
        yield from _supervision(vehicle, vehicle.supervisor, look)
    if state:
        known = vehicle.mode is not None
        mode = MODE_NAMES.get(state.mode, f"mode {state.mode}") if known else "mode unknown"
        motors = f"{'was ' if stale and known else ''}{_armed(vehicle) or 'armed or not: unknown'}"
        gain = f"{state.pilot_gain:.0%}" if known else _DASH
        yield Text.assemble((motors, "bold"), f" in {mode}   battery {_volts(state)}   stick gain {gain}")
        if round(state.depth_offset_m, 2):
            yield Text(f"the autopilot's depth, whose zero moved, is {state.depth_offset_m:+.2f} m off")


def _supervision(vehicle: Vehicle, supervisor: Supervisor, look: Look) -> Iterator[RenderableType]:
    style, name, has = _STYLES.get(supervisor.state, "reverse"), title(supervisor.state), vehicle.holder
    if "LINK_LOST" in supervisor.conditions:
        style, name, has = _STYLES["FAULT"], LINK_LOST, name
    yield Text.assemble((f"  {name}  ", style), f"  {has}, authority {supervisor.authority:.0%}")
    unsaid = [
        condition.text
        for condition in named(supervisor.conditions) & ~UNSAID
        if not any(words and words in supervisor.reason for words in (condition.awaited, condition.text))
    ]
    yield Text("; ".join(filter(None, (supervisor.reason, ", ".join(unsaid)))), "dim")
    if supervisor.remedy:
        yield Text(f"{TO_DO}: {whole(supervisor.remedy, printable(vehicle.name), look.endpoint)}")
    if vehicle.state and vehicle.state.pending:
        yield Text(on_engaging(vehicle.state.pending), "bold")


def _degrees_of_freedom(vehicle: Vehicle) -> Table:
    table, loop = _table("", "is", "should be", "error", "learnt", "status"), vehicle.loop
    for dof, name in _DOFS.items():
        record = vehicle.get(Dof, f"dof/{dof}")
        if record is None:
            continue
        known = not {"x", "e"} & set(record.absent)
        place = _place(record.x, dof) if known else _DASH
        if not known and loop:
            age_s = getattr(loop, _AGES[dof])
            never = age_s >= telemetry.NEVER_S
            last = _DASH if never else _place(record.x, dof)
            silent = "never came" if never else f"STALE {age_s:.0f} s"
            table.add_row(name, last, _DASH, _DASH, _DASH, silent, style="dim" if never else "dim yellow")
        elif not record.engaged:
            table.add_row(name, place, _DASH, _DASH, _DASH, "not held", style="dim")
        else:
            doing = "learning" if record.adapting else "held"
            table.add_row(
                Text(name, "bold"),
                place,
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


def _armed(vehicle: Vehicle) -> str:
    """Return whether the motors may turn; "" where nobody knows."""
    return {True: "ARMED", False: "disarmed", None: ""}[vehicle.armed]


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
    parser.add_argument("name", nargs="?", default="", metavar="VEHICLE", help="show only this one, in full")
    add_connect(parser)
    once = f"print one snapshot; status 1 if nothing comes in {PATIENCE_S:.0f} s"
    parser.add_argument("--once", action="store_true", help=once)
    parser.add_argument("--json", action="store_true", help="the same as JSON: the newest record of each key")
    return parser


def _nobody(options: argparse.Namespace, seen: Subscription) -> str:
    return "\n".join(silence(options.name, options.connect, connected=seen.connected))


def _once(options: argparse.Namespace, seen: Subscription, console: Console) -> int:
    fleet, deadline_s = Fleet(Vehicle), time.monotonic() + PATIENCE_S
    while not fleet.complete and time.monotonic() < deadline_s:
        fleet.take([*seen.last(), *seen.take()], time.monotonic())  # a replay keeps nothing
        time.sleep(0.02)
    look = Look(fleet, time.monotonic(), seen.connected, options.connect)
    if not look.vehicles:
        sys.stderr.write(f"holdfast watch: {_nobody(options, seen)}\n")
        return 1
    if options.json:
        vehicles = [
            {
                "vehicle": vehicle.name,
                "age_s": vehicle.age_s(look.now_s),
                **dict(sorted(vehicle.latest.items())),
            }
            for vehicle in look.vehicles
        ]
        figures = vehicles[0] if len(vehicles) == 1 else {"vehicles": vehicles}
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(figures)).decode() + "\n")
    else:
        console.print(picture(look))
    return 0


def _live(options: argparse.Namespace, seen: Subscription, console: Console) -> int:
    fleet = Fleet(Vehicle)
    with Live(console=console, screen=True, auto_refresh=False) as live:
        try:
            while True:
                now_s = time.monotonic()
                fleet.take(seen.take(), now_s)
                look = Look(fleet, now_s, seen.connected, options.connect)
                live.update(picture(look, _nobody(options, seen)), refresh=True)
                time.sleep(_REFRESH_S)
        except KeyboardInterrupt:
            return 0 if fleet.vehicles else 1
