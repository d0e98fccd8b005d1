"""`holdfast tell`: one command to one vehicle from a terminal, and the vehicle's own words about it."""

import argparse
import sys
import textwrap
import time
from collections.abc import Mapping
from typing import Any

import msgspec

from companion.telemetry import schemas as telemetry
from companion.telemetry.commands import COMMANDS, RECORDER_COMMANDS, fields
from companion.telemetry.schemas import printable
from dashboard.arguments import add_connect
from dashboard.zenoh_client import Subscription
from holdfast.arguments import command_parser

PATIENCE_S = 5.0

KNOWN = (*COMMANDS, *RECORDER_COMMANDS, "config")

HEAD = "commands and their fields (the vehicle answers with the values that are now in force):"
EXAMPLES = """\
  config                  Print the present settings; needs no permission.

examples:
  holdfast tell bluerov2 engage                                take control, and hold
  holdfast tell bluerov2 setpoint depth_m=5 heading_deg=90     move to a depth and a heading
  holdfast tell bluerov2 gains axis=heave kappa_per_s=8        change one gain
  holdfast tell bluerov2 config                                print the present settings

By default a companion accepts commands only from its own machine; commands over a network need `holdfast run
--allow-control`. The supervisor decides on every command.
Exit status: 0 done, 1 refused or no answer.
"""


def main(argv: list[str]) -> int:
    """Run the command; returns 1 if it was not done."""
    options = _parser().parse_args(argv)
    try:
        what = dict(_pair(text) for text in options.what)
        if options.command not in KNOWN:
            raise ValueError(f"there is no command '{options.command}'. Known: {', '.join(KNOWN)}")
    except ValueError as error:
        sys.stderr.write(f"holdfast tell: {error}\n")
        return 2
    return send("tell", options.vehicle, options.command, what, options.connect)


def send(program: str, vehicle: str, command: str, what: Mapping[str, object], connect: str) -> int:
    """Send a command and print the answer; return 1 if it was not done, 2 for what can be no command."""
    try:
        key = telemetry.command_key(vehicle, command)
        with Subscription(key, connect) as seen:
            until_s = time.monotonic() + PATIENCE_S
            while not seen.connected and time.monotonic() < until_s:
                time.sleep(0.02)
            if not seen.connected:
                sys.stderr.write(
                    f"holdfast {program}: nobody listens on {connect}. Start `holdfast run`, or "
                    "give its address with --connect.\n"
                )
                return 1
            if command == "config":
                return _config(seen, vehicle)
            reply = seen.tell(vehicle, command, what)
    except ValueError as error:
        sys.stderr.write(f"holdfast {program}: {error}\n")
        return 2
    sys.stdout.write(f"{'done' if reply.done else 'NOT done'}: {printable(reply.said)}\n")
    for name, value in reply.value.items():
        if what and name not in what:
            continue
        sys.stdout.write(f"  {printable(name)} = {printable(_shown(value))}\n")
    return 0 if reply.done else 1


def add_vehicle(parser: argparse.ArgumentParser) -> None:
    """Add who is told, and where it is found."""
    parser.add_argument(
        "vehicle", metavar="VEHICLE", help="name of the vehicle; `holdfast watch` shows the names"
    )
    add_connect(parser)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "tell",
        "Sends a command to a vehicle over Zenoh, and prints the answer.",
        _epilog(),
    )
    add_vehicle(parser)
    parser.add_argument("command", metavar="COMMAND", help="see the list below")
    parser.add_argument("what", nargs="*", default=[], metavar="KEY=VALUE", help="fields of the command")
    return parser


def _epilog() -> str:
    """Return the list of commands, made from their payloads, and the examples."""
    lines = [HEAD]
    for name, kind in (COMMANDS | RECORDER_COMMANDS).items():
        purpose = (kind.__doc__ or "").partition("\n")[0]
        lines += textwrap.wrap(f"{name:22}  {purpose}", 106, initial_indent="  ", subsequent_indent=" " * 26)
        taken = "  ".join(f"{field.name}={'|'.join(field.choices)}" for field in fields(kind))
        lines += textwrap.wrap(taken, 80, initial_indent=" " * 26, subsequent_indent=" " * 26)
    return "\n".join([*lines, EXAMPLES])


def _config(seen: Subscription, vehicle: str) -> int:
    answer = seen.ask(telemetry.config_key(vehicle))
    if answer is None:
        sys.stderr.write(f"holdfast tell: nobody answered for '{vehicle}'\n")
        return 1
    shown = msgspec.json.format(answer).decode(errors="replace")
    sys.stdout.write("".join(f"{printable(line)}\n" for line in shown.split("\n")))
    return 0


def _pair(text: str) -> tuple[str, Any]:
    """Take KEY=VALUE apart; a value that is no JSON is a word."""
    key, equals, value = text.partition("=")
    if not equals or not key:
        raise ValueError(f"'{text}': write it as KEY=VALUE, such as depth_m=5")
    try:
        return key, msgspec.json.decode(value)
    except msgspec.MsgspecError:
        return key, value


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
