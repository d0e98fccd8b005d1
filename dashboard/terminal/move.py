"""`holdfast goto` and `holdfast follow`: a vehicle to a place, or along the path of a file."""

import argparse
import math
import sys
from pathlib import Path

import msgspec

from companion.telemetry import path_files
from companion.telemetry.fields import fields_of
from companion.telemetry.operator_commands import Goto
from dashboard.arguments import add_connect
from dashboard.terminal.tell import add_vehicle, send
from holdfast.command_line import command_parser

GOTO_EXAMPLES = """\
examples:
  holdfast goto --north 3 --east -1.5 --depth 2       3 m north, 1.5 m west of the origin
  holdfast goto --offset --north 1 --speed 0.1        1 m further north than it is
  holdfast goto --body --forward 2 --right 0.5        as its pilot sees it
  holdfast goto --heading 90                          turn on the spot
  holdfast goto --pitch 20                            hold the bow up by 20 degrees; 0 is level
  holdfast goto --altitude 1.5                        keep 1.5 m over the ground, until --depth

Omitted coordinates stay. north and east need a position source, such as a DVL, and
altitude a rangefinder that looks down. Roll and pitch need a frame that can pitch (vectored_6dof) in MANUAL.
Exit status: 0 under way, 1 refused or no answer, 2 wrong arguments.
"""

FOLLOW_EXAMPLES = """\
examples:
  holdfast follow eight.toml                          a path in metres: docs/guidance.md
  holdfast follow --pause                             wait; --resume goes on, after --hold, goto
                                                      and a fault, too

A stick pauses a path, too.
Exit status: 0 done, 1 refused or no answer, 2 no path.
"""


OPTIONS = {
    "x_m": ("--north", "--forward"),
    "y_m": ("--east", "--right"),
    "depth_m": ("--depth", "--down"),
    "heading_deg": ("--heading",),
    "altitude_m": ("--altitude",),
    "roll_deg": ("--roll",),
    "pitch_deg": ("--pitch",),
    "speed_mps": ("--speed",),
}
"""Options of `goto`, by the field of its command."""


def goto(argv: list[str]) -> int:
    """Send a vehicle to a place; returns 1 if it was not done."""
    parser = command_parser(
        "goto",
        "Sends a vehicle that is engaged to a place in a straight line, and holds it there.",
        GOTO_EXAMPLES,
    )
    add_vehicle(parser)
    fields = fields_of(Goto)
    for name, options in OPTIONS.items():
        field = fields[name]
        parser.add_argument(
            *options, dest=name, type=_finite, metavar=field.unit.replace("°", "deg").upper(), help=field.what
        )
    frame = parser.add_mutually_exclusive_group()
    for name, axes in (("offset", "north, east"), ("body", "forward, right")):
        counted = f"counted from where it is: {axes}, down, and clockwise"
        frame.add_argument(f"--{name}", dest="frame", action="store_const", const=name, help=counted)
    parser.add_argument("--at-once", action="store_const", const=True, help=fields["at_once"].what)
    given = vars(parser.parse_intermixed_args(argv))
    vehicle, connect = given.pop("vehicle"), given.pop("connect")
    what = {key: value for key, value in given.items() if value is not None}
    return send("goto", vehicle, "goto", what, connect)


def follow(argv: list[str]) -> int:
    """Send a vehicle along a path; returns 1 if it was not done."""
    parser = command_parser(
        "follow",
        "Sends a vehicle along the path of a file.",
        FOLLOW_EXAMPLES,
    )
    add_connect(parser)
    parser.add_argument("words", nargs="*", metavar="[VEHICLE] FILE", help="in TOML")
    action = parser.add_mutually_exclusive_group()
    actions = {"pause": "pause it", "resume": "continue it", "hold": "stop and hold here; --resume goes on"}
    for name, purpose in actions.items():
        action.add_argument(f"--{name}", dest="action", action="store_const", const=name, help=purpose)
    options = parser.parse_intermixed_args(argv)
    if not options.words and not options.action:
        parser.error("which FILE? Or --pause, --resume, --hold")
    *vehicle, file = (*options.words, "") if options.action else options.words
    if len(vehicle) > 1:
        parser.error(f"one file, and at most one vehicle before it: {' '.join(options.words)}")
    whom = vehicle[0] if vehicle else None
    if options.action:
        return send("follow", whom, "path", {"action": options.action}, options.connect)
    try:
        path = path_files.read(Path(file))
    except ValueError as error:
        sys.stderr.write(f"holdfast follow: {error}\n")
        return 2
    return send("follow", whom, "follow", {"path": msgspec.to_builtins(path)}, options.connect)


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"{text}: must be a finite number")
    return number
