"""Both delays from synthetic clocks. Only their sum can destabilise, so only their sum has to be right."""

import numpy as np
import pytest

from companion.estimation.delay import SLEW, DelayMeter

BOOT_S = -812.5
"""Autopilot's clock minus ours."""

TICK_S, ECHO_S = 0.02, 0.04
AXES = np.array([0.3, -0.2, 0.5, 0.4])


def meter():
    return DelayMeter(0.010, 0.012)


def synced():
    """A meter that knows the clocks' offset, so that an echo can be placed."""
    m = meter()
    exchange(m, 0.01, 0.01, seconds=1.0)
    return m


BEFORE_ECHO_S = 0.012 + 0.01
"""What `synced` takes for the command delay: the configured one, and half of the round trip."""


def exchange(meter, up_s, down_s, seconds=8.0, jitter_s=0.0, seed=1, start_s=1000.0):
    """TIMESYNC at 4 Hz and attitude at 50 Hz through a link with these delays."""
    rng = np.random.default_rng(seed)

    def late(delay_s):
        return delay_s + (rng.exponential(jitter_s) if jitter_s else 0.0)

    for k in range(round(seconds / TICK_S)):
        now_s = start_s + k * TICK_S
        meter.stamped(now_s + late(up_s), now_s + BOOT_S)
        if k % 12 == 0:
            reached_s = now_s + late(down_s)
            meter.timesync(now_s, reached_s + late(up_s), reached_s + BOOT_S)
    return start_s + seconds


def command(t_s):
    """Some steering that never repeats itself within the lags looked at."""
    wave = np.sin(2.3 * t_s) + np.sin(7.1 * t_s + 1.0) + 0.5 * np.sin(17.0 * t_s)
    return 0.2 * wave * AXES


def steer(
    meter,
    delay_s,
    seconds=12.0,
    start_s=1000.0,
    ahead_s=3.0,
    commands=command,
    noise=0.0,
    seed=2,
    seen=lambda axes: axes,
):
    """Commands every tick from `ahead_s` before the first echo; the motors follow `delay_s` later.

    Their echo is stamped at its own pace.
    """
    rng = np.random.default_rng(seed)
    sent_t = start_s - ahead_s + np.arange(round((seconds + ahead_s) / TICK_S)) * TICK_S
    sent = np.array([commands(t) for t in sent_t])
    known = 0
    for t_s in np.arange(start_s, start_s + seconds, ECHO_S):
        at_s = t_s + rng.uniform(0.0, ECHO_S)
        index = max(np.searchsorted(sent_t, at_s - delay_s, side="right") - 1, 0)
        while known < len(sent_t) and sent_t[known] <= at_s + 0.02:
            meter.sent(sent_t[known], tuple(sent[known]))
            known += 1
        axes = seen(sent[index]) + noise * rng.normal(size=4)
        meter.echo(at_s + meter.clock.offset_s, tuple(axes))
    return start_s + seconds


@pytest.mark.parametrize(("up_s", "down_s"), [(0.05, 0.05), (0.08, 0.0), (0.0, 0.08), (0.03, 0.09)])
def test_the_sum_is_right_when_the_ways_differ(up_s, down_s):
    """An echo's stamp is read with the same offset: what one delay loses the other gains."""
    m = meter()
    end_s = exchange(m, up_s, down_s)
    moved_s = m.clock.offset_s - BOOT_S
    assert m.delays().telemetry_s == pytest.approx(up_s + moved_s, abs=1e-4)
    assert m.delays().telemetry_known
    assert up_s != down_s or moved_s == pytest.approx(0.0, abs=1e-6)
    actuation_s = 0.05
    steer(m, down_s + actuation_s - moved_s, start_s=end_s)
    total = m.delays().telemetry_s + m.delays().command_s
    assert total == pytest.approx(up_s + down_s + actuation_s, abs=0.006)


@pytest.mark.parametrize("lag_s", [0.0, 0.013, 0.15, 0.37])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_echos_lag_is_found_within_five_milliseconds(lag_s, noise):
    m = synced()
    steer(m, lag_s, noise=noise)
    assert m.delays().command_known
    assert m.delays().command_s == pytest.approx(lag_s, abs=0.005)


def test_before_an_echo_a_long_way_is_known_by_its_round_trip():
    m = meter()
    exchange(m, 0.05, 0.03, jitter_s=0.002)
    assert not m.delays().command_known
    assert m.delays().command_s == pytest.approx(0.012 + 0.04, abs=0.002)
    steer(m, 0.06)
    exchange(m, 0.05, 0.03, seconds=1.0, start_s=1020.0)
    assert m.delays().command_s == pytest.approx(0.06, abs=0.005)  # an echo knows better


def test_a_longer_way_is_followed_without_an_echo_and_without_a_jump():
    m = meter()
    exchange(m, 0.03, 0.03)
    end_s = steer(m, 0.04)
    moved = []
    for k in range(16):
        exchange(m, 0.08, 0.08, seconds=0.25, start_s=end_s + 0.25 * k)
        moved.append(m.delays().command_s)
    assert max(np.diff([0.04, *moved])) <= 0.5 * SLEW
    assert moved[-1] == pytest.approx(0.08, abs=0.005)


@pytest.mark.parametrize("period_s", [0.04, 0.1, 0.16, 0.3])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("bend", [np.sin, lambda phase: np.sign(np.sin(phase + 0.1))])
def test_a_command_that_repeats_itself_teaches_nothing_false(period_s, noise, bend):
    """A limit cycle fits its echo at every period: 15 ms were taken for 115 or 165."""
    m = synced()
    steer(m, 0.015, commands=lambda t: 0.3 * bend(2.0 * np.pi * t / period_s) * AXES, noise=noise)
    assert m.delays().command_s == pytest.approx(0.015, abs=0.008)


