"""`holdfast watch`: a vehicle, or a fleet, in a terminal. `Feed` gathers, `render` draws, `main` loops."""

import argparse
import math
import sys
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from companion.telemetry import schemas as telemetry
from companion.telemetry.conditions import UNSAID, named
from companion.telemetry.glossary import LINK_LOST, PAST, TO_DO, holder, silence, title
from companion.telemetry.modes import MODE_NAMES
from companion.telemetry.schemas import Command, Dof, Event, Loop, Plan, Schema, State, Supervisor, printable
from companion.telemetry.status_line import delay_text, left_text
from dashboard.arguments import add_connect
from dashboard.rate import Rate
from dashboard.terminal.small_map import Point, chart, nice_length
from dashboard.zenoh_client import Message, Subscription
from holdfast.arguments import command_parser

EXAMPLES = """\
examples:
  holdfast watch                                 the vehicles that publish on this machine
  holdfast watch --connect laptop.json5          a vehicle on the network, by TLS: docs/telemetry.md, "Where"
  holdfast watch --name kelp --once              one snapshot of one vehicle
  holdfast watch --once --json                   for scripts

By default a companion listens on its own machine alone; a Zenoh configuration opens it by TLS. With a Zenoh
router on the vehicle and telemetry.mode = "client" in the companion's configuration, --connect
tcp/192.168.2.2:7447 reaches it too, without encryption.
"""

STALE_S = 0.5
PATIENCE_S = 5.0

_REFRESH_S = 0.125
_WIDTH = 80
_BINS = 16
_BIN_S = 1.0
_RESTART_S = 1.0
_NOT_SHOWN = ("raw", "recorder", "config", "choices", "check")
_EVENTS = 2
_TRAIL, _TRAIL_S = 300, 0.4
_MAP = 44, 10
_VEHICLES = 32

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
_AXES = {"surge": "N", "sway": "N", "heave": "N", "yaw": "N·m"}
_ROUNDED = {"N": 0.5, "N·m": 0.1}
"""A frame carries whole microseconds: so much less or more than was asked is no saturation."""
_EIGHTHS = "▁▂▃▄▅▆▇█"
_DASH = "–"


@dataclass(frozen=True)
class View:
    """What is known of one vehicle at one moment, `now_s` on its own clock. `latest` by the key's tail.

    `age_s` is infinite before the first sample. `errors` holds, per DOF, the largest |e| (m or rad) of each
    of the last seconds, the newest last. `trail` is where it was in the last two minutes. `rate_hz` is that
    of the ticks in the last seconds, `bytes_per_s` what came of payload.
    """

    endpoint: str
    connected: bool
    vehicle: str
    age_s: float
    latest: Mapping[str, Schema]
    errors: Mapping[str, Sequence[float]]
    trail: Sequence[Point]
    events: Sequence[Event]
    now_s: float
    rate_hz: float
    bytes_per_s: float
    trouble: str

    @property
    def stale(self) -> bool:
        """Whether this is the past."""
        return self.age_s > STALE_S


