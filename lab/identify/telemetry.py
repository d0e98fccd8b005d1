"""What MAVLink messages say of a dive, whoever recorded and decoded them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from companion.identify.samples import Sample, Streams
from companion.mavlink.ardusub import DIRECTIONS, from_pwm_us

Fields = Callable[[str], Any]
"""Gives a message's field of a name."""

FROM_PILOT: Final = ("RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL")
USED: Final = (
    *FROM_PILOT,
    *("ATTITUDE", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "EKF_STATUS_REPORT", "SERVO_OUTPUT_RAW"),
    *("SYS_STATUS", "PARAM_VALUE"),
)
HORIZONTAL_VELOCITY, HORIZONTAL_POSITION, CONSTANT_POSITION = 1 << 1, 1 << 3 | 1 << 4, 1 << 7
"""Bits of EKF_STATUS_REPORT.flags and XKF4.SS: velocity; position, relative or not; it is assumed to stay."""
FIRST_MOTOR_FUNCTION: Final = 33
"""SERVOn_FUNCTION of motor 1."""
STICKS_NOTE: Final = "commands are sticks: right in MANUAL at full pilot gain alone"


class Telemetry:
    """Collects what messages say."""

    def __init__(self) -> None:
        self._streams = Streams()
        self._parameters: dict[str, float] = {}
        self._outputs: list[Sample] = []
        self._level: list[Sample] = []
        self._down: list[Sample] = []
        self._shift_s: float | None = None
        self._boot_s = 0.0
        self._vehicle: int | None = None

    @property
    def heard(self) -> bool:
        """Whether a vehicle's attitude came."""
        return self._vehicle is not None

    def take(self, t_s: float, system: int, name: str, get: Fields) -> None:
        """Take a message that arrived at `t_s`."""
        if name in FROM_PILOT:
            self._streams.sticks.append(Sample(t_s, _sticks(name, get)))
            return
        if name == "ATTITUDE" and self._vehicle is None:
            self._vehicle = system
        if system != self._vehicle:
            return
        streams = self._streams
        if name == "ATTITUDE":
            t_s = self._stamp(t_s, get("time_boot_ms") / 1e3)
            streams.attitude.append(Sample(t_s, (get("roll"), get("pitch"), get("yaw"))))
            streams.rates.append(Sample(t_s, (get("rollspeed"), get("pitchspeed"), get("yawspeed"))))
        elif name == "LOCAL_POSITION_NED":
            t_s = self._stamp(t_s, get("time_boot_ms") / 1e3)
            streams.level.append(Sample(t_s, (get("vx"), get("vy"))))
            streams.down.append(Sample(t_s, (get("vz"),)))
        elif name == "GLOBAL_POSITION_INT":
            t_s = self._stamp(t_s, get("time_boot_ms") / 1e3)
            streams.depth.append(Sample(t_s, (-get("relative_alt") / 1e3,)))
            self._level.append(Sample(t_s, (get("vx") / 100.0, get("vy") / 100.0)))
            self._down.append(Sample(t_s, (get("vz") / 100.0,)))
        elif name == "EKF_STATUS_REPORT":
            streams.aided.append(Sample(t_s, (aided(get("flags")),)))
        elif name == "SERVO_OUTPUT_RAW" and not get("port"):
            t_s = self._stamp(t_s, get("time_usec") / 1e6)
            self._outputs.append(Sample(t_s, tuple(get(f"servo{n}_raw") for n in range(1, 9))))
        elif name == "SYS_STATUS":
            streams.voltage.append(Sample(t_s, (get("voltage_battery") / 1e3,)))
        elif name == "PARAM_VALUE":
            self._parameters[_text(get("param_id"))] = float(get("param_value"))

    def collected(self) -> Streams:
        """Return what came; the outputs become motors by the parameters that the log has."""
        streams = self._streams
        streams.motors = motors_of(self._outputs, self._parameters)
        if not streams.down:
            streams.level, streams.down = self._level, self._down
        if streams.sticks and not streams.motors:
            streams.notes.append(STICKS_NOTE)
        return streams

    def _stamp(self, t_s: float, boot_s: float) -> float:
        """Return the vehicle's stamp on the clock of the arrivals, which the first message ties together."""
        if self._shift_s is None or boot_s < self._boot_s - 1.0 or abs(t_s - boot_s - self._shift_s) > 30.0:
            self._shift_s = t_s - boot_s
        self._boot_s = boot_s
        return boot_s + self._shift_s


def aided(flags: Any) -> float:
    """Return 1 if the EKF's horizontal velocity is measured by these status bits, else 0."""
    bits = int(flags.get("bits", 0)) if isinstance(flags, dict) else int(flags)
    measured = bits & HORIZONTAL_VELOCITY and bits & HORIZONTAL_POSITION
    return 1.0 if measured and not bits & CONSTANT_POSITION else 0.0


def motors_of(outputs: Sequence[Sample], parameters: Mapping[str, float]) -> list[Sample]:
    """Return the demand on each motor from servo outputs (µs), by SERVOn_FUNCTION and MOT_n_DIRECTION."""
    servo = {motor: motor for motor in range(1, 9)}
    for number in range(1, 17):
        motor = round(parameters.get(f"SERVO{number}_FUNCTION", 0.0)) - FIRST_MOTOR_FUNCTION + 1
        if motor in servo:
            servo[motor] = number
    signs = [-1.0 if parameters.get(name, 1.0) < 0.0 else 1.0 for name in DIRECTIONS]

    def demands(pwm_us: Sequence[float]) -> tuple[float, ...]:
        outputs_us = dict(enumerate(map(int, pwm_us), 1))
        return tuple(sign * from_pwm_us(outputs_us.get(servo[n]) or 1500) for n, sign in enumerate(signs, 1))

    return [Sample(t_s, demands(pwm_us)) for t_s, pwm_us in outputs]


def _sticks(name: str, get: Fields) -> tuple[float, ...]:
    if name == "MANUAL_CONTROL":
        x, y, z, r = (get(key) for key in "xyzr")
        return x / 1e3, y / 1e3, (500.0 - z) / 500.0, r / 1e3, 0.0, 0.0
    pwm_us = [get(f"chan{n}_raw") for n in range(1, 7)]
    pitch, roll, up, yaw, surge, sway = (from_pwm_us(us) if 800 <= us <= 2200 else 0.0 for us in pwm_us)
    return surge, sway, -up, yaw, roll, pitch


def _text(name: Any) -> str:
    return "".join(name).rstrip("\0") if isinstance(name, list) else str(name)
