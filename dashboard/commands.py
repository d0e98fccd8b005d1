"""What the dashboard adds to the front door."""


def watch(argv: list[str]) -> int:
    """Show a vehicle's state in the terminal, live over Zenoh."""
    from dashboard.watch import main

    return main(argv)


def tell(argv: list[str]) -> int:
    """Give a vehicle a command over Zenoh, and say what came of it."""
    from dashboard.tell import main

    return main(argv)