class Feed:
    """Gathers the messages of one vehicle."""

    def __init__(self, vehicle: str, endpoint: str) -> None:
        self._vehicle = vehicle
        self._endpoint = endpoint
        self._latest: dict[str, Schema] = {}
        self._errors: dict[str, deque[tuple[float, float]]] = {dof: deque(maxlen=_BINS) for dof in _DOFS}
        self._trail: deque[Point] = deque(maxlen=_TRAIL)
        self._trail_t_s = -math.inf
        self._events: deque[Event] = deque(maxlen=_EVENTS)
        self._t_s = -math.inf
        self._clocks_apart_s = math.inf
        self._ticks, self._bytes = Rate(), Rate()
        self._byte_count = 0
        self._trouble = ""

    @property
    def complete(self) -> bool:
        """Whether something came under every key."""
        return self._latest.keys() >= telemetry.EVERY_TICK.keys()

    @property
    def empty(self) -> bool:
        """Whether nothing came so far."""
        return not self._latest

    def take(self, messages: Iterable[Message], now_s: float) -> None:
        """Take what arrived until `now_s`, a monotonic clock of this machine."""
        for key, payload in messages:
            self._byte_count += len(payload)
            if key.rpartition("/")[2] in _NOT_SHOWN:
                continue
            try:
                record = _printable(telemetry.decode(key, payload))
            except ValueError as error:
                self._trouble = printable(str(error))
                continue
            if isinstance(record, Event):
                self._events.append(record)
                continue
            self._latest[key.split("/", 2)[2]] = record
            self._mark_time(record.t_s, now_s)
            if isinstance(record, Dof):
                self._bin(record)
            elif isinstance(record, Loop):
                self._ticks.add(record.t_s, record.tick)
            elif isinstance(record, State) and abs(record.t_s - self._trail_t_s) >= _TRAIL_S:
                self._trail_t_s = record.t_s
                self._trail.append(_position(record))
        self._bytes.add(now_s, self._byte_count)

    def view(self, now_s: float, connected: bool) -> View:
        """Return what there is to see at `now_s`."""
        age_s = math.inf if self.empty else max(0.0, now_s - self._t_s - self._clocks_apart_s)
        return View(
            endpoint=self._endpoint,
            connected=connected,
            vehicle=printable(self._vehicle),
            age_s=age_s,
            latest=dict(self._latest),
            errors={dof: [peak for _, peak in bins] for dof, bins in self._errors.items()},
            trail=list(self._trail),
            events=list(self._events),
            now_s=self._t_s + age_s,
            rate_hz=self._ticks.per_s,
            bytes_per_s=self._bytes.per_s,
            trouble=self._trouble,
        )

    def _mark_time(self, t_s: float, now_s: float) -> None:
        """Learn how far the two clocks are apart from the fastest message: then what was held up is old."""
        if t_s < self._t_s - _RESTART_S:
            self._t_s = self._clocks_apart_s = math.inf
            self._ticks = Rate()
        self._t_s = t_s if math.isinf(self._t_s) else max(self._t_s, t_s)
        self._clocks_apart_s = min(self._clocks_apart_s, now_s - t_s)

    def _bin(self, record: Dof) -> None:
        bins, start = self._errors[record.dof], record.t_s // _BIN_S
        peak = abs(record.e) if record.engaged and "e" not in record.absent else 0.0
        if bins and bins[-1][0] == start:
            peak = max(peak, bins.pop()[1])
        bins.append((start, peak))


class Feeds:
    """A feed for the vehicle asked for or, where none was, for each that is heard."""

    def __init__(self, vehicle: str, endpoint: str) -> None:
        self._endpoint = endpoint
        self._feeds = {vehicle: Feed(vehicle, endpoint)} if vehicle else {}
        self._nobody = Feed(vehicle, endpoint)

    @property
    def complete(self) -> bool:
        """Whether somebody was heard, and everybody under every key."""
        return bool(self._feeds) and all(feed.complete for feed in self._feeds.values())

    def take(self, messages: Iterable[Message], now_s: float) -> None:
        """Take what arrived until `now_s`, a monotonic clock of this machine."""
        by_vehicle: dict[str, list[Message]] = {}
        for message in messages:
            chunks = message.key.split("/", 2)
            if len(chunks) == 3:
                by_vehicle.setdefault(chunks[1], []).append(message)
        for vehicle, theirs in by_vehicle.items():
            if vehicle not in self._feeds and len(self._feeds) < _VEHICLES:
                self._feeds[vehicle] = Feed(vehicle, self._endpoint)
            if vehicle in self._feeds:
                self._feeds[vehicle].take(theirs, now_s)

    def views(self, now_s: float, connected: bool) -> list[View]:
        """Return what there is to see of each at `now_s`; a single empty view where nobody was heard."""
        heard = [feed for _, feed in sorted(self._feeds.items()) if not feed.empty]
        return [feed.view(now_s, connected) for feed in heard or [self._nobody]]


def picture(views: Sequence[View], columns: int) -> RenderableType:
    """Draw one vehicle wholly, several as a line each, on a terminal of so many columns."""
    return render(views[0], columns) if len(views) == 1 else render_fleet(views)


def render_fleet(views: Sequence[View]) -> RenderableType:
    """Draw a line per vehicle. What is old is dim and says so."""
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim", pad_edge=False)
    for heading in ("vehicle", "state", "depth", "heading", "motors", "battery", "data"):
        table.add_column(
            heading, no_wrap=True, justify="right" if heading in ("depth", "heading") else "left"
        )
    for view in views:
        supervisor = view.latest.get("supervisor")
        name = supervisor.state if isinstance(supervisor, Supervisor) else _DASH
        style = _STYLES.get(name, "")
        table.add_row(
            Text(view.vehicle, "bold"),
            Text(f" {title(name)} ", "" if view.stale else style),
            *_whereabouts(view.latest.get("state")),
            Text(f"STALE {view.age_s:.0f} s", "reverse") if view.stale else Text("live"),
            style="dim" if view.stale else "",
        )
    events = [_event(view.events[-1], view.now_s, f"{view.vehicle}: ") for view in views if view.events]
    hint = Text("one of them wholly: holdfast watch --name NAME", "dim")
    return Panel(
        Group(table, Text(), *events, hint),
        title=f"[bold]holdfast[/] {len(views)} vehicles",
        title_align="left",
        box=box.ROUNDED,
        width=_WIDTH,
    )


