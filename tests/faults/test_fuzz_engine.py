"""A short run of the semantic fuzzer; `python -m tests.tools.fuzz_engine` runs as long as one likes."""

import sys
from itertools import pairwise
from random import Random

import pytest
from tools.fuzz_engine import (
    DIVE_TICKS,
    KINDS,
    VEHICLE,
    Fuzzed,
    Tally,
    frame,
    frozen,
    fuzz,
    main,
    opened,
    stutters,
)

from companion.config import load_config
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


ATTITUDE = KINDS[30]


def heard(spoil, seconds=8.0):
    """The attitudes that come of 50 a second whose six values all move: (time, stamp, values)."""
    out = []
    for tick in range(round(50 * seconds)):
        sent = frame(ATTITUDE, [20 * tick, *(0.01 * tick + n for n in range(6))], VEHICLE)
        for t_ns, data in spoil(0.02 * tick, [(20_000_000 * tick, sent)]):
            known = opened(data)
            assert known is not None
            kind, (stamp, *values) = known
            assert kind is ATTITUDE
            out.append((t_ns / 1e9, stamp / 1e3, values))
    return out


def test_signals_stand_still_under_fresh_stamps():
    still = 0
    dive = Fuzzed(Random(1), load_config(), Tally())
    for number in range(60):
        came = heard(frozen(Random(number), dive), 1.0)
        assert [stamp for _, stamp, _ in came] == pytest.approx([0.02 * tick for tick in range(50)])
        moved = [len({values[n] for *_, values in came}) for n in range(6)]
        still += 1 in moved
    assert still > 5


def test_streams_fall_silent_and_come_again():
    """What comes is what was sent; some streams pause for about a second again and again."""
    again, dive = 0, Fuzzed(Random(1), load_config(), Tally())
    for number in range(60):
        came = heard(stutters(Random(number), dive))
        assert all(t_s == pytest.approx(stamp_s) for t_s, stamp_s, _ in came)
        times = [t_s for t_s, *_ in came]
        again += sum(0.3 < after - before < 2.0 for before, after in pairwise(times)) > 2
    assert again > 3


def test_it_says_how_many_ticks_it_did(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["fuzz_engine", "--ticks", "1000", "--first", "3"])
    assert main() == 0
    assert capsys.readouterr().out.startswith(f"{DIVE_TICKS} ticks in 1 dives, 0 break a promise; ")
