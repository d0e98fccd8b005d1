"""What is said where nothing is heard: what was, what may be, what to do."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_config
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.heard import LATELY_S
from companion.mavlink.signing import Signing
from companion.records import Sender

BEAT = mavlink.MAVLink_heartbeat_message(12, 3, 0x51, 19, 3, 3)
ATTITUDE = mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)
CAMERA = mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3)
STATION = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def said(message, system=1, component=1, *, version_1=False, key=None):
    """What one sender says."""
    link = mavlink.MAVLink(None, system, component)
    if key:
        link.signing.secret_key, link.signing.sign_outgoing = key, True
        link.signing.timestamp = 10**10
    return bytes(message.pack(link, force_mavlink1=version_1))


KEY, OTHER = b"k" * 32, b"o" * 32
HEARD = [
    (said(BEAT, version_1=True), None, "MAVLink 1 frames of system 1, component 1", "SERIALn_PROTOCOL = 2"),
    (said(ATTITUDE, 7, version_1=True), None, "MAVLink 1 frames of system 7", "link.vehicle_system = 7"),
    (said(BEAT, 7), None, "another autopilot, system 7, component 1", "set link.vehicle_system = 7"),
    (said(BEAT, 1, 2), None, "another autopilot, system 1, component 2", "set link.vehicle_component = 2"),
    (said(ATTITUDE), None, "frames of system 1, component 1, and no heartbeat", "pass HEARTBEAT"),
    (said(CAMERA, 1, 100), None, "system 1, component 100, which is no autopilot", "router"),
    (said(STATION, 255, 190), None, "only heartbeats of a ground station, system 255", "MAVLink Endpoints"),
    (said(STATION, 255, 25), None, "only our own frames", "link.endpoint"),
    (b"$GPGGA,1,2,3,4", None, "bytes that are not MAVLink, such as '$GPGGA,1,2,3'", "baud rate"),
    (b"\x00\xfd\x01\xfe\xff", None, "bytes that are not MAVLink", "SERIALn_PROTOCOL"),
    (said(BEAT), KEY, "frames of system 1, component 1 that are not signed", "the vehicle's key"),
    (said(BEAT, key=OTHER), KEY, "that are signed with another key", "link.signing_key_file"),
    (said(STATION, 255, 190) + said(BEAT, 7), None, "another autopilot, system 7", "= 7"),
]


@pytest.mark.parametrize("stream", [False, True], ids=["a stranger's datagram", "a stream"])
@pytest.mark.parametrize(("data", "key", "found", "fix"), HEARD, ids=[f"{found}" for *_, found, _ in HEARD])
def test_silence_is_said_only_where_nothing_arrives(data, key, found, fix, stream):
    overrides = ("link.endpoint=tcp:127.0.0.1:5760",) if stream else ()
    autopilot = Autopilot(load_config(overrides=overrides), Signing(key) if key else None)

    def hear(now_s):
        if stream or autopilot.sender(now_s, data) is Sender.EXPECTED:
            autopilot.receive([(round(now_s * 1e9), data)])
        return autopilot.heard.contact(now_s)

    assert autopilot.heard.contact(0.9)[0].startswith("nothing arrives at ")
    why, todo = hear(1.0)
    assert found in why
    assert fix in todo
    assert ("tcp:" if stream else "udp-listen:127.0.0.1:14550") in why
    assert autopilot.heard.contact(1.1 + LATELY_S)[0].startswith("nothing arrives at "), (
        "what was heard is over"
    )


def test_of_a_cut_link_it_says_that_nothing_arrives_as_soon_as_the_heartbeat_is_missed():
    autopilot = Autopilot(config := load_config())
    autopilot.receive([(0, said(BEAT) + said(ATTITUDE) + said(STATION, 255, 190))])
    assert autopilot.heard.contact(config.supervisor.heartbeat_timeout_s)[0].startswith("nothing arrives at ")


def test_an_autopilot_that_speaks_mavlink_1_is_greeted_and_one_that_is_barred_is_named():
    autopilot = Autopilot(load_config())
    assert autopilot.sender(0.0, said(BEAT, version_1=True)) is Sender.BEHIND, "it may speak MAVLink 2 then"
    assert autopilot.sender(0.0, said(BEAT, 7, version_1=True)) is Sender.STRANGER
    signed = Autopilot(load_config(), Signing(KEY))
    assert signed.sender(0.0, said(BEAT, version_1=True)) is Sender.STRANGER
    signed.heard.barred(0.0, "10.0.0.5")
    assert "MAVLink 1" in signed.heard.contact(0.0)[0]
    autopilot = Autopilot(load_config())
    autopilot.heard.barred(0.0, "10.0.0.5")
    assert "datagrams of 10.0.0.5, which link.allow leaves out" in autopilot.heard.contact(0.0)[0]
