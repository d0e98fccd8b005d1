"""The real firmware and our stand-in answer alike, on the same plant: each of `questions`."""

from fnmatch import fnmatchcase

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from questions import QUESTIONS, Near, Partner
from sim_wire import vehicle

from lab.loop.firmware import ORIGIN_DEG_E7, Firmware, parameters_of
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config

PLANT = ("current.enabled=false", "hull.net_buoyancy_n=0.0", "initial.eta=[0.0, 0.0, 3.0, 0.0, 0.0, 0.0]")
REST_S = 34.0
"""Our stand-in rests so long before it is asked: the firmware has long booted by then."""

KNOWN = (
    ("fields", "AHRS.omegaI?", "our gyro has no bias to be estimated"),
    ("fields", "BATTERY_STATUS.*", "our electronics draw 0.5 A, the firmware's simulated vehicle none"),
    ("fields", "SYS_STATUS.*_battery", "our electronics draw 0.5 A, the firmware's simulated vehicle none"),
    ("fields", "GIMBAL_DEVICE_ATTITUDE_STATUS.q", "the camera's estimated angle has no noise"),
    ("fields", "SCALED_PRESSURE.*", "a BlueROV2's first barometer is in the dry hull"),
    ("fields", "SCALED_PRESSURE2.press_abs", "the firmware simulates salt water of 1024 kg/m³"),
    ("fields", "SIMSTATE.lng", "rounding of the last digit"),
    ("commands", "MAV_CMD_DO_ACCEPT_MAG_CAL", "depends on how far the calibration begun before has come"),
    ("commands", "MAV_CMD_DO_SEND_BANNER", "the board's own number"),
    ("commands", "MAV_CMD_GIMBAL_FULL_RESET", "a text that happens to fall there"),
    ("parameters", "*GPS1_*", "the firmware hides the parameters of a GPS that is off"),
    ("parameters", "SCR_ENABLE: *", "only builds with scripting have it"),
    ("parameters", "NET_*", "only builds with networking have it"),
    ("parameters", "BARO?_GND_PRESS: value", "set when the barometer is zeroed"),
    ("parameters", "BARO_PRIMARY: value", "a BlueROV2's depth sensor is the second barometer"),
    ("parameters", "BATT_CAPACITY: value", "the configured battery's"),
    ("parameters", "COMPASS_OFS*", "a calibrated compass"),
    ("parameters", "SIM_PLD_*", "the place of the dive"),
    ("parameters", "STAT_*", "counts what this board has lived through"),
    ("arming", "*, armed", "its EKF turns its yaw when it is armed near the simulated steel"),
)
"""Question and answer, with wildcards, and why they may differ."""


@pytest.mark.parametrize("question", QUESTIONS)
def test_answers_are_the_same_or_differ_for_a_known_reason(question, ardusub):
    config = load_config(DEFAULT_CONFIG, PLANT)
    with Firmware(ardusub, config, seed=1) as firmware:
        theirs = answers(question, firmware)
    ours = vehicle(*PLANT)
    Partner(ours).ask(mavlink.MAVLink_set_gps_global_origin_message(1, *ORIGIN_DEG_E7, 0), REST_S)
    ours = answers(question, ours)
    known = [pattern for where, pattern, _ in KNOWN if where == question]
    if question == "parameters":  # set for the firmware's simulator at its start
        known += [f"{name}: value" for name in parameters_of(config)]
    different = {
        name: (theirs.get(name), ours.get(name))
        for name in dict.fromkeys([*theirs, *ours])
        if not agree(theirs.get(name), ours.get(name))
        and not any(fnmatchcase(name, pattern) for pattern in known)
    }
    assert not different


def answers(question, rov):
    partner = Partner(rov)
    partner.listen(2.0)
    return dict(QUESTIONS[question](partner))


def agree(theirs, ours):
    if isinstance(theirs, Near) and isinstance(ours, Near):
        return ours.value == pytest.approx(
            theirs.value, abs=max(theirs.tolerance, ours.tolerance), nan_ok=True
        )
    return theirs == ours
