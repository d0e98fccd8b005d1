"""What is known of one dive, on one clock, and the figures drawn from it. No clock, no socket."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Command, Schema, State, Supervisor
from sim_bridge.vehicle import Truth
from sim_bridge.zenoh_link import TruthSample

Array = NDArray[np.float64]
Sample = TypeVar("Sample", State, Command)

CLOCK_S = 1.0
"""A sample that is stamped later than the last truth by more than this has another clock's stamp."""
TICK_GAP = 1.5
"""Two commands further apart than this many ticks are no neighbours: one between them was lost."""
WORTH = 0.05
"""A part is worth something where it changes the error by more than this share."""
Z, PSI = 2, 5

_truth = msgspec.json.Decoder(TruthSample)


@dataclass
class DemoRecording:
    """What came over Zenoh during one dive, in the order in which it came."""

    truth: list[TruthSample] = field(default_factory=list)
    state: list[State] = field(default_factory=list)
    command: list[Command] = field(default_factory=list)
    d_hat_n: float = 0.0
    saturated: bool = False
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
        elif isinstance(record, telemetry.Dof) and record.dof == "z":
            self.d_hat_n, self.saturated = record.d_hat, record.saturated


@dataclass(frozen=True)
class DemoDive:
    """One dive. Every time is the vehicle's clock since arming, in s; arrays are (n,), per kind of sample.

    Errors are truth minus reference; thrust is positive down.
    """

    t_s: Array
    """of the simulator's truth"""
    depth_m: Array
    depth_desired_m: Array
    heading_error_rad: Array
    thrust_n: Array
    command_t_s: Array
    """of the controller's ticks"""
    command_n: Array

    @property
    def depth_error_mm(self) -> Array:
        """Depth minus reference."""
        return 1e3 * (self.depth_m - self.depth_desired_m)


class DemoFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What the table and demo.json say of one dive; of all phases together, but for the first."""

    phase_rms_mm: dict[str, float]
    """Depth error in each phase."""
    depth_rms_mm: float
    depth_sd_mm: float
    """Depth error about its mean."""
    depth_peak_mm: float
    heading_rms_deg: float
    thrust_rms_n: float
    """The true heave thrust."""
    chatter_n: float
    """RMS change of the heave thrust command from one controller tick to the next."""


def arrange(recording: DemoRecording) -> DemoDive:
    """Line up the samples on the vehicle's clock, from arming on.

    Raises ValueError when a kind of sample is missing or the vehicle never armed.
    """
    zero_s = recording.armed_s
    # Before the controller knows the vehicle's clock, its samples carry its own: hours later, or earlier.
    last_s = recording.truth[-1].t_s + CLOCK_S if recording.truth else zero_s
    state, command = _between(recording.state, zero_s, last_s), _between(recording.command, zero_s, last_s)
    armed = [sample for sample in recording.truth if sample.t_s >= zero_s]
    for name, samples in (("truth", armed), ("state", state), ("command", command)):
        if len(samples) < 2:
            raise ValueError(f"no sample of '{name}' came over Zenoh from an armed vehicle")
    t_s, state_s = _column(armed, "t_s"), _column(state, "boot_s")
    return diving(
        armed,
        np.interp(t_s, state_s, _column(state, "depth_desired_m")),
        np.interp(t_s, state_s, np.unwrap(_column(state, "heading_desired_rad"))),
        _column(command, "boot_s") - zero_s,
        _column(command, "heave_delivered_n"),
    )


def diving(
    truth: Sequence[Truth | TruthSample],
    depth_desired_m: Array,
    heading_desired_rad: Array,
    command_t_s: Array,
    command_n: Array,
) -> DemoDive:
    """Return the dive of these truths, the first of which is the first armed one, and its references."""
    eta = np.array([sample.eta for sample in truth])
    t_s = _column(truth, "t_s")
    return DemoDive(
        t_s=t_s - t_s[0],
        depth_m=eta[:, Z],
        depth_desired_m=depth_desired_m,
        heading_error_rad=_wrap(eta[:, PSI] - heading_desired_rad),
        thrust_n=np.array([sample.tau[Z] for sample in truth]),
        command_t_s=command_t_s,
        command_n=command_n,
    )


def figures(
    dive: DemoDive, phases: Mapping[str, tuple[float, float]], *, about_mean: bool = False
) -> DemoFigures:
    """Draw the figures of one dive; with `about_mean` those of its phases are about the mean of all of them.

    Raises ValueError where the dive ends before its phases do.
    """
    begin_s, end_s = min(begin for begin, _ in phases.values()), max(end for _, end in phases.values())
    if dive.t_s[-1] < end_s - CLOCK_S:
        raise ValueError(f"the dive ended {dive.t_s[-1]:.1f} s after arming, before {end_s:g} s")
    held = _within(dive.t_s, (begin_s, end_s))
    error_mm = dive.depth_error_mm
    mean_mm = float(error_mm[held].mean())
    shown_mm = error_mm - mean_mm if about_mean else error_mm
    ticks = _within(dive.command_t_s, (begin_s, end_s))
    command_s, command_n = dive.command_t_s[ticks], dive.command_n[ticks]
    neighbours = np.diff(command_s) < TICK_GAP * np.median(np.diff(command_s))
    return DemoFigures(
        phase_rms_mm={name: _rms(shown_mm[_within(dive.t_s, span)]) for name, span in phases.items()},
        depth_rms_mm=_rms(error_mm[held]),
        depth_sd_mm=_rms(error_mm[held] - mean_mm),
        depth_peak_mm=float(np.abs(shown_mm[held]).max()),
        heading_rms_deg=math.degrees(_rms(dive.heading_error_rad[held])),
        thrust_rms_n=_rms(dive.thrust_n[held]),
        chatter_n=_rms(np.diff(command_n)[neighbours]),
    )


def worth(part: str, without: DemoFigures, with_it: DemoFigures) -> str:
    """Say in which phases a part of the controller makes the depth error smaller, and in which not."""
    changes = {
        phase: with_it.phase_rms_mm[phase] / rms_mm - 1.0 for phase, rms_mm in without.phase_rms_mm.items()
    }
    less = [f"{phase} {100.0 * change:+.0f} %" for phase, change in changes.items() if change < -WORTH]
    more = [f"{phase} {100.0 * change:+.0f} %" for phase, change in changes.items() if change > WORTH]
    none = [phase for phase, change in changes.items() if abs(change) <= WORTH]
    said = [
        f"{words}: {', '.join(where)}"
        for words, where in (
            ("lowers the error", less),
            ("raises it", more),
            (f"brings nothing (within {100.0 * WORTH:.0f} %)", none),
        )
        if where
    ]
    return f"{part} " + "; it ".join(said) + "."


def _within(t_s: Array, span: tuple[float, float]) -> NDArray[np.bool_]:
    return (t_s >= span[0]) & (t_s < span[1])


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
