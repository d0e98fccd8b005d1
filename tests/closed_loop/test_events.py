"""What the event key tells of a dive: what changed, once, in words."""

from msgspec.structs import replace
from virtual import Dive, active

from companion.records import Condition, State
from companion.supervision.rules import BLOCKING
from companion.telemetry.event_log import EventLog
from companion.telemetry.glossary import UNSAID
from companion.telemetry.operator_commands import CommandResult
from companion.telemetry.schemas import Reply


def reported(dive, seconds, log=None, **first):
    """Return (severity, kind, text) of what happens in the coming seconds."""
    log = log or EventLog()
    events = [event for step in dive.run(seconds) for event in log.step(step.sample, **first)]
    return [(event.severity, event.kind, event.text) for event in events]


def test_a_start_tells_the_way_to_active_and_what_the_autopilot_says():
    events = reported(Dive(), 4.0)
    assert events[0][:2] == ("info", "state")
    assert events[0][2].startswith("IDLE: waiting for")
    assert ("info", "state", "ACTIVE: engaged") in events
    assert ("info", "autopilot", "Arming motors") in events
    assert ("info", "condition", "the vehicle is armed") in events
    assert not [text for severity, _, text in events if severity == "warning"]  # not read yet is not refused


def test_a_row_of_the_list_that_is_refused_is_told_unless_it_is_not_read_yet():
    sample, log = active().run(0.02)[-1].sample, EventLog()
    log.step(sample)
    refused = replace(sample.verdict, conditions=sample.verdict.conditions | Condition.PREFLIGHT_FAILURE)
    assert not log.step(replace(sample, verdict=refused, reads=True))
    (event,) = log.step(replace(sample, verdict=refused))
    assert event.text == "a row of the pre-dive list is refused"


def test_a_fault_is_reported_with_its_condition_once():
    dive, log = active(), EventLog()
    reported(dive, 0.1, log)
    dive.fault("link_cut", 1.5)
    events = reported(dive, 1.4, log)
    conditions = [text for _, kind, text in events if kind == "condition"]
    assert conditions == [
        "telemetry or ticks pause at times",
        "the vehicle is not heard",
        "no fresh depth",
        "no fresh attitude",
    ], "the cause first"
    assert dive.step.sample.verdict.reason == "the vehicle is not heard"
    assert [event for event in events if event[0] == "fault"] == [
        ("fault", "state", f"FAULT: {dive.step.sample.verdict.reason}")
    ]
    assert dive.state is State.FAULT


def test_every_condition_has_words_in_three_forms_of_its_own():
    """A missing one is named; the page pairs an end with its beginning by their words."""
    reported = list(~UNSAID)
    assert not [one.name for one in reported if not (one.text and one.ended and one.remedy)]
    assert not [one.name for one in BLOCKING if not one.awaited]
    assert len({one.text for one in Condition}) == len(Condition)
    assert len({one.ended for one in reported}) == len(reported)


def test_commands_are_reported_with_their_answer():
    results = [
        CommandResult("hold depth 5 m", Reply(done=True, said="on its way")),
        CommandResult("engage", Reply(done=False, said="refused: no")),
    ]
    dive = active()
    events = EventLog().step(dive.run(0.02)[-1].sample, results, ["47\n11"])
    assert [(event.severity, event.kind, event.text) for event in events[:3]] == [
        ("info", "command", "hold depth 5 m: on its way"),
        ("warning", "command", "engage: refused: no"),
        ("warning", "condition", "another companion of this name came: instance 47\\n11"),
    ]


def test_a_flood_of_refused_commands_hides_nothing_else_and_is_counted():
    """Whoever may not command it asked 75 000 times: 1200 lines, and nothing else was left on the page."""
    dive, log = Dive(), EventLog()
    refused = [CommandResult(f"hold depth {n} m", Reply(done=False, said="refused: no")) for n in range(2)]
    events = reported(dive, 24.0, log, results=refused, duplicate_instances=["4f11"])
    texts = [text for _, _, text in events]
    assert sum(text.startswith("hold depth") for text in texts) == 30, "ten in ten seconds"
    assert texts.count("990 more lines in 10 s were left out: command, warning") == 2
    assert sum(text.startswith("another companion") for text in texts) == 30
    assert sum("left out: another companion of this name came: instance" in text for text in texts) == 2
    assert {"ACTIVE: engaged", "Arming motors", "the vehicle is armed"} <= set(texts)


def test_a_condition_that_flickers_is_told_at_times_and_each_change_of_state_at_once():
    sample, log, events = active().run(0.02)[-1].sample, EventLog(), []
    for tick in range(1000):
        on = Condition.SATURATED if tick % 2 else Condition(0)
        state = State.READY if tick % 100 == 99 else State.ACTIVE
        verdict = replace(sample.verdict, conditions=on, state=state)
        now = replace(sample.state, t_s=100.0 + 0.02 * tick)
        events += log.step(replace(sample, state=now, verdict=verdict))
    texts = [event.text for event in events]
    assert texts.count(Condition.SATURATED.text) == texts.count(Condition.SATURATED.ended) == 20
    assert "240 more lines in 10 s were left out: " + Condition.SATURATED.text in texts
    assert sum(event.kind == "state" for event in events) == 20
