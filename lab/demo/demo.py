"""`holdfast demo`: what each part of Holdfast is worth, beside ALT_HOLD, which the pilot has today.

Holdfast dives first in real time, for people to watch: a simulated vehicle and the controller, in processes
of their own, talk MAVLink over UDP, and what is shown and counted is what a stranger hears over Zenoh. Then
come four dives in virtual time, with the same vehicle, water, path and load: the law alone, the law with
the observer's disturbance, Holdfast, and ALT_HOLD.
"""

import argparse
import signal
import socket
import sys
import tempfile
import time  # noqa: TID251 - real processes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

import msgspec
from rich.console import Console
from rich.live import Live

from dashboard.zenoh_client import Subscription
from holdfast.arguments import command_parser
from lab.demo import place_show
from lab.demo import screen as demo_screen
from lab.demo.crew import ChildError, Crew
from lab.demo.place import PlaceStory
from lab.demo.screen import DemoView, Now
from lab.demo.story import VEHICLE_FILE, Story
from lab.demo.timeline import DemoDive, DemoFigures, DemoRecording, arrange, figures, worth
from lab.demo.virtual import dive_alt_hold, dive_holdfast
from lab.loop.firmware import FirmwareError
from lab.options import add_firmware, find_firmware, json_file
from lab.ports import free_port

VEHICLE = "demo"
LOOPBACK = "127.0.0.1"
PATIENCE_S = 20.0
LOOK_S = 0.05
FRAME_S = 0.125
LINE_S = 2.0
PARTS = {"law": "none", "observer": "observer", "holdfast": ""}
"""The dives of Holdfast in virtual time, and their compensators; empty: the shipped one."""


class DemoError(Exception):
    """The demo cannot go on; the message says why, and what was last heard."""


class StoppedError(Exception):
    """SIGINT or SIGTERM came."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.status = 128 + number


class Show(Protocol):
    """Shows a view to somebody."""

    def __call__(self, view: DemoView) -> None:
        """Show it, if it is time."""


def main(argv: list[str]) -> int:
    """Run the command; return its exit status."""
    parser = _parser()
    options = parser.parse_args(argv)
    seed, name = Story.seed if options.seed is None else options.seed, "demo-dvl" if options.dvl else "demo"
    png, json = options.out / f"{name}.png", options.json or options.out / f"{name}.json"
    if options.dvl and options.firmware is not None:
        parser.error("--dvl dives our simulator alone: leave --firmware out")
    if not find_firmware("demo", options):
        return 2
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        if options.dvl:
            return place_show.perform(PlaceStory(seed=seed), png, json)
        return perform(Story(seed=seed), png, json, options.firmware)
    except OSError as error:
        sys.stderr.write(f"holdfast demo: {error}\n")
        return 1


def perform(story: Story, png: Path, json: Path, firmware: Path | None = None) -> int:
    """Dive, then print the table and write picture and figures; return the exit status."""
    console = Console()
    began_s = time.monotonic()
    about_mean = firmware is not None
    try:
        with _signals() as stop_asked, _show(console) as show:
            dives = _dive_all(story, _Teller(story, show, stop_asked), firmware)
        results = {name: figures(dive, story.phases, about_mean=about_mean) for name, dive in dives.items()}
    except StoppedError as stopped:
        console.print(f"{stopped}: stopped, and nothing runs any more.")
        return stopped.status
    except (DemoError, ChildError, FirmwareError, ValueError) as error:
        sys.stderr.write(f"holdfast demo: {error}\n")
        return 1
    said = [
        worth("The observer", results["law"], results["observer"]),
        worth("The network", results["observer"], results["holdfast"]),
    ]
    console.print(demo_screen.table(results, story, about_mean=about_mean))
    console.print(*said, sep="\n", highlight=False)
    try:
        _write_json(json, story, said, results)
        _draw(png, story, said, dives, results, firmware)
    except KeyboardInterrupt:
        return StoppedError(signal.SIGINT).status
    console.print(f"Picture: {png}   Figures: {json}   ({time.monotonic() - began_s:.0f} s)", highlight=False)
    return 0


EXAMPLES = """\
examples:
  holdfast demo                           a minute; writes out/demo.png and out/demo.json
  holdfast demo --seed 7 --out out/seven  other waves and noise
  holdfast demo --firmware                the same dives on the real ArduSub, in virtual time
  holdfast demo --dvl                     a place and a path, with a DVL; writes out/demo-dvl.png
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "demo",
        "Shows what each part of Holdfast is worth: a simulated vehicle with a payload skid and weed in a "
        "motor keeps depth and heading in a current and waves, moves half a metre down and up again "
        "twice, and a load is hung on and dropped. Holdfast dives in real time, for you to watch. Then "
        "the same dive is repeated in virtual time: by the control law alone; by the law with the "
        "observer; by Holdfast, which adds the network; by ArduSub's depth hold, ALT_HOLD, with its "
        "default gains. Takes a minute; Ctrl-C ends it at any moment. With --firmware the four dives are "
        "on the real ArduSub, without the one in real time. With --dvl the vehicle keeps a place in a "
        "turning current and waves, by ArduSub's POSHOLD and by Holdfast, which then follows a path: in "
        "virtual time, in less than a minute.",
        EXAMPLES,
    )
    parser.add_argument(
        "--dvl", action="store_true", help="a place and a path beside POSHOLD, with a position from a DVL"
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("out"),
        help="where demo.png and demo.json, or demo-dvl.png and demo-dvl.json, go (default: out)",
    )
    parser.add_argument("--json", metavar="FILE", type=json_file, help="write the figures to FILE instead")
    parser.add_argument(
        "--seed", metavar="N", type=int, help=f"of waves and noise, for all dives (default: {Story.seed})"
    )
    add_firmware(parser)
    return parser


