"""Dives in virtual time for the tests: engine and stand-in vehicle in lockstep, and somebody in between."""

import copyreg
import gc
import struct
from copy import deepcopy
from functools import wraps
from math import nan
from pathlib import Path
from types import MappingProxyType
from typing import cast

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_config
from companion.engine import Engine
from companion.mavlink.relay import Relay
from companion.records import ZERO, Request, Setpoint, State
from lab.loop.firmware import Firmware
from lab.loop.lockstep import START_S, LinkDelay, Lockstep, Step
from lab.studies.promises import Promises
from sim_bridge.fault_kinds import Fault
from sim_bridge.sim_config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

ROOT = Path(__file__).parent.parent
CALM = ("current.enabled=false",)
DEPTH_M, HEADING_RAD = 1.0, 0.3
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
WITH_PILOT = ("ground_station.endpoint=udp-listen:127.0.0.1:14551", "vehicle.thrust_path=manual_control")


def hold(z=DEPTH_M, psi=HEADING_RAD, x=nan, y=nan):
    return Setpoint((x, y, z, psi))


def message_id(frame):
    return frame[7] | frame[8] << 8 | frame[9] << 16


def pieces(data):
    """The frames (MAVLink 2) of a datagram, each with its message's id."""
    while data:
        signature = 13 if data[2] & 1 else 0
        frame, data = data[: 12 + data[1] + signature], data[12 + data[1] + signature :]
        yield message_id(frame), frame


def rewritten(changes):
    """What `Tap.spoil` may be: fields of messages are what `changes` makes of them and of their first value.

    `changes` has functions of (value, first value) by message and field: {"VFR_HUD": {"climb": freeze}}.
    """
    ids = {getattr(mavlink, f"MAVLINK_MSG_ID_{name}"): fields for name, fields in changes.items()}
    reader, writer = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 1)
    first: dict[tuple[int, str], object] = {}

    def spoil(_, inbox):
        return [(at, b"".join(map(spoilt, pieces(data)))) for at, data in inbox]

    def spoilt(piece):
        kind, frame = piece
        if kind not in ids:
            return frame
        message = reader.parse_buffer(frame)[0]
        for field, change in ids[kind].items():
            value = getattr(message, field)
            setattr(message, field, change(value, first.setdefault((kind, field), value)))
        return bytes(message.pack(writer))

    return spoil


def freeze(value, first):
    return first


def blocked(seed=1):
    """What comes where the port of the depth sensor is blocked: noise about what it said last."""
    rng = np.random.default_rng(seed)

    def about(scale):
        def noisy(value, first):
            noise = scale * rng.standard_normal()
            return first + (round(noise) if isinstance(value, int) else noise)

        return noisy

    return {
        "GLOBAL_POSITION_INT": {"relative_alt": about(3.0), "alt": about(3.0)},
        "SCALED_PRESSURE": {"press_abs": about(0.3)},
        "SCALED_PRESSURE2": {"press_abs": about(0.3)},
        "VFR_HUD": {"climb": lambda *_: 0.005 * rng.standard_normal(), "alt": about(3e-3)},
    }


class Somebody:
    """Another MAVLink sender, such as a ground station with a joystick."""

    def __init__(self, system=255, component=190):
        self._mav = mavlink.MAVLink(None, system, component)

    def frame(self, message):
        return bytes(message.pack(self._mav))

    def stick(self, us=1800):
        """An override that moves the forward stick."""
        channels = (65535, 65535, 1500, 1500, us, 1500, 65535, 65535)
        return self.frame(mavlink.MAVLink_rc_channels_override_message(1, 1, *channels))

    def arm(self):
        return self.frame(mavlink.MAVLink_command_long_message(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0))

    def origin(self):
        """What a position source's driver sends, without which the EKF gives no position."""
        return self.frame(mavlink.MAVLink_set_gps_global_origin_message(1, 473977418, 85455939, 0))

    def parameter(self, name, value):
        return self.frame(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))