def render(view: View, columns: int = _WIDTH) -> RenderableType:
    """Draw a view. Every colour has a word beside it; what is old is dim and says so.

    Below 80 columns it is without the error's history, and the demand's gauge is shorter: it fits into 66.
    """
    narrow = columns < _WIDTH
    if not view.latest:
        return Panel(_waiting(view), title="holdfast", title_align="left", box=box.ROUNDED)
    loop = view.latest.get("loop")
    version = loop.version if isinstance(loop, Loop) else ""
    past = Text(f" STALE: {PAST.format(view.age_s)}. ", "reverse")
    body = Group(
        _banner(view),
        past if view.stale else Text(),
        _degrees_of_freedom(view, narrow),
        Text(),
        _thrust(view, narrow),
        Text(),
        _health(view),
    )
    notes = [_event(event, view.now_s) for event in view.events]
    if view.trouble:
        notes.append(Text(view.trouble, "italic"))
    return Panel(
        Group(body, *notes, *_from_above(view)),
        title=Text.assemble(("holdfast", "bold"), f" {view.vehicle}", (f"  {version}", "dim")),
        title_align="left",
        subtitle=_freshness(view),
        subtitle_align="right",
        box=box.ROUNDED,
        style="dim" if view.stale else "",
        width=min(columns, _WIDTH),
    )


def main(argv: list[str]) -> int:
    """Run the command; returns 1 when nothing came in time."""
    options = _parser().parse_args(argv)
    console = Console()
    fleet = Feeds(options.name or "", options.connect)
    once = options.once or not console.is_terminal
    try:
        with Subscription(f"holdfast/{options.name or '*'}/**", options.connect) as seen:
            views = _once(fleet, seen) if once else _live(fleet, seen, console)
    except ValueError as error:
        sys.stderr.write(f"holdfast watch: {error}\n")
        return 2
    if not views[0].latest:
        sys.stderr.write(f"holdfast watch: {_waiting(views[0]).plain}\n")
        return 1
    if once and options.json != "-":
        console.print(picture(views, console.width))
    if options.json:
        vehicles = [figures_of(view) for view in views]
        figures = vehicles[0] if len(vehicles) == 1 else {"vehicles": vehicles}
        text = msgspec.json.format(msgspec.json.encode(figures)).decode() + "\n"
        if options.json == "-":
            sys.stdout.write(text)
        else:
            Path(options.json).write_text(text, encoding="utf-8")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "watch",
        "Shows the state of a vehicle in the terminal, live over Zenoh; with several vehicles "
        "one line for each. Ctrl-C ends it. If the output is not a terminal, it prints one snapshot.",
        EXAMPLES,
    )
    parser.add_argument("--name", metavar="NAME", help="show only this vehicle, with all panels")
    add_connect(parser)
    parser.add_argument(
        "--once",
        action="store_true",
        help=f"print one snapshot; status 1 if nothing comes in {PATIENCE_S:.0f} s",
    )
    parser.add_argument(
        "--json",
        nargs="?",
        const="-",
        metavar="FILE",
        help="write the last snapshot to FILE as JSON; without FILE print that instead of the picture",
    )
    return parser


def _once(fleet: Feeds, seen: Subscription) -> list[View]:
    deadline_s = time.monotonic() + PATIENCE_S
    while not fleet.complete and time.monotonic() < deadline_s:
        fleet.take(seen.last(), time.monotonic())
        time.sleep(0.02)
    return fleet.views(time.monotonic(), seen.connected)


def _live(fleet: Feeds, seen: Subscription, console: Console) -> list[View]:
    views = fleet.views(time.monotonic(), connected=False)
    with Live(picture(views, console.width), console=console, screen=True, auto_refresh=False) as live:
        try:
            while True:
                now_s = time.monotonic()
                fleet.take(seen.take(), now_s)
                views = fleet.views(now_s, seen.connected)
                live.update(picture(views, console.width), refresh=True)
                time.sleep(_REFRESH_S)
        except KeyboardInterrupt:
            return views


