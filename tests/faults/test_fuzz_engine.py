"""A short run of the semantic fuzzer; `python -m tests.tools.fuzz_engine` runs as long as one likes."""

from collections import Counter

import pytest
from tools.fuzz_engine import DIVE_TICKS, Tally, fuzz

from companion.records import State

DIVES = 2


@pytest.mark.parametrize("first", [1, 101, 201, 301])
def test_no_sequence_of_messages_breaks_a_promise(first: int) -> None:
    """12 000 ticks in all; `fuzz` raises, and its dive's number repeats it."""
    tally, states = Tally(), Counter[State]()
    for number in range(first, first + DIVES):
        fuzz(number, tally, states)
    assert tally.ticks == DIVES * DIVE_TICKS
    assert states[State.ACTIVE] > 50
