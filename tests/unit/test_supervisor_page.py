"""The supervisor's page is what its tables say."""

from companion.records import Condition
from companion.telemetry.glossary import STATES, title
from lab.supervisor_page import PAGE, page


def test_the_page_is_not_stale():
    assert PAGE.read_text(encoding="utf-8") == page(), "run: holdfast lab schema --write"


def test_every_condition_and_state_is_on_it():
    text = page()
    rows = [f"\n| {title(state)} | {words.text} |" for state, words in STATES.items()]
    rows += [f"\n| {title(condition.name or '')} | {condition.text}" for condition in Condition]
    assert [row for row in rows if text.count(row) != 1] == []
