"""Bytes gone bad: garbage, doubles, disorder, flipped bits; a reboot. test_absurd_values.py has numbers."""

import numpy as np
import pytest
from virtual import DEPTH_M, active, shared

from companion.records import Condition, Request, State
from lab.loop.lockstep import START_S


def arrival(t_s):
    return round((START_S + t_s) * 1e9)


def still_holds(dive, within_m=0.12):
    """It went on holding all the time, and is where it should be."""
    assert dive.state is State.ACTIVE
    assert abs(dive.step.truth.eta[2] - DEPTH_M) < within_m


@shared
def arrived(**arguments):
    dive = active(seconds=6.0, **arguments)
    still_holds(dive)
    return dive


def garbage(dive, rng):
    def spoil(t_s, inbox):
        junk = rng.integers(0, 256, rng.integers(1, 300), dtype=np.uint8).tobytes()
        return [(arrival(t_s), junk), *inbox, (arrival(t_s), b"\xfd" + junk)]

    dive.tap.spoil = spoil


def flipped_bits(dive, rng):
    def flip(data):
        spoilt = bytearray(data)
        spoilt[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        return bytes(spoilt)

    dive.tap.spoil = lambda t_s, inbox: [
        (at, flip(data) if rng.random() < 0.3 else data) for at, data in inbox
    ]


def doubled(dive, rng):
    dive.fault("link_duplicating", value=0.7)


def lossy(dive, rng):
    """With the dive's seed: three heartbeats in a row, one dive in forty, are a lost link."""
    dive.fault("link_lossy", value=0.2)


def out_of_order(dive, rng):
    """Held back by up to 80 ms, each for itself; arrival stamps are those of their real arrival."""
    waiting: list[tuple[float, bytes]] = []

    def shuffle(t_s, inbox):
        waiting.extend((t_s + 0.08 * rng.random(), data) for _, data in inbox)
        here = [item for item in waiting if item[0] <= t_s]
        waiting[:] = [item for item in waiting if item[0] > t_s]
        rng.shuffle(here)
        return [(arrival(t_s), data) for _, data in here]

    dive.tap.spoil = shuffle


@pytest.mark.parametrize(
    "act", [garbage, flipped_bits, doubled, lossy, out_of_order], ids=lambda act: act.__name__
)
def test_bytes_gone_bad_are_borne(act):
    dive = arrived(seed=3)
    act(dive, np.random.default_rng(4))
    dive.run(5.0)
    still_holds(dive)
    assert act is not garbage or dive.step.sample.counters.garbage >= 300


@pytest.mark.parametrize("late_s", [0.02, 0.3, 1.5])
def test_every_datagram_a_second_time_by_a_longer_way_changes_nothing(late_s):
    """The climb rate has no stamp: its late copies took the vehicle 0.2 m away."""
    dive = arrived()
    waiting: list[tuple[float, bytes]] = []

    def copied(t_s, inbox):
        waiting.extend((t_s + late_s, data) for _, data in inbox)
        late = [data for at_s, data in waiting if at_s <= t_s]
        del waiting[: len(late)]
        return [*inbox, *((arrival(t_s), data) for data in late)]

    dive.tap.spoil = copied
    steps = dive.run(10.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert max(abs(step.truth.eta[2] - DEPTH_M) for step in steps) < 0.03


def test_an_autopilot_that_reboots_is_not_armed_again_and_can_be_engaged_again():
    """Even though told to arm: what ended a dive is for somebody to look at."""
    dive = arrived()
    since_s = dive.t_s
    dive.fault("reboot")
    steps = dive.run(6.0)
    assert any(step.sample.verdict.conditions & Condition.REBOOTED for step in steps)
    assert dive.state in (State.IDLE, State.FAULT)
    assert dive.tap.last_thrust_s - since_s <= 1.1
    assert not dive.step.truth.armed
    assert dive.motors_rest()
    dive.ask(Request.CLEAR_FAULT)
    dive.run(0.1)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE, within_s=8.0)
    dive.run(6.0)
    still_holds(dive)


def test_a_link_that_comes_and_goes_is_not_engaged_through():
    """Some silences only interrupt; too many end control."""
    dive = active()
    since_s = dive.t_s
    for _ in range(14):
        dive.fault("link_cut", 0.8)
        dive.run(1.2)
    assert dive.state is State.FAULT
    assert dive.tap.last_thrust_s - since_s <= 12.0
