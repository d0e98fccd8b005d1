"""A pilot's ground station: what it hears of Holdfast, decoded by pymavlink, and what it commands."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Somebody

from companion.telemetry.event_log import EventLog

ENGAGE, RELEASE, HOLD = 1, 2, 3
"""Parameter 1 of MAV_CMD_USER_1."""


class Shown:
    """The frames for the ground station's link, or, without one, for the vehicle's."""

    def __init__(self, dive):
        self.dive, self.log = dive, EventLog()
        self.parser = mavlink.MAVLink(None)
        self.sequence = []
        """Of all frames of our component."""
        self._data = b""
        dive.tap.after = self._after

    def _after(self, out, sample):
        shown = self.dive.engine.displayed(sample, self.log.step(sample))
        self.sequence += [frame[4] for frame in (*out, *shown) if frame[5:7] == bytes((1, 25))]
        self._data += b"".join(shown)

    def run(self, seconds):
        """Return the messages of the coming seconds."""
        self.dive.run(seconds)
        data, self._data = self._data, b""
        return self.parser.parse_buffer(data) or []

    def texts(self, seconds):
        return joined(self.run(seconds))


def command(action, system=255, target=(1, 25), number=mavlink.MAV_CMD_USER_1):
    """A MAVLink action of QGroundControl (src/QmlControls/MavlinkAction.cc): COMMAND_LONG to a component."""
    message = mavlink.MAVLink_command_long_message(*target, number, 0, action, 0, 0, 0, 0, 0, 0)
    return Somebody(system).frame(message)


def results(messages):
    """Return the answers to commands."""
    return [message.result for message in messages if message.get_type() == "COMMAND_ACK"]


def joined(messages):
    """Return (severity, text) of the STATUSTEXTs, chunks put together as MAVLink says."""
    texts: list[tuple[int, str]] = []
    parts: list[str] = []
    for message in messages:
        if message.get_type() == "STATUSTEXT":
            assert message.chunk_seq == len(parts)
            parts.append(message.text)
            if not message.id or len(message.text) < 50:
                texts.append((message.severity, "".join(parts)))
                parts = []
    assert not parts, "a text that does not end"
    return texts
