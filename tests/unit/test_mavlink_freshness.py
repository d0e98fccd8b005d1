"""What is only late is dropped, and what started anew is noticed."""

from companion.mavlink.freshness import MESSAGES, Freshness
from companion.records import Attitude, Depth, DepthRate, Heartbeat, Reboot
from companion.records.events import Event


def depth(boot_s: float) -> Depth:
    return Depth(0.0, boot_s, 1.0)


def attitude(boot_s: float) -> Attitude:
    return Attitude(0.0, boot_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_news_and_what_has_no_stamp_pass() -> None:
    events: list[Event] = [
        depth(1.0),
        attitude(1.0),
        DepthRate(0.0, None, 0.1),
        Heartbeat(0.0, True, 19, 4),
        depth(1.02),
    ]
    assert Freshness().drop_stale(events) == events


def test_a_repeated_or_overtaken_sample_is_no_news() -> None:
    fresh = Freshness()
    assert fresh.drop_stale([depth(5.0), depth(5.0), depth(4.98), attitude(4.98)]) == [
        depth(5.0),
        attitude(4.98),
    ]


def test_an_absurd_first_stamp_does_not_silence_its_kind_for_ever() -> None:
    fresh = Freshness()
    events: list[Depth | Attitude] = [depth(4e6)]
    events += [event for i in range(100) for event in (depth(5.0 + 0.02 * i), attitude(5.0 + 0.02 * i))]
    assert depth(5.0 + 0.02 * 99) in fresh.drop_stale(events)


def test_stamps_ahead_of_the_clock_are_dropped_unless_they_go_on() -> None:
    fresh = Freshness()
    own = [Attitude(0.02 * i, 5.0 + 0.02 * i, *[0.0] * 6) for i in range(200)]
    twin = [Attitude(0.02 * i, 705.0 + 0.02 * i, *[0.0] * 6) for i in range(200)]
    mixed = [event for pair in zip(own, twin, strict=True) for event in pair]
    assert fresh.drop_stale(mixed) == own  # and the last of the twin counts already
    after = fresh.drop_stale(Attitude(4.0 + 0.02 * i, 905.0 + 0.02 * i, *[0.0] * 6) for i in range(30))
    assert isinstance(after[0], Reboot)
    assert len(after) == 1 + 30 - (MESSAGES - 2)


def test_a_clock_that_stays_back_is_a_reboot() -> None:
    fresh = Freshness()
    fresh.drop_stale([depth(500.0), attitude(500.0)])
    after = fresh.drop_stale(depth(1.0 + 0.02 * i) for i in range(MESSAGES + 5))
    assert isinstance(after[0], Reboot)
    assert after[1:] == [depth(1.0 + 0.02 * i) for i in range(MESSAGES - 1, MESSAGES + 5)]
    assert fresh.drop_stale([attitude(2.0)]) == [attitude(2.0)]


def test_one_kind_with_strange_stamps_is_no_reboot() -> None:
    for strange_s in (3605.0, 0.0):
        fresh = Freshness()
        fresh.drop_stale([depth(5.0), attitude(5.0)])
        both = [(Attitude(t_s, 5.0 + t_s, *[0.0] * 6), Depth(t_s, strange_s, 1.0)) for t_s in TIMES_S]
        assert fresh.drop_stale(event for pair in both for event in pair) == [good for good, _ in both]
        right = [Depth(4.0 + t_s, 9.0 + t_s, 1.0) for t_s in TIMES_S]
        assert fresh.drop_stale(right) == right


def test_a_reboot_is_noticed_though_a_kind_stays_away_after_it() -> None:
    fresh = Freshness()
    for t_s in TIMES_S:
        fresh.drop_stale([Depth(t_s, 500.0 + t_s, 1.0), Attitude(t_s, 500.0 + t_s, *[0.0] * 6)])
    after = fresh.drop_stale(Depth(9.0 + t_s, 1.0 + t_s, 1.0) for t_s in TIMES_S)
    assert isinstance(after[0], Reboot)


TIMES_S = [0.02 * i for i in range(1, 200)]
