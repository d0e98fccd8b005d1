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
