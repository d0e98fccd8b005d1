"""The companion's subcommands. Heavy imports wait until a command is called."""

import argparse
import json
import logging
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from holdfast import RefusedError, files
from holdfast.command_line import command_parser, position

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from companion.config import Config, VehicleFile
    from companion.identify.sample_table import Table

    Conclude = Callable[[Table, VehicleFile, Path, Sequence[int]], int]

EXAMPLES = """\
examples:
  holdfast run                                  connect and publish, without steering
  holdfast run --engage                         ask for MANUAL and, when the pilot has armed, hold here
  holdfast run --engage --arm --depth 5         the same, but arm the vehicle too and hold 5 m
  holdfast run --engage --depth-only            the firmware keeps roll, pitch and heading: for a first dive
  holdfast run --vehicle bluerov2 --name kelp   another vehicle of config/vehicles/, and its name for `watch`
  holdfast run --vehicle my-rov.toml            your own: config/vehicles/custom.toml explains such a file
  holdfast run --engage --arm --set link.endpoint=tcp:127.0.0.1:5760

Stop with Ctrl-C; Holdfast then sends neutral frames. `holdfast watch` shows the state.
"""

THRUSTERS_MOVE = """\
The vehicle will move: pulses of a fifth of the thrust on each axis in turn, for eight seconds. If nobody has
armed it, it is armed for that. It must be under water, with a metre of free water around it.
"""

CHECK_EXAMPLES = """\
examples:
  holdfast check                                listen for about five seconds, then print the list
  holdfast check --set-origin 47.40,8.55        at the surface: also set the EKF origin
  holdfast check --thrusters                    under water: small pulses on each axis, 8 s; it arms the
                                                vehicle for that, if nobody has, and disarms it again
  holdfast check --json --set link.endpoint=tcp:127.0.0.1:5760

exit status: 0 all rows good; 1 warnings; 2 refused rows (`holdfast run` will not engage), no vehicle, or a
wrong configuration. If the vehicle is disarmed, the check switches to MANUAL, STABILIZE and back. It sends
no steering without --thrusters.
"""

IDENTIFY_MOVES = """\
The vehicle will move by itself for one to two minutes: 0.5 m on each held axis, 50° in heading.
It needs 1.2 m of depth and 2 m of free water around it. A stick at full deflection, the release
button, `holdfast release`, a mode change or Ctrl-C ends it.
"""

IDENTIFY_EXAMPLES = """\
examples:
  holdfast identify                             armed, 1.5 m deep or more, in calm water: ask, then move
  holdfast identify --vehicle bluerov2 --arm    begin with another preset, and arm
  holdfast run --vehicle vehicle.toml           use what was found
  holdfast identify --from dive.BIN             from logs of any dives instead: nothing moves; `--from --help`
  holdfast identify --test dive.BIN --vehicle vehicle.toml   how well a vehicle's file predicts a log

Supervisor and guard of `holdfast run` are in charge. docs/identify.md says what is measured, and how well.
"""

INIT_EXAMPLES = """\
examples:
  holdfast init                                               ask, and write companion.toml
  holdfast init --out /etc/holdfast/companion.toml --where blueos --vehicle bluerov2
  holdfast init --yes --name kelp --holds all                 for scripts: ask nothing
"""

CONFIG_EXAMPLES = """\
examples:
  holdfast config show companion.toml                         every key: value, range, and where it comes from
  holdfast config check companion.toml                        as `holdfast run --config companion.toml`
  holdfast config check vehicle.toml                          as `holdfast run --vehicle vehicle.toml`

exit status: 0 sound; 2 not, and it says file, key, value and what is allowed. Without FILE the shipped file.
"""


