"""`holdfast demo`: what the pilot has today, ALT_HOLD, and Holdfast without and with its compensator.

Holdfast's two dives are in real time: a simulated vehicle and the controller, in processes of their own, talk
MAVLink over UDP. What is shown, drawn and counted is what a stranger hears over Zenoh: the controller's state
and the simulator's truth. ALT_HOLD dives first, in this process and in virtual time, with the same vehicle,
sea and load; it begins at its depth and heading, because no pilot follows a reference with his stick.
"""

import argparse
import math
import signal
import socket
import sys
import tempfile
import time  # noqa: TID251 - real processes
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
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
from lab.demo.timeline import (
    ARRIVED_M,
    DemoDive,
    DemoFigures,
    DemoRecording,
    arrange,
    at_depth,
    figures,
    window,
)
from lab.loop.firmware import FirmwareError, command_line
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import Scenario, hold
from lab.options import add_firmware, find_firmware, json_file
from lab.ports import free_port
from lab.rivals import alt_hold
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant
from sim_bridge.physics.thrusters import thrusters_of
from sim_bridge.vehicle import Truth

VEHICLE = "demo"
LOOPBACK = "127.0.0.1"
PATIENCE_S = 20.0
FIRMWARE_PATIENCE_S = 60.0
"""The real firmware's EKF has to settle first."""
LOOK_S = 0.05
FRAME_S = 0.125
LINE_S = 2.0
AXES = ("surge", "sway", "heave", "yaw")


@dataclass(frozen=True)
class Story:
    """What happens in a dive; times in s since arming. The same seed gives the same sea."""

    seed: int = 1
    depth_m: float = 5.0
    heading_deg: float = 45.0
    load_n: float = 12.0
    load_on_s: float = 16.0
    load_off_s: float = 23.0
    end_s: float = 26.5
    current_m_s: float = 0.3
    wave_height_m: float = 0.3
    wave_period_s: float = 5.0


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
    try:
        with _signals() as stop_asked, _show(console) as show:
            teller = _Teller(story, show)
            dives = {"alt_hold": _dive_alt_hold(story, teller, stop_asked, firmware)}
            for name in ("off", "on"):
                dives[name] = arrange(_dive(story, name, teller, stop_asked, firmware))
        span = window(list(dives.values()), story.depth_m)
    except StoppedError as stopped:
        console.print(f"{stopped}: stopped, and nothing runs any more.")
        return stopped.status
    except (DemoError, ChildError, FirmwareError, ValueError) as error:
        sys.stderr.write(f"holdfast demo: {error}\n")
        return 1
    results = {name: figures(dive, span) for name, dive in dives.items()}
    console.print(demo_screen.table(results, span, story.depth_m))
    try:
        _write_json(json, story, span, results)
        _draw(png, story, span, dives, results, firmware)
    except KeyboardInterrupt:
        return StoppedError(signal.SIGINT).status
    console.print(f"Picture: {png}   Figures: {json}   ({time.monotonic() - began_s:.0f} s)", highlight=False)
    return 0


EXAMPLES = """\
examples:
  holdfast demo                           a minute; writes out/demo.png and out/demo.json
  holdfast demo --seed 7 --out out/seven  other waves and noise
  holdfast demo --firmware                ALT_HOLD of the real ArduSub
  holdfast demo --dvl                     a place and a path, with a DVL; writes out/demo-dvl.png
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "demo",
        "Shows what Holdfast gives: a simulated vehicle holds depth and heading in a current and "
        "waves, and a load is hung on and dropped. First at 5 m, in virtual time, by ArduSub's depth hold, "
        "ALT_HOLD with its default gains (our simulator's copy of it, or the real one with --firmware); then "
        "twice in real time by Holdfast, which arms and dives to 5 m: without and with the compensator that "
        "learns the disturbance. Takes a minute; Ctrl-C ends it at any moment. With --dvl the vehicle keeps "
        "a place in a turning current and waves, by ArduSub's POSHOLD and by Holdfast, which then follows a "
        "path: in virtual time, in less than a minute.",
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


def _dive_alt_hold(
    story: Story, teller: "_Teller", stop_asked: Callable[[], int], firmware: Path | None
) -> DemoDive:
    """Hold the story's depth and heading from boot on by ALT_HOLD with its default gains, in virtual time."""
    heading_rad = math.radians(story.heading_deg)
    start = f"initial.eta=[0, 0, {story.depth_m}, 0, 0, {heading_rad}]"
    plant = load_plant(DEFAULT_CONFIG, [*_sea(story), start])
    scenario = Scenario(
        "demo",
        plant=lambda base, _: base,
        target=hold(story.depth_m, heading_rad),
        duration_s=alt_hold.ARM_S + story.end_s,
        seed=story.seed,
    )
    nominal = thrusters_of(plant.thrusters)
    dived: list[Truth] = []
    command_n: list[float] = []
    teller.begin("alt_hold")
    teller.tell_alt_hold(None)
    with closing(alt_hold.truths(scenario, plant, LinkDelay(), {}, firmware)) as truths:
        for truth in truths:
            if number := stop_asked():
                raise StoppedError(number)
            dived.append(truth)
            command_n.append(alt_hold.commanded_n(truth, nominal))
            teller.tell_alt_hold(truth)
    return at_depth(dived, command_n, story.depth_m, heading_rad)


