"""Two Holdfasts with the same ids on one vehicle: the younger one releases, and both tell.

Routers differ in what they pass on: a plain one gives everybody the others' frames, some give everybody his
own back as well, mavlink-router and MAVProxy pass nothing on to where the same ids are, and ArduSub passes
from link to link what has no target.
"""

import hashlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import CALM, ROOT, Somebody, active, hold, message_id, shared

from companion.config import load_config
from companion.engine import Engine
from companion.mavlink.signing import Signing
from companion.records import Condition, LoopHealth, Request, State
from companion.telemetry.event_log import EventLog
from lab.loop.lockstep import START_S
from lab.studies.promises import Promises
from sim_bridge.sim_config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

FIRST, CAME = Condition.OTHER_FIRST, Condition.OTHER_CAME
ROUTERS = ("forwards", "echoes", "hides", "ardusub")
TICK_S = 0.02
COMPONENT = 25


class Holdfast:
    """An engine on the router, with a clock of its own as every computer has; it asks to engage at once."""

    def __init__(self, link, begun_s):
        config = load_config()
        self.engine, self.link = Engine(config, hold(), arm=True), link
        self.promises, self.log = Promises(config), EventLog()
        self.start_s, self.begun_s = START_S + 100.3 * link, begun_s
        self.inbox, self.requests, self.told = [], [Request.ENGAGE], []
        self.states, self.seen, self.steered_s = [], [], []

    def step(self, t_s):
        inbox, self.inbox = self.inbox, []
        requests, self.requests = self.requests, []
        heard = [(round((self.start_s + t_s) * 1e9), data) for data in inbox]
        tick = round((t_s - self.begun_s) / TICK_S)
        out, sample = self.engine.step(
            self.start_s + t_s, heard, LoopHealth(tick, 50.0, 0.0, 0.0, 0, 0), requests
        )
        self.promises.hold(t_s, out, sample, requests, steers=self.engine.steering)
        self.told += [event.text for event in self.log.step(sample)]
        self.states.append(sample.verdict.state)
        self.seen += [t_s] if sample.verdict.conditions & (FIRST | CAME) else []
        self.steered_s += [t_s] if self.promises.frames else []
        self.conditions, self.reason = sample.verdict.conditions, sample.verdict.reason
        return out

    @property
    def state(self):
        return self.states[-1]


class Routed:
    """A vehicle, and whoever steers it through a router."""

    def __init__(self, router):
        self.vehicle = Vehicle(load_plant(ROOT / "config" / "sim.toml", CALM), 1)
        self.router, self.holdfasts, self._down, self._begun = router, [], [], 0
        for link in (1, 2, 3):
            self.vehicle.open_link(link)

    def begin(self):
        """Start one more Holdfast."""
        self._begun += 1
        self.holdfasts.append(Holdfast(self._begun, self.vehicle.time_s))
        return self.holdfasts[-1]

    def run(self, seconds):
        for _ in range(round(seconds / TICK_S)):
            for _ in range(round(TICK_S / self.vehicle.step_s)):
                down, self._down = self._down, []
                for link, data in self.vehicle.step(down):
                    for one in self.holdfasts:
                        own_link = self.router in ("ardusub", "apart")
                        hidden = self.router == "apart" and data[6] == COMPONENT
                        if link == (one.link if own_link else 1) and not hidden:
                            one.inbox.append(data)
            sent = [(one, data) for one in self.holdfasts for data in one.step(self.vehicle.time_s)]
            for sender, data in sent:
                self._down.append((sender.link if self.router in ("ardusub", "apart") else 1, data))
                for one in self.holdfasts:
                    if self.router == "echoes" or (self.router == "forwards" and one is not sender):
                        one.inbox.append(data)
        return self

    def rests(self):
        return set(self.vehicle.truth().motor_pwm) == {1500}


@shared
def holding(router):
    """One that holds the vehicle."""
    routed = Routed(router)
    older = routed.begin()
    routed.run(8.0)
    assert older.state is State.ACTIVE
    assert not older.seen, "its own frames are no other's"
    return routed, older


@pytest.mark.parametrize("router", ROUTERS)
def test_who_came_later_does_not_engage_and_both_tell(router):
    routed, older = holding(router)
    younger, began_s = routed.begin(), routed.vehicle.time_s
    routed.run(6.0)
    assert max(older.seen[0], younger.seen[0]) - began_s <= 1.0
    assert set(older.states[-300:]) == {State.ACTIVE}
    assert State.ACTIVE not in younger.states
    assert CAME in older.conditions
    assert FIRST in younger.conditions
    assert CAME.text in older.told
    assert FIRST.text in younger.told or FIRST.awaited in younger.reason
    assert not [t_s for t_s in younger.steered_s if t_s > began_s + 1.0]
    older.requests.append(Request.STOP)
    routed.run(2.0)
    assert routed.rests(), "nobody takes the vehicle over"
    assert State.ACTIVE not in younger.states