def run(argv: list[str]) -> int:
    """Run the controller: hold a vehicle at its setpoint."""
    parser = command_parser(
        "run",
        "Connects to an ArduSub vehicle over MAVLink, and holds it after a request to engage.",
        EXAMPLES,
    )
    _add_config(parser)
    _add_flags(
        parser,
        engage="engage as soon as it is permitted",
        arm="arm the vehicle when it engages, now or later",
        depth_only="steer in STABILIZE: the firmware keeps roll, pitch and heading",
        allow_control="also accept commands over Zenoh from other machines, see `holdfast tell`",
    )
    for option, unit in (("--depth", "M"), ("--heading", "DEG")):
        parser.add_argument(option, type=float, metavar=unit, help="to hold; default: the present one")
    arguments = parser.parse_args(argv)

    from companion import app
    from companion.config import ConfigError
    from companion.io.logs import log_to
    from companion.records import Request, Setpoint
    from companion.telemetry import ranges
    from holdfast import validation

    if arguments.allow_control:
        arguments.set.append("telemetry.allow_control=always")
    if arguments.depth_only:
        arguments.set.append("vehicle.steering_mode=stabilize")
    log_to(sys.stderr)
    with _refusing():
        config = _configuration(arguments)
        deepest = config.supervisor.max_depth_m, "supervisor.max_depth_m"
        for name, value, kind, limit in (
            ("--depth", arguments.depth, ranges.Depth, deepest),
            ("--heading", arguments.heading, ranges.HeadingDeg, validation.NO_LIMIT),
        ):
            if value is not None and (refused := validation.refusal(name, value, kind, limit)):
                raise ConfigError(refused)
        if arguments.heading is not None and not config.vehicle.holds_heading:
            raise ConfigError(
                "--heading: in STABILIZE the firmware keeps the heading; "
                'leave it out, or steer in MANUAL: vehicle.steering_mode = "manual"'
            )
        if arguments.arm and not arguments.engage:
            logging.getLogger("holdfast").info("--arm: it arms when it is told to engage (`holdfast engage`)")
        requests = [Request.ENGAGE] if arguments.engage else []
        depth_m, heading_deg = (math.nan if v is None else v for v in (arguments.depth, arguments.heading))
        setpoint = Setpoint((math.nan, math.nan, depth_m, math.radians(heading_deg)))
        return app.run(config, setpoint, arm=arguments.arm, requests=requests)


@contextmanager
def _refusing() -> Iterator[None]:
    """Turn an error of a file or a value into the one line of a command that cannot begin."""
    try:
        yield
    except ValueError as error:
        raise RefusedError(str(error)) from error


def _add_flags(parser: argparse.ArgumentParser, **flags: str) -> None:
    """Add options without a value, by name and help."""
    for name, text in flags.items():
        parser.add_argument(f"--{name.replace('_', '-')}", action="store_true", help=text)


def _add_config(parser: argparse.ArgumentParser) -> None:
    """Add what says where the configuration is, which vehicle, and what differs."""
    parser.add_argument("--config", type=Path, metavar="FILE", help="default: config/companion.toml")
    for option, metavar, text in (
        ("--vehicle", "NAME|FILE", "a name of config/vehicles/, or a file; default: the configuration's"),
        ("--name", "NAME", "name of the vehicle in telemetry; default: vehicle.name"),
    ):
        parser.add_argument(option, metavar=metavar, help=text)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key")


def _configuration(arguments: argparse.Namespace) -> "Config":
    """Return the configuration that `_add_config`'s options ask for."""
    from companion.config import DEFAULT_FILE, load_config

    chosen = {"vehicle.preset": arguments.vehicle, "vehicle.name": arguments.name}
    named = [f"{key}={json.dumps(name)}" for key, name in chosen.items() if name]
    return load_config(arguments.config or DEFAULT_FILE, [*named, *arguments.set])