def figures_of(view: View) -> dict[str, object]:
    """Return the newest record of each key, as `--json` prints it."""
    latest = {tail: msgspec.to_builtins(record) for tail, record in sorted(view.latest.items())}
    return {"vehicle": view.vehicle, "age_s": view.age_s, **latest}


def _printable(record: Schema) -> Schema:
    """Return the record with all texts safe for a terminal: anybody may publish under these keys."""
    for name in record.__struct_fields__:
        value = getattr(record, name)
        if isinstance(value, str) and not value.isprintable():
            record = msgspec.structs.replace(record, **{name: printable(value)})
        elif isinstance(value, tuple) and any(
            isinstance(part, str) and not part.isprintable() for part in value
        ):
            record = msgspec.structs.replace(record, **{name: tuple(map(printable, value))})
    return record


# --- The parts of the picture -----------------------------------------------------------------------------


def _waiting(view: View) -> Text:
    return Text("\n".join(silence(view.vehicle, view.endpoint, connected=view.connected)))


def _freshness(view: View) -> Text:
    age = f"{view.age_s:.2f} s old"
    age += f", {view.bytes_per_s / 1000.0:.0f} kB/s" if view.bytes_per_s else ""
    link = "" if view.connected else ", not connected"
    return Text(f" STALE, {age}{link} ", "reverse") if view.stale else Text(f"live, {age}{link}")


def _whereabouts(state: Schema | None) -> tuple[str, str, str, str]:
    """Return depth, heading, armed or not, and battery; a dash for what is not known."""
    if not isinstance(state, State):
        return _DASH, _DASH, _DASH, _DASH
    return (
        _DASH if "depth_m" in state.absent else _place(state.depth_m, "z"),
        _DASH if "heading_rad" in state.absent else _place(state.heading_rad, "psi"),
        _DASH if "armed" in state.absent else "ARMED" if state.armed else "disarmed",
        _DASH if "voltage_v" in state.absent else f"{state.voltage_v:.1f} V",
    )


def _event(event: Event, now_s: float, whose: str = "") -> Text:
    """Draw an event in one line, with its age."""
    style = {"fault": "bold red", "warning": "yellow"}.get(event.severity, "")
    line = Text(f"{max(0.0, now_s - event.t_s):4.0f} s ago  {whose}{event.severity}: {event.text}", style)
    line.truncate(_WIDTH - 4, overflow="ellipsis")
    return line


def _holder(name: str, state: Schema | None) -> str:
    if not isinstance(state, State):
        return holder(name, guidance="", armed=None, mode=None)
    armed = None if "armed" in state.absent else state.armed
    mode = None if "mode" in state.absent else state.mode
    return holder(name, guidance=state.guidance, armed=armed, mode=mode)


def _banner(view: View) -> RenderableType:
    supervisor, state = view.latest.get("supervisor"), view.latest.get("state")
    lines: list[Text] = []
    was_armed = state.armed if isinstance(state, State) and "armed" not in state.absent else None
    if view.stale and isinstance(supervisor, Supervisor):
        reason, remedy = silence(
            view.vehicle, view.endpoint, connected=view.connected, state=supervisor.state, armed=was_armed
        )
        lines += [Text(reason, "bold"), Text(f"{TO_DO}: {remedy}")]
    elif isinstance(supervisor, Supervisor):
        style, name = _STYLES.get(supervisor.state, "reverse"), title(supervisor.state)
        has = _holder(supervisor.state, state)
        if "LINK_LOST" in supervisor.conditions:
            style, name, has = _STYLES["FAULT"], LINK_LOST, name
        lines.append(Text.assemble((f"  {name}  ", style), f"  {has}, authority {supervisor.authority:.0%}"))
        shown = named(supervisor.conditions) & ~UNSAID
        unsaid = [
            condition.text
            for condition in shown
            if condition.awaited not in supervisor.reason and condition.text not in supervisor.reason
        ]
        lines.append(Text("; ".join(filter(None, (supervisor.reason, ", ".join(unsaid)))), "dim"))
        if supervisor.remedy:
            lines.append(Text(f"{TO_DO}: {supervisor.remedy}"))
    if isinstance(state, State):
        known = "armed" not in state.absent
        mode = MODE_NAMES.get(state.mode, f"mode {state.mode}") if known else "mode unknown"
        volts = _DASH if "voltage_v" in state.absent else f"{state.voltage_v:.1f} V"
        armed = Text("ARMED", "bold") if state.armed else Text("disarmed")
        armed = Text(f"was {armed.plain}") if view.stale else armed
        armed = armed if known else Text("armed or not: unknown", "bold yellow")
        lines.append(
            Text.assemble(
                armed,
                f" in {mode}   battery {volts}   stick gain ",
                f"{state.pilot_gain:.0%}" if known else _DASH,
                f"   roll {_angle(state, 'roll_rad')}   pitch {_angle(state, 'pitch_rad')}",
                _held_angles(state),
            )
        )
    return Group(*lines)


