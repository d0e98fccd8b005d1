"""Tests against the real ArduSub: skipped, and said so, where HOLDFAST_ARDUSUB does not name its program."""

import os
from pathlib import Path

import pytest
from virtual import Dive

from companion.records import State
from lab.loop.firmware import VARIABLE, program

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items):
    if os.environ.get(VARIABLE):
        return
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=f"{VARIABLE} is not set"))


@pytest.fixture(scope="session")
def ardusub():
    """The path of the real firmware's program."""
    return program(None)


@pytest.fixture
def dived(ardusub):
    """Make dives with the firmware that are closed after the test."""
    opened = []

    def make(*plant, **arguments):
        opened.append(Dive(*plant, firmware=ardusub, **arguments))
        return opened[-1]

    yield make
    for dive in opened:
        dive.vehicle.close()


@pytest.fixture
def holding(dived):
    """Make dives that have held for `seconds`."""

    def make(*plant, seconds=3.0, **arguments):
        dive = dived(*plant, **arguments).until(State.ACTIVE, 12.0)
        dive.run(seconds)
        assert dive.state is State.ACTIVE, dive.step.sample.verdict.reason
        return dive

    return make
