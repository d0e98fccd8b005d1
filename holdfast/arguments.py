"""The parser that every command begins with."""

import argparse
import textwrap


def command_parser(command: str, description: str, examples: str) -> argparse.ArgumentParser:
    """Make the parser of a command; its help ends with `examples`, as they stand."""
    return argparse.ArgumentParser(
        prog=f"holdfast {command}",
        description=textwrap.fill(description, 100),
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
