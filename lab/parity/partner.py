"""A ground station in virtual time: it sends, lets time pass, and returns what was answered."""

from collections.abc import Callable
from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

LINK = 1
GROUND_STATION, COMPONENT = 255, 190
HEARTBEAT_PERIOD_S = 1.0
ANSWER_S = 0.25

Message = Any
"""A pymavlink message; the dialect has no types."""


class SteppedVehicle(Protocol):
    """What `sim_bridge.vehicle.Vehicle` and `lab.loop.firmware.Firmware` have in common."""

    step_s: float
    time_s: float

    def open_link(self, link: int) -> None:
        """Take a link's telemetry from now on."""

    def step(self, datagrams: Any = ()) -> list[tuple[int, bytes]]:
        """Advance one step."""

    def truth(self) -> Any:
        """Tell the truth."""


class Partner:
    """One link to one vehicle, as system 255, which is its ground station and pilot."""

    def __init__(self, vehicle: SteppedVehicle) -> None:
        self.vehicle = vehicle
        self.heartbeats = True
        """Whether the ground station sends its own heartbeat once a second."""
        self.streaming: Callable[[], Message] | None = None
        """What is sent 20 times a second, such as sticks."""
        self._wire = mavlink.MAVLink(None, GROUND_STATION, COMPONENT)
        self._wire.robust_parsing = True
        self._heartbeat_s = self._stream_s = vehicle.time_s
        self._out: list[tuple[int, bytes]] = []
        vehicle.open_link(LINK)

    def send(self, message: Message, system: int = GROUND_STATION, component: int = COMPONENT) -> None:
        """Send with the next step."""
        wire = self._wire
        wire.srcSystem, wire.srcComponent = system, component
        self._out.append((LINK, bytes(message.pack(wire))))
        wire.seq = (wire.seq + 1) % 256

    def listen(self, seconds: float) -> list[Message]:
        """Let `seconds` pass; return what the vehicle said, in order."""
        heard: list[Message] = []
        until_s = self.vehicle.time_s + seconds - 1e-9
        while self.vehicle.time_s < until_s:
            now_s = self.vehicle.time_s
            if self.heartbeats and now_s >= self._heartbeat_s:
                self._heartbeat_s = now_s + HEARTBEAT_PERIOD_S
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            if self.streaming is not None and now_s >= self._stream_s:
                self._stream_s = now_s + 0.05
                self.send(self.streaming())
            out, self._out = self._out, []
            for link, data in self.vehicle.step(out):
                if link == LINK:
                    heard += [
                        message
                        for message in self._wire.parse_buffer(data) or ()
                        if message.get_type() != "BAD_DATA" and message.get_srcSystem() == 1
                    ]
        return heard

    def ask(self, message: Message, seconds: float = ANSWER_S) -> list[Message]:
        """Send and listen."""
        self.send(message)
        return self.listen(seconds)

    def command(self, number: int, *parameters: float, seconds: float = ANSWER_S) -> list[Message]:
        """Send a COMMAND_LONG and listen."""
        padded = [*parameters, *[0.0] * 7][:7]
        return self.ask(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded), seconds)

    def set_mode(self, mode: int) -> list[Message]:
        """Ask for a flight mode, and listen."""
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)

    def arm(self) -> list[Message]:
        """Ask for arming, and listen."""
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def disarm(self) -> list[Message]:
        """Ask for disarming, and listen."""
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)


def of_type(kind: str, heard: list[Message]) -> list[Message]:
    """Return the messages of a kind."""
    return [message for message in heard if message.get_type() == kind]


def result(heard: list[Message], command: int) -> int | str:
    """Return the result that a COMMAND_ACK gave for a command, or "no answer"."""
    results = [message.result for message in of_type("COMMAND_ACK", heard) if message.command == command]
    return int(results[0]) if results else "no answer"


def texts(heard: list[Message]) -> tuple[str, ...]:
    """Return the texts that were said, with severity; chunks of one text are joined."""
    said: list[str] = []
    for message in of_type("STATUSTEXT", heard):
        if message.id and message.chunk_seq and said:
            said[-1] += message.text
        else:
            said.append(f"{message.severity}: {message.text}")
    return tuple(said)