class Cockpit(Somebody):
    """A pilot at a ground station on the companion's second link: heartbeats, and sticks if any are set.

    `sent` is all that it said, `passed` what the relay let through to the vehicle, `heard` what came back.
    """

    def __init__(self, config, signing=None):
        super().__init__()
        self.relay = Relay(config, signing)
        self.sticks = None
        self.alive = True
        self.extra = []
        self.sent, self.passed, self.heard = b"", b"", b""

    def push(self, surge=0.0, sway=0.0, heave=0.0, yaw=0.0, buttons=0, **rest):
        """Move the sticks and leave them there; fractions of full stick, heave down."""
        axes = (round(1000 * surge), round(1000 * sway), 500 - round(500 * heave), round(1000 * yaw))
        self.sticks = mavlink.MAVLink_manual_control_message(1, *axes, buttons, **rest)

    def says(self, tick):
        """What it says in this tick: MANUAL_CONTROL at 25 Hz, as QGroundControl does."""
        out, self.extra = self.extra, []
        if self.alive and tick % 50 == 0:
            out.append(self.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
        if self.sticks is not None and tick % 2 == 0:
            out.append(self.frame(self.sticks))
        return out

    def exchange(self, t_ns, inbox, tick):
        """Relay both ways; return what goes to the vehicle at once, and the pilot's frames for the engine."""
        passed: list[bytes] = []
        for data in self.says(tick):
            self.sent += data
            passed += self.relay.to_vehicle(t_ns, data)
        self.passed += b"".join(passed)
        self.heard += b"".join(piece for at, data in inbox for piece in self.relay.to_ground(at, data))
        return passed, self.relay.take()


class Tap:
    """Stands where the engine is: spoils what comes, adds to what goes, holds every tick to account."""

    def __init__(self, engine, config, cockpit=None):
        self.engine = engine
        self.cockpit = cockpit
        self.promises = Promises(config, pilot=cockpit is not None)
        self.spoil = lambda now_s, inbox: inbox
        self.to_vehicle = []
        self.after = lambda out, sample: None
        """Called after each tick, with what the engine sent."""
        self.asleep_until_s = 0.0
        self.mute_until_s = 0.0
        """Until then nothing that is sent arrives."""
        self.frames = []
        self.history = []
        self._inbox, self._requests, self._sample = [], [], None

    @property
    def last_thrust_s(self):
        """When a frame last demanded thrust, 0 if none did."""
        return max(self.promises.last_thrust_s, 0.0)

    def aim(self, setpoint):
        self.engine.aim(setpoint)

    def step(self, now_s, inbox, health, requests, excitation=ZERO):
        t_s = now_s - START_S
        self._inbox += self.spoil(t_s, list(inbox))
        self._requests += requests
        extra, self.to_vehicle = self.to_vehicle, []
        if t_s < self.asleep_until_s and self._sample is not None:
            return extra, self._sample
        inbox, self._inbox = self._inbox, []
        requests, self._requests = self._requests, []
        passed = []
        if self.cockpit is None:
            out, sample = self.engine.step(now_s, inbox, health, requests, (), excitation)
        else:
            passed, ground = self.cockpit.exchange(round(now_s * 1e9), inbox, health.tick)
            out, sample = self.engine.step(now_s, inbox, health, requests, ground, excitation)
            self.cockpit.relay.withhold = self.engine.steering
        self._sample = sample
        self.after(out, sample)
        self.history.append((t_s, sample.verdict.state))
        self.promises.hold(t_s, out, sample, requests, steers=self.engine.steering)
        self.frames += [(t_s, axes) for axes in self.promises.frames]
        return [] if t_s < self.mute_until_s else passed + out + extra, sample


class Dive:
    """A vehicle and its companion from boot on."""

    step: Step  # the newest

    def __init__(
        self,
        *plant,
        companion=(),
        config=None,
        setpoint=None,
        arm=True,
        engage=True,
        seed=1,
        link=None,
        base="sim.toml",
        signing=None,
        pilot=False,
        firmware=None,
        surveyed=True,
    ):
        config = config or load_config(overrides=(*companion, *(WITH_PILOT if pilot else ())))
        body = load_plant(ROOT / "config" / base, (*CALM, *plant))
        self.vehicle = Firmware(firmware, body, seed, surveyed=surveyed) if firmware else Vehicle(body, seed)
        self.engine = Engine(config, setpoint or hold(), arm=arm, signing=signing)
        cockpit = Cockpit(config, signing) if pilot else None
        if cockpit is not None:
            self.cockpit = cockpit
        self.tap = Tap(self.engine, config, cockpit)
        self.loop = Lockstep(
            self.vehicle, cast(Engine, self.tap), link or LinkDelay(), seed, config.loop.rate_hz
        )
        if engage:
            self.loop.requests.append(Request.ENGAGE)

    @property
    def t_s(self):
        return self.vehicle.time_s

    @property
    def state(self):
        return self.step.sample.verdict.state

    def run(self, seconds):
        """Let it run; return all steps."""
        steps = list(self.loop.run(seconds))
        self.step = steps[-1]
        return steps

    def until(self, state, within_s=6.0):
        """Run until the supervisor is in `state`."""
        for step in self.loop.run(within_s):
            self.step = step
            if self.state is state:
                return self
        raise AssertionError(
            f"not {state} within {within_s} s but {self.state}: {step.sample.verdict.reason}"
        )

    def ask(self, request):
        self.loop.requests.append(request)

    def fault(self, kind, seconds=1e9, **what):
        self.vehicle.inject(Fault(kind=kind, at_s=self.t_s, duration_s=seconds, **what))

    def knock(self, yaw_radps):
        """Change the yaw rate of the body at once by this much."""
        assert isinstance(self.vehicle, Vehicle)
        *others, r = self.vehicle.physics.state
        self.vehicle.physics.state = (*others, r + yaw_radps)

    def states_since(self, t_s):
        """The states of the time after `t_s`, each change once."""
        states = [state for at_s, state in self.tap.history if at_s > t_s + 1e-9]
        return [now for i, now in enumerate(states) if i == 0 or states[i - 1] is not now]

    def motors_rest(self):
        return set(self.step.truth.motor_pwm) == {1500}


class SharedDives:
    """Beginnings of dives, dived once in a process: whoever asks again gets a copy, at a tenth of the time.

    A test with `monkeypatch` gets dives of its own: conftest.py sees to it.
    """

    MOST = 16
    enabled = True

    def __init__(self):
        self._kept = {}

    def copy_of(self, key, begin):
        """Return a copy of what `begin` gave for this key."""
        if not self.enabled:
            return begin()
        begun = self._kept.pop(key, None) or begin()
        self._kept[key] = begun
        if len(self._kept) > self.MOST:
            del self._kept[next(iter(self._kept))]
        return deepcopy(begun)


SHARED = SharedDives()
copyreg.pickle(struct.Struct, lambda one: (struct.Struct, (one.format,)))
copyreg.pickle(MappingProxyType, lambda one: (MappingProxyType, tuple(gc.get_referents(one))))
"""A view of a copied dictionary is a view of the copy."""


def shared(begin):
    """Let a function that begins a dive do it once for the same arguments; each caller gets a copy.

    What it sets up may not refer to the dive by a closure.
    """

    @wraps(begin)
    def copied(*arguments, **named):
        if named.get("signing") or named.get("firmware"):
            return begin(*arguments, **named)
        key = begin.__module__, begin.__name__, repr(arguments), repr(sorted(named.items()))
        return SHARED.copy_of(key, lambda: begin(*arguments, **named))

    return copied


@shared
def active(*plant, seconds=1.0, **arguments):
    """A dive that has been holding for `seconds`."""
    dive = Dive(*plant, **arguments).until(State.ACTIVE)
    dive.run(seconds)
    assert dive.state is State.ACTIVE
    return dive
