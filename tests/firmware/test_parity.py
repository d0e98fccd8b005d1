"""The real firmware and our stand-in answer alike, on the same plant: each of `questions`.

The stand-in imitates 4.7. What another version answers in another way stands in OF_ANOTHER_VERSION.
"""

from fnmatch import fnmatchcase

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from questions import QUESTIONS, Near, Partner
from sim_wire import REQUEST, vehicle

from companion.mavlink.link_maintenance import PARAMETERS, RENAMED
from lab.loop.firmware import ORIGIN_DEG_E7, Firmware, parameters_of
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config

PLANT = ("current.enabled=false", "hull.net_buoyancy_n=0.0", "initial.eta=[0.0, 0.0, 3.0, 0.0, 0.0, 0.0]")
ORIGIN_S = 16.0
REST_S = 36.0
"""Our stand-in rests so long before it is asked: the firmware has long booted by then."""

NOBODY = "nobody steers by it: the stand-in sends it at rest, at the same rate"
KNOWN = (
    ("fields", "AHRS.omegaI?", "our gyro has no bias to be estimated"),
    ("fields", "AHRS.error_yaw", "the firmware's EKF still settles"),
    *(("fields", f"{name}.*", NOBODY) for name in ("SCALED_IMU?", "SIMSTATE", "NAV_CONTROLLER_OUTPUT")),
    *(("fields", f"{name}.*", NOBODY) for name in ("GIMBAL_DEVICE_ATTITUDE_STATUS", "VIBRATION")),
    *(("arming", f"{name}, *", "the stand-in refuses it") for name in ("ACRO", "SURFTRAK", "MOTOR_DETECT")),
    ("fields", "EKF_STATUS_REPORT.*_variance", "the firmware's EKF still settles"),
    ("fields", "VFR_HUD.groundspeed", "the firmware's EKF still settles"),
    ("fields", "BATTERY_STATUS.*", "our electronics draw 0.5 A, the firmware's simulated vehicle none"),
    ("fields", "SYS_STATUS.*_battery", "our electronics draw 0.5 A, the firmware's simulated vehicle none"),
    ("fields", "SCALED_PRESSURE.*", "a BlueROV2's first barometer is in the dry hull"),
    ("fields", "SCALED_PRESSURE2.press_abs", "the firmware simulates salt water of 1024 kg/m³"),
    ("commands", "MAV_CMD_DO_SEND_BANNER", "the board's own number"),
    ("parameters", "BARO?_GND_PRESS: value", "set when the barometer is zeroed"),
    ("parameters", "BARO_PRIMARY: value", "a BlueROV2's depth sensor is the second barometer"),
    ("parameters", "BATT_CAPACITY: value", "the configured battery's"),
    ("parameters", "COMPASS_OFS*", "a calibrated compass"),
    ("parameters", "SIM_PLD_*", "the place of the dive"),
    ("parameters", "STAT_*", "counts what this board has lived through"),
    ("arming", "*, armed", "its EKF turns its yaw when it is armed near the simulated steel"),
)
"""Question and answer, with wildcards, and why they may differ in every version."""

