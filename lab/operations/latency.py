"""How late things are on their way through `holdfast run`: the relay, and a command after its sensor.

Measured from outside while it dives in the simulator: this process stands on the wire to the vehicle and is
the ground station as well, so that one clock stamps everything. What the machine itself costs just then
shows in a process that only sends everything back.
"""

import select
import socket
import time

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
STEERING = (mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE)
SAY_S = 0.01
COMPUTING_S = 0.001
"""A command that leaves sooner after a sensor's datagram was computed before it came."""


class Wire:
    """The wire between vehicle and companion, with a ground station at the companion's other link."""

    def __init__(self) -> None:
        self._ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(4)]
        for end in self._ends:
            end.bind(("127.0.0.1", 0))
        self._vehicle, self._companion, self._ground, self._echo = self._ends
        self._packer = mavlink.MAVLink(None, 255, 190)
        self._count = 0
        self._reply_to: tuple[str, int] | None = None
        self.up_s: list[float] = []
        """Vehicle to ground station, through the relay."""
        self.down_s: list[float] = []
        """Ground station to vehicle."""
        self.echo_s: list[float] = []
        """To the process that does nothing and back."""
        self.command_s: list[float] = []
        """A datagram with ATTITUDE to the first command that was computed with it.

        Telemetry and ticks both come every 20 ms, each by its own clock: how long the one waits for the
        other, 0 to 20 ms, is another in every run, and hardly changes within it.
        """

    def endpoints(self) -> tuple[str, str, str]:
        """Return where the vehicle calls, and the companion's two endpoints."""
        vehicle, companion, ground = (
            f"127.0.0.1:{end.getsockname()[1]}" for end in (self._vehicle, self._companion, self._ground)
        )
        return vehicle, f"udp-connect:{companion}", f"udp-connect:{ground}"

    def run(self, seconds: float, warm_up_s: float, echo_port: int) -> None:
        """Pass everything on for so long; stamp what passes once `warm_up_s` is over."""
        begun_s = next_s = time.monotonic()
        sent_up: dict[bytes, float] = {}
        sent_down: dict[bytes, float] = {}
        sensed: list[float] = []
        companion = ground = None
        echoed_s = 0.0
        while (now_s := time.monotonic()) < begun_s + seconds:
            counts = now_s > begun_s + warm_up_s
            if now_s >= next_s and ground is not None:
                next_s += SAY_S
                data = self._said()
                sent_down[data] = time.monotonic()
                self._ground.sendto(data, ground)
                echoed_s = time.monotonic()
                self._echo.sendto(data, ("127.0.0.1", echo_port))
            ends, _, _ = select.select(self._ends, [], [], SAY_S / 4)
            for end in ends:
                try:
                    data, peer = end.recvfrom(65535)
                except ConnectionError:
                    continue
                at_s = time.monotonic()
                if end is self._echo:
                    self.echo_s += [at_s - echoed_s] if counts else []
                elif end is self._vehicle:
                    self._reply_to = peer
                    if companion is not None:
                        self._companion.sendto(data, companion)
                        sent_up[data] = at_s
                        if _message_id(data) == ATTITUDE:
                            sensed.append(at_s)
                elif end is self._ground:
                    ground = peer
                    if (since_s := sent_up.pop(data, None)) is not None and counts:
                        self.up_s.append(at_s - since_s)
                else:
                    companion = peer
                    if (since_s := sent_down.pop(data, None)) is not None and counts:
                        self.down_s.append(at_s - since_s)
                    if _message_id(data) in STEERING:
                        used = [s for s in sensed if at_s - s >= COMPUTING_S]
                        sensed = sensed[len(used) :]
                        self.command_s += [at_s - s for s in used] if counts else []
                    if self._reply_to is not None:
                        self._vehicle.sendto(data, self._reply_to)

    def close(self) -> None:
        """Close the sockets."""
        for end in self._ends:
            end.close()

    def _said(self) -> bytes:
        """Return a frame of the ground station's; its heartbeats count up, so that each is known again."""
        self._packer.seq = (self._packer.seq + 1) & 0xFF
        self._count += 1
        message = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, self._count, 4, 3)
        return bytes(message.pack(self._packer))


def echo(port: int) -> None:
    """Send every datagram back, for ever."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", port))
        while True:
            end.sendto(*end.recvfrom(65535))


def percentiles_ms(delays_s: list[float]) -> tuple[float, float]:
    """Return median and 99th percentile in ms."""
    p50, p99 = np.percentile(delays_s, [50, 99]) * 1e3
    return float(p50), float(p99)


def _message_id(frame: bytes) -> int:
    return frame[7] | frame[8] << 8 | frame[9] << 16 if len(frame) > 9 and frame[0] == 0xFD else -1
