"""What the real ArduSub forwards; the same with our stand-in: tests/closed_loop/test_pilot_display.py."""

import pytest
from forwarding_tests import (
    begun,
    test_the_autopilot_keeps_its_own_counsel,  # noqa: F401 - they run here
    test_words_numbers_commands_and_answers_pass_the_vehicle,  # noqa: F401
)

from lab.loop.firmware import Firmware


@pytest.fixture
def pilot(ardusub):
    pilot = begun(ardusub)
    assert isinstance(pilot.dive.vehicle, Firmware)
    with pilot.dive.vehicle:
        yield pilot
