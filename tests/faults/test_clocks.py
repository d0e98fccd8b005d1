"""Clocks that contradict each other: two autopilots with one system id, clocks that jump, answers that lie.

Whatever they say nothing raises, predictions run forward, and what lasts is handed over.
"""

import copy
import itertools

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, active, shared

from companion.records import Condition, State
from lab.loop.lockstep import START_S, LinkDelay

TIMESYNC = "TIMESYNC"
DOUBT_S = 2.0
"""How long contradictions last before the vehicle is handed over."""


class Liar:
    """Rewrites what the autopilot says: its stamps, its answers to TIMESYNC, when they arrive."""

    def __init__(self):
        self._in, self.packer = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 1)
        self.stamps_s = self.answers_s = self.late_s = 0.0
        self.twin_s = None
        self.deaf = False
        self._waiting = []

    def __call__(self, t_s, inbox):
        reported = []
        for t_ns, data in inbox:
            for message in self._in.parse_buffer(bytearray(data)) or ():
                answer = message.get_type() == TIMESYNC
                if answer and self.deaf:
                    continue
                if answer and self.late_s:
                    self._waiting.append((t_s + self.late_s, self._reported(message, 0.0, self.answers_s)))
                    self.late_s = 0.0
                    continue
                reported.append((t_ns, self._reported(message, self.stamps_s, self.answers_s)))
                if self.twin_s is not None:
                    reported.append((t_ns, self._reported(message, self.twin_s, self.twin_s)))
        due = [data for at_s, data in self._waiting if at_s <= t_s]
        self._waiting = [(at_s, data) for at_s, data in self._waiting if at_s > t_s]
        return reported + [(round((START_S + t_s) * 1e9), data) for data in due]

    def _reported(self, message, stamps_s, answers_s):
        message = copy.copy(message)
        if message.get_type() == TIMESYNC:
            message.tc1 = max(message.tc1 + round(answers_s * 1e9), 1)
        elif hasattr(message, "time_boot_ms"):
            message.time_boot_ms = max(message.time_boot_ms + round(stamps_s * 1e3), 0)
        elif message.get_type() == "SERVO_OUTPUT_RAW":
            message.time_usec = max(message.time_usec + round(stamps_s * 1e6), 0)
        return bytes(message.pack(self.packer))


@shared
def lied_to(**arguments):
    dive = active(seconds=4.0, **arguments)
    liar = dive.tap.spoil = Liar()
    dive.run(0.5)
    assert dive.state is State.ACTIVE
    return dive, liar


def reported(steps, condition):
    return [step.t_s for step in steps if step.sample.verdict.conditions & condition]


def forward(steps):
    return all(
        step.sample.state.delays.telemetry_s >= 0.0 and step.sample.state.ahead_s >= 0.0 for step in steps
    )


def test_a_late_first_answer_while_engaged_changes_nothing():
    """Only then is the clocks' offset known at all, and half of the delay would be taken for offset."""
    dive = Dive()
    liar = dive.tap.spoil = Liar()
    liar.deaf = True
    dive.until(State.ACTIVE)
    dive.run(2.0)
    liar.deaf, liar.late_s = False, 0.2
    steps = dive.run(6.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert forward(steps)
    assert not reported(steps, Condition.CLOCK_JUMPED)
    assert max(step.sample.state.delays.total_s for step in steps) < 0.15
    assert abs(steps[-1].sample.state.eta[2] - 1.0) < 0.02


@pytest.mark.parametrize("jump_s", [0.3, -0.3])
def test_a_clock_that_jumps_is_reported_and_followed(jump_s):
    dive, liar = lied_to()
    liar.stamps_s = liar.answers_s = jump_s
    steps = dive.run(6.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert forward(steps)
    jumped = reported(steps, Condition.CLOCK_JUMPED)
    assert 0.0 < max(jumped) - steps[0].t_s < 1.0
    assert steps[-1].sample.state.delays.total_s < 0.06


@pytest.mark.parametrize(
    ("what", "value_s"),
    [("stamps_s", 0.3), ("answers_s", -0.2), ("twin_s", 0.3), ("twin_s", -0.3), ("twin_s", 700.0)],
)
def test_clocks_that_go_on_contradicting_each_other_are_handed_over(what, value_s):
    """Stamps ahead of the answers, answers behind the stamps, two autopilots with one system id."""
    dive, liar = lied_to()
    setattr(liar, what, value_s)
    steps = dive.run(DOUBT_S + 0.5)
    assert forward(steps)
    inconsistent = reported(steps, Condition.CLOCK_INCONSISTENT)
    assert inconsistent
    assert inconsistent[0] - steps[0].t_s == pytest.approx(DOUBT_S, abs=0.4)
    assert [state for state, _ in itertools.groupby(step.sample.verdict.state for step in steps)] == [
        State.ACTIVE,
        State.HAND_OVER,
    ]
    assert "clock" in dive.step.sample.verdict.reason


class Asked:
    """Answers of the autopilot to questions that are not ours: of a clock that is ahead of ours."""

    def __init__(self, each_s, ahead_s):
        self._packer, self._each_s, self._ahead_s, self._next_s = (
            mavlink.MAVLink(None, 1, 1),
            each_s,
            ahead_s,
            0.0,
        )
        self.boot_s = 0.0

    def __call__(self, t_s, inbox):
        if t_s < self._next_s:
            return inbox
        self._next_s, now_s = t_s + 0.25, START_S + t_s
        sent_s = min(now_s - 2.0 * self._each_s + self._ahead_s, now_s - 0.001)
        answer = mavlink.MAVLink_timesync_message(
            round((self.boot_s + t_s - self._each_s) * 1e9), round(sent_s * 1e9)
        )
        return [*inbox, (round(now_s * 1e9), bytes(answer.pack(self._packer)))]


@pytest.mark.parametrize(("each_s", "ahead_s"), [(0.06, 0.1), (0.12, 0.2)])
def test_answers_to_somebody_elses_questions_hide_no_delay(each_s, ahead_s):
    dive = Dive(link=LinkDelay(each_s, each_s, 0.004)).until(State.ACTIVE, 14.0)
    dive.run(4.0)
    told = dive.step.sample.state
    dive.tap.spoil = asked = Asked(each_s, ahead_s)
    asked.boot_s = told.boot_s - told.t_s + START_S
    dive.run(10.0)
    assert dive.step.sample.state.delays.total_s == pytest.approx(told.delays.total_s, abs=0.02)
    assert dive.step.sample.state.delays.telemetry_s > each_s


def test_two_autopilots_are_not_engaged():
    dive = Dive("parameters.FS_PILOT_INPUT=1")
    liar = dive.tap.spoil = Liar()
    liar.twin_s = 0.4
    dive.run(8.0)
    assert State.ACTIVE not in dive.states_since(0.0)
    assert "clock" in dive.step.sample.verdict.reason


@pytest.mark.parametrize(("boot_ms", "count"), [(2**32 - 1, 5), (0, 1)])
def test_a_few_absurd_stamps_change_nothing(boot_ms, count):
    dive, _ = lied_to()
    clean, left = dive.tap.spoil, [count]

    def spoil(t_s, inbox):
        inbox = clean(t_s, inbox)
        if left[0]:
            left[0] -= 1
            absurd = mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0)
            inbox = [*inbox, (round((START_S + t_s) * 1e9), bytes(absurd.pack(clean.packer)))]
        return inbox

    dive.tap.spoil = spoil
    steps = dive.run(3.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert forward(steps)
