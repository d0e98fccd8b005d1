"""Numbers that are finite and absurd, and those that are not, in one field for 0.4 s while it holds.

Nothing raises, no command leaves the envelope (`virtual.Tap`), and afterwards it believes what is true.
"""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from tools.fuzz_engine import altered
from virtual import DEPTH_M, active

from companion.records import PSI, Condition, State, Z
from lab.loop.lockstep import START_S

ABSURD = [
    ("ATTITUDE", "time_boot_ms", 2**32 - 1),
    ("GLOBAL_POSITION_INT", "time_boot_ms", 2**32 - 1),
    ("GLOBAL_POSITION_INT", "relative_alt", -(2**31)),
    ("SERVO_OUTPUT_RAW", "time_usec", 2**32 - 1),
    ("SERVO_OUTPUT_RAW", "servo5_raw", 65535),
    ("TIMESYNC", "tc1", 2**63 - 1),
    ("BATTERY_STATUS", "voltages", 0),
    ("NAMED_VALUE_FLOAT", "value", 1e-45),
    *[
        (message, field, value)
        for message, field in (("ATTITUDE", "yaw"), ("ATTITUDE", "yawspeed"), ("VFR_HUD", "climb"))
        for value in (-3e38, 1e-45, math.inf, math.nan)
    ],
    ("EKF_STATUS_REPORT", "pos_vert_variance", 3e38),
]


@pytest.mark.parametrize(("message", "field", "value"), ABSURD)
def test_an_absurd_number_passes_without_a_trace(message, field, value):
    dive = active(seconds=3.0)
    wanted = getattr(mavlink, f"MAVLINK_MSG_ID_{message}")
    until_s = dive.t_s + 0.4

    def change(kind, values):
        if kind.id == wanted:
            values[kind.fields.index(field)] = value

    spoil = altered(change)
    dive.tap.spoil = lambda t_s, inbox: spoil(START_S + t_s, inbox) if t_s <= until_s else inbox
    dive.run(3.0)
    assert dive.state is State.ACTIVE, dive.step.sample.verdict.reason
    believed, true = dive.step.sample.state.eta, dive.step.truth.eta
    assert believed[Z] == pytest.approx(true[2], abs=0.05)
    assert math.remainder(believed[PSI] - true[5], math.tau) == pytest.approx(0.0, abs=0.05)
    assert dive.step.sample.state.delays.total_s < 0.08


@pytest.mark.parametrize(
    ("source", "spiked"),
    [
        ("relative_alt", {"SCALED_PRESSURE2": ("press_abs", -882.6)}),
        ("relative_alt", {"GLOBAL_POSITION_INT": ("relative_alt", 9000)}),
        ("pressure", {"SCALED_PRESSURE2": ("press_abs", -882.6)}),
        (
            "relative_alt",
            {"SCALED_PRESSURE2": ("press_abs", -882.6), "GLOBAL_POSITION_INT": ("relative_alt", 9000)},
        ),
    ],
    ids=["the pressure beside it", "the depth", "the pressure that is the depth", "both"],
)
def test_spikes_of_a_barometer_are_left_out_and_told(source, spiked):
    """A reading each second is 9 m too shallow, in each message that has it."""
    dive = active("sensors.dvl=false", companion=[f"vehicle.depth_source={source}"], seconds=8.0)
    begun_s = dive.t_s

    def change(kind, values):
        field, by = spiked.get(mavlink.mavlink_map[kind.id].msgname, ("", 0))
        if field:
            values[kind.fields.index(field)] += by

    spoil = altered(change)

    def spikes(t_s, inbox):
        at_s = (t_s - begun_s) % 1.03
        return spoil(START_S + t_s, inbox) if at_s < 0.09 else inbox

    dive.tap.spoil = spikes
    steps = dive.run(14.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert max(abs(step.truth.eta[2] - DEPTH_M) for step in steps) < 0.03
    told = [step for step in steps if step.sample.verdict.warnings & Condition.DEPTH_JUMPED]
    assert 0 < len(told) <= 42
    resets = Condition.DEPTH_RESET | Condition.INNOVATION_LARGE
    assert not any(step.sample.verdict.conditions & resets for step in steps)
