"""Some dives of the campaign, and that it would notice."""

from copy import deepcopy

import pytest

from companion.records import State
from lab.studies.breaking import FAULTS, ON_FIRMWARE, VARIANTS, Broken, prepared
from lab.studies.fault_dives import TOGETHER, FaultCase, FaultDives, case, dive, dive_group
from lab.study import parser_of
from sim_bridge.fault_kinds import FAULT_KINDS

GROUPS = (1, 2, 3, 6, 7, 9, 13, 19, 22, 59)
"""Of dives that begin alike: every state and every variant."""

DIVES = 3
"""Of each group."""


@pytest.mark.parametrize("group", GROUPS)
def test_every_promise_is_kept(group):
    options = ["--first", str(group * TOGETHER), "--dives", str(DIVES)]
    study = FaultDives(parser_of(FaultDives).parse_args(options))
    (cases,) = study.groups(study.cases())
    assert [row["broken"] for row in study.dive(cases)] == [""] * DIVES


def test_the_groups_begin_in_every_state_with_every_variant():
    cases = [case(group * TOGETHER) for group in GROUPS]
    assert {one.state for one in cases} == set(State)
    assert {one.variant for one in cases} == set(VARIANTS)


def test_the_numbers_draw_everything():
    cases = [case(number) for number in range(2000)]
    assert {fault.kind for one in cases for fault in one.faults} == set(FAULTS)
    assert {one.state for one in cases} == set(State)
    assert {one.variant for one in cases} == set(VARIANTS)


def test_with_the_real_firmware_only_what_can_be_done_to_it_is_drawn():
    cases = [case(number, firmware=True) for number in range(2000)]
    assert {fault.kind for one in cases for fault in one.faults} == set(ON_FIRMWARE)
    assert {one.state for one in cases} == set(State) - {State.HAND_OVER}
    assert not any(fault.message for one in cases for fault in one.faults)
    asked = [FAULTS[kind].begin for kind in ON_FIRMWARE]
    assert all(FAULT_KINDS[begin].on_firmware for begin in asked if isinstance(begin, str))


@pytest.fixture(scope="module")
def active():
    with prepared("heavy", State.ACTIVE, 0) as diving:
        yield diving


def noticed(diving, kind, value=0.5):
    """What is said of one more dive of the same vehicle."""
    one = FaultCase(1, "heavy", State.ACTIVE, (Broken(kind, 0.0, "", value),), fingers=False)
    return dive(deepcopy(diving), one)["broken"]


def test_it_would_notice_thrust_that_goes_on(active, monkeypatch):
    monkeypatch.setitem(FAULTS, "disarmed", FAULTS["disarmed"]._replace(begin=lambda *_: None))
    assert "still pushing" in noticed(active, "disarmed")


def test_it_would_notice_an_exception(active, monkeypatch):
    monkeypatch.setattr("companion.engine.guard", lambda *_: 1 / 0)
    assert "ZeroDivisionError" in noticed(active, "leak")


def test_a_dive_is_its_number():
    assert [*dive_group([7])] == [*dive_group([7])]
