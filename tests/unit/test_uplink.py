"""All that a real QGroundControl sent to a real BlueROV2, sent to our stand-in: it answers in kind.

`python -m tests.tools.uplink` made the files from logs of ArduSub 4.1: tests/data/README.md.
"""

import json
from fnmatch import fnmatchcase

import pytest
from sim_wire import vehicle
from tools.uplink import DATA, LOGS, Answers, replay

from sim_bridge.firmware.params import DEFAULTS

GONE = {
    "SYSID_*": "MAV_SYSID, MAV_GCS_SYSID",
    "SR?_*": "MAVn_*",
    "GPS_*": "GPS1_*, GPS2_*",
    "MNT_*": "MNT1_*",
    "PRX_*": "PRX1_*",
    "RELAY_*": "RELAYn_*",
    "RNGFND1_*": "hidden while RNGFND1_TYPE is 0, as ArduSub 4.1 did not",
    "RNGFND_GAIN": "SURFTRAK took its place",
    "AHRS_CUSTOM_*": "CUST_ROT_*",
    "COMPASS_CUS_*": "CUST_ROT_*",
    "COMPASS_TYPEMASK": "COMPASS_DISBLMSK",
    "INS_NOTCH_ENABLE": "INS_HNTC2_ENABLE",
    "CAM_RC_TYPE": "CAM1_TYPE",
    "ARSPD_TYPE": "hidden while ARSPD_ENABLE is 0",
    "BATT_BUS": "hidden with an analogue battery monitor",
    "BRD_ALT_CONFIG": "of the real board",
    "BRD_PWM_COUNT": "of the real board, and gone",
    "CONTROL_FRAME": "of a beta version",
    "SCR_ENABLE": "only builds with scripting have it",
}
"""Parameters of ArduSub 4.1 that 4.7 does not tell, and what took their place."""
UNANSWERED = {"PARAM_SET RNGFND1_MAX_CM": "4.7 does not have this parameter"}
NOT_STREAMED = {
    "HWSTATUS": "on request only since 4.7",
    "MOUNT_STATUS": "GIMBAL_DEVICE_ATTITUDE_STATUS since 4.4",
    "SENSOR_OFFSETS": "gone since 4.3",
    "LOCAL_POSITION_NED": "that vehicle had a position from GPS_INPUT",
    "PARAM_VALUE": "another program set parameters",
}


@pytest.fixture(scope="module", params=LOGS)
def both(request: pytest.FixtureRequest) -> tuple[Answers, Answers]:
    """The real vehicle's answers, and ours."""
    real: Answers = json.loads((DATA / f"{request.param}-answers.json").read_text(encoding="ascii"))
    return real, replay(vehicle(), request.param)


def test_every_request_that_was_answered_is_answered_alike(both: tuple[Answers, Answers]) -> None:
    real, ours = both
    for request, said in real["answered"].items():
        autopilots = [one for one in said if one.startswith("1: ")]
        if request in UNANSWERED:
            assert autopilots
            assert not ours["answered"][request]
        else:
            assert ours["answered"][request] == autopilots, request


def test_every_parameter_that_is_still_there_is_reported(both: tuple[Answers, Answers]) -> None:
    real, ours = both
    assert set(ours["parameters"]) == set(DEFAULTS)
    missing = set(real["parameters"]) - set(DEFAULTS)
    assert not {name for name in missing if not any(fnmatchcase(name, gone) for gone in GONE)}


def test_every_message_streams_as_fast(both: tuple[Answers, Answers]) -> None:
    real, ours = both
    for kind, rate_hz in real["rates_hz"].items():
        if kind not in NOT_STREAMED:
            rate = 18.0 if kind == "NAMED_VALUE_FLOAT" else rate_hz  # 4.7 tells nine values for eight
            assert ours["rates_hz"][kind] == pytest.approx(rate, rel=0.06, abs=0.06), kind
