"""The supervisor's page is what its tables say."""

from companion.records import Condition, State
from lab.supervisor_page import PAGE, page


def test_the_page_is_not_stale():
    assert PAGE.read_text(encoding="utf-8") == page(), "run: holdfast lab schema --write"


def test_every_condition_and_state_is_on_it():
    text = page()
    for state in State:
        assert f" {state} " in text
    for condition in Condition:
        assert text.count(f"\n| {(condition.name or '').replace('_', ' ')} |") == 1
