"""What is said where nothing is heard: what was, what may be, what to do."""

import pytest

from companion.telemetry.glossary import silence

ENDPOINT = "tcp/127.0.0.1:7447"


@pytest.mark.parametrize("state", ["ACTIVE", "RAMP_DOWN", "HAND_OVER"])
def test_of_a_vehicle_that_was_steered_it_says_what_it_does_alone(state: str) -> None:
    reason, remedy = silence("kelp", ENDPOINT, connected=False, state=state, armed=True)
    assert reason == f"No news from kelp. It was {state.replace('_', ' ')} and armed."
    assert "disarms 3 s after the last frame" in remedy
    assert "Take over" in remedy
    assert "armed" not in silence("kelp", ENDPOINT, connected=False, state=state, armed=None)[0]


@pytest.mark.parametrize("state", ["", "IDLE", "READY", "PILOT", "FAULT"])
def test_of_one_that_was_not_it_alarms_nobody(state: str) -> None:
    reason, remedy = silence("kelp", ENDPOINT, connected=True, state=state, armed=True)
    assert "Holdfast did not steer" in reason
    assert "disarms" not in remedy


def test_where_nothing_was_ever_heard_it_says_what_to_start() -> None:
    assert ENDPOINT in silence("", ENDPOINT, connected=False)[0]
    for connected in (True, False):
        assert "holdfast run" in silence("", ENDPOINT, connected=connected)[1]
