"""What fails beside the tick is counted, told once of each kind, and ends nothing."""

import logging
from functools import partial

import pytest

from companion.io.beside import Beside


class PanicError(BaseException):
    """As Zenoh's PanicException, which is no Exception."""


def failing(error):
    raise error


def test_an_error_is_counted_each_time_and_told_once_with_its_place(caplog):
    caplog.set_level(logging.INFO, logger="holdfast")
    beside = Beside()
    for error in (OverflowError("cannot convert float infinity"), OverflowError("again"), PanicError("2106")):
        assert not beside.do("the status line", partial(failing, error))
    assert beside.do("the map", lambda: True)
    assert beside.count == 3
    first, panic = beside.told
    assert "the status line failed" in first
    assert "cannot convert float infinity" in first
    assert "2106" in panic
    assert caplog.text.count("in failing") == 2


@pytest.mark.parametrize("passed", [KeyboardInterrupt, SystemExit, ConnectionError])
def test_what_is_meant_to_end_it_does(passed):
    with pytest.raises(passed):
        Beside(ConnectionError).do("the log", lambda: failing(passed()))
