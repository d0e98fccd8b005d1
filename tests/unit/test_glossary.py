"""No screen has words of its own for a state, a condition, what moves the vehicle, or silence."""

from pathlib import Path

import pytest

from companion.records import Condition, State
from companion.supervision.rules import TRANSITIONS
from companion.supervision.supervisor import remedy as remedy_of
from companion.telemetry import glossary
from companion.telemetry.modes import Mode
from dashboard.web import vocabulary

ROOT = Path(__file__).parents[2]
SCREENS = sorted(
    [
        *(ROOT / "dashboard" / "web").glob("*.py"),
        *(ROOT / "dashboard" / "web" / "static").glob("*.js"),
        ROOT / "dashboard" / "web" / "static" / "index.html",
        *(ROOT / "dashboard" / "terminal").glob("*.py"),
        ROOT / "companion" / "mavlink" / "pilot_display.py",
        ROOT / "companion" / "telemetry" / "event_log.py",
    ]
)


def phrases() -> set[str]:
    """Every wording of the glossary that has two words or more."""
    words = [text for c in Condition for text in (c.text, c.awaited, c.ended, c.remedy)]
    words += [text for state in glossary.STATES.values() for text in (state.text, state.remedy)]
    words += [*glossary.COURSES.values(), *glossary.SERVER_SILENT, *glossary.LATE, glossary.NO_VEHICLE]
    words += [glossary.LINK_LOST, glossary.NO_DATA, f"{glossary.TO_DO}:"]
    return {text.rstrip(".").lower() for text in words if " " in text}


@pytest.mark.parametrize("file", SCREENS, ids=lambda file: file.name)
def test_no_screen_has_words_of_its_own(file: Path) -> None:
    source = file.read_text(encoding="utf-8").lower()
    assert not [phrase for phrase in phrases() if phrase in source]


def test_every_state_and_course_has_its_words_and_the_page_has_the_same() -> None:
    assert list(glossary.STATES) == list(State)
    module = vocabulary.module()
    for words in glossary.STATES.values():
        assert f'"{words.text}"' in module
    for name in vocabulary.SHARED:
        first = getattr(glossary, name)
        assert (first if isinstance(first, str) else first[0]) in module


def test_no_two_words_mean_one_thing() -> None:
    """The reason of a state is its condition in the condition's words; engaging alone has its own."""
    own = {row.words for row in TRANSITIONS if row.words}
    assert own == {"all conditions for engaging are met", "a condition for engaging is not met", "engaged"}
    texts = [condition.text for condition in Condition]
    assert len(set(texts)) == len(texts)


@pytest.mark.parametrize(
    ("state", "armed", "mode", "guidance", "who"),
    [
        (State.ACTIVE, True, Mode.MANUAL, "path", "Holdfast follows the path"),
        (State.ACTIVE, True, Mode.MANUAL, "", "Holdfast holds here"),
        (State.PILOT, True, Mode.ALT_HOLD, "", "ALT_HOLD has it"),
        (State.PILOT, True, Mode.STABILIZE, "", "the pilot has it, STABILIZE"),
        (State.PILOT, True, None, "", "the pilot has it"),
        (State.PILOT, None, None, "", "the pilot, or ALT_HOLD, has it"),
        (State.IDLE, False, Mode.MANUAL, "", "disarmed: nobody has it"),
        (State.HAND_OVER, True, Mode.MANUAL, "", "handing over to ALT_HOLD"),
        ("NEWER", None, None, "", ""),
    ],
)
def test_who_has_the_vehicle(
    state: str, armed: bool | None, mode: int | None, guidance: str, who: str
) -> None:
    assert glossary.holder(state, guidance=guidance, armed=armed, mode=mode) == who


def test_a_vehicle_that_nobody_steers_is_said_to_be_disarmed_soon() -> None:
    who = glossary.holder(State.READY, guidance="", armed=True, mode=Mode.ALT_HOLD, disarms_in_s=2.6)
    assert who == "nobody steers: the autopilot disarms in 3 s unless a pilot does"
    who = glossary.holder(State.READY, guidance="", armed=True, mode=Mode.MANUAL, system_status=5)
    assert who == "no pilot is known (a failsafe is latched), MANUAL"


def test_a_command_is_named_wholly_and_on_the_page_it_is_a_button() -> None:
    remedy = remedy_of(State.FAULT, Condition.PILOT_TAKEOVER)
    assert glossary.whole(remedy, "bluerov2", glossary.ENDPOINT) == remedy
    told = glossary.whole(remedy, "kelp", "tcp/10.0.0.2:7447")
    assert "`holdfast tell kelp clear_fault --connect tcp/10.0.0.2:7447`" in told
    assert glossary.on_page(remedy) == "clear the fault (button Clear fault)"
    page = (ROOT / "dashboard" / "web" / "static" / "index.html").read_text(encoding="utf-8")
    for button in glossary.BUTTONS.values():
        assert f">{button}</button>" in page


@pytest.mark.parametrize("condition", list(Condition))
def test_no_remedy_asks_to_engage_without_saying_how(condition: Condition) -> None:
    for words in condition.remedy.split(";"):
        assert "engage" not in words or "`holdfast" in words


def test_troubleshooting_repeats_no_remedy() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    assert not [c.name for c in Condition if c.remedy and c.remedy in page]