def _degrees_of_freedom(view: View, narrow: bool) -> Table:
    table = _table("", "is", "should be", "error", f"|e| in {_BINS} s", "learnt", "")
    loop = view.latest.get("loop")
    for dof, name in _DOFS.items():
        record = view.latest.get(f"dof/{dof}")
        if not isinstance(record, Dof):
            continue
        known = not {"x", "e"} & set(record.absent)
        place = _place(record.x, dof) if known else _DASH
        if not known and isinstance(loop, Loop):
            age_s = getattr(loop, _AGES[dof])
            silent = "never came" if age_s >= telemetry.NEVER_S else f"STALE {age_s:.0f} s"
            last = _DASH if age_s >= telemetry.NEVER_S else _place(record.x, dof)
            style = "dim" if age_s >= telemetry.NEVER_S else "dim yellow"
            table.add_row(name, last, _DASH, _DASH, "", _DASH, silent, style=style)
            continue
        if not record.engaged:
            table.add_row(name, place, _DASH, _DASH, "", _DASH, "not held", style="dim")
            continue
        table.add_row(
            Text(name, "bold"),
            place,
            _place(record.x_d, dof),
            _error(record.e, dof) if known else _DASH,
            _sparkline(view.errors.get(dof, [])),
            f"{record.d_hat:+.1f} {record.tau_unit}",
            _doing(record),
        )
    if narrow:
        del table.columns[4]
    return table


def _thrust(view: View, narrow: bool) -> Table:
    half, scale = (6, "-100 % +100 %") if narrow else (12, "-100 %    demand   +100 %")
    table = _table("", scale, "%", "asked", "given", "")
    command = view.latest.get("command")
    if isinstance(command, Command):
        for axis, unit in _AXES.items():
            demand = getattr(command, axis)
            suffix = "nm" if unit == "N·m" else "n"
            asked = getattr(command, f"{axis}_requested_{suffix}")
            given = getattr(command, f"{axis}_delivered_{suffix}")
            limited = abs(asked - given) > _ROUNDED[unit] + 0.02 * abs(asked)
            table.add_row(
                axis,
                gauge(demand, half),
                f"{100 * demand:+.0f}",
                f"{asked:+.1f} {unit}",
                f"{given:+.1f} {unit}",
                Text("SATURATED", "bold yellow") if limited else "",
            )
    return table


def _position(state: State) -> Point:
    return (math.nan, math.nan) if {"x_m", "y_m"} & set(state.absent) else (state.x_m, state.y_m)


def _from_above(view: View) -> list[RenderableType]:
    """Draw a map beside its legend, if the position is known."""
    state, plan, loop = (view.latest.get(tail) for tail in ("state", "plan", "loop"))
    if not isinstance(state, State) or not isinstance(loop, Loop) or loop.position_age_s >= telemetry.NEVER_S:
        return []
    held = all(isinstance(dof := view.latest.get(f"dof/{name}"), Dof) and dof.engaged for name in "xy")
    wanted = (state.x_desired_m, state.y_desired_m) if held else (math.nan, math.nan)
    path = list(zip(plan.x_m, plan.y_m, strict=False)) if isinstance(plan, Plan) else []
    lines = [("dim", path), ("cyan", view.trail), ("yellow", [wanted])]
    picture, m_per_column = chart(lines, _position(state), state.heading_rad, *_MAP)
    scale_m = nice_length(m_per_column * 20)
    legend = [
        Text(f"├{'─' * max(0, round(scale_m / m_per_column) - 2)}┤ {scale_m:g} m, north is up"),
        Text(f"north {_metres(_position(state)[0])}   east {_metres(_position(state)[1])}"),
        Text(f"should be {_metres(wanted[0])}   {_metres(wanted[1])}", "yellow"),
    ]
    if isinstance(plan, Plan) and path and state.path_length_m > 0.0:
        laps = state.path_progress_m / state.path_length_m
        legend.append(Text(f"{plan.name or 'path'}: {laps:.0%}, {state.guidance}", "dim"))
    left = (
        math.inf if name in state.absent else getattr(state, name) for name in ("path_left_m", "path_left_s")
    )
    if text := left_text(*left):
        legend.append(Text(text, "dim"))
    if isinstance(plan, Plan) and plan.fenced and len(plan.fence_north_m) == len(plan.fence_east_m) == 2:
        (south, north), (west, east) = plan.fence_north_m, plan.fence_east_m
        legend.append(Text(f"fence N {south:g} to {north:g}, E {west:g} to {east:g}", "dim"))
    grid = Table.grid(padding=(0, 1))
    grid.add_row(picture, Group(*legend))
    return [grid]


