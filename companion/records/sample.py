"""Everything of one tick, as it leaves for telemetry."""

import msgspec

from companion.records.control import AxisCommand, DofSample, Wrench
from companion.records.dof import LEVEL, Angles, Vector
from companion.records.events import LinkCounters, StatusText
from companion.records.operator import Guided
from companion.records.state import VehicleState
from companion.records.supervision import Verdict


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
    """Of floods on the links."""
    errors: int = 0
    """Of what runs beside the tick."""


class ControlSample(msgspec.Struct, frozen=True):
    """Everything of one tick, as it leaves for telemetry."""

    state: VehicleState
    eta_d: Vector
    """Where it should be now; `dofs` is about `state.ahead_s` later."""

    dofs: DofSample
    command: AxisCommand
    requested: Wrench
    delivered: Wrench
    verdict: Verdict
    counters: LinkCounters
    loop: LoopHealth
    guided: Guided = Guided("", 0)
    angles_d: Angles = LEVEL
    """Of roll and pitch, at which they are held."""

    texts: tuple[StatusText, ...] = ()
    """What the autopilot said since the tick before."""

    refused: str = ""
    """Why the pilot's engage button was refused in this tick."""

    disarms_in_s: float = 0.0
    """Until the autopilot disarms, as nobody steers; 0 where it does not."""

    @property
    def foreign(self) -> int:
        """Messages of other systems, and datagrams of others than the links' peers."""
        return self.counters.foreign + self.loop.strangers
