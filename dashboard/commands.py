"""The dashboard's subcommands. Each is imported when it is called: `holdfast --help` names them all."""

from collections.abc import Callable, Mapping
from importlib import import_module
from types import MappingProxyType


def _command(
    module: str, function: str, purpose: str, given: Mapping[str, object] = MappingProxyType({})
) -> Callable[[list[str]], int]:
    """Return what calls a function of dashboard with the arguments, and with `given`."""

    def command(argv: list[str]) -> int:
        status: int = getattr(import_module(f"dashboard.{module}"), function)(argv, **given)
        return status

    command.__doc__ = purpose
    return command


def _order(name: str, purpose: str, command: str, **what: object) -> Callable[[list[str]], int]:
    order = {"name": name, "purpose": purpose, "command": command, "what": what}
    return _command("terminal.tell", "order", purpose, order)


dashboard = _command("web.command", "main", "Serve a web page with plots, horizon, events and tuning.")
watch = _command("terminal.watch", "main", "Show a vehicle's state in the terminal, live over Zenoh.")
engage = _order("engage", "Let Holdfast take control, and hold the vehicle where it is.", "engage")
release = _order("release", "Give every axis back to the pilot, within a second.", "release")
hold = _order("hold", "Stop a path or a move, and hold the vehicle here.", "path", action="hold")
tell = _command("terminal.tell", "main", "Send a command to a vehicle over Zenoh, and print the answer.")
goto = _command("terminal.move", "goto", "Send a vehicle to a place.")
follow = _command("terminal.move", "follow", "Send a vehicle along the path of a file.")
record = _command("recording.record", "main", "Record everything that a vehicle publishes, as MCAP.")
replay = _command("recording.replay", "main", "Publish a recording over Zenoh again, for a dashboard.")