# --- The dives --------------------------------------------------------------------------------------------


def _dive_all(story: Story, teller: "_Teller", firmware: Path | None) -> dict[str, DemoDive]:
    """Dive; return the dives in the order of the table."""
    live = {} if firmware else {"live": arrange(_dive_live(story, teller))}
    parts: dict[str, DemoDive] = {}
    for name, compensator in PARTS.items():
        teller.begin(name)
        parts[name] = dive_holdfast(story, compensator, firmware, teller.tell_virtual)
    teller.begin("alt_hold")
    alt_hold = dive_alt_hold(story, parts["holdfast"], firmware, teller.tell_virtual)
    return {"alt_hold": alt_hold, **parts, **live}


def _dive_live(story: Story, teller: "_Teller") -> DemoRecording:
    """Dive in real time; return what was heard of it."""
    teller.begin("live")
    endpoint = f"tcp/{LOOPBACK}:{free_port(socket.SOCK_STREAM)}"
    mavlink = f"{LOOPBACK}:{free_port(socket.SOCK_DGRAM)}"
    teller.endpoint = endpoint
    heard, depth_m = DemoRecording(), story.depth_m
    with (
        tempfile.TemporaryDirectory(prefix="holdfast-demo-") as logs,
        Crew(Path(logs)) as crew,
        Subscription(f"*/{VEHICLE}/**", endpoint) as seen,
    ):
        # The controller first: whoever is there when the vehicle boots loses nothing of its dive.
        crew.start("run", *_companion_options(story, endpoint, mavlink))
        deadline_s = time.monotonic() + PATIENCE_S
        vehicle_started = False
        while heard.since_arming_s < story.end_s:
            teller.refuse_signals()
            crew.check()
            if not vehicle_started and seen.connected:
                crew.start("sim", "--udp-connect", mavlink, *_sim_options(story, endpoint))
                vehicle_started = True
            for key, payload in seen.take():
                heard.add(key, payload)
                if heard.supervisor and heard.supervisor.state == "ACTIVE":
                    deadline_s = time.monotonic() + story.end_s + PATIENCE_S
            if heard.truth and story.depth_m_at(max(0.0, heard.since_arming_s)) != depth_m:
                depth_m = story.depth_m_at(heard.since_arming_s)
                reply = seen.tell(VEHICLE, "setpoint", {"depth_m": depth_m})
                if not reply.done:
                    raise DemoError(f"the controller refuses a depth of {depth_m:g} m: {reply.said}")
            teller.tell_live(heard)
            _refuse_trouble(heard, seen.connected, time.monotonic() > deadline_s, endpoint, crew)
            time.sleep(LOOK_S)
    return heard


def _companion_options(story: Story, endpoint: str, mavlink: str) -> list[str]:
    options = ["--engage", "--arm", "--depth", str(story.depth_m), "--heading", str(story.heading_deg)]
    settings = {
        "vehicle.name": VEHICLE,
        "link.endpoint": f"udp-listen:{mavlink}",
        "telemetry.endpoint": endpoint,
    }
    for key, value in settings.items():
        options += ["--set", f"{key}={value}"]
    return options


def _sim_options(story: Story, endpoint: str) -> list[str]:
    options = ["--vehicle", VEHICLE_FILE.stem.removeprefix("sim-"), "--zenoh", endpoint, "--name", VEHICLE]
    for setting in story.settings():
        options += ["--set", setting]
    return [*options, "--seed", str(story.seed)]


def _refuse_trouble(heard: DemoRecording, connected: bool, late: bool, endpoint: str, crew: Crew) -> None:
    """Raise DemoError if the controller let go, or if nothing comes of it."""
    supervisor = heard.supervisor
    if supervisor and supervisor.state in ("RAMP_DOWN", "HAND_OVER", "PILOT", "FAULT"):
        raise DemoError(
            f"the controller let go of the vehicle: {supervisor.reason} ({supervisor.state}). "
            f"Where this machine is very busy, try again later.\n{crew.last_lines()}"
        )
    if not late:
        return
    if not connected:
        raise DemoError(f"nobody came to listen on Zenoh's {endpoint}.\n{crew.last_lines()}")
    if not heard.truth:
        raise DemoError(f"nothing of the simulator came over Zenoh's {endpoint}.\n{crew.last_lines()}")
    why = f"{supervisor.state}: {supervisor.reason}" if supervisor else "it says nothing over Zenoh"
    raise DemoError(f"the controller does not dive ({why}).\n{crew.last_lines()}")


