"""One tick, from what is asked to what leaves for telemetry."""

from enum import IntEnum, StrEnum, auto
from typing import NamedTuple

import msgspec

from companion.records.conditions import Condition
from companion.records.control import AxisCommand, Dofs
from companion.records.dof import LEVEL, ZERO, Angles, Vector, Z
from companion.records.events import LinkCounters, StatusText
from companion.records.state import VehicleState

ENGAGE_S = 5.0
"""A command or a button asks to engage for this time: later it would be a surprise."""
DIVING_M = 0.5


class Request(IntEnum):
    """What an operator can ask for."""

    ENGAGE = auto()
    STOP = auto()
    CLEAR_FAULT = auto()
    RESET_MODEL = auto()
    WITHDRAW = auto()
    """Drop a request to engage; an engaged vehicle stays engaged."""


class Setpoint(NamedTuple):
    """Where to be, in DOF order, with rate and acceleration; a NaN place: where it is when engaged."""

    eta_d: Vector
    eta_d_dot: Vector = ZERO
    eta_d_ddot: Vector = ZERO


class Guided(msgspec.Struct, frozen=True):
    """What moves the target: hold, move, path, paused, waiting, refused; "" while nothing is held."""

    kind: str
    number: int
    """Counts the courses."""
    name: str = ""
    """The path's, or why it was refused."""
    progress_m: float = 0.0
    length_m: float = 0.0
    speed_mps: float = 0.0
    """Along the path."""
    altitude_m: float = 0.0
    """Over the ground, that is kept; 0 for none, or none yet."""
    left_m: float = 0.0
    left_s: float = 0.0
    """Estimated time to the end of the path or the move; infinite if it has none."""
    pending: str = ""
    """What it does as soon as it engages, in words; empty: it holds where it is."""


class State(StrEnum):
    """The supervisor's states."""

    IDLE = "IDLE"
    READY = "READY"
    ACTIVE = "ACTIVE"
    RAMP_DOWN = "RAMP_DOWN"
    HAND_OVER = "HAND_OVER"
    PILOT = "PILOT"
    FAULT = "FAULT"


class Verdict(msgspec.Struct, frozen=True):
    """The supervisor's word for this tick. `authority` 0..1 scales the wrench: 0 is neutral.

    `warnings` are the conditions that only warn; with `freeze` learning is frozen.
    `remedy` is the one thing to do that gets the operator on.
    """

    state: State
    conditions: Condition
    authority: float
    reason: str
    warnings: Condition = Condition(0)
    freeze: bool = False
    remedy: str = ""


class DiveTotals(NamedTuple):
    """Totals since this process started, counted while the vehicle was armed."""

    deepest_m: float = 0.0
    dive_s: float = 0.0
    """Time spent deeper than DIVING_M."""

    def after(self, state: VehicleState, dt_s: float) -> "DiveTotals":
        """Return them after one more tick."""
        depth_m = state.eta[Z]
        if not state.armed or state.stale[Z] or not depth_m > DIVING_M:
            return self
        return DiveTotals(max(self.deepest_m, depth_m), self.dive_s + dt_s)


class LoopHealth(msgspec.Struct, frozen=True):
    """How the process itself is doing."""

    tick: int
    rate_hz: float
    lateness_ms: float
    compute_us: float
    late_ticks: int
    samples_dropped: int
    strangers: int = 0
    """Datagrams of others than the links' peers."""
    peer_changes: int = 0
    left_out_bytes: int = 0
    """Bytes of floods on the links that were dropped."""
    errors: int = 0
    """Errors in what runs beside the tick."""
    dive: DiveTotals = DiveTotals()


class ControlSample(msgspec.Struct, frozen=True):
    """Everything of one tick, as it leaves for telemetry."""

    state: VehicleState
    eta_d: Vector
    """Where it should be now; `dofs` is about `state.ahead_s` later."""
    dofs: Dofs
    command: AxisCommand
    requested: Vector
    delivered: Vector
    """Body forces tau = X, Y, Z (N) and N (N·m), by axis."""
    verdict: Verdict
    counters: LinkCounters
    loop: LoopHealth
    guided: Guided = Guided("", 0)
    angles_d: Angles = LEVEL
    """Roll and pitch at which they are held, rad."""
    texts: tuple[StatusText, ...] = ()
    """What the autopilot said since the tick before."""
    refused: str = ""
    """Why the pilot's engage button was refused in this tick."""
    disarms_in_s: float = 0.0
    """Time until the autopilot disarms, as nobody steers; 0 if it does not."""
    reads: bool = False
    """Whether what the pre-dive list needs is still being read."""

    @property
    def foreign(self) -> int:
        """Messages of other systems, and datagrams of others than the links' peers."""
        return self.counters.foreign + self.loop.strangers