@pytest.mark.parametrize("router", ["forwards", "hides"])
def test_of_two_that_came_together_neither_steers_until_one_has_gone(router):
    routed = Routed(router)
    both = [routed.begin(), routed.run(1.0).begin()]
    routed.run(9.0)
    assert all(FIRST in one.conditions and one.state is State.IDLE for one in both)
    assert routed.rests()
    routed.holdfasts.remove(both[0])
    both[1].requests.append(Request.ENGAGE)
    routed.run(8.0)
    assert both[1].state is State.ACTIVE
    assert FIRST.ended in both[1].told


@pytest.mark.parametrize("router", ["forwards", "hides"])
def test_the_older_one_that_starts_again_is_the_younger(router):
    routed, older = holding(router)
    younger = routed.begin()
    routed.run(3.0)
    routed.holdfasts.remove(older)
    routed.run(0.5)
    again = routed.begin()
    routed.run(6.0)
    assert FIRST in again.conditions
    assert State.ACTIVE not in again.states + younger.states, "each believes the other to be first"


def test_two_that_long_steered_apart_both_let_go():
    """The routers between them were joined: each was there first."""
    routed, one = holding("apart")
    other = routed.begin()
    routed.run(6.0)
    assert one.state is other.state is State.ACTIVE
    routed.router, joined_s = "forwards", routed.vehicle.time_s
    routed.run(7.0)
    assert max(one.seen[0], other.seen[0]) - joined_s <= 1.0
    assert {one.state, other.state} <= {State.IDLE, State.READY}
    assert routed.rests()


def replayed(dive, late_s):
    """Let the engine hear what it sends, and the answers to it, again `late_s` later."""
    back: list[tuple[float, bytes]] = []
    spoil = dive.tap.spoil

    def echo(t_s, inbox):
        due = [data for at_s, data in back if at_s <= t_s]
        answers = [data for _, data in inbox if message_id(data) == mavlink.MAVLINK_MSG_ID_TIMESYNC]
        back[:] = [(at_s, data) for at_s, data in back if at_s > t_s]
        back.extend((t_s + late_s, data) for data in answers)
        return [*spoil(t_s, inbox), *((round((START_S + t_s) * 1e9), data) for data in due)]

    dive.tap.spoil = echo
    dive.tap.after = lambda out, _: back.extend((dive.t_s + late_s, data) for data in out)
    return dive


@pytest.mark.parametrize(
    ("passphrase", "late_s"),
    [*(("", late_s) for late_s in (0.0, 1.5, 2.2, 30.0)), *(("kelp", late_s) for late_s in (0.0, 2.2, 9.0))],
)
def test_our_own_frames_may_come_back_late(passphrase, late_s):
    """By a router that repeats, or by who recorded them and has no key."""
    key = hashlib.sha256(passphrase.encode()).digest()
    dive = replayed(
        active(
            f'signing_passphrase="{passphrase}"',
            signing=Signing(key, 7, 1_795_000_000.0) if passphrase else None,
        ),
        late_s,
    )
    refused = dive.step.sample.counters.refused
    steps = dive.run(late_s + 4.5)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert not any(step.sample.verdict.conditions & (FIRST | CAME) for step in steps)
    told = dive.step.sample.counters.refused - refused
    assert told > 200 if passphrase else told == 0


class Asking:
    """Another program asks the autopilot for its clock, ten times a second, as MAVROS does."""

    def __init__(self, dive, nanoseconds):
        self._asks, self._dive, self._nanoseconds = Somebody(1, 191), dive, nanoseconds

    def ask(self, times):
        for n in range(times):
            ts1 = (1_795_000_000_000_000 + 100_000 * n) * 1000 + self._nanoseconds
            self._dive.tap.to_vehicle.append(self._asks.frame(mavlink.MAVLink_timesync_message(0, ts1)))
            self._dive.run(0.1)
        self._dive.run(0.1)
        return self._dive.step.sample.verdict.conditions & (FIRST | CAME)


@pytest.mark.parametrize(("nanoseconds", "times", "another"), [(305, 60, 0), (5305, 2, 0), (5305, 3, CAME)])
def test_answers_to_somebody_else_are_no_other_holdfast_s_until_three_have_our_mark(
    nanoseconds, times, another
):
    """One in 10 000 of MAVROS' questions has it: three within a second by chance once in 600 000 h."""
    assert Asking(active(), nanoseconds).ask(times) == another


HEARTBEAT = mavlink.MAVLink_heartbeat_message(18, 8, 0, 1, 4, 3)
"""With a custom mode: without one it is our own first, to the byte."""
FRAMES = {"heartbeat": Somebody(1, 25).frame(HEARTBEAT), "steering": Somebody(255, 25).stick(1600)}


@pytest.mark.parametrize("over", ["vehicle", "ground station"])
@pytest.mark.parametrize("frame", FRAMES.values(), ids=FRAMES)
def test_any_frame_of_our_ids_is_noticed_on_either_link(over, frame):
    dive = active(pilot=True)
    if over == "vehicle":
        dive.tap.spoil = lambda t_s, inbox: [*inbox, (round((START_S + t_s) * 1e9), frame)]
    else:
        dive.cockpit.extra = [frame]
    dive.run(0.1)
    assert dive.step.sample.verdict.conditions & CAME
    assert dive.state is State.ACTIVE, "it is no pilot's stick"
