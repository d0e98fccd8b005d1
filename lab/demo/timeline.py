"""What is known of one dive, arranged on one clock, and the figures drawn from it. No clock, no socket."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Command, Dof, Schema, State, Supervisor
from sim_bridge.vehicle import Truth
from sim_bridge.zenoh_link import TruthSample

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Sample = TypeVar("Sample", State, Command, Dof)

ARRIVED_M = 0.005
"""The reference has arrived when it is as near as this to the depth asked for."""
UNDER_WAY_M = 1.0
"""The way down counts from this depth of the reference: above it the waves throw the vehicle about."""
CLOCK_S = 1.0
"""A sample that is stamped later than the last truth by more than this has another clock's stamp."""
TICK_GAP = 1.5
"""Two commands further apart than this many ticks are no neighbours: one between them was lost."""
Z, PSI = 2, 5

_truth = msgspec.json.Decoder(TruthSample)


@dataclass
class DemoRecording:
    """What came over Zenoh during one dive, in the order in which it came."""

    truth: list[TruthSample] = field(default_factory=list)
    state: list[State] = field(default_factory=list)
    heave: list[Dof] = field(default_factory=list)
    command: list[Command] = field(default_factory=list)
    supervisor: Supervisor | None = None
    armed_s: float = math.inf
    """The vehicle's clock when it was first seen armed."""

    @property
    def since_arming_s(self) -> float:
        """Time of the newest truth; negative infinity before the arming."""
        return self.truth[-1].t_s - self.armed_s if self.truth else -math.inf

    def add(self, key: str, payload: bytes) -> None:
        """Take one message; raise ValueError for one that is neither the controller's nor the simulator's."""
        if key.startswith("sim/"):
            truth = _truth.decode(payload)
            self.truth.append(truth)
            if truth.armed:
                self.armed_s = min(self.armed_s, truth.t_s)
        else:
            self._keep(telemetry.decode(key, payload))

    def _keep(self, record: Schema) -> None:
        if isinstance(record, Supervisor):
            self.supervisor = record
        elif "boot_s" in record.absent:
            return
        elif isinstance(record, State):
            self.state.append(record)
        elif isinstance(record, Command):
            self.command.append(record)
        elif isinstance(record, Dof) and record.dof == "z":
            self.heave.append(record)


@dataclass(frozen=True)
class DemoDive:
    """One dive. Every time is the vehicle's clock since arming, in s; arrays are (n,), per kind of sample.

    Errors are truth minus reference. `disturbance_n` and `d_hat_n` have the paper's sign,
    m z'' = tau - h - d: positive lifts the vehicle. `d_hat_n` stands at the time at which its thrust acts,
    `ahead_s` after its tick. Thrust is positive down. ALT_HOLD has no d_hat: its last three arrays are empty.
    """

    t_s: Array
    """of the simulator's truth"""
    depth_m: Array
    depth_desired_m: Array
    depth_error_m: Array
    heading_error_rad: Array
    thrust_n: Array
    disturbance_n: Array
    load_on: Flags

    command_t_s: Array
    """of the controller's ticks"""
    command_n: Array
    tick_s: float

    d_hat_t_s: Array
    d_hat_n: Array
    saturated: Flags


class DemoFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What the table and demo.json say of one dive; over the window unless its name says otherwise."""

    depth_rms_mm: float
    depth_sd_mm: float
    """Depth error about its mean."""
    depth_peak_mm: float
    heading_rms_deg: float
    thrust_rms_n: float
    """The true heave thrust."""
    chatter_n: float
    """RMS change of the heave thrust command from one controller tick to the next."""
    disturbance_rms_n: float
    """The true heave disturbance about its mean."""
    d_hat_error_rms_n: float | None
    """d_hat minus the true disturbance; none of ALT_HOLD."""
    way_down_rms_mm: float | None
    """Depth error while the reference goes down from 1 m; none of a dive that begins at its depth."""
    way_down_peak_mm: float | None
    saturated_percent: float | None
    """Share of the ticks of the whole dive in which heave was saturated; not known of ALT_HOLD."""
    ticks: int
    ticks_lost: int
    """Ticks missing among those, late ones included."""


def arrange(recording: DemoRecording) -> DemoDive:
    """Line up the samples on the vehicle's clock, from arming on.

    Raises ValueError when a kind of sample is missing or the vehicle never armed.
    """
    zero_s = recording.armed_s
    # Before the controller knows the vehicle's clock, its samples carry its own: hours later, or earlier.
    last_s = recording.truth[-1].t_s + CLOCK_S if recording.truth else zero_s
    truth = [sample for sample in recording.truth if sample.t_s >= zero_s]
    state, command, heave = (
        _between(recording.state, zero_s, last_s),
        _between(recording.command, zero_s, last_s),
        _between(recording.heave, zero_s, last_s),
    )
    for name, samples in (("truth", truth), ("state", state), ("command", command), ("dof/z", heave)):
        if len(samples) < 2:
            raise ValueError(f"no sample of '{name}' came over Zenoh from an armed vehicle")

    t_s = _column(truth, "t_s")
    eta = np.array([sample.eta for sample in truth])
    state_s = _column(state, "boot_s")
    depth_desired_m = np.interp(t_s, state_s, _column(state, "depth_desired_m"))
    heading_desired_rad = np.interp(t_s, state_s, np.unwrap(_column(state, "heading_desired_rad")))
    return DemoDive(
        t_s=t_s - zero_s,
        depth_m=eta[:, Z],
        depth_desired_m=depth_desired_m,
        depth_error_m=eta[:, Z] - depth_desired_m,
        heading_error_rad=_wrap(eta[:, PSI] - heading_desired_rad),
        thrust_n=np.array([sample.tau[Z] for sample in truth]),
        disturbance_n=-np.array([sample.disturbance[Z] for sample in truth]),
        load_on=np.array([sample.load_on for sample in truth]),
        command_t_s=_column(command, "boot_s") - zero_s,
        command_n=_column(command, "heave_delivered_n"),
        tick_s=float(np.median(np.diff(_column(command, "t_s")))),
        d_hat_t_s=_column(heave, "boot_s") + _column(heave, "ahead_s") - zero_s,
        d_hat_n=_column(heave, "d_hat"),
        saturated=np.array([sample.saturated for sample in heave]),
    )


def at_depth(
    truth: Sequence[Truth | TruthSample], command_n: Sequence[float], depth_m: float, heading_rad: float
) -> DemoDive:
    """Arrange a dive of ALT_HOLD that is to stay at one depth and heading, from arming on.

    `command_n` is the heave thrust that the motors were told at each of the truths.
    """
    armed = [sample.armed for sample in truth]
    first = armed.index(True)
    t_s = _column(truth[first:], "t_s") - truth[first].t_s
    eta = np.array([sample.eta for sample in truth[first:]])
    nothing = np.array([])
    return DemoDive(
        t_s=t_s,
        depth_m=eta[:, Z],
        depth_desired_m=np.full(len(t_s), depth_m),
        depth_error_m=eta[:, Z] - depth_m,
        heading_error_rad=_wrap(eta[:, PSI] - heading_rad),
        thrust_n=np.array([sample.tau[Z] for sample in truth[first:]]),
        disturbance_n=-np.array([sample.disturbance[Z] for sample in truth[first:]]),
        load_on=np.array([sample.load_on for sample in truth[first:]]),
        command_t_s=t_s,
        command_n=np.array(command_n[first:]),
        tick_s=float(np.median(np.diff(t_s))),
        d_hat_t_s=nothing,
        d_hat_n=nothing,
        saturated=nothing.astype(bool),
    )


def window(dives: Sequence[DemoDive], depth_m: float) -> tuple[float, float]:
    """Return the span in s since arming in which the reference of every dive has arrived at `depth_m`.

    Raises ValueError when one never did.
    """
    begins: list[float] = []
    for dive in dives:
        arrived = np.abs(dive.depth_desired_m - depth_m) < ARRIVED_M
        if not arrived.any():
            raise ValueError(
                f"the reference never arrived at {depth_m:g} m: it ended at {dive.depth_desired_m[-1]:.2f} m"
            )
        begins.append(float(dive.t_s[int(arrived.argmax())]))
    return max(begins), min(float(dive.t_s[-1]) for dive in dives)


def figures(dive: DemoDive, span: tuple[float, float]) -> DemoFigures:
    """Draw the figures of one dive over the window `span`, in s since arming."""
    begin_s, end_s = span
    held = (dive.t_s >= begin_s) & (dive.t_s <= end_s)
    arrived = np.abs(dive.depth_desired_m - dive.depth_desired_m[-1]) < ARRIVED_M
    down = (dive.depth_desired_m > UNDER_WAY_M) & ~arrived & (dive.t_s < begin_s)
    error_mm = 1e3 * dive.depth_error_m
    disturbance_n = dive.disturbance_n[held]
    ticks = (dive.command_t_s >= begin_s) & (dive.command_t_s <= end_s)
    learnt = (dive.d_hat_t_s >= begin_s) & (dive.d_hat_t_s <= end_s)
    true_then_n = np.interp(dive.d_hat_t_s[learnt], dive.t_s, dive.disturbance_n)
    command_s, command_n = dive.command_t_s[ticks], dive.command_n[ticks]
    neighbours = np.diff(command_s) < TICK_GAP * dive.tick_s
    expected = round((command_s[-1] - command_s[0]) / dive.tick_s) + 1
    return DemoFigures(
        depth_rms_mm=_rms(error_mm[held]),
        depth_sd_mm=float(error_mm[held].std()),
        depth_peak_mm=_peak(error_mm[held]),
        heading_rms_deg=math.degrees(_rms(dive.heading_error_rad[held])),
        thrust_rms_n=_rms(dive.thrust_n[held]),
        chatter_n=_rms(np.diff(command_n)[neighbours]),
        disturbance_rms_n=_rms(disturbance_n - disturbance_n.mean()),
        d_hat_error_rms_n=_rms(dive.d_hat_n[learnt] - true_then_n) if learnt.any() else None,
        way_down_rms_mm=_rms(error_mm[down]) if down.any() else None,
        way_down_peak_mm=_peak(error_mm[down]) if down.any() else None,
        saturated_percent=100.0 * float(dive.saturated.mean()) if dive.saturated.size else None,
        ticks=int(ticks.sum()),
        ticks_lost=max(0, expected - int(ticks.sum())),
    )


def spans(t_s: Array, flags: Flags) -> list[tuple[float, float]]:
    """Return the (begin, end) times between which `flags`, of shape (n,), hold."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    last = len(t_s) - 1
    return [(float(t_s[a]), float(t_s[min(b, last)])) for a, b in edges.reshape(-1, 2)]


def _between(samples: Sequence[Sample], begin_s: float, end_s: float) -> list[Sample]:
    """Return the samples that the vehicle's clock stamped in that time, in the order of their stamps."""
    return sorted(
        (sample for sample in samples if begin_s <= sample.boot_s <= end_s), key=lambda sample: sample.boot_s
    )


def _column(samples: Sequence[Schema | Truth | TruthSample], name: str) -> Array:
    return np.array([getattr(sample, name) for sample in samples], dtype=float)


def _wrap(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _peak(values: Array) -> float:
    return float(np.abs(values).max())
