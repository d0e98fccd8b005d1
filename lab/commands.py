"""What `holdfast` can do with both rooms at once. Imports nothing heavy before a command is called."""

import sys


def demo(argv: list[str]) -> int:
    """Watch one dive twice, without and with the learning compensator: table and picture in a minute."""
    del argv
    sys.stderr.write("holdfast demo: being built\n")
    return 1


def bench(argv: list[str]) -> int:
    """Measure what a tick costs, how late it comes, and how fast virtual time runs."""
    del argv
    sys.stderr.write("holdfast bench: being built\n")
    return 1
