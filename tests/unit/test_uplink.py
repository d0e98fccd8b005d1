"""All that a real QGroundControl sent to a real BlueROV2, sent to our stand-in: it answers in kind.

`python -m tests.tools.uplink` made the files from logs of ArduSub 4.1: tests/data/README.md.
"""

import json

import pytest
from sim_wire import vehicle
from tools.uplink import DATA, LOGS, Answers, replay

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


def test_every_message_streams_as_fast(both: tuple[Answers, Answers]) -> None:
    real, ours = both
    for kind, rate_hz in real["rates_hz"].items():
        if kind not in NOT_STREAMED:
            rate = 18.0 if kind == "NAMED_VALUE_FLOAT" else rate_hz  # 4.7 tells nine values for eight
            assert ours["rates_hz"][kind] == pytest.approx(rate, rel=0.06, abs=0.06), kind