def _dive(
    story: Story, name: str, teller: "_Teller", stop_asked: Callable[[], int], firmware: Path | None
) -> DemoRecording:
    """Dive once with Holdfast; return what was heard of it."""
    teller.begin(name)
    endpoint = f"tcp/{LOOPBACK}:{free_port(socket.SOCK_STREAM)}"
    mavlink = f"{LOOPBACK}:{free_port(socket.SOCK_DGRAM)}"
    teller.endpoint = endpoint
    heard = DemoRecording()
    with (
        tempfile.TemporaryDirectory(prefix="holdfast-demo-") as logs,
        Crew(Path(logs)) as crew,
        Subscription(f"*/{VEHICLE}/**", endpoint) as seen,
    ):
        # The controller first: whoever is there when the vehicle boots loses nothing of its dive.
        crew.start("run", *_companion_options(story, name, endpoint, mavlink))
        deadline_s = time.monotonic() + (PATIENCE_S if firmware is None else FIRMWARE_PATIENCE_S)
        vehicle_started = False
        while heard.since_arming_s < story.end_s:
            if number := stop_asked():
                raise StoppedError(number)
            crew.check()
            if not vehicle_started and seen.connected:
                _start_vehicle(crew, story, endpoint, mavlink, firmware, Path(logs))
                vehicle_started = True
            for key, payload in seen.take():
                heard.add(key, payload)
                if heard.supervisor and heard.supervisor.state == "ACTIVE":
                    deadline_s = time.monotonic() + story.end_s + PATIENCE_S
            teller.tell(heard)
            _refuse_trouble(heard, seen.connected, time.monotonic() > deadline_s, endpoint, crew)
            time.sleep(LOOK_S)
    return heard


def _companion_options(story: Story, name: str, endpoint: str, mavlink: str) -> list[str]:
    options = ["--engage", "--arm", "--depth", str(story.depth_m), "--heading", str(story.heading_deg)]
    settings = {
        "vehicle.name": VEHICLE,
        "link.endpoint": f"udp-listen:{mavlink}",
        "telemetry.endpoint": endpoint,
    }
    if name == "off":
        settings |= {f"{axis}.compensator": "none" for axis in AXES}
    for key, value in settings.items():
        options += ["--set", f"{key}={value}"]
    return options


def _start_vehicle(
    crew: Crew, story: Story, endpoint: str, mavlink: str, firmware: Path | None, directory: Path
) -> None:
    """Start our stand-in, or the real firmware with our physics, in real time."""
    if firmware is None:
        crew.start("sim", "--udp-connect", mavlink, *_sim_options(story, endpoint))
        return
    port = free_port(socket.SOCK_DGRAM)
    plant = load_plant(DEFAULT_CONFIG, _sea(story))
    crew.start("sim", "--physics-only", f"{LOOPBACK}:{port}", *_sim_options(story, endpoint))
    serial = int(mavlink.rpartition(":")[2])
    crew.run("ardusub", command_line(firmware, plant, directory, port, [serial]), directory)


def _sim_options(story: Story, endpoint: str) -> list[str]:
    options = ["--zenoh", endpoint, "--name", VEHICLE, "--seed", str(story.seed)]
    for setting in _sea(story):
        options += ["--set", setting]
    return options


