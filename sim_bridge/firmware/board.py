"""What the firmware remembers from one boot to the next, and what is done to it: arming, modes, messages."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware import arming
from sim_bridge.firmware.link import KeyStore, Link
from sim_bridge.firmware.mode_behaviour import NAMES, NEED_POSITION, NOT_IMITATED, FlightControl
from sim_bridge.firmware.packing import Message
from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.pilot_input import FN_ARM, FN_ARM_TOGGLE, FN_DISARM, FN_MODES, NEUTRAL, Pilot
from sim_bridge.firmware.result_texts import ACCEPTED, BANNER, CRITICAL, FAILED, FRAMES, INFO, WARNING
from sim_bridge.physics.plant import State, state_of
from sim_bridge.physics.sensors import Estimate, Sensors

STANDBY, ACTIVE, FAILSAFE = 3, 4, 5
DISARMED = 81
"""base_mode of a disarmed vehicle."""
THROTTLE_DEMAND = 3
TEXT_BYTES = 50


class Origin(NamedTuple):
    """The EKF's origin: degrees·1e7 and mm above the sea."""

    lat: int
    lon: int
    alt_mm: int


NOWHERE = Origin(0, 0, 0)


@dataclass(eq=False)
class Board:
    """An autopilot's state. Time is seconds since boot and arrives as data."""

    params: Parameters
    """They survive reboots, so they come from outside; so does `keys`."""
    sensors: Sensors
    """Read when something needs them."""
    frame: str
    """vectored or vectored_6dof."""
    has_position: bool
    """Whether there is a position source, or will be."""
    rc_receiver: bool
    """Whether the vehicle has an RC receiver, whose sticks rest."""
    links: dict[int, Link]
    """Links by number: the dictionary that the vehicle fills."""
    keys: KeyStore
    rebooted: bool = field(kw_only=True)
    """It says what the firmware says as it boots. The first one has done so before anybody listened."""

    def __post_init__(self) -> None:
        self.origin = NOWHERE if self.has_position else None  # a DVL's driver sets it as it starts
        self.has_position = self.has_position and self.sensors.aided
        self.boot_s = 0.0
        self.armed = False
        self.reboot_requested = False
        self.failing = {"pilot"}
        """Which failsafes hold: pilot, ground station, leak."""
        self.pilot_seen_s: float | None = None
        self.motor_pwm = self.idle = [NEUTRAL] * (8 if self.frame == "vectored_6dof" else 6)
        self.last_demand: tuple[float, ...] | None = None
        self.input_is_new = True
        self.voltage_v, self.current_a, self.consumed_mah, self.capacity_mah = 16.0, 0.0, 0.0, 1.0
        self.state: State = state_of((0.0,) * 6, (0.0,) * 6)
        self.ekf_doubt: float | None = None
        """The EKF's variance while it has no solution."""
        self.range_quality = 0
        self.alter: Callable[[Message], Message | None] | None = None
        """Set by the vehicle while a fault falsifies telemetry."""
        self.pilot = Pilot(self.params, self._button, partial(self.say, INFO))
        self.control = FlightControl(self.params)
        self.out: list[tuple[int, bytes]] = []
        self._text_id = 0

    @property
    def mode(self) -> int:
        """The flight mode's number."""
        return self.control.mode

    @property
    def system(self) -> int:
        """Our MAVLink system id."""
        return int(self.params["MAV_SYSID"]) & 0xFF

    @property
    def boot_ms(self) -> int:
        """Milliseconds since boot, as uint32."""
        return round(self.boot_s * 1000) & 0xFFFFFFFF

    @property
    def boot_us(self) -> int:
        """Microseconds since boot."""
        return round(self.boot_s * 1e6)

    def estimate(self) -> Estimate:
        """Return what the EKF makes of the sensors."""
        return self.sensors.estimate(max(0.1, self.params["BARO_SPEC_GRAV"]))

    def arm(self, *, forced: bool = False) -> int:
        """Arm the motors, without any check if `forced`; the MAV_RESULT."""
        if self.armed:
            return ACCEPTED
        refusals = arming.refusals(self.params, self.pilot, self.boot_s, self.pilot_seen_s, forced=forced)
        for refusal in refusals:
            self.say(CRITICAL, refusal)
        if refusals:
            return FAILED
        self.say(INFO, "Arming motors")
        self.armed = self.input_is_new = True
        self.sensors.rezero()
        self.control.rest(self.estimate(), self.boot_s)
        return ACCEPTED

    def disarm(self) -> int:
        """Stop the motors; never refused."""
        if self.armed:
            self.say(INFO, "Disarming motors")
            self.armed = False
        return ACCEPTED

    def set_mode(self, number: int) -> int:
        """Change the flight mode; the MAV_RESULT. The present mode again is a success that does nothing."""
        if number == self.mode:
            return ACCEPTED
        if number not in NAMES:
            self.say(WARNING, f"No such mode {number}")
            return FAILED
        if number in NEED_POSITION:
            self.say(WARNING, f"Mode change failed: {NAMES[number]} requires position")
        if number in NOT_IMITATED or (number in NEED_POSITION and self.has_position and self.origin):
            self.say(WARNING, f"The stand-in has no {NAMES[number]}; ArduSub: docs/sitl.md")
        if number in (*NEED_POSITION, *NOT_IMITATED):
            return FAILED
        self.neutralise()
        throttle = self.last_demand[THROTTLE_DEMAND] if self.last_demand else 0.0
        self.control.enter(number, self.estimate(), throttle)
        self.broadcast(self.heartbeat())
        return ACCEPTED

    def neutralise(self) -> None:
        """Centre the sticks at once."""
        self.pilot.neutralise()
        self.input_is_new = True

    def _button(self, function: int) -> None:
        if function == FN_ARM or (function == FN_ARM_TOGGLE and not self.armed):
            self.arm()
        elif function in (FN_DISARM, FN_ARM_TOGGLE):
            self.disarm()
        elif function in FN_MODES:
            self.set_mode(FN_MODES[function])

    def heartbeat(self) -> Message:
        """Build the HEARTBEAT: type, mode, arming and status."""
        kind = (mavlink.MAV_TYPE_SUBMARINE, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
        base_mode = DISARMED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else DISARMED
        status = FAILSAFE if self.failing else ACTIVE if self.armed else STANDBY
        return mavlink.MAVLink_heartbeat_message(*kind, base_mode, self.mode, status, 3)

    def say(self, severity: int, text: str, only: int | None = None) -> None:
        """Send a STATUSTEXT to every link, or to `only` one, in chunks that share a number if it is long."""
        self._text_id += 1
        raw = text.encode()
        chunks = [raw[at : at + TEXT_BYTES] for at in range(0, len(raw), TEXT_BYTES)]
        identity = self._text_id if len(chunks) > 1 else 0
        for n, chunk in enumerate(chunks):
            message = mavlink.MAVLink_statustext_message(severity, chunk, identity, n)
            if only is None:
                self.broadcast(message)
            else:
                self.send(only, message)

    def say_banner(self, link: int) -> None:
        """Say on a link which firmware and frame this is."""
        for text in (*BANNER, f"Frame: {FRAMES[self.frame]}"):
            self.say(INFO, text, only=link)

    def broadcast(self, message: Message) -> None:
        """Send a message on every link."""
        for number in self.links:
            self.send(number, message)

    def send(self, link: int, message: Message) -> None:
        """Send a message on a link after this step."""
        altered = self.alter(message) if self.alter else message
        if altered is not None:
            self.out.append((link, self.links[link].pack(altered, self.system)))
