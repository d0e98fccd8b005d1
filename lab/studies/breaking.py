"""What breaks in the dives of `holdfast lab faults`; every tick keeps `lab.studies.promises`.

After a fault that must end steering, thrust is neutral within the time that `FAULTS` states.
"""

import copyreg
import gc
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import nan
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import Config, load_config
from companion.engine import Engine
from companion.records import ZERO, ControlSample, LoopHealth, Request, Setpoint, State, Vector
from lab.loop.dive import engaging
from lab.loop.lockstep import START_S, Lockstep
from lab.studies.promises import Promises, hold_telemetry
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.fault_kinds import FAULT_KINDS, Fault
from sim_bridge.sim_config import load_config as load_plant

Inbox = list[tuple[int, bytes]]
RAMP_S = 1.0
STALE_S = 0.6
"""An attitude or a depth is older than its timeout, and a tick has passed."""
HEARTBEAT_S = 1.1
LATE_S = 0.1
RIDDEN_OUT_S = 1.05
"""A silence of up to a second, give or take a tick, ends nothing."""

VARIANTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "heavy": ((), ()),
    "heavy in waves": (("waves.enabled=true",), ()),
    "heavy, sticks": ((), ("vehicle.thrust_path=manual_control",)),
    "heavy with DVL": (("sensors.dvl=true",), ()),
    "heavy, STABILIZE": ((), ("vehicle.steering_mode=stabilize",)),
    "six thrusters": ((), ("vehicle.frame=vectored",)),
}
"""What is changed in the simulator, and in the companion."""
STREAMS = (
    *("ATTITUDE", "GLOBAL_POSITION_INT", "VFR_HUD", "HEARTBEAT", "SERVO_OUTPUT_RAW", "TIMESYNC"),
    *("BATTERY_STATUS", "EKF_STATUS_REPORT", "NAMED_VALUE_FLOAT", "PARAM_VALUE", ""),
)
NEEDED = ("ATTITUDE", "GLOBAL_POSITION_INT", "")
"""Streams without which nothing is steered."""

# A prepared dive is copied: copies of these are what they were.
copyreg.pickle(struct.Struct, lambda one: (struct.Struct, (one.format,)))
copyreg.pickle(MappingProxyType, lambda one: (MappingProxyType, tuple(gc.get_referents(one))))


@dataclass(frozen=True)
class Broken:
    """One fault of a dive: its kind, when it begins (s after the state was reached) and what it draws."""

    kind: str
    at_s: float
    message: str
    value: float


class CheckedEngine(Engine):
    """The real engine between a spoilt inbox and somebody who checks every tick."""

    def __init__(self, config: Config, setpoint: Setpoint, *, arm: bool) -> None:
        super().__init__(config, setpoint, arm=arm)
        self.spoils: list[Callable[[float, Inbox], Inbox]] = []
        self.to_vehicle: list[bytes] = []
        self.asleep_until_s = 0.0
        self.promises = Promises(config)
        self._waiting: tuple[Inbox, list[Request]] = [], []
        self._sample: ControlSample | None = None

    def step(
        self,
        now_s: float,
        datagrams: Sequence[tuple[int, bytes]],
        loop: LoopHealth,
        requests: Sequence[Request] = (),
        ground: Sequence[tuple[int, bytes]] = (),
        excitation: Vector = ZERO,
    ) -> tuple[list[bytes], ControlSample]:
        """Advance one tick, unless asleep; raise PromiseBrokenError."""
        t_s, spoilt = now_s - START_S, list(datagrams)
        for spoil in self.spoils:
            spoilt = spoil(t_s, spoilt)
        inbox, asked = self._waiting[0] + spoilt, [*self._waiting[1], *requests]
        self._waiting = inbox, asked
        if t_s < self.asleep_until_s and self._sample is not None:
            return [], self._sample
        self._waiting = [], []
        others, self.to_vehicle = self.to_vehicle, []
        out, self._sample = super().step(now_s, inbox, loop, asked, ground, excitation)
        self.promises.hold(t_s, out, self._sample, asked, steers=self.steering)
        hold_telemetry(self._sample)
        return out + others, self._sample


