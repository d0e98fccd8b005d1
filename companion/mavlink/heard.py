"""What arrives that is not the vehicle which we look for: why there is no heartbeat, and what helps.

`holdfast check`, `run` and every screen have these words. Silence is said only where nothing arrives.
"""

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import LinkSection
from companion.mavlink.frames import V1_MARKER, WireFrame, frame_at

LATELY_S: Final = 3.0
"""Longer than the interval of heartbeats, shorter than LINK_LOST waits: a cut link is reported at once."""
LOOK_S: Final = 0.02
MOST: Final = 32
"""Senders that are kept."""
EXCERPT: Final = 12

NOTHING: Final = "look at power, cable and link.endpoint; in BlueOS, MAVLink Endpoints says where it sends"
ELSEWHERE: Final = "send the vehicle's MAVLink here (BlueOS: MAVLink Endpoints), or change link.endpoint"
PROTOCOL: Final = "SERIALn_PROTOCOL = 2 in the autopilot, n = 0 for USB"
UNSIGNED, OTHER_KEY, OLD, V1, AUTOPILOT, FRAMES, OTHER, GROUND, OURS, BARRED, JUNK = range(11)
WORDS: Final = {
    UNSIGNED: ("frames of {} that are not signed", "set the vehicle's key, or no link.signing_key_file"),
    OTHER_KEY: ("frames of {} that are signed with another key", "link.signing_key_file: use one key"),
    OLD: ("frames of {}, rightly signed, with time stamps of the past", "set the clocks: docs/wiring.md"),
    V1: ("MAVLink 1 frames of {}", f"set {PROTOCOL}; {{ids}}"),
    AUTOPILOT: ("heartbeats of another autopilot, {},", "set {ids}"),
    FRAMES: ("frames of {}, and no heartbeat of the autopilot", "let the router pass HEARTBEAT; {ids}"),
    OTHER: ("heartbeats of {}, which is no autopilot", "let the router pass the autopilot's frames"),
    GROUND: ("only heartbeats of a ground station, {}", ELSEWHERE),
    OURS: ("only our own frames", ELSEWHERE),
    BARRED: ("datagrams of {}, which link.allow leaves out,", "add it to link.allow"),
    JUNK: ("bytes that are not MAVLink, {}", f"correct port or baud rate in link.endpoint, or {PROTOCOL}"),
}
"""What is said of an arrival, and what helps; the most telling first."""


class Overheard:
    """Takes what the link cannot use, each with its arrival on our clock."""

    def __init__(self, link: LinkSection) -> None:
        self._link = link
        self._wanted = (link.vehicle_system, link.vehicle_component)
        self._seen: dict[tuple[int, tuple[int, int] | str], float] = {}
        """When something came last: what, and of which system and component, or of whom in words."""
        self._looked_s = -LOOK_S
        self.vehicle_signs = False
        """Whether the vehicle's last heartbeat was signed."""

    def frame(self, t_s: float, frame: WireFrame, kind: int = FRAMES) -> None:
        """Note a sound frame; `kind` tells what is wrong with its signature."""
        system, component = frame.system, frame.component
        if frame.version == 1:
            kind = V1
        elif component == self._link.component and system in (self._link.system, self._wanted[0]):
            kind = OURS
        elif kind == FRAMES and frame.id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            beat = frame.message()
            other = OTHER if beat.autopilot == mavlink.MAV_AUTOPILOT_INVALID else AUTOPILOT
            kind = GROUND if beat.type == mavlink.MAV_TYPE_GCS else other
        self._note(t_s, kind, (system, component))

    def junk(self, t_s: float, data: bytes) -> None:
        """Note what is no MAVLink 2; one in LOOK_S is looked at for a frame of MAVLink 1."""
        if t_s - self._looked_s < LOOK_S:
            return
        self._looked_s, at = t_s, data.find(V1_MARKER)
        if at >= 0 and (frame := frame_at(data, at)[1]) is not None:
            self.frame(t_s, frame)
        else:
            known = next((whom for kind, whom in self._seen if kind == JUNK), "")
            self._note(t_s, JUNK, known or f"such as {ascii(data[:EXCERPT])[1:]}")

    def barred(self, t_s: float, host: str) -> None:
        """Note a sender that is not permitted."""
        self._note(t_s, BARRED, host)

    def _note(self, t_s: float, kind: int, whom: tuple[int, int] | str) -> None:
        if (kind, whom) in self._seen or len(self._seen) < MOST:
            self._seen[kind, whom] = t_s

    def contact(self, now_s: float) -> tuple[str, str]:
        """Return why the heartbeat does not come, and what to do."""
        self._seen = {key: t_s for key, t_s in self._seen.items() if now_s - t_s <= LATELY_S}
        if not self._seen:
            return f"nothing arrives at {self._link.endpoint}", NOTHING
        kind, _, whom, ids = min((kind, *self._in_words(whom)) for kind, whom in self._seen)
        found, fix = (words.format(whom, ids=ids).rstrip("; ") for words in WORDS[kind])
        return f"{found} arrive at {self._link.endpoint}", fix

    def _in_words(self, whom: tuple[int, int] | str) -> tuple[bool, str, str]:
        """Return whether it is another than is wanted, who it is, and which keys would want it."""
        if isinstance(whom, str):
            return False, whom, ""
        triples = zip(("vehicle_system", "vehicle_component"), whom, self._wanted, strict=True)
        ids = ", ".join(f"link.{name} = {has}" for name, has, wanted in triples if has != wanted)
        return bool(ids), "system {}, component {}".format(*whom), ids