@pytest.mark.parametrize(("lag_s", "found_s"), [(0.3, 0.06), (0.0, 0.01), (0.03, 0.03)])
def test_what_the_echo_says_is_bounded_by_what_timesync_allows(lag_s, found_s):
    """10 ms to the autopilot, 20 ms of its input loop, 30 ms beside."""
    m = synced()
    end_s = 1001.0
    for k in range(48):
        exchange(m, 0.01, 0.01, seconds=0.25, start_s=end_s)
        end_s = steer(m, lag_s, start_s=end_s, seconds=0.25, ahead_s=0.0 if k else 3.0)
    assert m.delays().command_s == pytest.approx(found_s, abs=0.005)


def test_an_echo_of_somebody_else_changes_nothing():
    """Motors that do what nobody asked for: no lag fits, the start value stays."""
    m, rng = synced(), np.random.default_rng(3)
    sent_t = 1000.0 + np.arange(500) * TICK_S
    sent = np.array([command(t) for t in sent_t])
    for t_s, axes in zip(sent_t, sent, strict=True):
        m.sent(t_s, tuple(axes))
        m.echo(t_s + m.clock.offset_s, tuple(0.1 * rng.normal(size=4)))
    assert m.delays().command_s == pytest.approx(BEFORE_ECHO_S)


def pushes(t_s):
    """A push and a rest by turns: at rest whatever does not move is like what was sent."""
    return 0.4 * max(np.sin(2.0 * np.pi * t_s / 1.3), 0.0) * AXES


@pytest.mark.parametrize("commands", [command, pushes])
@pytest.mark.parametrize(
    "seen",
    [lambda axes: 0.0 * axes, lambda axes: 0.0 * axes + 0.1, lambda axes: axes[[2, 3, 0, 1]]],
    ids=["no pulses", "stands still", "of other motors"],
)
def test_an_echo_that_does_not_move_with_the_commands_is_none(seen, commands):
    m = synced()
    steer(m, 0.022, commands=commands, seen=seen)
    assert not m.delays().command_known
    assert m.delays().command_s == pytest.approx(BEFORE_ECHO_S)


@pytest.mark.parametrize("commands", [command, pushes])
def test_an_echo_that_is_a_tenth_weaker_is_one(commands):
    m = synced()
    steer(m, 0.04, commands=commands, seen=lambda axes: 0.9 * axes)
    assert m.delays().command_known
    assert m.delays().command_s == pytest.approx(0.04, abs=0.006)


@pytest.mark.parametrize(("before_s", "after_s"), [(0.04, 0.12), (0.15, 0.03)])
def test_a_changed_command_delay_is_found(before_s, after_s):
    m = synced()
    end_s = steer(m, before_s)
    assert m.delays().command_s == pytest.approx(before_s, abs=0.005)
    steer(m, after_s, start_s=end_s, seconds=20.0, ahead_s=0.0)
    assert m.delays().command_s == pytest.approx(after_s, abs=0.005)


def test_a_clock_that_was_set_anew_is_believed_by_its_second_answer():
    meter = DelayMeter(0.01, 0.012)
    for k in range(40):
        meter.timesync(1000.0 + k * 0.25, 1000.0 + k * 0.25 + 0.01, k * 0.25 + 0.005 + 500.0)
    late_s = 1000.0 + 20.0
    meter.timesync(late_s, late_s + 0.8, 20.0 + 0.7 + 500.0)  # slow, but its round trip explains it
    assert meter.clock.offset_s == pytest.approx(500.0 - 1000.0, abs=1e-6)
    assert meter.clock.doubt_s(late_s + 0.9) == 0.0
    meter.timesync(late_s + 1.0, late_s + 1.03, 3.0)
    assert meter.clock.offset_s == pytest.approx(500.0 - 1000.0, abs=1e-6)
    assert meter.clock.doubt_s(late_s + 1.2) == pytest.approx(0.17)
    meter.timesync(late_s + 1.25, late_s + 1.28, 3.25)
    assert meter.clock.offset_s == pytest.approx(3.0 - late_s - 1.015, abs=1e-6)
    assert meter.clock.doubt_s(late_s + 1.28) == 0.0


def test_a_second_answer_to_one_question_narrows_nothing():
    """Who read the question off the wire answers as well: 20 ms of the way would be left of 60."""
    m = meter()
    for k in range(40):
        t_s = 1000.0 + 0.25 * k
        m.timesync(t_s, t_s + 0.12, t_s + 0.06 + BOOT_S)
        m.timesync(t_s, t_s + 0.121, t_s + 0.101 + BOOT_S)
        m.timesync(t_s, t_s + 0.122, t_s + 0.02 + BOOT_S)
    assert m.clock.offset_s == pytest.approx(BOOT_S, abs=1e-6)


def test_a_clock_that_runs_slow_is_followed_and_does_not_pass_for_two():
    """A simulator on a busy machine: its clock loses a tenth."""
    m, doubts = meter(), []
    for k in range(100):
        t_s = 1000.0 + 0.25 * k
        m.timesync(t_s, t_s + 0.01, 0.9 * 0.25 * k + 0.005)
        doubts.append(m.clock.doubt_s(t_s + 0.01))
    assert m.clock.offset_s == pytest.approx(0.9 * 0.25 * 99 - t_s, abs=0.1)
    assert max(doubts) < 0.6