class Diving:
    """A vehicle and its companion in virtual time, and an outsider."""

    def __init__(self, loop: Lockstep) -> None:
        self.loop = loop
        self.outsider = mavlink.MAVLink(None, 255, 190)

    @property
    def engine(self) -> CheckedEngine:
        """The companion's."""
        return cast(CheckedEngine, self.loop.engine)

    @property
    def t_s(self) -> float:
        """Simulated time."""
        return self.loop.vehicle.time_s

    def run(self, seconds: float) -> None:
        """Let it run."""
        for _ in self.loop.run(seconds):
            pass

    def fault(self, kind: str, value: float = 0.0, seconds: float = 1e9, **more: Any) -> None:
        """Let the simulator break something from now on."""
        fault = Fault(kind=kind, at_s=self.t_s, duration_s=seconds, value=value, **more)
        self.loop.vehicle.inject(fault)  # type: ignore[attr-defined]  # the stand-in and the firmware have it

    def until(self, state: State, within_s: float = 8.0) -> None:
        """Run until the supervisor is in `state`."""
        for _ in self.loop.run(within_s):
            if self.engine.verdict.state is state:
                return
        raise RuntimeError(f"never {state}, but {self.engine.verdict}")

    def say(self, message: Any) -> None:
        """Let another ground station say something."""
        self.engine.to_vehicle.append(bytes(message.pack(self.outsider)))

    def reach(self, state: State, *, stabilize: bool) -> None:
        """Bring the supervisor into a state."""
        if state in (State.IDLE, State.READY):
            self.loop.requests.clear()
            self.run(2.5)
        else:
            self.until(State.ACTIVE)
            self.run(2.0)
        if state is State.READY:
            self.fault("mode", 0.0 if stabilize else 19.0)
            self.say(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
        elif state is State.RAMP_DOWN:
            self.loop.requests.append(Request.STOP)
        elif state is State.HAND_OVER:
            self.fault("leak")
        elif state is State.PILOT:
            self.fault("mode", 2.0)
        elif state is State.FAULT:
            self.fault("link_cut", seconds=1.5)
        self.until(state)


@contextmanager
def prepared(variant: str, state: State, seed: int, firmware: Path | None = None) -> Iterator[Diving]:
    """Give a dive of a variant whose supervisor is in this state."""
    plant, companion = VARIANTS[variant]
    if state is State.READY:
        plant = (*plant, "parameters.FS_PILOT_INPUT=1")
    if state is State.RAMP_DOWN:
        companion = (*companion, "supervisor.ramp_down_s=4")
    file = DEFAULT_CONFIG.with_name("sim-bluerov2.toml" if variant == "six thrusters" else "sim.toml")
    sea, config = load_plant(file, ("current.enabled=false", *plant)), load_config(overrides=companion)
    surveyed, setpoint = firmware is not None, Setpoint((nan, nan, 1.0, 0.3))
    with engaging(
        config, sea, setpoint, seed, firmware=firmware, surveyed=surveyed, engine=CheckedEngine
    ) as loop:
        diving = Diving(loop)
        diving.reach(state, stabilize="STABILIZE" in variant)
        yield diving


Begin = Callable[[Diving, Broken, np.random.Generator], None]


def _spoilt(change: Callable[[bytes, np.random.Generator], Sequence[bytes]]) -> Begin:
    """Return a fault that changes datagrams with a probability; each becomes none, one or several."""

    def begin(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
        dive.engine.spoils.append(
            lambda _, inbox: [
                (at, new)
                for at, data in inbox
                for new in (change(data, rng) if rng.random() < broken.value else (data,))
            ]
        )

    return begin


def _flipped(data: bytes, rng: np.random.Generator) -> Sequence[bytes]:
    bits = bytearray(data)
    bits[rng.integers(len(bits))] ^= 1 << int(rng.integers(8))
    return (bytes(bits),)


def _shuffled(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    waiting: list[tuple[float, bytes]] = []

    def spoil(t_s: float, inbox: Inbox) -> Inbox:
        waiting.extend((t_s + 0.1 * broken.value * rng.random(), data) for _, data in inbox)
        here = [data for due_s, data in waiting if due_s <= t_s]
        waiting[:] = [delivery for delivery in waiting if delivery[0] > t_s]
        rng.shuffle(here)
        return [(_stamp(t_s), data) for data in here]

    dive.engine.spoils.append(spoil)


def _stranger(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    """Another vehicle on the same wire: disarmed, elsewhere, upside down; and another component of ours."""
    packers = [mavlink.MAVLink(None, 2, 1), mavlink.MAVLink(None, 1, 100), mavlink.MAVLink(None, 77, 77)]

    def spoil(t_s: float, inbox: Inbox) -> Inbox:
        boot = int(rng.integers(2**32))
        lies = (
            mavlink.MAVLink_heartbeat_message(12, 3, 81, 0, 5, 3),
            mavlink.MAVLink_attitude_message(boot, 3.0, 1.5, -2.0, 9.0, 9.0, 9.0),
            mavlink.MAVLink_global_position_int_message(boot, 0, 0, 0, -99_000, 0, 0, 0, 0),
            mavlink.MAVLink_statustext_message(2, b"Leak Detected", 0, 0),
        )
        lie = lies[int(rng.integers(len(lies)))]
        return [*inbox, (_stamp(t_s), bytes(lie.pack(packers[int(rng.integers(3))])))]

    dive.engine.spoils.append(spoil)


def _junk(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    def spoil(t_s: float, inbox: Inbox) -> Inbox:
        junk = rng.integers(0, 256, int(rng.integers(1, 600)), dtype=np.uint8).tobytes()
        return [(_stamp(t_s), b"\xfd" + junk), *inbox, (_stamp(t_s), junk)]

    dive.engine.spoils.append(spoil)


def _stamp(t_s: float) -> int:
    return round((START_S + t_s) * 1e9)


def _stall(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    dive.engine.asleep_until_s = dive.t_s + _stalls_s(broken)


def _stalls_s(broken: Broken) -> float:
    return 0.35 + 2.0 * broken.value


def _stalled(broken: Broken) -> float | None:
    stalls_s = _stalls_s(broken)
    return None if stalls_s < RIDDEN_OUT_S else stalls_s + RAMP_S + LATE_S


def _stale(broken: Broken) -> float | None:
    return STALE_S if broken.message in NEEDED else None


def _parameter(name: str, value: float | None = None) -> Begin:
    def begin(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
        new = float(rng.choice([0.0, 1.0, 2.0, 50.0])) if value is None else value
        dive.say(mavlink.MAVLink_param_set_message(1, 1, name.encode(), new, 9))

    return begin


def _pilots_stick(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    channels = (65535, 65535, 1500, 1500, 1800, 1500, 65535, 65535)
    frame = bytes(mavlink.MAVLink_rc_channels_override_message(1, 1, *channels).pack(dive.outsider))
    dive.engine.spoils.append(lambda t_s, inbox: [*inbox, (_stamp(t_s), frame)])


def _thruster(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    dive.fault("thruster", thruster=int(rng.integers(1, 7)))


class FaultSpec(NamedTuple):
    """How a fault begins, and how long ACTIVE may push afterwards; None where it may be borne."""

    begin: str | Begin
    """A fault of the vehicle's script, by its kind, or what somebody else does."""
    within_s: float | Callable[[Broken], float | None] | None = None
    value: tuple[float, float] = (0.0, 1.0)
    on_stream: bool = False


FAULTS: dict[str, FaultSpec] = {
    "datagrams lost": FaultSpec(_spoilt(lambda data, rng: ())),
    "all lost": FaultSpec(_spoilt(lambda data, rng: ()), STALE_S, (1.0, 1.0)),
    "doubled": FaultSpec(_spoilt(lambda data, rng: (data, data))),
    "reordered": FaultSpec(_shuffled),
    "delayed": FaultSpec("link_delayed", None, (0.0, 0.4)),
    "cut short": FaultSpec(_spoilt(lambda data, rng: (data[: rng.integers(1, len(data) + 1)],))),
    "bits flipped": FaultSpec(_spoilt(_flipped)),
    "every one flipped": FaultSpec(_spoilt(_flipped), STALE_S, (1.0, 1.0)),
    "junk between": FaultSpec(_junk),
    "strangers and wrong components": FaultSpec(_stranger),
    "link cut both ways": FaultSpec("link_cut", STALE_S),
    "frozen but sent": FaultSpec("message_frozen", _stale, on_stream=True),
    "stopped": FaultSpec("message_stopped", _stale, on_stream=True),
    "NaN": FaultSpec("message_nan", on_stream=True),
    "infinite": FaultSpec("message_extreme", None, (np.inf, np.inf), on_stream=True),
    "integers and floats at their largest": FaultSpec("message_extreme", None, (3e38, 3e38), on_stream=True),
    "reboot": FaultSpec("reboot", HEARTBEAT_S),
    "disarmed": FaultSpec("disarm", HEARTBEAT_S),
    "mode changed": FaultSpec("mode", HEARTBEAT_S, (2.0, 2.0)),
    "a stick moved": FaultSpec(_pilots_stick, LATE_S),
    "failsafe switched off": FaultSpec(_parameter("FS_PILOT_INPUT", 0.0), RAMP_S + LATE_S),
    "parameters changed": FaultSpec(_parameter("JS_GAIN_DEFAULT")),
    "throttle gain changed": FaultSpec(_parameter("JS_THR_GAIN")),
    "leak": FaultSpec("leak", RAMP_S + 2.0 * LATE_S),
    "EKF lost": FaultSpec("ekf", RAMP_S + 0.6, (1.0, 3.0)),
    "depth jumps": FaultSpec("depth_shifted", None, (-9.0, 9.0)),
    "yaw reset": FaultSpec("yaw_reset", None, (-180.0, 180.0)),
    "position reset": FaultSpec("position_reset", None, (-9.0, 9.0)),
    "battery flat": FaultSpec("voltage", None, (6.0, 12.0)),
    "thruster dead": FaultSpec(_thruster),
    "companion stalls": FaultSpec(_stall, _stalled),
}

ON_FIRMWARE = tuple(
    name
    for name, spec in FAULTS.items()
    if not isinstance(spec.begin, str) or FAULT_KINDS[spec.begin].on_firmware
    if name != "depth jumps"
)
"""Left out: what would change the firmware's own messages, a leak (no pin), losses and resets of its EKF, and
a jump of its pressure, which its EKF may well reject."""


def begin(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    """Let a fault begin now."""
    how = FAULTS[broken.kind].begin
    if isinstance(how, str):
        dive.fault(how, broken.value, message=broken.message)
    else:
        how(dive, broken, rng)


def within_s(broken: Broken) -> float | None:
    """Return how long ACTIVE may push after a fault, None where it may be borne."""
    within = FAULTS[broken.kind].within_s
    return within(broken) if callable(within) else within
