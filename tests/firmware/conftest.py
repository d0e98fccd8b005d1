"""Tests against the real ArduSub: skipped, and said so, where HOLDFAST_ARDUSUB does not name its program."""

import os
from pathlib import Path

import pytest

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
