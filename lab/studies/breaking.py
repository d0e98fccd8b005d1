"""What breaks in the dives of `holdfast lab faults`; every tick keeps `lab.studies.promises`.

After a fault that must end steering, thrust is neutral within the time that `FAULTS` states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_config
from companion.engine import Engine
from companion.records import ControlSample, LoopHealth, Request, Setpoint, State
from lab.loop.firmware import Firmware
from lab.loop.lockstep import START_S, LinkDelay, Lockstep
from lab.studies.promises import Promises, hold_telemetry
from sim_bridge.config import load_config as load_plant
from sim_bridge.fault_kinds import FAULT_KINDS, Fault
from sim_bridge.vehicle import Vehicle

Inbox = list[tuple[int, bytes]]
PLANT = Path(__file__).parents[2] / "config"
AFTER_S = 4.0
RAMP_S = 1.0
DEPTH_STALE_S = ATTITUDE_STALE_S = 0.6
HEARTBEAT_S = 1.1
LATE_S = 0.1

VARIANTS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("heavy", (), ()),
    ("heavy in waves", ("waves.enabled=true",), ()),
    ("heavy, sticks", (), ('vehicle.thrust_path="manual_control"',)),
    ("heavy with DVL", ("sensors.dvl=true",), ()),
    ("heavy, STABILIZE", (), ('vehicle.steering_mode="stabilize"',)),
    ("six thrusters", (), ('vehicle.frame="vectored"',)),
)
STREAMS: tuple[str, ...] = (
    "ATTITUDE",
    "GLOBAL_POSITION_INT",
    "VFR_HUD",
    "HEARTBEAT",
    "SERVO_OUTPUT_RAW",
    "TIMESYNC",
)
STREAMS += ("BATTERY_STATUS", "EKF_STATUS_REPORT", "NAMED_VALUE_FLOAT", "PARAM_VALUE", "")
STALE_S = {"ATTITUDE": ATTITUDE_STALE_S, "GLOBAL_POSITION_INT": DEPTH_STALE_S, "": DEPTH_STALE_S}


@dataclass(frozen=True)
class Broken:
    """One fault of a dive: its kind, when it begins (s after the state was reached) and what it draws."""

    kind: str
    at_s: float
    message: str
    value: float


class CheckedEngine(Engine):
    """The real engine between a spoilt inbox and somebody who checks every tick."""

    def __init__(self, *overrides: str, depth_m: float = 1.0) -> None:
        config = load_config(overrides=overrides)
        super().__init__(config, Setpoint((nan, nan, depth_m, 0.3)), arm=True)
        self.spoils: list[Callable[[float, Inbox], Inbox]] = []
        self.to_vehicle: list[bytes] = []
        self.asleep_until_s = 0.0
        self.promises = Promises(config)
        self._kept: Inbox = []
        self._wishes: list[Request] = []
        self._sample: ControlSample | None = None

    def step(
        self,
        now_s: float,
        datagrams: Sequence[tuple[int, bytes]],
        loop: LoopHealth,
        requests: Sequence[Request] = (),
        ground: Sequence[tuple[int, bytes]] = (),
    ) -> tuple[list[bytes], ControlSample]:
        """Advance one tick, unless asleep; raise PromiseBrokenError."""
        t_s, inbox = now_s - START_S, list(datagrams)
        for spoil in self.spoils:
            inbox = spoil(t_s, inbox)
        self._kept += inbox
        self._wishes += requests
        if t_s < self.asleep_until_s and self._sample is not None:
            return [], self._sample
        others, self.to_vehicle = self.to_vehicle, []
        inbox, self._kept = self._kept, []
        wishes, self._wishes = self._wishes, []
        out, sample = super().step(now_s, inbox, loop, wishes, ground)
        self.promises.hold(t_s, out, sample, wishes, steers=self.steering)
        hold_telemetry(sample)
        self._sample = sample
        return out + others, sample


class Diving:
    """A vehicle and its companion in virtual time."""

    def __init__(self, variant: int, state: State, firmware: Path | None = None) -> None:
        _, plant, companion = VARIANTS[variant]
        extra = {
            State.READY: ("parameters.FS_PILOT_INPUT=1",),
            State.RAMP_DOWN: (),
        }.get(state, ())
        ramp = ("supervisor.ramp_down_s=4",) if state is State.RAMP_DOWN else ()
        file = PLANT / ("sim-bluerov2.toml" if 'vehicle.frame="vectored"' in companion else "sim.toml")
        config = load_plant(file, ("current.enabled=false", *plant, *extra))
        self.vehicle = Vehicle(config, variant) if firmware is None else Firmware(firmware, config, variant)
        self.engine = CheckedEngine(*companion, *ramp)
        self.loop = Lockstep(self.vehicle, self.engine, LinkDelay(), variant)
        self._variant = variant
        self.outsider = mavlink.MAVLink(None, 255, 190)
        try:
            self._reach(state)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the firmware, if it is a process."""
        if isinstance(self.vehicle, Firmware):
            self.vehicle.close()

    @property
    def t_s(self) -> float:
        """Simulated time."""
        return self.vehicle.time_s

    def run(self, seconds: float) -> None:
        """Let it run."""
        for _ in self.loop.run(seconds):
            pass

    def fault(
        self, kind: str, value: float = 0.0, message: str = "", seconds: float = 1e9, **more: str
    ) -> None:
        """Let the simulator break something from now on."""
        fault = {"kind": kind, "at_s": self.t_s, "duration_s": seconds, "value": value, "message": message}
        self.vehicle.inject(Fault(**fault, **more))  # type: ignore[arg-type]  # strings and numbers by name

    def until(self, state: State, within_s: float = 8.0) -> None:
        """Run until the supervisor is in `state`."""
        for _ in self.loop.run(within_s):
            if self.engine.verdict.state is state:
                return
        raise RuntimeError(f"never {state}, but {self.engine.verdict}")

    def say(self, message: Any) -> None:
        """Let another ground station say something."""
        self.engine.to_vehicle.append(bytes(message.pack(self.outsider)))

    def _reach(self, state: State) -> None:
        if state in (State.IDLE, State.READY):
            self.run(2.5)
            if state is State.READY:
                self.fault("mode", 0.0 if "STABILIZE" in VARIANTS[self._variant][0] else 19.0)
                self.say(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
                self.until(state)
            return
        self.loop.requests.append(Request.ENGAGE)
        self.until(State.ACTIVE)
        self.run(2.0)
        if state is State.RAMP_DOWN:
            self.loop.requests.append(Request.STOP)
        elif state is State.HAND_OVER:
            self.fault("leak")
        elif state is State.PILOT:
            self.fault("mode", 1.0)
        elif state is State.FAULT and isinstance(self.vehicle, Firmware):
            self.fault("link_cut", seconds=1.5)
        elif state is State.FAULT:
            self.fault("message_stopped", message="ATTITUDE", seconds=1.5)
        self.until(state)


# --- What breaks --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class InSimulator:
    """A fault of the vehicle's script."""

    kind: str

    def __call__(self, dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
        """Begin it."""
        dive.fault(self.kind, broken.value, broken.message)


def _spoilt(change: Callable[[bytes, np.random.Generator], Sequence[bytes]], most: float = 1.0) -> "Begin":
    """Return a fault that changes datagrams with a probability; each becomes none, one or several."""

    def begin(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
        def spoil(_: float, inbox: Inbox) -> Inbox:
            return [
                (at, new)
                for at, data in inbox
                for new in (change(data, rng) if rng.random() < most * broken.value else (data,))
            ]

        dive.engine.spoils.append(spoil)

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
        return [(round((START_S + t_s) * 1e9), data) for data in here]

    dive.engine.spoils.append(spoil)


def _stranger(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    """Another vehicle on the same wire: disarmed, elsewhere, upside down; and another component of ours."""
    packers = [mavlink.MAVLink(None, 2, 1), mavlink.MAVLink(None, 1, 100), mavlink.MAVLink(None, 77, 77)]

    def spoil(t_s: float, inbox: Inbox) -> Inbox:
        at, boot = round((START_S + t_s) * 1e9), int(rng.integers(2**32))
        lies = (
            mavlink.MAVLink_heartbeat_message(12, 3, 81, 0, 5, 3),
            mavlink.MAVLink_attitude_message(boot, 3.0, 1.5, -2.0, 9.0, 9.0, 9.0),
            mavlink.MAVLink_global_position_int_message(boot, 0, 0, 0, -99_000, 0, 0, 0, 0),
            mavlink.MAVLink_statustext_message(2, b"Leak Detected", 0, 0),
        )
        lie = lies[int(rng.integers(len(lies)))]
        return [*inbox, (at, bytes(lie.pack(packers[int(rng.integers(3))])))]

    dive.engine.spoils.append(spoil)


def _junk(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    def spoil(t_s: float, inbox: Inbox) -> Inbox:
        junk = rng.integers(0, 256, int(rng.integers(1, 600)), dtype=np.uint8).tobytes()
        at = round((START_S + t_s) * 1e9)
        return [(at, b"\xfd" + junk), *inbox, (at, junk)]

    dive.engine.spoils.append(spoil)


def _stall(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    dive.engine.asleep_until_s = dive.t_s + _stalls_s(broken)


def _stalls_s(broken: Broken) -> float:
    return 0.35 + 2.0 * broken.value


def _stalled(broken: Broken) -> float | None:
    """One of up to a second is ridden out, give or take a tick."""
    stalls_s = _stalls_s(broken)
    return None if stalls_s < 1.05 else stalls_s + RAMP_S + LATE_S


def _parameter(name: str, value: float | None = None) -> "Begin":
    def begin(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
        new = float(rng.choice([0.0, 1.0, 2.0, 50.0])) if value is None else value
        dive.say(mavlink.MAVLink_param_set_message(1, 1, name.encode(), new, 9))

    return begin


def _pilots_stick(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    channels = (65535, 65535, 1500, 1500, 1800, 1500, 65535, 65535)
    frame = bytes(mavlink.MAVLink_rc_channels_override_message(1, 1, *channels).pack(dive.outsider))
    dive.engine.spoils.append(lambda t_s, inbox: [*inbox, (round((START_S + t_s) * 1e9), frame)])


def _thruster(dive: Diving, broken: Broken, rng: np.random.Generator) -> None:
    dive.vehicle.inject(Fault(kind="thruster", at_s=dive.t_s, thruster=int(rng.integers(1, 7)), value=0.0))


Begin = Callable[[Diving, Broken, np.random.Generator], None]


class FaultSpec(NamedTuple):
    """How a fault begins, and how long ACTIVE may push afterwards; None where it may be borne."""

    begin: Begin
    within_s: Callable[[Broken], float | None]
    value: tuple[float, float] = (0.0, 1.0)
    on_stream: bool = False


def _never(_: Broken) -> None:
    return None


def _after(seconds: float) -> Callable[[Broken], float]:
    return lambda _: seconds


def _stale(broken: Broken) -> float | None:
    return STALE_S.get(broken.message)


FAULTS: dict[str, FaultSpec] = {
    "datagrams lost": FaultSpec(_spoilt(lambda data, rng: ()), _never),
    "all lost": FaultSpec(_spoilt(lambda data, rng: ()), _after(DEPTH_STALE_S), (1.0, 1.0)),
    "doubled": FaultSpec(_spoilt(lambda data, rng: (data, data)), _never),
    "reordered": FaultSpec(_shuffled, _never),
    "delayed": FaultSpec(InSimulator("link_delayed"), _never, (0.0, 0.4)),
    "cut short": FaultSpec(_spoilt(lambda data, rng: (data[: rng.integers(1, len(data) + 1)],)), _never),
    "bits flipped": FaultSpec(_spoilt(_flipped), _never),
    "every one flipped": FaultSpec(_spoilt(_flipped), _after(DEPTH_STALE_S), (1.0, 1.0)),
    "junk between": FaultSpec(_junk, _never),
    "strangers and wrong components": FaultSpec(_stranger, _never),
    "link cut both ways": FaultSpec(InSimulator("link_cut"), _after(DEPTH_STALE_S)),
    "frozen but sent": FaultSpec(InSimulator("message_frozen"), _stale, on_stream=True),
    "stopped": FaultSpec(InSimulator("message_stopped"), _stale, on_stream=True),
    "NaN": FaultSpec(InSimulator("message_nan"), _never, on_stream=True),
    "infinite": FaultSpec(InSimulator("message_extreme"), _never, (np.inf, np.inf), on_stream=True),
    "integers and floats at their largest": FaultSpec(
        InSimulator("message_extreme"), _never, (3e38, 3e38), on_stream=True
    ),
    "reboot": FaultSpec(InSimulator("reboot"), _after(HEARTBEAT_S)),
    "disarmed": FaultSpec(InSimulator("disarm"), _after(HEARTBEAT_S)),
    "mode changed": FaultSpec(InSimulator("mode"), _after(HEARTBEAT_S), (2.0, 2.0)),
    "a stick moved": FaultSpec(_pilots_stick, _after(LATE_S)),
    "failsafe switched off": FaultSpec(_parameter("FS_PILOT_INPUT", 0.0), _after(RAMP_S + LATE_S)),
    "parameters changed": FaultSpec(_parameter("JS_GAIN_DEFAULT"), _never),
    "throttle gain changed": FaultSpec(_parameter("JS_THR_GAIN"), _never),
    "leak": FaultSpec(InSimulator("leak"), _after(RAMP_S + 2.0 * LATE_S)),
    "EKF lost": FaultSpec(InSimulator("ekf"), _after(RAMP_S + 0.6), (1.0, 3.0)),
    "depth jumps": FaultSpec(InSimulator("depth_shifted"), _never, (-9.0, 9.0)),
    "yaw reset": FaultSpec(InSimulator("yaw_reset"), _never, (-180.0, 180.0)),
    "position reset": FaultSpec(InSimulator("position_reset"), _never, (-9.0, 9.0)),
    "battery flat": FaultSpec(InSimulator("voltage"), _never, (6.0, 12.0)),
    "thruster dead": FaultSpec(_thruster, _never),
    "companion stalls": FaultSpec(_stall, _stalled),
}


ON_FIRMWARE = tuple(
    name
    for name, kind in FAULTS.items()
    if not (isinstance(kind.begin, InSimulator) and not FAULT_KINDS[kind.begin.kind].on_firmware)
    and name != "depth jumps"
)
"""Left out: what would change the firmware's own messages, a leak (no pin), losses and resets of its EKF, and
a jump of its pressure, which its EKF may well reject."""


def draw(kind: str, rng: np.random.Generator) -> Broken:
    """Return a fault of this kind, with what it draws."""
    low, high = FAULTS[kind].value
    return Broken(
        kind,
        at_s=round(float(rng.uniform(0.0, 0.8)), 2),
        message=str(rng.choice(STREAMS)) if FAULTS[kind].on_stream else "",
        value=low if low == high else float(rng.uniform(low, high)),
    )
