"""The supervisor's page is what its tables say."""

from lab.supervisor_page import PAGE, page


def test_the_page_is_not_stale():
    assert PAGE.read_text(encoding="utf-8") == page(), "run: holdfast lab schema --write"
