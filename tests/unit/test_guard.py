"""Whatever comes in, what leaves is finite, bounded and slow, and neutral unless permitted."""

import math
from functools import reduce
from operator import or_

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from test_supervisor import EXPECTED, FORBIDS_ENGAGING

from companion.records import NEUTRAL, AxisCommand, Condition, State, Verdict
from companion.supervision.guard import Envelope, guard
from companion.supervision.supervisor import StateMachine

C = Condition
PERMITTED = Verdict(State.ACTIVE, C(0), 1.0, "")
CARRY_AUTHORITY = (State.ACTIVE, State.RAMP_DOWN, State.HAND_OVER)

axes = st.floats() | st.floats(-2.0, 2.0)
any_command = st.builds(AxisCommand, *[axes] * 6)
authorities = st.floats() | st.floats(0.0, 1.0)
any_verdict = st.builds(Verdict, st.sampled_from(list(State)), st.just(C(0)), authorities, st.just(""))
envelopes = st.builds(Envelope, st.floats(0.01, 1.0), st.floats(0.01, 100.0))
any_conditions = st.integers(0, reduce(or_, C).value).map(C)
few_conditions = st.one_of(st.just(C(0)), st.just(C.ENGAGE_ASKED), st.sampled_from(list(C)), any_conditions)
ONLY_WHILE_IT_LASTS = (
    C.OFF_TRACK | C.THRUST_UNANSWERED | C.THRUST_OPPOSED | C.TURNED_OVER | C.TILT_PERSISTS
) | (C.AUTOPILOT_FAILSAFE | C.FAILSAFE_SURFACES | C.PILOT_LOST_SURFACE)
"""Need not forbid engaging: they come only of steering, or with another condition that forbids it."""
ENDS_ACTIVE = reduce(or_, EXPECTED[State.ACTIVE]) & ~ONLY_WHILE_IT_LASTS
ENGAGING_FORBIDDEN = reduce(or_, FORBIDS_ENGAGING)


@given(any_command, any_verdict, envelopes, st.floats(0.001, 0.1), st.data())
def test_guard_is_finite_bounded_slow_and_neutral_unless_permitted(command, verdict, envelope, dt_s, data):
    axis = st.floats(-envelope.max_axis, envelope.max_axis)
    previous = data.draw(st.builds(AxisCommand, *[axis] * 6))
    sent = guard(command, verdict, previous, envelope, dt_s)
    permitted = verdict.state in CARRY_AUTHORITY and 0.0 < verdict.authority <= 1.0
    if not permitted or not all(map(math.isfinite, command)):
        assert sent == NEUTRAL
        return
    for now, before in zip(sent, previous, strict=True):
        assert math.isfinite(now)
        assert abs(now) <= envelope.max_axis
        assert abs(now - before) <= envelope.max_slew_per_s * dt_s + 1e-12


@given(
    any_command,
    any_verdict,
    any_command,
    envelopes,
    any_command,
    st.lists(st.booleans(), min_size=6, max_size=6),
)
def test_the_guard_has_the_last_word_on_the_pilots_axes_too(
    wanted, verdict, previous, envelope, sticks, held
):
    sent = guard(wanted, verdict, previous, envelope, 0.02, sticks, held)
    alone = guard(wanted, verdict, previous, envelope, 0.02)
    for now, ours, stick, is_held in zip(sent, alone, sticks, held, strict=True):
        if is_held:
            assert now == ours
        elif math.isfinite(stick):
            assert now == max(-1.0, min(1.0, stick))
        else:
            assert now == 0.0


@pytest.mark.parametrize("axis", AxisCommand._fields[:4])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_guard_lets_a_fair_command_pass_and_bounds_and_slows_each_axis_alone(axis, sign):
    fair = NEUTRAL._replace(**{axis: sign * 0.1})
    assert guard(fair, PERMITTED, NEUTRAL, Envelope(0.8, 5.0), 0.02) == fair
    command, seen = NEUTRAL, []
    for _ in range(20):
        command = guard(NEUTRAL._replace(**{axis: sign * 9.0}), PERMITTED, command, Envelope(0.8, 5.0), 0.02)
        seen.append(getattr(command, axis))
        assert command._replace(**{axis: 0.0}) == NEUTRAL
    np.testing.assert_allclose(seen, sign * np.minimum(0.1 * np.arange(1, 21), 0.8), atol=1e-12)


