"""A short run of the semantic fuzzer; `python -m tests.tools.fuzz_engine` runs as long as one likes."""

from tools.fuzz_engine import DIVE_TICKS, Tally, fuzz

from companion.records import State

DIVES = 4


def test_nothing_that_is_heard_ordered_or_configured_breaks_a_promise() -> None:
    """6 000 ticks; `fuzz` raises, and its dive's number repeats it."""
    tally = Tally()
    for number in range(1, 1 + DIVES):
        fuzz(number, tally)
    assert tally.ticks == DIVES * DIVE_TICKS
    assert tally.states[State.ACTIVE] > 50
    assert tally.answers["done"] > 0
    assert tally.answers["refused"] > 0
    assert tally.paths > 10
