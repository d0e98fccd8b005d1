"""Between the ground station and the vehicle: every byte passes as and when it came, but for one thing.

While the engine steers, the pilot's steering does not reach the vehicle by itself: MANUAL_CONTROL and
RC_CHANNELS_OVERRIDE overwrite each other in ArduSub, and two senders make phantom button presses. It goes to
the engine, which sends one message for both. So do the messages that move the setpoint (`pilot.TARGETS`).
What asks something of our own component never reaches the vehicle. Frames may be MAVLink 1 or 2, signed or
not; they keep their signatures. Where there is a key the engine gets only what is signed with it: else
anybody could steer.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import Config
from companion.endpoint import Endpoint
from companion.mavlink.ardusub import NS_PER_S
from companion.mavlink.codec import addresses_us
from companion.mavlink.frames import HEADERS_OF_BOTH, Splitter, WireFrame, leading_frames
from companion.mavlink.inbox import MAX_BYTES, MAX_LOOKS
from companion.mavlink.pilot_frames import TARGETS, override_deflection
from companion.mavlink.signing import Signing
from companion.records import Sender

MAX_DATAGRAM: Final = 1400  # below Ethernet's 1500
MAX_LOOKS_A_TICK: Final = 2 * MAX_LOOKS
"""More beginnings of frames either way in one tick, or more than MAX_BYTES, are a flood, and dropped."""

MAX_FRAMES_A_TICK: Final = 64
"""The pilot's frames that the engine gets."""

HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT
MANUAL_CONTROL: Final = mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL
OVERRIDE: Final = mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE


class _Budget:
    """What may still pass one way in this tick."""

    def __init__(self) -> None:
        self._bytes, self._looks = MAX_BYTES, MAX_LOOKS_A_TICK

    def allows(self, data: bytes) -> bool:
        """Take the size of `data` from the remaining budget; tell whether it was enough."""
        self._bytes -= len(data)
        if self._bytes >= 0:
            self._looks -= len(HEADERS_OF_BOTH.findall(data))
        return self._bytes >= 0 and self._looks >= 0


class Relay:
    """Both ways between two links. `withhold` is set while the engine steers."""

    def __init__(self, config: Config, signing: Signing | None = None) -> None:
        vehicle, ground = Endpoint.parse(config.link.endpoint), Endpoint.parse(config.ground_station.endpoint)
        self.withhold = False
        self.left_out = 0
        """Bytes of floods."""
        self._link = link = config.link
        self._ours = {(link.system, link.component), (link.vehicle_system, link.component)}
        self._signing = signing
        self._up, self._down = (Splitter(end.is_stream, version_1=True) for end in (vehicle, ground))
        self._reframes_up = vehicle.is_stream and not ground.is_stream
        self._reframes_down = ground.is_stream and not vehicle.is_stream
        self._passed = 0
        self._heard: deque[tuple[int, bytes]] = deque(maxlen=MAX_FRAMES_A_TICK)
        self._up_budget, self._down_budget = _Budget(), _Budget()

    def to_ground(self, t_ns: int, data: bytes) -> Sequence[bytes]:
        """Return what goes to the ground station: all that came from the vehicle, in whole frames."""
        if not self._up_budget.allows(data):
            self.left_out += len(data)
            return ()
        if not self._reframes_up:
            return (data,)
        return _packed(piece for _, piece in self._up.cut(t_ns / NS_PER_S, data))

    def to_vehicle(self, t_ns: int, data: bytes) -> Sequence[bytes]:
        """Return the part of the ground station's bytes that goes to the vehicle."""
        if not self._down_budget.allows(data):
            self.left_out += len(data)
            return ()
        out: list[bytes] = []
        at = -self._passed  # of the piece, seen from the first byte that the vehicle does not have yet
        for frame, piece in self._down.cut(t_ns / NS_PER_S, data):
            withheld = frame is not None and self._withholds(t_ns, frame, piece)
            if not withheld or at < 0:
                out.append(piece[max(0, -at) :])
            at += len(piece)
        self._passed = max(0, -at)
        if not (self.withhold or self._reframes_down):
            out.append(self._down.rest[self._passed :])
            self._passed = len(self._down.rest)
        return _packed(out) if self._reframes_down else [b"".join(out)] if any(out) else ()

    def take(self) -> list[tuple[int, bytes]]:
        """Return the pilot's frames since the last tick: arrival (monotonic ns) and bytes."""
        heard = list(self._heard)
        self._heard.clear()
        self._up_budget, self._down_budget = _Budget(), _Budget()
        return heard

    def sender(self, _: float, data: bytes) -> Sender:
        """Tell who sent a datagram. The pilot's begins with sound frames, one of which the engine would get.

        Where there is a key that must be signed and new as well; `to_vehicle` will still find it new.
        """
        for frame, piece in leading_frames(data):
            if self._is_beacon(frame) or self._is_steering(frame):
                if self._signing is None:
                    return Sender.EXPECTED
                return self._signing.sender(piece) if frame.version == 2 else Sender.STRANGER
        return Sender.STRANGER

    def _withholds(self, t_ns: int, frame: WireFrame, data: bytes) -> bool:
        """Keep the pilot's heartbeat, steering and commands for the engine; tell if it alone gets it."""
        steering, addressed = self._is_steering(frame), addresses_us(frame, self._link)
        ours = (frame.system, frame.component) in self._ours
        heard = steering and (self.withhold or frame.id not in TARGETS)
        if (heard or addressed or ours or self._is_beacon(frame)) and self._believed(frame, data):
            self._heard.append((t_ns, data))
        return addressed or (steering and self.withhold)

    def _is_beacon(self, frame: WireFrame) -> bool:
        return frame.id == HEARTBEAT and bool(frame.message().type == mavlink.MAV_TYPE_GCS)

    def _is_steering(self, frame: WireFrame) -> bool:
        return frame.system == self._link.system and _steers(frame, self._link.vehicle_system)

    def _believed(self, frame: WireFrame, data: bytes) -> bool:
        return self._signing is None or (frame.version == 2 and self._signing.accepts(data))


def _steers(frame: WireFrame, vehicle: int) -> bool:
    """Tell whether ArduSub would be steered by it: overrides that touch none of the six axes pass."""
    if frame.id == MANUAL_CONTROL:
        return bool(frame.message().target == vehicle)
    if frame.id in TARGETS:
        return frame.message().target_system in (0, vehicle)
    return frame.id == OVERRIDE and override_deflection(frame.message()) is not None


def _packed(pieces: Iterable[bytes]) -> list[bytes]:
    """Join pieces to as few datagrams as possible, without cutting a piece that fits into one."""
    datagrams: list[bytes] = []
    for piece in pieces:
        for at in range(0, len(piece), MAX_DATAGRAM):
            part = piece[at : at + MAX_DATAGRAM]
            if datagrams and len(datagrams[-1]) + len(part) <= MAX_DATAGRAM:
                datagrams[-1] += part
            else:
                datagrams.append(part)
    return datagrams
