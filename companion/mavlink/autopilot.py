"""The autopilot as the engine sees it: bytes in, events out; commands in, bytes out."""

from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import Config
from companion.endpoint import Endpoint
from companion.mavlink.ardusub import FRAMES, NS_PER_S, manual_control_reach, quantise, stick_demand
from companion.mavlink.codec import STEERING, Codec, Packer
from companion.mavlink.decode import Decoder
from companion.mavlink.encode import Commands, clock_mark
from companion.mavlink.frames import frame_at
from companion.mavlink.freshness import Freshness
from companion.mavlink.link_maintenance import LinkMaintenance
from companion.mavlink.messages import Message, message_name
from companion.mavlink.pilot_frames import pilot_events
from companion.mavlink.signing import Signing
from companion.mavlink.streams import streams
from companion.records import (
    NEUTRAL,
    AxisCommand,
    Event,
    Flags,
    GlobalOrigin,
    LinkCounters,
    OtherHoldfast,
    PilotSticks,
)
from companion.telemetry.modes import Mode

ABOUT = {"FRAME_CONFIG", "FS_PILOT_INPUT", "FS_PILOT_TIMEOUT", "MAV_GCS_SYSID"}


class Autopilot:
    """One vehicle behind one link: decoding, steering by the configured path, and what is asked again."""

    def __init__(self, config: Config, signing: Signing | None = None) -> None:
        link, vehicle = config.link, config.vehicle
        self._link = link
        mark = clock_mark(link.system, link.component)
        self._commands = Commands(link.vehicle_system, link.vehicle_component, mark)
        rates_hz = streams(vehicle.depth_source)
        self.asked_hz = {message_name(key): hz for key, hz in rates_hz.items()}
        """How often each stream is wanted, by MAVLink name."""
        self._maintenance = LinkMaintenance(self._commands, rates_hz)
        self.parameters = self._maintenance.parameters
        """The autopilot's parameters, as far as they were read."""
        self.counters = LinkCounters()
        """What became of the bytes."""
        self._decoder = Decoder(self.counters, depth_source=vehicle.depth_source, parameters=self.parameters)
        self._codec = Codec(
            link,
            stream=Endpoint.parse(link.endpoint).is_stream,
            wanted=self._decoder.ids,
            counters=self.counters,
            signing=signing,
        )
        self.heard = self._codec.heard
        self.sender = self._codec.sender
        onboard = (link.vehicle_system, link.component, signing, self._codec.sent)
        self._onboard = Packer(*onboard)
        self._display = Packer(*onboard) if config.ground_station.endpoint else self._onboard
        """Packs for the pilot's link; without one these frames go over the vehicle's, with our heartbeat."""
        self._hello = Packer(*onboard)
        """A packer of its own: it must not shift the sequence numbers of what the ticks send."""
        self._signing = signing
        self._freshness = Freshness()
        self._path = vehicle.thrust_path
        self._tilts = config.levels

    def hello(self) -> bytes:
        """Return a heartbeat for whoever is not yet our peer; signed, it tells the time."""
        return self._hello.encode(self._commands.heartbeat())

    def receive(
        self, datagrams: Sequence[tuple[int, bytes]], ground: Sequence[tuple[int, bytes]] = ()
    ) -> list[Event]:
        """Turn what arrived, each with its arrival in monotonic ns, into events. Never raises for any bytes.

        `ground` are the pilot's frames as `Relay.take` gives them. Those with our ids are another Holdfast's,
        or our own that come back.
        """
        events: list[Event] = []
        for t_ns, data in datagrams:
            t_s = t_ns / NS_PER_S
            found = self._codec.decode(t_s, data)
            for message in found.messages:
                self._maintenance.heard(message.MESSAGE_ID)
                events += self._decoder.to_events(message, t_s)
            events += [OtherHoldfast(t_s, frame.id in STEERING) for frame in found.others]
            for asked in found.addressed:
                events += pilot_events(asked, t_s, self.origin, self._link)
        others: list[Event] = []
        pilots: list[Event] = []
        for t_ns, data in ground:
            frame, t_s = frame_at(data, 0)[1] if data else None, t_ns / NS_PER_S
            if frame is None:
                continue
            if (frame.system, frame.component) not in self._codec.ours:
                pilots += pilot_events(frame, t_s, self.origin, self._link)
            elif self._codec.is_others(frame, data):
                others.append(OtherHoldfast(t_s, frame.id in STEERING))
        return [*self._freshness.drop_stale(events), *others, *pilots]

    def upkeep(
        self,
        now_s: float,
        events: Sequence[Event],
        *,
        mode: Mode | None,
        arm: bool,
        confirm: frozenset[str] = frozenset(),
    ) -> list[bytes]:
        """Return the requests of this tick, for `mode` too unless it is None, and with `arm` for arming.

        The parameters in `confirm` are read again at once.
        """
        if self._signing is not None:
            self._signing.advance(now_s)
        asked = self._maintenance.step(now_s, events, want_mode=mode, want_armed=arm, confirm=confirm)
        return [self._encode(message) for message in asked]

    def displayed(self, messages: Sequence[Message]) -> list[bytes]:
        """Return the frames for the pilot's ground station, from the vehicle's system and our component."""
        return [self._display.encode(message) for message in messages]

    def _encode(self, message: Message) -> bytes:
        """Pack requests as the ground station that ArduSub obeys, and our heartbeat as part of the vehicle.

        A heartbeat under the ground station's id would hide from the firmware that the real one is lost.
        """
        onboard = message.MESSAGE_ID == mavlink.MAVLINK_MSG_ID_HEARTBEAT
        return (self._onboard if onboard else self._codec).encode(message)

    def set_mode(self, mode: Mode) -> bytes:
        """Return the frame that asks for `mode` once, whatever the heartbeat says."""
        return self._codec.encode(self._commands.set_mode(mode))

    def disarm(self) -> bytes:
        """Return the frame that asks once to disarm; `upkeep` never does."""
        return self._encode(self._commands.arm(False))

    def sticks_beside(
        self, engaged: Flags, pilot: PilotSticks | None, pilot_gain: float
    ) -> tuple[AxisCommand, tuple[bool, bool, bool, bool, bool, bool]]:
        """Return what the pilot's sticks demand, and which of the six axes are held beside them.

        All are held without sticks. Roll and pitch are where they are levelled, as long as anything is.
        """
        if pilot is None:
            return NEUTRAL, (True, True, True, True, True, True)
        tilts = self._tilts and any(engaged)
        return stick_demand(pilot.sticks, pilot_gain, self._throttle_gain), (*engaged, tilts, tilts)

    def steer(self, command: AxisCommand, pilot_gain: float, pilot: PilotSticks | None = None) -> bytes:
        """Return the frame that puts `command` on the vehicle's axes, with the pilot's buttons."""
        if self._path == "rc_override":
            return self._codec.encode(self._commands.rc_override(command, tilts=self._tilts))
        return self._codec.encode(
            self._commands.manual_control(command, pilot_gain, self._throttle_gain, pilot)
        )

    def neutral(self) -> bytes:
        """Return the frame that stops all thrust."""
        return self.steer(NEUTRAL, 1.0)

    def applied(self, command: AxisCommand, pilot_gain: float) -> AxisCommand:
        """Return what the vehicle makes of `command` after rounding to the wire's integers."""
        return quantise(command, self._path, pilot_gain, self._throttle_gain)

    def reach(self, pilot_gain: float, share: float) -> AxisCommand:
        """Return a share of the largest demand that the path can carry on each axis."""
        if self._path == "rc_override":
            return AxisCommand(share, share, share, share, share, share)
        surge, sway, heave, yaw, _, _ = manual_control_reach(pilot_gain, self._throttle_gain)
        return AxisCommand(share * surge, share * sway, share * heave, share * yaw, share, share)

    @property
    def origin(self) -> GlobalOrigin | None:
        """Where on earth the EKF's origin is, once it has reported one."""
        return self._maintenance.origin

    @property
    def about(self) -> str:
        """Who it is and what protects it, in a line; empty until that is known."""
        reported, firmware = self.parameters, self._maintenance.firmware
        if firmware is None or not reported.keys() >= ABOUT:
            return ""
        frame = FRAMES.get(reported["FRAME_CONFIG"], f"frame {reported['FRAME_CONFIG']:g}")
        return f"ArduSub {firmware.text}, {frame}, " + ", ".join(
            f"{name} {reported[name]:g}" for name in sorted(ABOUT - {"FRAME_CONFIG"})
        )

    @property
    def measured_hz(self) -> dict[str, float]:
        """How often each stream comes, by MAVLink name, where that was measured."""
        return {message_name(key): hz for key, hz in self._maintenance.streams.measured_hz.items()}

    @property
    def all_parameters_known(self) -> bool:
        """Whether all that was asked for has been answered."""
        return self._maintenance.all_parameters_known

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> bytes:
        """Return the frame that tells the EKF where on earth it is."""
        return self._codec.encode(self._commands.set_origin(latitude_deg, longitude_deg))

    @property
    def _throttle_gain(self) -> float:
        return self.parameters.get("JS_THR_GAIN", 1.0)
