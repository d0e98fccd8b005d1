"""What the dashboard adds to the front door."""


def watch(argv: list[str]) -> int:
    """Show a vehicle's state in the terminal, live over Zenoh."""
    from dashboard.watch import main

    return main(argv)
