"""A thruster dies, and the firmware's own mixer drives the seven others."""

import pytest

from lab.studies.motor_failures import DEAD, HEAVY, MotorFailure, dive


@pytest.mark.parametrize("motor", [1, 5, 8])
def test_depth_and_heading_are_held_without_it(ardusub, motor):
    row = dive(MotorFailure(HEAVY, motor, DEAD, 3), ardusub)
    assert row["ended"] == "held"
    assert row["found"] == (motor if motor > 4 else 0), "horizontal ones have nothing to do"
    assert row["rms_mm"] < 30.0
    assert row["peak_mm"] < 100.0
    assert row["heading_deg"] < 5.0
    assert row["tilt_deg"] < 30.0
