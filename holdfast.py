"""The command `holdfast COMMAND`. It imports a package only when one of its commands is called."""

import sys
from importlib.metadata import EntryPoint, entry_points, version

ABOUT = """\
Holdfast keeps an ArduSub ROV at a setpoint or on a path, against currents, waves, the
pull of a tether and an unknown load. It runs on the companion computer, reads depth and
attitude over MAVLink, and sends thrust commands. Each degree of freedom has a
Lyapunov-based law; a small neural network estimates the disturbance on-line.

  ArduSub, or `holdfast sim`  <-- MAVLink -->  `holdfast run`  -- Zenoh -->  `holdfast watch`

Start with `holdfast demo`: a simulated dive on this machine, in about a minute.
"""


def _commands() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group="holdfast.commands")}


def _help(commands: dict[str, EntryPoint]) -> str:
    lines = [ABOUT]
    package = ""
    for entry in sorted(commands.values(), key=lambda entry: (entry.module, entry.name)):
        if entry.module.partition(".")[0] != package:
            package = entry.module.partition(".")[0]
            lines.append(f"{package}:")
        summary = (entry.load().__doc__ or "").strip().partition("\n")[0]
        lines.append(f"  holdfast {entry.name:<11} {summary}")
    lines.append("\n`holdfast COMMAND --help` explains each command.")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """Dispatch to the subcommand that a package registered as `holdfast.commands`; return its exit status."""
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