def check(argv: list[str]) -> int:
    """Check the pre-dive list of a connected vehicle."""
    parser = command_parser(
        "check",
        "Checks whether the connected vehicle is ready, and prints a list of rows.",
        CHECK_EXAMPLES,
    )
    _add_config(parser)
    _add_flags(
        parser,
        json="for scripts: print JSON instead of the table",
        thrusters="send a pulse on each axis: the vehicle MOVES; it must be under water",
        yes="do not ask before --thrusters moves it",
    )
    parser.add_argument(
        "--set-origin",
        type=position,
        metavar="LAT,LON",
        help="set the EKF origin, in degrees, at the surface",
    )
    arguments = parser.parse_args(argv)

    from companion.assembly import refuse_fast_gains
    from companion.predive.app import inspect
    from companion.predive.inspection import CONTACT_S
    from companion.predive.table import as_json, from_json, show, worst
    from companion.telemetry.schemas import key
    from companion.telemetry.session import asked

    with _refusing():
        config = _configuration(arguments)
        refuse_fast_gains(config)
        name, telemetry = config.vehicle.name, config.telemetry
        answer = None if telemetry.mode == "file" else asked(telemetry.endpoint, key(name, "check"))
        if answer is not None:
            sys.stderr.write(f"`holdfast run` holds the vehicle '{name}' and answers: what it sees now\n")
            if arguments.thrusters or arguments.set_origin is not None:
                raise RefusedError("--thrusters and --set-origin need the port: end `holdfast run` first")
            rows, notes = from_json(answer), list[str]()
        else:
            sys.stderr.write(f"waiting for a vehicle at {config.link.endpoint}, {CONTACT_S:g} s at most\n")
            if arguments.thrusters and not arguments.yes and not _agreed(THRUSTERS_MOVE):
                return 130
            rows, notes = inspect(config, origin=arguments.set_origin, thrusters=arguments.thrusters)
    if arguments.json:
        sys.stdout.write(as_json(rows, notes) + "\n")
    else:
        show(rows, notes)
    return int(worst(rows))


def identify(argv: list[str], conclude: "Conclude") -> int:
    """Measure a vehicle by moving it; `conclude` fits a vehicle to the table, and writes it to the file."""
    parser = command_parser(
        "identify",
        "Holds the vehicle as `holdfast run` does, and moves each axis to and fro in turn, half "
        "a minute each: the vehicle MOVES, up to 0.5 m and 50°, with small pushes. It always moves heave "
        "and yaw, and surge and sway where a position is measured. From the motion it finds mass, "
        "damping, buoyancy, lag, motor start and delay, each with its deviation, and writes a vehicle file.",
        IDENTIFY_EXAMPLES,
    )
    _add_config(parser)
    _add_flags(parser, arm="arm the vehicle when engaging", yes="do not ask before it moves")
    parser.add_argument(
        "--out", type=Path, default=Path("vehicle.toml"), metavar="FILE", help="default: %(default)s"
    )
    arguments = parser.parse_args(argv)

    from companion import app
    from companion.config import vehicle_of
    from companion.identify.manoeuvre import Manoeuvre
    from companion.io.logs import log_to
    from companion.records import Request, Setpoint

    log_to(sys.stderr)
    logging.getLogger("holdfast").setLevel(logging.WARNING)
    with _refusing():
        config = _configuration(arguments)
        files.refuse_existing(arguments.out)
        if not arguments.yes and not _agreed(IDENTIFY_MOVES):
            return 130
        manoeuvre = Manoeuvre(lambda doing: sys.stderr.write(f"{doing}\n"))
        here = Setpoint((math.nan,) * 4)
        status = app.run(config, here, arm=arguments.arm, requests=[Request.ENGAGE], manoeuvre=manoeuvre)
        if manoeuvre.failure or not (manoeuvre.done and manoeuvre.moved):
            why = manoeuvre.failure or "stopped"
            sys.stderr.write(f"holdfast identify: broken off: {why}; nothing was written\n")
            return status or 1
        table = manoeuvre.streams.table("the manoeuvre", config.vehicle.frame)
        return conclude(table, vehicle_of(config), arguments.out, manoeuvre.moved)


