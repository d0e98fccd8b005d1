"""The closed loop in virtual time: the companion's engine and a vehicle exchange MAVLink bytes.

The vehicle is our stand-in (`sim_bridge.vehicle`) or the real firmware (`lab.loop.firmware`). It steps,
datagrams travel for as long as the link says, the engine ticks. The same seed gives the same samples, and an
hour of diving with our stand-in takes a minute or two.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from companion.engine import Engine
from companion.records import ZERO, ControlSample, LoopHealth, Request, Setpoint
from sim_bridge.vehicle import Truth

COMPANION_LINK = 1
START_S = 1000.0
"""The companion's clock when the vehicle boots: the two clocks are never equal."""


class SteppedVehicle(Protocol):
    """What the loop needs of `sim_bridge.vehicle.Vehicle` or `lab.loop.firmware.Firmware`."""

    step_s: float
    time_s: float

    def open_link(self, link: int) -> None:
        """Declare a link."""

    def step(self, datagrams: Sequence[tuple[int, bytes]] = ()) -> list[tuple[int, bytes]]:
        """Advance `step_s`; take and return (link, bytes)."""

    def truth(self) -> Truth:
        """Tell the present truth."""


@dataclass(frozen=True)
class LinkDelay:
    """How long datagrams travel: `up_s` to the companion, `down_s` to the vehicle, each plus 0..`jitter_s`.

    `change_s` may give an extra delay each way from some time on: (since_s, extra_s).
    """

    up_s: float = 0.001
    down_s: float = 0.001
    jitter_s: float = 0.004
    change_s: tuple[float, float] = (np.inf, 0.0)

    def extra_s(self, now_s: float) -> float:
        """Return what is added each way at simulated time `now_s`."""
        return self.change_s[1] if now_s >= self.change_s[0] else 0.0


@dataclass
class Wire:
    """Datagrams on their way, in the order in which they arrive."""

    _flying: deque[tuple[float, bytes]] = field(default_factory=deque)
    _last_s: float = 0.0

    def put(self, arrives_s: float, data: bytes) -> None:
        """Send `data` so that it arrives at `arrives_s`, but overtakes nothing that was sent before."""
        self._last_s = max(self._last_s, arrives_s)
        self._flying.append((self._last_s, data))

    def arrived(self, now_s: float) -> Iterator[tuple[float, bytes]]:
        """Give what has arrived by `now_s`, with its time of arrival."""
        while self._flying and self._flying[0][0] <= now_s:
            yield self._flying.popleft()


@dataclass(frozen=True)
class Step:
    """One tick of the closed loop: what the controller thought and what was true."""

    t_s: float
    sample: ControlSample
    truth: Truth


class Lockstep:
    """Engine and vehicle in one virtual time that starts when the vehicle boots.

    The engine's period has to be a whole multiple of the vehicle's step, which the constructor checks.
    """

    def __init__(
        self, vehicle: SteppedVehicle, engine: Engine, link: LinkDelay, seed: int, rate_hz: float = 50.0
    ) -> None:
        self.vehicle = vehicle
        self.engine = engine
        self._link = link
        self._steps = round(1.0 / (rate_hz * vehicle.step_s))
        if abs(self._steps * vehicle.step_s * rate_hz - 1.0) > 1e-9:
            raise ValueError(f"a tick of 1/{rate_hz} s is no whole multiple of the step {vehicle.step_s} s")
        self._rate_hz = rate_hz
        self._random = np.random.default_rng(seed)
        self._up, self._down = Wire(), Wire()
        self._tick = 0
        self.requests: list[Request] = []
        self.excitation = ZERO
        vehicle.open_link(COMPANION_LINK)

    def tick(self) -> Step:
        """Advance by one tick of the engine."""
        vehicle, link = self.vehicle, self._link
        for _ in range(self._steps):
            commands = [(COMPANION_LINK, data) for _, data in self._down.arrived(vehicle.time_s)]
            for _, data in vehicle.step(commands):
                delay_s = link.up_s + link.extra_s(vehicle.time_s) + self._jitter()
                self._up.put(vehicle.time_s + delay_s, data)
        now_s = vehicle.time_s
        inbox = [(round((START_S + t_s) * 1e9), data) for t_s, data in self._up.arrived(now_s)]
        self._tick += 1
        health = LoopHealth(self._tick, self._rate_hz, 0.0, 0.0, 0, 0)
        requests, self.requests = self.requests, []
        out, sample = self.engine.step(START_S + now_s, inbox, health, requests, excitation=self.excitation)
        for data in out:
            delay_s = link.down_s + link.extra_s(now_s) + self._jitter()
            self._down.put(now_s + delay_s, data)
        return Step(now_s, sample, vehicle.truth())

    def run(self, duration_s: float, aim: Callable[[float], Setpoint] | None = None) -> Iterator[Step]:
        """Tick for `duration_s`; `aim` gives the setpoint at each simulated time."""
        for _ in range(round(duration_s * self._rate_hz)):
            if aim is not None:
                self.engine.aim(aim(self.vehicle.time_s + 1.0 / self._rate_hz))
            yield self.tick()

    def _jitter(self) -> float:
        return self._link.jitter_s * self._random.random()
