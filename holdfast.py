"""The front door: `holdfast COMMAND`. Imports no room before one of its commands is called."""

import sys
from importlib.metadata import EntryPoint, entry_points, version

ABOUT = """\
Holdfast holds an ArduSub ROV still, or on a path, against currents, waves, a tugging
tether and an unweighed load. It runs on the companion computer, reads depth and attitude
over MAVLink, and answers with thrust: a Lyapunov-based law for each degree of freedom,
and a small neural network that learns the disturbance while it dives.

  ArduSub, or `holdfast sim`  <-- MAVLink -->  `holdfast run`  -- Zenoh -->  `holdfast watch`

Start with `holdfast demo`: a dive in the simulator, on this machine, in about a minute.
"""


def _commands() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group="holdfast.commands")}


def _help(commands: dict[str, EntryPoint]) -> str:
    lines = [ABOUT]
    room = ""
    for entry in sorted(commands.values(), key=lambda entry: (entry.module, entry.name)):
        if entry.module.partition(".")[0] != room:
            room = entry.module.partition(".")[0]
            lines.append(f"{room}:")
        summary = (entry.load().__doc__ or "").strip().partition("\n")[0]
        lines.append(f"  holdfast {entry.name:<11} {summary}")
    lines.append("\n`holdfast COMMAND --help` explains each.")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """Dispatch to the subcommand that a room registered as `holdfast.commands`; return its exit status."""
    arguments = sys.argv[1:] if argv is None else argv
    commands = _commands()
    if not arguments or arguments[0] in ("-h", "--help"):
        sys.stdout.write(_help(commands) + "\n")
        return 0
    name, *rest = arguments
    if name == "--version":
        sys.stdout.write(f"holdfast {version('holdfast')}\n")
        return 0
    if name not in commands:
        known = ", ".join(sorted(commands))
        sys.stderr.write(f"holdfast: there is no command '{name}'. Known: {known}. See `holdfast --help`.\n")
        return 2
    status: int = commands[name].load()(rest)
    return status


if __name__ == "__main__":
    sys.exit(main())
