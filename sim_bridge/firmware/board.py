"""What commands, targets, failsafes and the motor test see of the autopilot that they belong to."""

from typing import Protocol

from sim_bridge.firmware.messages import Message, Origin
from sim_bridge.firmware.missions import Missions
from sim_bridge.firmware.modes import FlightControl
from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.streams import Streams
from sim_bridge.physics.sensors import Estimate


class Board(Protocol):
    """The part of `Autopilot` that carries commands out."""

    params: Parameters
    armed: bool
    boot_s: float
    idle: list[int]
    """The motors' PWM at rest (µs)."""
    home: Origin | None
    origin: Origin | None
    servo_9: int
    missions: Missions
    control: FlightControl
    reboot_requested: bool

    def estimate(self) -> Estimate:
        """Return what the EKF makes of the sensors."""

    def arm(self, *, forced: bool = False) -> int:
        """Arm the motors, without any check if `forced`; the MAV_RESULT."""

    def neutralise(self) -> None:
        """Centre the sticks at once."""

    def disarm(self) -> int:
        """Stop the motors; never refused."""

    def set_mode(self, number: int) -> int:
        """Change the flight mode; the MAV_RESULT."""

    def say(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT to every link."""

    def say_banner(self, link: int) -> None:
        """Say on a link which firmware and frame this is."""

    def send(self, link: int, message: Message) -> None:
        """Send a message on a link after this step."""

    def request(self, link: int, number: int) -> int:
        """Send a message once; the MAV_RESULT."""

    def streams(self, link: int) -> Streams:
        """Return the intervals of a link."""

    def set_home(self, place: Origin) -> None:
        """Take a place as home, and tell everybody."""

    def calibrate_barometer(self) -> None:
        """Take the present pressure for that of the surface."""

    def test_motor(self, motor: int, kind: float, throttle: float) -> int:
        """Run one motor; the MAV_RESULT."""