BOARD_ONLY = "its program for the simulator is built without the pilot-input failsafe that a board has"
OF_ANOTHER_VERSION = {
    "4.7": (  # the end of 2025; the stand-in's table is of an earlier 4.7
        ("streams", "GPS_RAW_INT, Hz", "not sent where the GPS is off"),
        ("fields", "GPS_RAW_INT.*", "not sent where the GPS is off"),
        ("requests", "GPS_RAW_INT: asked once", "not sent where the GPS is off"),
        ("failsafes", "*ilent for*", "the text of the lost heartbeat names no number"),
    ),
    "4.5": (
        ("streams", "GIMBAL_DEVICE_ATTITUDE_STATUS, Hz", "it starts without a camera mount"),
        ("streams", "TERRAIN_REPORT, Hz", "its simulator is built without terrain"),
        ("fields", "GIMBAL_DEVICE_ATTITUDE_STATUS.*", "it starts without a camera mount"),
        ("fields", "TERRAIN_REPORT.*", "its simulator is built without terrain"),
        ("fields", "GLOBAL_POSITION_INT.alt", "0 without a position"),
        ("fields", "VFR_HUD.alt", "0 without a position"),
        ("fields", "HEARTBEAT.system_status", BOARD_ONLY),
        ("fields", "MEMINFO.*", "the simulator's"),
        ("fields", "NAMED_VALUE_FLOAT.*", "its outputs for camera and lights are not set"),
        ("fields", "NAV_CONTROLLER_OUTPUT.alt_error", "not zeroed while disarmed"),
        ("fields", "RC_CHANNELS.chancount", "its simulator has a receiver"),
        ("fields", "SERVO_OUTPUT_RAW.servo10_raw", "its outputs for camera and lights are not set"),
        ("fields", "SYS_STATUS.onboard_*", "its simulator has a receiver"),
        ("requests", "TERRAIN_REPORT: *", "its simulator is built without terrain"),
        ("requests", "GIMBAL_DEVICE_ATTITUDE_STATUS: asked once", "it starts without a camera mount"),
        ("requests", "ATTITUDE too fast", "clamped to the loop's rate"),
        ("requests", "ATTITUDE below -1", "taken for unsigned"),
        ("commands", "MAV_CMD_NAV_LAND", "SURFACE is refused without a position"),
        ("commands", "MAV_CMD_NAV_LOITER_UNLIM", "another text"),
        ("parameters", "read  3", "another table"),
        ("parameters", "SERIAL?_*", "another default"),
        ("parameters", "SIM_*", "another simulator"),
        ("parameters", "EK3_SRC_OPTIONS: value", "another default"),
        ("parameters", "MNT1_TYPE: value", "it starts without a camera mount"),
        ("parameters", "RC3_TRIM: value", "another default, which ArduSub replaces while it steers"),
        ("parameters", "RC_PROTOCOLS: value", "another default"),
        ("parameters", "SERVO9_FUNCTION: value", "another default"),
        ("arming", "?: arm with *", BOARD_ONLY),
        ("arming", "arm with *", "it arms whatever the sticks say: THR_ARM_POS came later"),
        ("arming", "SURFACE, disarmed", "SURFACE is refused without a position"),
        ("arming", "POSHOLD, disarmed", "another text"),
        ("arming", "GUIDED, disarmed", BOARD_ONLY),
        ("steering", "* channels", "its simulator has a receiver"),
        ("failsafes", "sticks are silent for 4 s", BOARD_ONLY),
        ("failsafes", "*silent for [68] s*", BOARD_ONLY),
        ("failsafes", "* back", BOARD_ONLY),
        ("routing", "SET_MODE", "is acknowledged, too"),
        ("dynamics", "SURFACE: *", "SURFACE is refused without a position"),
    ),
}
"""Question and answer, with wildcards, and why this version answers in another way than the stand-in."""


@pytest.mark.parametrize("question", QUESTIONS)
def test_answers_are_the_same_or_differ_for_a_known_reason(question, ardusub):
    config = load_config(DEFAULT_CONFIG, PLANT)
    with Firmware(ardusub, config, seed=1, surveyed=False) as firmware:
        theirs, version = answers(question, firmware, ORIGIN_S)
    ours, _ = answers(question, vehicle(*PLANT), REST_S)
    known = [pattern for where, pattern, _ in (*KNOWN, *OF_ANOTHER_VERSION[version]) if where == question]
    if question == "parameters":
        # Each version has names of its own; those that Holdfast reads are in all of them.
        read = {RENAMED.get(name, name) for name in PARAMETERS}
        assert read <= {RENAMED.get(name, name) for name in names(theirs)}
        known += [f"{name}: *" for name in names(theirs) ^ names(ours)]
        known += [f"{name}: value" for name in parameters_of(config)]  # set at the simulator's start
    different = {
        name: (theirs.get(name), ours.get(name))
        for name in dict.fromkeys([*theirs, *ours])
        if not agree(theirs.get(name), ours.get(name))
        and not any(fnmatchcase(name, pattern) for pattern in known)
    }
    assert not different


def answers(question, rov, rest_s):
    """Give an origin, wait; return the vehicle's answers by name, and its version, such as "4.5"."""
    partner = Partner(rov)
    partner.ask(mavlink.MAVLink_set_gps_global_origin_message(1, *ORIGIN_DEG_E7, 0), rest_s)
    answered = dict(QUESTIONS[question](partner))
    version = partner.order(REQUEST, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION).last("AUTOPILOT_VERSION")
    return answered, f"{version.flight_sw_version >> 24}.{version.flight_sw_version >> 16 & 255}"


def names(answered):
    """Return the parameters among the answers."""
    return {name.partition(":")[0] for name in answered if name.endswith(": value")}


def agree(theirs, ours):
    if isinstance(theirs, Near) and isinstance(ours, Near):
        return ours.value == pytest.approx(
            theirs.value, abs=max(theirs.tolerance, ours.tolerance), nan_ok=True
        )
    return theirs == ours