@contextmanager
def _signals() -> Iterator[Callable[[], int]]:
    """Give a function that returns the signal that came, or 0: so nothing is ever cut off half-way."""
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        del frame
        came.append(number)

    handlers: dict[int, Any] = {
        number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield lambda: came[0] if came else 0
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


# --- What people see --------------------------------------------------------------------------------------


@contextmanager
def _show(console: Console) -> Iterator[Show]:
    """Give what shows a view: frames on a terminal, lines elsewhere."""
    shown_s = -LINE_S
    phase = ""

    def print_line(view: DemoView) -> None:
        nonlocal shown_s, phase
        if view.phase != phase or time.monotonic() - shown_s >= LINE_S:
            shown_s, phase = time.monotonic(), view.phase
            sys.stdout.write(demo_screen.line(view) + "\n")
            sys.stdout.flush()

    if not console.is_terminal:
        yield print_line
        return
    with Live(console=console, auto_refresh=False) as live:

        def draw(view: DemoView) -> None:
            nonlocal shown_s
            if time.monotonic() - shown_s >= FRAME_S:
                shown_s = time.monotonic()
                live.update(demo_screen.render(view, console.width), refresh=True)

        yield draw


class _Teller:
    """Follows the dive that is under way and shows it; raises StoppedError after a signal."""

    def __init__(self, story: Story, show: Show, stop_asked: Callable[[], int]) -> None:
        self.endpoint = ""
        self._story = story
        self._show = show
        self._stop_asked = stop_asked
        self._name = ""
        self._errors: dict[str, list[tuple[float, float]]] = {}

    def refuse_signals(self) -> None:
        """Raise StoppedError if SIGINT or SIGTERM came."""
        if number := self._stop_asked():
            raise StoppedError(number)

    def begin(self, name: str) -> None:
        """Turn to another dive."""
        self._name = name
        self._errors[name] = []
        self._tell("booting the vehicle", 0.0, None)

    def tell_live(self, heard: DemoRecording) -> None:
        """Show where the dive in real time stands."""
        now = _now(heard)
        if now:
            self._errors[self._name].append((heard.since_arming_s, now.error_mm))
        self._tell(phase_of(heard, self._story), heard.since_arming_s, now)

    def tell_virtual(self, t_s: float, error_mm: float) -> None:
        """Show where a dive in virtual time stands."""
        self.refuse_signals()
        self._errors[self._name].append((t_s, error_mm))
        self._tell(f"{_named(self._story, t_s)}, in virtual time", t_s, None)

    def _tell(self, phase: str, t_s: float, now: Now | None) -> None:
        story = self._story
        self._show(
            DemoView(
                dive=self._name,
                phase=phase,
                t_s=t_s,
                end_s=story.end_s,
                now=now,
                errors=self._errors,
                marks={name: begin_s for name, (begin_s, _) in story.phases.items()},
                endpoint=self.endpoint,
            )
        )


def _now(heard: DemoRecording) -> Now | None:
    if not (heard.truth and heard.state and heard.command):
        return None
    truth, state = heard.truth[-1], heard.state[-1]
    return Now(
        depth_m=float(truth.eta[2]),
        depth_desired_m=state.depth_desired_m,
        heading_rad=float(truth.eta[5]),
        heading_desired_rad=state.heading_desired_rad,
        thrust_n=heard.command[-1].heave_delivered_n,
        saturated=heard.saturated,
        disturbance_n=-float(truth.disturbance[2]),
        d_hat_n=heard.d_hat_n,
    )


def phase_of(heard: DemoRecording, story: Story) -> str:
    """Say in words what happens now."""
    if heard.supervisor is None:
        return "starting the controller"
    if not heard.truth:
        return "booting the vehicle"
    if heard.supervisor.state != "ACTIVE":
        return "arming" if heard.truth[-1].armed is False else f"armed; {heard.supervisor.reason}"
    return f"{_named(story, heard.since_arming_s)}, in real time"


def _named(story: Story, t_s: float) -> str:
    """Return the phase at a time since arming; before the first one it is that already."""
    begun = [name for name, (begin_s, _) in story.phases.items() if t_s >= begin_s]
    return begun[-1] if begun else next(iter(story.phases))


# --- What stays -------------------------------------------------------------------------------------------


def _write_json(path: Path, story: Story, said: list[str], results: dict[str, DemoFigures]) -> None:
    content: dict[str, object] = {**results, "worth": said, "phases_s": story.phases, "story": story}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(content)) + b"\n")


def _draw(
    path: Path,
    story: Story,
    said: list[str],
    dives: dict[str, DemoDive],
    results: dict[str, DemoFigures],
    firmware: Path | None,
) -> None:
    from lab.demo.picture import draw

    how = "the real ArduSub" if firmware else "our simulator"
    mean = "; errors are about their mean: the firmware's zero of depth is off" if firmware else ""
    caption = (
        f"{story.words}\nVehicle, water, path and load are the same in each dive, in virtual time with "
        f"{how}. ALT_HOLD has its default gains and gets the same path{mean}."
    )
    draw(dives, results, story, said, caption).savefig(path)
