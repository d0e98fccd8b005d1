"""What every tick keeps, whatever happens: held by `holdfast lab faults`, the fuzzer and the tests' dives.

- a command is finite, and the part of it that is ours is inside the envelope and changes no faster than that
  allows, or is neutral at once;
- at most one steering frame leaves in a tick, none while the engine does not steer; it is within full stick,
  demands no more roll and pitch than the envelope, and leaves the camera alone;
- authority is within 0 and 1, and goes only with ACTIVE, RAMP_DOWN and HAND_OVER;
- ACTIVE and RAMP_DOWN push on a depth and an attitude that are no older than their timeouts;
- without authority the part of a command that is ours is neutral, and so is every frame unless a pilot steers
  beside us;
- ACTIVE is entered from READY alone, after somebody asked, with nothing against it;
- telemetry is JSON without NaN or null.
"""

import struct
from collections.abc import Sequence
from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion import assembly
from companion.config import Config
from companion.records import NEUTRAL, Condition, ControlSample, Request, State
from companion.supervision.rules import BLOCKING
from companion.supervision.supervisor import CARRY_AUTHORITY
from companion.telemetry.samples import encode

AGAINST = BLOCKING | Condition.PILOT_TAKEOVER | Condition.OPERATOR_STOP
UNTOUCHED = 65535
HALF_US = 0.5 / 400
ROUNDING = 1e-9


class PromiseBrokenError(AssertionError):
    """Something happened that must never happen."""


def promise(kept: bool, said: str) -> None:
    """Raise PromiseBrokenError unless kept."""
    if not kept:
        raise PromiseBrokenError(said)


def steering(frame: bytes) -> tuple[float, ...] | None:
    """Return what a frame demands of surge, sway, heave (up), yaw, roll and pitch, -1..1; None if of nothing.

    Raises PromiseBrokenError where it moves the camera.
    """
    number = int.from_bytes(frame[7:10], "little")
    payload = frame[10 : 10 + frame[1]].ljust(40, b"\0")
    if number == mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE:
        *channels, pan, tilt = struct.unpack_from("<8H", payload)
        promise(pan == tilt == UNTOUCHED, "a frame that moves the camera")
        pitch, roll, heave, yaw, surge, sway = (
            0.0 if us == UNTOUCHED else (us - 1500) / 400 for us in channels
        )
        return surge, sway, heave, yaw, roll, pitch
    if number == mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL:
        x, y, z, r = struct.unpack_from("<4h", payload)
        return x / 1000, y / 1000, (z - 500) / 500, r / 1000, 0.0, 0.0
    return None


def hold_telemetry(sample: ControlSample) -> None:
    """Raise PromiseBrokenError where a sample is published as something that is no number."""
    for key, _, payload in encode(sample, "promised"):
        absurd = b"NaN" in payload or b"Infinity" in payload or b":null" in payload
        promise(not absurd, f"telemetry that is no number: {key} {payload!r}")


class Promises:
    """Holds one engine to account, tick by tick.

    `pilot`: a pilot steers beside us, over the ground station's link; axes that are not engaged are his.
    """

    def __init__(self, config: Config, *, pilot: bool = False) -> None:
        envelope = assembly.envelope(config)
        self._most = (*(envelope.max_axis,) * 4, *(envelope.max_tilt_axis,) * 2)
        self._step = envelope.max_slew_per_s / config.loop.rate_hz + ROUNDING
        self._limits = config.supervisor
        self._pilot = pilot
        self.asked_otherwise = False
        """Somebody asks to engage by a button or a MAVLink command, of which no request tells."""
        self._asked = False
        self._was = State.IDLE
        self._command: Sequence[float] = NEUTRAL
        self._ours = (True,) * 6
        self._at_rest = True
        self.frames: list[tuple[float, ...]] = []
        """The steering frames of the last tick."""
        self.last_thrust_s = -1.0
        """When a frame last demanded thrust."""

    def hold(
        self,
        t_s: float,
        out: Sequence[bytes],
        sample: ControlSample,
        requests: Sequence[Request],
        *,
        steers: bool,
    ) -> None:
        """Check a tick: what was sent and recorded, what was asked in it, whether the engine steers.

        Raises PromiseBrokenError.
        """
        self.frames = [axes for axes in map(steering, out) if axes is not None]
        pushing = any(map(any, self.frames))
        self._hold_command(sample)
        self._hold_frames(steers=steers)
        verdict = sample.verdict
        permitted = verdict.authority > 0.0
        promise(0.0 <= verdict.authority <= 1.0, f"an absurd authority of {verdict.authority}")
        promise(not permitted or verdict.state in CARRY_AUTHORITY, "authority without permission")
        ages, limits = sample.state.ages, self._limits
        fresh = ages.depth_s <= limits.depth_timeout_s and ages.attitude_s <= limits.attitude_timeout_s
        steers_by_them = permitted and verdict.state in (State.ACTIVE, State.RAMP_DOWN)
        promise(fresh or not steers_by_them, "authority on a depth or an attitude that is too old")
        promise(permitted or self._at_rest, "a command without authority")
        promise(permitted or self._pilot or not pushing, "thrust without authority")
        self._hold_engaging(sample, requests)
        if pushing:
            self.last_thrust_s = t_s

    def _hold_command(self, sample: ControlSample) -> None:
        command, engaged = sample.command, sample.dofs.engaged
        ours = (*engaged, *(any(engaged),) * 2) if self._pilot else (True,) * 6
        promise(all(map(isfinite, command)), f"a command that is not finite: {command}")
        inside = (
            abs(axis) <= (most if held else 1.0)
            for axis, most, held in zip(command, self._most, ours, strict=True)
        )
        promise(all(inside), f"a command outside the envelope: {command}")
        steps = [
            abs(now - last)
            for now, last, held, was in zip(command, self._command, ours, self._ours, strict=True)
            if held and was
        ]
        jump = max(steps, default=0.0)
        self._at_rest = not any(axis for axis, held in zip(command, ours, strict=True) if held)
        promise(jump <= self._step or self._at_rest, f"a command that jumps by {jump}")
        self._command, self._ours = command, ours

    def _hold_frames(self, *, steers: bool) -> None:
        promise(len(self.frames) <= int(steers), f"{len(self.frames)} steering frames in a tick")
        for axes in self.frames:
            promise(all(abs(axis) <= 1.0 for axis in axes), f"a frame out of range: {axes}")
            tilts = zip(axes[4:], self._most[4:], strict=True)
            within = all(abs(axis) <= most + HALF_US + ROUNDING for axis, most in tilts)
            promise(within, f"a frame that tilts: {axes}")

    def _hold_engaging(self, sample: ControlSample, requests: Sequence[Request]) -> None:
        state, conditions = sample.verdict.state, sample.verdict.conditions
        self._asked |= Request.ENGAGE in requests
        if state is State.ACTIVE and self._was is not State.ACTIVE:
            promise(self._was is State.READY, f"engaged from {self._was}")
            promise(self._asked or self.asked_otherwise, "engaged without being asked")
            promise(not conditions & AGAINST, f"engaged against {conditions & AGAINST!r}")
        if Request.STOP in requests or (self._was is State.ACTIVE and state is not State.ACTIVE):
            self._asked = False
        self._was = state
