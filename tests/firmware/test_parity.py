"""The real firmware and our stand-in answer alike: each scenario of `python -m lab.parity`."""

import pytest

from lab.parity.__main__ import agree, compare, plant, readable
from lab.parity.questions import SCENARIOS
from lab.parity.reasons import reason


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_answers_are_the_same_or_differ_for_a_known_reason(scenario, ardusub):
    config = plant(scenario)
    different = {
        name: tuple(map(readable, both))
        for name, both in compare(scenario, ardusub, config).items()
        if not agree(*both) and not reason(scenario, name, config)
    }
    assert not different
