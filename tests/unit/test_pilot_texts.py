"""Which words reach the pilot's ground station, how often and in which pieces."""

from types import SimpleNamespace

import pytest
from pilot_station import joined
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.codec import Packer
from companion.mavlink.pilot_display import MOST, MOST_S, PilotDisplay
from companion.records import Condition, Guided, PilotHeartbeat, State
from companion.telemetry.schemas import Event

C = Condition
WARNING = mavlink.MAV_SEVERITY_WARNING
REFUSED = "engage by button: refused: the vehicle is disarmed"


class Screen:
    """A ground station's: what it shows of the display's frames, in pymavlink's own decoding."""

    def __init__(self):
        self.display, self.packer = PilotDisplay(), Packer(1, 25)
        self.parser = mavlink.MAVLink(None)
        self.now_s = 0.0
        self.tick()

    def heard(self, *events, reports=(), **sample):
        """Return the messages of one more tick."""
        self.now_s += 0.02
        messages = self.display.step(sampled(self.now_s, **sample), list(events), list(reports))
        data = b"".join(self.packer.encode(message) for message in messages)
        return self.parser.parse_buffer(data) or [] if data else []

    def tick(self, *events, **sample):
        """Return (severity, text) of one more tick, chunks joined as MAVLink says."""
        return joined(self.heard(*events, **sample))

    def wait(self, seconds, **sample):
        return [text for _ in range(round(seconds / 0.02)) for text in self.tick(**sample)]


def sampled(t_s, state=State.ACTIVE, reason="engaged", remedy="", authority=1.0, refused="", engaged=True):
    return SimpleNamespace(
        state=SimpleNamespace(t_s=t_s, boot_s=t_s, disturbance=(1.0, 2.0, 3.0, 0.5)),
        verdict=SimpleNamespace(state=state, reason=reason, remedy=remedy, authority=authority),
        dofs=SimpleNamespace(e=(0.0, 0.0, 0.01, 0.0), engaged=(False, False, engaged, engaged)),
        guided=Guided("", 0),
        refused=refused,
    )


def event(kind, severity, text):
    return Event(t_s=0.0, boot_s=0.0, severity=severity, kind=kind, text=text)


def begins(condition):
    return event("condition", "warning", condition.text)


def ends(condition):
    return event("condition", "info", condition.ended)


@pytest.mark.parametrize(
    ("severity", "shown"),
    [
        ("info", mavlink.MAV_SEVERITY_NOTICE),
        ("warning", mavlink.MAV_SEVERITY_WARNING),
        ("fault", mavlink.MAV_SEVERITY_CRITICAL),
    ],
)
def test_a_state_has_its_severity_its_reason_and_what_to_do(severity, shown):
    happened = event("state", severity, "FAULT: no fresh depth")
    todo = "" if severity == "info" else "; to do: check the sensor"
    assert Screen().tick(happened, remedy="check the sensor") == [
        (shown, f"Holdfast FAULT: no fresh depth{todo}")
    ]


@pytest.mark.parametrize(
    ("happened", "told"),
    [
        (begins(C.SATURATED), [(WARNING, f"Holdfast: {C.SATURATED.text}; to do: {C.SATURATED.remedy}")]),
        (event("command", "warning", REFUSED), [(WARNING, f"Holdfast: {REFUSED}")]),
        (event("autopilot", "fault", "Leak Detected"), []),
        (event("command", "info", "hold depth 5 m: on its way"), []),
    ],
    ids=["condition", "refused button", "told by the autopilot", "told by who commands"],
)
def test_conditions_and_refusals_are_told_and_what_the_pilot_has_from_elsewhere_is_not(happened, told):
    assert Screen().tick(happened) == told


@pytest.mark.parametrize(
    "again",
    [
        event("command", "warning", REFUSED),
        event("condition", "warning", "another companion of this name came: instance 1"),
        event("state", "info", "follows the path: wall"),
    ],
    ids=lambda event: event.kind,
)
def test_what_happens_again_is_told_again_and_not_at_every_press(again):
    screen = Screen()
    assert len(screen.tick(again)) == 1
    if again.kind != "state":
        assert screen.tick(again) == []
        assert len(screen.wait(30.1)) == 1, "once, however often it was pressed"
        assert screen.wait(30.0) == []
    assert len(screen.tick(again)) == 1


