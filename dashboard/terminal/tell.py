"""`holdfast tell`, `engage`, `release`, `hold`: a command to one vehicle, and what it answers."""

import argparse
import sys
import textwrap
from collections.abc import Mapping
from typing import Any

import msgspec

from companion.telemetry import schemas as telemetry
from companion.telemetry.fields import fields_of
from companion.telemetry.glossary import whole
from companion.telemetry.operator_commands import COMMANDS
from companion.telemetry.schemas import printable
from dashboard.arguments import PATIENCE_S, add_connect
from dashboard.whom import heard, wait
from dashboard.zenoh_client import Subscription
from holdfast.command_line import command_parser

KNOWN = (*COMMANDS, "config")

HEAD = "commands and their fields (the vehicle answers with the values that are now in force):"
EXAMPLES = """\
  config                  Print the present settings; needs no permission.

examples:
  holdfast tell goto depth_m=5 heading_deg=90         move to a depth and a heading
  holdfast tell gains axis=heave kappa_per_s=8        change one gain
  holdfast tell config                                print the present settings
  holdfast tell kelp clear_fault                      to the one that is called kelp

By default a companion accepts commands only from its own machine; commands over a network need `holdfast run
--allow-control`. The supervisor decides on every command.
Exit status: 0 done, 1 refused or no answer.
"""


ORDER_EXAMPLES = """\
examples:
  holdfast {name}
  holdfast {name} kelp                                the one that is called kelp

VEHICLE may be left out where one vehicle is heard. The supervisor decides on every command.
Exit status: 0 done, 1 refused or no answer.
"""


def main(argv: list[str]) -> int:
    """Run `holdfast tell`; returns 1 if it was not done."""
    parser = command_parser(
        "tell", "Sends a command to a vehicle over Zenoh, and prints the answer.", _epilog()
    )
    add_connect(parser)
    about = "see the list below; `holdfast watch` shows the names of vehicles"
    parser.add_argument("words", nargs="+", metavar="[VEHICLE] COMMAND [KEY=VALUE ...]", help=about)
    options = parser.parse_args(argv)
    words: list[str] = options.words
    vehicle = words.pop(0) if words[0] not in KNOWN and len(words) > 1 else None
    command, *fields_given = words
    try:
        if command not in KNOWN:
            raise ValueError(f"there is no command '{command}'. Known: {', '.join(KNOWN)}")
        what = dict(_pair(text) for text in fields_given)
    except ValueError as error:
        sys.stderr.write(f"holdfast tell: {error}\n")
        return 2
    return send("tell", vehicle, command, what, options.connect)


def order(argv: list[str], name: str, purpose: str, command: str, what: Mapping[str, object]) -> int:
    """Run a command of one word, such as `holdfast release`; returns 1 if it was not done."""
    parser = command_parser(name, purpose, ORDER_EXAMPLES.format(name=name))
    add_vehicle(parser)
    options = parser.parse_args(argv)
    return send(name, options.vehicle, command, what, options.connect)


def send(program: str, vehicle: str | None, command: str, what: Mapping[str, object], connect: str) -> int:
    """Send a command and print the answer; return 1 if it was not done, 2 for what can be no command.

    Without a vehicle's name it is the only one that is heard.
    """
    try:
        if vehicle is not None:
            telemetry.key(vehicle, "command", command)  # raises ValueError for what can be no name
        with Subscription("holdfast/*/alive/none", connect) as seen:  # nothing comes there: it only asks
            if not wait(lambda: seen.connected, PATIENCE_S):
                sys.stderr.write(
                    f"holdfast {program}: nobody listens on {connect}. Start `holdfast run`, or "
                    "give its address with --connect.\n"
                )
                return 1
            guessed = ""
            if vehicle is None:
                vehicle = _only_one(seen)
                guessed = f" by {printable(vehicle)}"
            if command == "config":
                return _config(seen, vehicle)
            reply = seen.tell(vehicle, command, what)
    except ValueError as error:
        sys.stderr.write(f"holdfast {program}: {error}\n")
        return 2
    sys.stdout.write(
        f"{'done' if reply.done else 'NOT done'}{guessed}: {whole(printable(reply.said), vehicle, connect)}\n"
    )
    for name, value in reply.value.items():
        if what and name not in what:
            continue
        sys.stdout.write(f"  {printable(name)} = {whole(printable(_shown(value)), vehicle, connect)}\n")
    return 0 if reply.done else 1


def add_vehicle(parser: argparse.ArgumentParser) -> None:
    """Add who is told, and where it is found."""
    about = "its name, if more than one vehicle is heard"
    parser.add_argument("vehicle", nargs="?", metavar="VEHICLE", help=about)
    add_connect(parser)


def _only_one(seen: Subscription) -> str:
    """Return the name of the vehicle whose companion runs; raise ValueError if none or several do."""
    names = heard(seen, PATIENCE_S)
    if len(names) != 1:
        raise ValueError(f"which vehicle? {seen.others()}; name it")
    return names.pop()


def _epilog() -> str:
    """Return the list of commands, made from their payloads, and the examples."""
    lines = [HEAD]
    for name, kind in COMMANDS.items():
        purpose = (kind.__doc__ or "").partition("\n")[0]
        lines += textwrap.wrap(f"{name:22}  {purpose}", 106, initial_indent="  ", subsequent_indent=" " * 26)
        taken = "  ".join(f"{name}={'|'.join(field.choices)}" for name, field in fields_of(kind).items())
        lines += textwrap.wrap(taken, 80, initial_indent=" " * 26, subsequent_indent=" " * 26)
    return "\n".join([*lines, EXAMPLES])


def _config(seen: Subscription, vehicle: str) -> int:
    answer = seen.ask(telemetry.key(vehicle, "config"))
    if answer is None:
        sys.stderr.write(f"holdfast tell: nobody answers for '{vehicle}'; {seen.others()}\n")
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