def test_an_axis_that_the_pilot_gives_back_starts_from_his_stick():
    sticks, at_rest = AxisCommand(heave=0.9), (True, True, False, True, True, True)
    envelope = Envelope(0.8, 4.0, 0.4)
    sent = guard(NEUTRAL, PERMITTED, NEUTRAL, envelope, 0.02, sticks, at_rest)
    assert sent.heave == 0.9
    sent = guard(NEUTRAL, PERMITTED, sent, envelope, 0.02, sticks)
    assert sent.heave == 0.9 - 4.0 * 0.02


class Permission(RuleBasedStateMachine):
    """A supervisor under any sequence of conditions."""

    @initialize(ramp_down_s=st.floats(0.01, 5.0))
    def start(self, ramp_down_s):
        self.supervisor = StateMachine(ramp_down_s)
        self.verdict = Verdict(State.IDLE, C(0), 0.0, "")
        self.conditions = C(0)
        self.was = self.verdict

    @rule(conditions=few_conditions, dt_s=st.sampled_from([0.0, 0.005, 0.02, 0.3, 10.0]))
    def step(self, conditions, dt_s):
        conditions |= C.RAMPED_DOWN if self.supervisor.ramped_down(dt_s) else C(0)
        self.was, self.conditions = self.verdict, conditions
        self.verdict = self.supervisor.step(conditions, dt_s)

    @rule()
    def approach(self):
        """Tick until engaged, if that is possible: otherwise a random walk is rarely ACTIVE."""
        for _ in range(4):
            self.step(C.CLEAR_ASKED | C.ENGAGE_ASKED, 0.02)

    @invariant()
    def authority_goes_with_the_state(self):
        state, authority = self.verdict.state, self.verdict.authority
        assert 0.0 <= authority <= 1.0
        assert authority == 0.0 or state in CARRY_AUTHORITY

    @invariant()
    def authority_never_grows_while_ramping_down(self):
        if self.verdict.state in (State.RAMP_DOWN, State.HAND_OVER):
            assert self.verdict.authority <= self.was.authority

    @invariant()
    def engaging_was_asked_for_and_permitted(self):
        if self.verdict.state is State.ACTIVE and self.was.state is not State.ACTIVE:
            assert self.was.state is State.READY
            assert self.conditions & C.ENGAGE_ASKED
            assert not self.conditions & ENGAGING_FORBIDDEN

    @invariant()
    def active_ends_when_anything_needed_is_missing(self):
        if self.verdict.state is State.ACTIVE:
            assert not self.conditions & ENDS_ACTIVE
            assert self.was.state is not State.ACTIVE or not self.conditions & ONLY_WHILE_IT_LASTS

    @invariant()
    def it_hands_over_only_what_it_held_and_ends_with_the_pilot_a_fault_or_idle(self):
        was, now = self.was.state, self.verdict.state
        surfaces = C.FAILSAFE_SURFACES in self.conditions
        if now is State.HAND_OVER:
            assert was in (State.ACTIVE, State.HAND_OVER) or (was is State.RAMP_DOWN and surfaces)
            assert not surfaces or self.verdict.authority == 0.0
        if was is State.HAND_OVER:
            assert now in (State.HAND_OVER, State.PILOT, State.FAULT, State.IDLE)
        if was in (State.PILOT, State.FAULT):
            assert now in (was, State.FAULT, State.IDLE)

    @invariant()
    def what_is_told_holds(self):
        assert self.verdict.warnings & self.conditions == self.verdict.warnings
        assert not self.verdict.freeze or self.verdict.warnings

    @invariant()
    def a_fault_is_left_only_when_cleared(self):
        if self.was.state is State.FAULT and self.verdict.state is not State.FAULT:
            assert self.conditions & C.CLEAR_ASKED
            assert not self.conditions & C.NON_FINITE
            assert self.verdict.state is State.IDLE


Permission.TestCase.settings = settings(stateful_step_count=40)
TestPermission = Permission.TestCase