def _agreed(what: str) -> bool:
    """Ask whether it may move; without a terminal it may not."""
    if not sys.stdin.isatty():
        raise RefusedError("it moves the vehicle: say --yes where nobody can be asked")
    sys.stdout.write(f"{what}Go on? [y/N] ")
    sys.stdout.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def init(argv: list[str]) -> int:
    """Ask about the vehicle, and write a commented configuration."""
    from companion.config import DEFAULT_FILE, load_config
    from companion.config_text import with_values
    from companion.first_config import places, proposing, questions

    parser = command_parser(
        "init",
        "Listens for a vehicle, asks five questions and writes a configuration for `holdfast run --config "
        "FILE`, with what a pilot sets explained in it. What an option answers is not asked.",
        INIT_EXAMPLES,
    )
    parser.add_argument(
        "--out", type=Path, default=Path("companion.toml"), metavar="FILE", help="default: %(default)s"
    )
    for question in questions():
        words = "|".join(choice.word for choice in question.choices) or "NAME"
        parser.add_argument(f"--{question.name}", metavar=words, help=question.text)
    _add_flags(parser, yes="ask nothing: the first choice of each question")
    arguments = parser.parse_args(argv)
    out = arguments.out
    files.refuse_existing(out)
    if not arguments.yes and not sys.stdin.isatty():
        raise RefusedError("nobody can be asked here: say --yes, and answer by options what differs")
    values: dict[str, float | str] = {}
    found = None
    if not arguments.yes and not (arguments.where and arguments.vehicle):
        from companion.predive import search

        sys.stdout.write("Listening for a vehicle, for some seconds ...\n")
        sys.stdout.flush()
        found = search.search(load_config(), [*places(), *search.serial_lines()])
        words = "None is heard: is it switched on? The questions go on without it."
        if found:
            words = f"Heard: {', '.join(filter(None, (found.firmware, found.frame)))} at {found.endpoint}."
        sys.stdout.write(f"{words} Enter takes what is proposed first.\n")
    for asked in questions():
        question = (
            proposing(asked, {"vehicle": found.preset, "where": found.endpoint}.get(asked.name, ""))
            if found
            else asked
        )
        given = getattr(arguments, question.name)
        if given is None and not arguments.yes:
            try:
                given = input(question.prompt)
            except EOFError:
                return 130
        with _refusing():
            values[question.key] = question.value((given or "").strip())
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(with_values(DEFAULT_FILE.read_text(encoding="utf-8"), values), encoding="utf-8")
    try:
        load_config(out)
    except RefusedError:
        out.unlink()
        raise
    sys.stdout.write(
        f"written: {out}\nnext:    holdfast check --config {out}    then: holdfast run --config {out}\n"
    )
    return 0


def config(argv: list[str]) -> int:
    """Check a configuration or a vehicle's file, or show all keys."""
    parser = command_parser(
        "config",
        "`holdfast config check FILE` says whether `holdfast run` would take a file, or where "
        "it is wrong; `holdfast config show FILE` prints every key with its value, what is allowed, and "
        "where the value comes from. FILE is a configuration, or a vehicle's file such as `holdfast "
        "identify` writes.",
        CONFIG_EXAMPLES,
    )
    parser.add_argument("action", choices=("check", "show"))
    parser.add_argument("file", type=Path, nargs="?", metavar="FILE")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key")
    arguments = parser.parse_args(argv)

    from companion.assembly import refuse_fast_gains
    from companion.config import DEFAULT_FILE, holds_a_vehicle_alone, load_with_origins
    from companion.config_text import listing

    overrides, file = arguments.set, arguments.file or DEFAULT_FILE
    alone = holds_a_vehicle_alone(file)
    if alone:
        overrides = [f"vehicle.preset={json.dumps(str(file))}", *overrides]
    found, origins = load_with_origins(DEFAULT_FILE if alone else file, overrides)
    refuse_fast_gains(found)
    if arguments.action == "show":
        sys.stdout.writelines(f"{line}\n" for line in listing(found, origins))
        return 0
    sys.stdout.write(f"{file}: {'a vehicle' if alone else 'a configuration'} that `holdfast run` takes\n")
    return 0
