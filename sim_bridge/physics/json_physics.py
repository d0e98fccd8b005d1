"""External physics for the real ArduSub, through its JSON backend: bytes in, bytes out, no socket, no clock.

The firmware (`--model JSON:127.0.0.1`) sends a frame with the PWM of its outputs, then blocks for a reply:
the state after 1/frame_rate. So time follows the firmware's frames, at any speed-up.

Frame, little-endian: magic uint16 (18458 with 16 outputs, 29569 with 32), frame_rate uint16 (Hz), frame_count
uint32, PWM uint16 each (µs; 0 = no pulse). Reply, text between two line feeds:

| field | meaning | unit |
|---|---|---|
| timestamp | physics time since the firmware's first frame; below the last one is a reset to it | s |
| imu.gyro | rates p, q, r | rad/s, body FRD |
| imu.accel_body | specific force: acceleration less gravity; (0, 0, −9.80665) at rest | m/s², body FRD |
| position | north, east, down of the start location | m |
| velocity | over the ground | m/s, NED |
| quaternion | body to NED, w first | - |
| no_time_sync | 1: the firmware does not wait for the wall clock (lockstep) | - |

The firmware reads it literally: an array follows `":` without a space. Steps of 0.1 s and more do not advance
its time. Its barometer, compass and GPS are simulated by itself from this state, and it ignores our battery:
SIM_BATT_VOLTAGE.
"""

import math
import struct
from collections.abc import Callable
from typing import NamedTuple

from sim_bridge.physics.body import Physics
from sim_bridge.physics.plant import GRAVITY, State, Three, down_axis, ned_velocity
from sim_bridge.physics.thrusters import NEUTRAL_US

OUTPUTS = {18458: 16, 29569: 32}
"""Number of outputs by magic."""
HEADER = struct.Struct("<HHI")
RATES_HZ = (20, 5000)
"""A frame rate outside is taken as the nearer end: below 10 Hz the firmware's time would not advance."""
STAMP_MARGIN = 1.0 + 1e-9
"""The firmware truncates the step to whole µs: a hair more keeps rounding from making 2500 µs into 2499."""
LOST_AFTER_S = 0.5
"""A frame that comes again so long after its answer did not get it: the firmware waits a second."""


class Asked(NamedTuple):
    """What the firmware asks: one step with these outputs."""

    rate_hz: int
    number: int
    """Counts from 0 at the firmware's start."""
    pwm: tuple[int, ...]
    """(16,) or (32,), µs; 0 where there is no pulse."""


class Sensed(NamedTuple):
    """What the firmware's simulated sensors feel."""

    state: State
    """x, y, z (m, NED), unit quaternion body to NED, nu (m/s, rad/s, body)."""
    acceleration: Three
    """Acceleration over the ground, body axes (m/s²); the reply subtracts gravity."""


def parse(packet: bytes) -> Asked | None:
    """Return the frame in `packet`, or None if it is none."""
    if len(packet) < HEADER.size:
        return None
    magic, rate_hz, number = HEADER.unpack_from(packet)
    outputs = OUTPUTS.get(magic, 0)
    if not outputs or not rate_hz or len(packet) != HEADER.size + 2 * outputs:
        return None
    return Asked(rate_hz, number, struct.unpack_from(f"<{outputs}H", packet, HEADER.size))


def reply(time_s: float, motion: Sensed, *, time_sync: bool = True) -> bytes:
    """Return the text that answers a frame; `time_s` is the time that the firmware is to see."""
    x, y, z, q0, q1, q2, q3, _, _, _, p, q, r = motion.state
    north, east, down = ned_velocity(motion.state)
    ax, ay, az = (a - GRAVITY * g for a, g in zip(motion.acceleration, down_axis(motion.state), strict=True))
    text = (
        f'{{"timestamp":{time_s * STAMP_MARGIN:.12f},'
        f'"imu":{{"gyro":{_array(p, q, r)},"accel_body":{_array(ax, ay, az)}}},'
        f'"position":{_array(x, y, z)},"quaternion":{_array(q0, q1, q2, q3)},'
        f'"velocity":{_array(north, east, down)},"no_time_sync":{int(not time_sync)}}}'
    )
    return f"\n{text}\n".encode()