def _sea(story: Story) -> list[str]:
    """Return the overrides of the simulator's configuration."""
    settings: dict[str, object] = {
        "current.enabled": "true",
        "current.speed_m_s": story.current_m_s,
        "waves.enabled": "true",
        "waves.height_m": story.wave_height_m,
        "waves.period_s": story.wave_period_s,
        "load.enabled": "true",
        "load.weight_n": story.load_n,
        "load.on_s": story.load_on_s,
        "load.off_s": story.load_off_s,
    }
    return [f"{key}={value}" for key, value in settings.items()]


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
    """Follows the recording of the dive that is under way and shows it."""

    def __init__(self, story: Story, show: Show) -> None:
        self.endpoint = ""
        self._story = story
        self._show = show
        self._name = ""
        self._errors: dict[str, list[tuple[float, float]]] = {}

    def begin(self, name: str) -> None:
        """Turn to another dive."""
        self._name = name
        self._errors[name] = []

    def tell(self, heard: DemoRecording) -> None:
        """Show where a dive of Holdfast stands."""
        now = _now(heard)
        if now:
            self._errors[self._name].append((heard.since_arming_s, now.error_mm))
        self._tell(phase_of(heard, self._story), heard.since_arming_s, now)

    def tell_alt_hold(self, truth: Truth | None) -> None:
        """Show where the dive of ALT_HOLD stands; none at its boot."""
        story = self._story
        t_s = truth.t_s - alt_hold.ARM_S if truth else 0.0
        if truth:
            self._errors[self._name].append((t_s, 1e3 * (float(truth.eta[2]) - story.depth_m)))
        self._tell(f"ALT_HOLD at {story.depth_m:g} m, in virtual time", t_s, None)

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
                marks={"armed": 0.0, "load on": story.load_on_s, "off": story.load_off_s},
                endpoint=self.endpoint,
            )
        )


def _now(heard: DemoRecording) -> Now | None:
    if not (heard.truth and heard.state and heard.command and heard.heave):
        return None
    truth, state, heave = heard.truth[-1], heard.state[-1], heard.heave[-1]
    return Now(
        depth_m=float(truth.eta[2]),
        depth_desired_m=state.depth_desired_m,
        heading_rad=float(truth.eta[5]),
        heading_desired_rad=state.heading_desired_rad,
        thrust_n=heard.command[-1].heave_delivered_n,
        saturated=heave.saturated,
        disturbance_n=-float(truth.disturbance[2]),
        d_hat_n=heave.d_hat,
    )


def phase_of(heard: DemoRecording, story: Story) -> str:
    """Say in words what happens now."""
    if heard.supervisor is None:
        return "starting the controller"
    if not heard.truth:
        return "booting the vehicle"
    if heard.supervisor.state != "ACTIVE":
        return "arming" if heard.truth[-1].armed is False else f"armed; {heard.supervisor.reason}"
    if heard.truth[-1].load_on:
        return f"a load of {story.load_n:g} N hangs on it"
    if heard.since_arming_s > story.load_on_s:
        return "the load is gone"
    if abs(heard.state[-1].depth_desired_m - story.depth_m) > ARRIVED_M:
        return f"diving to {story.depth_m:g} m"
    return f"holding {story.depth_m:g} m and {story.heading_deg:g}° in current and waves"


# --- What stays -------------------------------------------------------------------------------------------


def _write_json(path: Path, story: Story, span: tuple[float, float], results: dict[str, DemoFigures]) -> None:
    content: dict[str, object] = {**results, "window_s": span, "story": story}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(content)) + b"\n")


def _draw(
    path: Path,
    story: Story,
    span: tuple[float, float],
    dives: dict[str, DemoDive],
    results: dict[str, DemoFigures],
    firmware: Path | None,
) -> None:
    from lab.demo.picture import draw

    sea = f"{story.current_m_s:g} m/s current, {story.wave_height_m:g} m waves of {story.wave_period_s:g} s"
    how, zero, measure = "our simulator's copy of it", "", "depth_rms_mm"
    if firmware:
        how, measure = "the real firmware", "depth_sd_mm"
        zero = "\nThe firmware moves its zero of depth by centimetres on arming."
    figure = draw(
        dives,
        results,
        span,
        f"at {story.depth_m:g} m in waves, with a load hung on and dropped",
        "Simulated BlueROV2 Heavy; vehicle, sea and load are the same three times: "
        f"{sea}, {story.load_n:g} N. Holdfast dives from the surface, in real time,\n"
        "and learns on the way down also damping that its model lacks. "
        f"ALT_HOLD ({how}, default gains) begins at {story.depth_m:g} m, in virtual time; "
        f"it is drawn where the table measures.{zero}",
        measure,
    )
    figure.savefig(path)
