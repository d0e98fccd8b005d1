"""The command `holdfast COMMAND`. It imports a package only when one of its commands is called.

A checkout has the other packages beside this one. An installation has them inside it, so that site-packages
gets no `config` or `lab`; importing this package makes them importable.
"""

import os
import re
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import EntryPoint, entry_points, requires
from importlib.metadata import version as version_of
from pathlib import Path
from typing import NoReturn

if (Path(__file__).parent / "companion").is_dir():
    sys.path.insert(0, str(Path(__file__).parent))

ABOUT = """\
Holdfast holds an ArduSub ROV still, or moves it along a path, in currents and waves, with a
pulling tether and an unknown load. It runs on the companion computer and speaks MAVLink. Start with
`holdfast demo`, a simulated dive. `holdfast init` writes a configuration for your vehicle.

  ArduSub, or `holdfast sim`  <-- MAVLink -->  `holdfast run`  -- Zenoh -->  `holdfast watch`
"""

LAB = "`holdfast lab` measures Holdfast in virtual time and improves it: dives, searches, comparisons."

DISTRIBUTION = "holdfast-rov"
"""The name for pip and of the wheels. In the package index `holdfast` is somebody else's project."""


class RefusedError(Exception):
    """What was asked for cannot be begun; the text says in one line what, where and what to do."""


DONE, FAILED, REFUSED, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141
"""Exit statuses: 1 is a bad result, 2 what could not begin (usage, configuration, no such file, no extra)."""


PILOT = (
    "demo", "sim", "fault", "init", "config", "check", "run", "identify", "watch", "dashboard",
    "engage", "release", "hold", "goto", "follow", "tell", "record", "replay", "report", "install",
)  # fmt: skip
"""The commands in the order in which a pilot meets them; others are under `holdfast lab`."""


def commands_by_name() -> dict[str, EntryPoint]:
    """Return the subcommands that the installed packages register, `lab bench` and its like among them."""
    found = {entry.name: entry for entry in entry_points(group="holdfast.commands")}
    return found | {f"lab {entry.name}": entry for entry in entry_points(group="holdfast.lab")}


def summary(entry: EntryPoint) -> str:
    """Return what a command does, in one line."""
    return (entry.load().__doc__ or "").strip().partition("\n")[0]


def _help(commands: dict[str, EntryPoint], names: Sequence[str]) -> str:
    lines = [f"  holdfast {name:<13} {summary(commands[name])}" for name in names]
    return "\n".join([*lines, "`holdfast COMMAND --help` explains each command."])


def main(argv: list[str] | None = None) -> int:
    """Dispatch to the subcommand that a package registered as `holdfast.commands`; return its exit status.

    What a command cannot do becomes one line here: a file that cannot be opened, a missing extra, Ctrl-C, a
    reader of its output that went away.
    """
    arguments = sys.argv[1:] if argv is None else argv
    command = " ".join(arguments[: 2 if arguments[:1] == ["lab"] else 1])
    try:
        status = _dispatch(arguments, command)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the flush at the exit
        return PIPE_CLOSED
    except ModuleNotFoundError as error:
        extra = extra_of(error.name or "", command)
        if not extra:
            raise
        _say(command, f"needs {error.name}. Install the extra: {how_to_install(extra)}")
        return REFUSED
    except RefusedError as error:
        _say(command, str(error))
        return REFUSED
    except OSError as error:
        _say(command, f"{error.filename}: {error.strerror}" if error.filename else str(error))
        return REFUSED if error.filename else FAILED
    return status


def run() -> NoReturn:
    """Run the command of this process, and leave with its exit status.

    Where Zenoh is loaded, the interpreter's own tear-down is skipped: a thread of Zenoh's that asks for the
    GIL just then is unwound through foreign frames, and aborts the process.
    """
    status = main()
    if "zenoh" in sys.modules:
        import logging

        logging.shutdown()
        with suppress(BrokenPipeError):
            sys.stdout.flush()
        os._exit(status)
    sys.exit(status)


def _dispatch(arguments: list[str], command: str) -> int:
    commands = commands_by_name()
    if not arguments or arguments[0] in ("-h", "--help"):
        lab = ", ".join(name.removeprefix("lab ") for name in commands if name not in PILOT)
        sys.stdout.write(
            f"{ABOUT}\n{_help(commands, PILOT)}\nTo measure and improve it: `holdfast lab`: {lab}.\n"
        )
        return DONE
    if arguments[0] in ("-V", "--version"):
        from holdfast.version import about

        sys.stdout.write(about())
        return DONE
    if command == "--print-completion":
        _print_completion(commands, arguments)
    if command in ("lab", "lab -h", "lab --help"):
        sys.stdout.write(f"{LAB}\n\n{_help(commands, [name for name in commands if name not in PILOT])}\n")
        return DONE
    if command not in commands:
        known = ", ".join(PILOT)
        raise RefusedError(f"there is no command '{command}'. Known: {known}. See `holdfast --help`.")
    status: int = commands[command].load()(arguments[len(command.split()) :])
    return status


def _print_completion(commands: dict[str, EntryPoint], arguments: list[str]) -> NoReturn:
    """Print what makes a shell complete commands, and end."""
    import argparse

    import shtab

    parser = argparse.ArgumentParser(prog="holdfast")
    names = parser.add_subparsers()
    for name in PILOT:
        names.add_parser(name, help=summary(commands[name]), add_help=False)
    shtab.add_argument_to(parser)
    parser.parse_args(arguments)
    raise AssertionError("shtab ends the process")


def _say(command: str, what: str) -> None:
    sys.stderr.write(f"holdfast {command}: {what}\n")


def own_version() -> str:
    """Return the version of this installation."""
    return version_of(DISTRIBUTION)


def port_taken(kind: str, port: int) -> str:
    """Return what to do where a "udp" or "tcp" port is taken."""
    return (
        f"{kind} port {port} is taken by another process, which `sudo ss -{kind[0]}lnp sport = :{port}` "
        "names; end that, or choose another port"
    )


def how_to_install(extra: str) -> str:
    """Return the command that adds an extra to this installation."""
    return f"{sys.executable} -m pip install '{DISTRIBUTION}[{extra}]'"


def extra_of(module: str, command: str) -> str:
    """Return the extra that brings a module: of several the command's, its package's, or the smallest.

    An extra that includes another one lists all of its modules too. "" if none brings it.
    """
    line = re.compile(r"""([\w-]+?)(?:-sdk)?(?![\w-]).*; extra == ["'](\w+)["']""")
    every = [match.groups() for text in requires(DISTRIBUTION) or () if (match := line.match(text))]
    sizes = Counter(extra for _, extra in every)
    found = sorted(
        (extra for brought, extra in every if brought == module.partition(".")[0]), key=sizes.__getitem__
    )
    entry = commands_by_name().get(command)
    likely = (command, entry.module.partition(".")[0] if entry else "", *found)
    return next((extra for extra in likely if extra in found), "")