def test_a_condition_that_flickers_is_told_once_in_30_s():
    screen = Screen()
    texts = []
    for _ in range(500):  # 20 s
        texts += screen.tick(begins(C.DELAY_TOO_LONG))
        texts += screen.tick(ends(C.DELAY_TOO_LONG))
    assert [text.split(";")[0] for _, text in texts] == [
        f"Holdfast: {C.DELAY_TOO_LONG.text}",
        f"Holdfast: {C.DELAY_TOO_LONG.ended}",
    ]
    assert screen.wait(60.0) == [], "it has ended, and that was told"
    assert len(screen.tick(begins(C.DELAY_TOO_LONG))) == 1


def test_texts_are_few_a_fault_does_not_queue_and_none_is_lost():
    """All conditions at once: MOST go within MOST_S."""
    screen = Screen()
    fault = event("state", "fault", "FAULT: a tick was too late")
    conditions = [condition for condition in C if condition.remedy]
    assert len(conditions) > 2 * MOST
    texts = screen.tick(*map(begins, conditions))
    assert len(texts) == MOST
    assert screen.wait(MOST_S / 2) == []
    assert [severity for severity, _ in screen.tick(fault)] == [mavlink.MAV_SEVERITY_CRITICAL]
    later = screen.wait(10 * MOST_S)
    assert {text for _, text in texts + later} == {
        f"Holdfast: {condition.text}; to do: {condition.remedy}".replace("°", " deg")
        for condition in conditions
    }


def test_what_has_ended_before_it_could_be_told_is_not_told():
    screen = Screen()
    conditions = [condition for condition in C if condition.remedy]
    screen.tick(*map(begins, conditions))
    screen.tick(*map(ends, conditions))
    later = screen.wait(100.0)
    assert len(later) == MOST, "the ends of what was told"
    assert all("to do" not in text for _, text in later)


@pytest.mark.parametrize("length", [10, 49, 50, 51, 99, 100, 101, 150, 240])
def test_long_words_come_in_chunks_of_50_whose_last_is_not_full(length):
    screen, ids = Screen(), set()
    for letter in "xy":
        words = letter * (length - len("Holdfast "))
        heard = screen.heard(event("state", "info", words))
        messages = [message for message in heard if message.get_type() == "STATUSTEXT"]
        assert [text.rstrip() for _, text in joined(messages)] == [f"Holdfast {words}"]
        (identity,) = {message.id for message in messages}
        ids.add(identity)
    assert ids == {0} if length <= 50 else len(ids - {0}) == 2, "two texts have two ids"


def test_foreign_letters_and_endless_names_cannot_break_a_text():
    [(_, text)] = Screen().tick(event("state", "info", "follows the path: Ωmega 90° " + 999 * "ß"))
    assert text.startswith("Holdfast follows the path: ?mega 90 deg ")
    assert len(text) < 300
    assert text.endswith("?...")


def test_a_ground_station_that_comes_later_is_told_the_state_and_one_that_stays_is_not():
    screen = Screen()
    beat = [PilotHeartbeat(0.0)]
    screen.tick(event("state", "info", "ACTIVE: engaged"))
    assert screen.wait(4.0) == []
    assert screen.tick(reports=beat) == [], "it was there all the time"
    assert screen.wait(6.0) == []
    assert screen.tick(reports=beat) == [(mavlink.MAV_SEVERITY_NOTICE, "Holdfast ACTIVE: engaged")]
    assert screen.tick(reports=beat) == []
    assert screen.wait(6.0) == []
    assert screen.tick(reports=beat, state=State.FAULT, reason="no fresh depth", remedy="look") == [
        (mavlink.MAV_SEVERITY_CRITICAL, "Holdfast FAULT: no fresh depth; to do: look")
    ]
