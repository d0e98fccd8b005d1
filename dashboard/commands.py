"""The dashboard's subcommands."""

import sys


def watch(argv: list[str]) -> int:
    """Show a vehicle's state in the terminal, live over Zenoh."""
    from dashboard.terminal.watch import main

    return main(argv)


def dashboard(argv: list[str]) -> int:
    """Serve a web page with plots, horizon, events and tuning."""
    from dashboard.web.options import settings

    try:
        wanted = settings(argv)
    except ValueError as error:
        sys.stderr.write(f"holdfast dashboard: {error}\n")
        return 2
    from dashboard.web.app import main

    return main(wanted)


def engage(argv: list[str]) -> int:
    """Let Holdfast take control, and hold the vehicle where it is."""
    from dashboard.terminal.tell import order

    return order("engage", "Takes control of the vehicle, and holds it where it is.", argv, "engage")


def release(argv: list[str]) -> int:
    """Give every axis back to the pilot, at once."""
    from dashboard.terminal.tell import order

    return order("release", "Gives every axis back to the pilot, at once.", argv, "release")


def hold(argv: list[str]) -> int:
    """Stop a path or a move, and hold the vehicle here."""
    from dashboard.terminal.tell import order

    purpose = "Stops a path or a move, and holds the vehicle here; `holdfast follow --resume` goes on."
    return order("hold", purpose, argv, "path", {"action": "hold"})


def tell(argv: list[str]) -> int:
    """Send a command to a vehicle over Zenoh, and print the answer."""
    from dashboard.terminal.tell import main

    return main(argv)


def goto(argv: list[str]) -> int:
    """Send a vehicle to a place."""
    from dashboard.terminal.move import goto

    return goto(argv)


def follow(argv: list[str]) -> int:
    """Send a vehicle along the path of a file."""
    from dashboard.terminal.move import follow

    return follow(argv)


def record(argv: list[str]) -> int:
    """Record everything that a vehicle publishes, as MCAP."""
    from dashboard.recording.record import main

    return main(argv)


def replay(argv: list[str]) -> int:
    """Publish a recording over Zenoh again, for a dashboard."""
    from dashboard.recording.replay import main

    return main(argv)