def _metres(value: float) -> str:
    return f"{value:.2f} m" if math.isfinite(value) else _DASH


def _health(view: View) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    loop = view.latest.get("loop")
    if isinstance(loop, Loop):
        ages = (
            ("link", loop.link_age_s),
            ("depth", loop.depth_age_s),
            ("attitude", loop.attitude_age_s),
            ("position", loop.position_age_s),
        )
        grid.add_row("signals", Text("   ").join(_age(name, age_s) for name, age_s in ages))
        grid.add_row(
            "delays",
            f"telemetry {delay_text(loop.telemetry_delay_s, loop.telemetry_delay_known)}   "
            f"command {delay_text(loop.command_delay_s, loop.command_delay_known)}",
        )
        rate_hz = view.rate_hz or loop.rate_hz
        grid.add_row(
            "loop",
            f"{rate_hz:.1f} Hz   {loop.lateness_ms:.2f} ms late   {loop.compute_us:.0f} µs a tick   "
            f"{loop.late_ticks} late ticks   {loop.samples_dropped} dropped",
        )
        flood = f"   {loop.left_out_bytes} bytes of a flood left out" if loop.left_out_bytes else ""
        grid.add_row(
            "mavlink",
            f"{loop.messages} messages   {loop.garbage} garbage   {loop.foreign} foreign   "
            f"{loop.implausible} implausible{flood}",
        )
    return grid


def _table(*headings: str) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim", pad_edge=False)
    for heading in headings:
        number = heading in ("is", "should be", "error", "learnt", "asked", "given", "%")
        table.add_column(
            heading, justify="right" if number else "left", min_width=9 if number else 7, no_wrap=True
        )
    return table


def _place(value: float, dof: str) -> str:
    return f"{math.degrees(value) % 360:.1f}°" if dof == "psi" else f"{value:.3f} m"


def _angle(state: State, name: str) -> str:
    return _DASH if name in state.absent else f"{math.degrees(getattr(state, name)):+.0f}°"


def _held_angles(state: State) -> str:
    held = math.degrees(state.roll_desired_rad), math.degrees(state.pitch_desired_rad)
    return f"   held at {held[0]:+.0f}° and {held[1]:+.0f}°" if max(map(abs, held)) > 0.5 else ""


def _error(value: float, dof: str) -> str:
    return f"{math.degrees(value):+.2f}°" if dof == "psi" else f"{1000 * value:+.0f} mm"


def _doing(record: Dof) -> Text:
    if record.saturated:
        return Text("SATURATED", "bold yellow")
    return Text("learning" if record.adapting else "held")


def _sparkline(peaks: Sequence[float]) -> Text:
    top = max(peaks, default=0.0)
    columns = (_EIGHTHS[min(7, int(8 * peak / top))] if top > 0 else _EIGHTHS[0] for peak in peaks)
    return Text("".join(columns).rjust(_BINS), "cyan")


def gauge(value: float, half: int) -> Text:
    """Draw -1..1 from the middle outwards, in half columns."""
    halves = round(min(1.0, abs(value)) * 2 * half)
    full, rest = divmod(halves, 2)
    right = ("█" * full + "▌" * rest).ljust(half, "·") if value > 0 else "·" * half
    left = ("▐" * rest + "█" * full).rjust(half, "·") if value < 0 else "·" * half
    return Text(f"{left}│{right}", "bold yellow" if halves == 2 * half else "cyan")


def _age(name: str, age_s: float) -> Text:
    if age_s >= telemetry.NEVER_S:
        return Text(f"{name} never", "dim")
    return Text(f"{name} {age_s:.2f} s", "bold yellow" if age_s > STALE_S else "")