def _array(*values: float) -> str:
    return "[" + ", ".join(f"{value:.9f}" for value in values) + "]"


class Responder:
    """Answers the frames of one firmware: each new frame moves the body once.

    The firmware sends a frame again when it has waited a second. If its first copy was only read late, both
    copies are here before the answer: the second one is left alone, because an answer too many would be taken
    for that of the next frame, and put the physics a frame behind for good. If the answer was lost, it is
    sent again.

    A firmware that restarts (its frame count goes back) finds the body where it is, as a vehicle whose
    autopilot reboots in the water; its time starts at 0 again. Whatever the bytes, nothing raises.
    """

    def __init__(self, move: Callable[[Asked, float], Sensed], step_s: float | None = None) -> None:
        """Prepare to answer; `move` advances the body by a time (s) under a frame's outputs.

        That is `step_s`, and the firmware then does not wait for the wall clock; None: 1/frame_rate.
        """
        self._move = move
        self._step_s = step_s
        self._last: Asked | None = None
        self._answer = b""
        self._answered_s = -math.inf
        self._time_s = 0.0
        self.restarts = 0
        self.bad = 0

    def is_repeated(self, packet: bytes) -> bool:
        """Whether `packet` is a copy of the frame that was answered last."""
        frame = parse(packet)
        return frame is not None and self._last is not None and frame.number == self._last.number

    def answer(self, packet: bytes, now_s: float) -> bytes | None:
        """Return the reply to a packet that is read at `now_s` of a real clock; None if it gets none."""
        frame, last = parse(packet), self._last
        if frame is None:
            self.bad += 1
            return None
        if last is not None and frame.number == last.number:
            if now_s - self._answered_s < LOST_AFTER_S:
                return None
        else:
            if last is not None and frame.number < last.number:
                self.restarts += 1
                self._time_s = 0.0
            self._last = frame
            dt_s = self._step_s or 1.0 / min(max(frame.rate_hz, RATES_HZ[0]), RATES_HZ[1])
            self._time_s += dt_s
            self._answer = reply(self._time_s, self._move(frame, dt_s), time_sync=self._step_s is None)
        self._answered_s = now_s
        return self._answer


class DrivenBody:
    """Our physics under a firmware's outputs. A load's times count from the first turn of a motor.

    The firmware tells its physics no arming; an armed vehicle turns its motors at once unless it has nothing
    to correct. An output without a pulse is a motor at rest.
    """

    DRAIN_PERIOD_S = 0.1

    def __init__(self, physics: Physics, source_v: float) -> None:
        """Put the motors on the first outputs; `source_v` is the battery's open-circuit voltage."""
        self.physics = physics
        self.source_v = source_v
        self.pwm: tuple[int, ...] = (NEUTRAL_US,) * physics.thrusters
        self.turned_s: float | None = None
        """Physics time at which a motor first turned."""
        self._undrained_s = 0.0

    def move(self, frame: Asked, dt_s: float) -> Sensed:
        """Advance by `dt_s` (s)."""
        physics = self.physics
        self.pwm = tuple(us or NEUTRAL_US for us in frame.pwm[: len(self.pwm)])
        if self.turned_s is None and any(us != NEUTRAL_US for us in self.pwm):
            self.turned_s = physics.time_s
        physics.step(self.pwm, -1.0 if self.turned_s is None else physics.time_s - self.turned_s, dt_s)
        self._undrained_s += dt_s
        if self._undrained_s >= self.DRAIN_PERIOD_S - 1e-9:
            physics.drain(self.source_v, self._undrained_s)
            self._undrained_s = 0.0
        return Sensed(physics.state, physics.acceleration())
