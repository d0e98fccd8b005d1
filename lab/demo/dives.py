"""The demo's dives in virtual time, by ALT_HOLD and by Holdfast or a part of it, and their figures."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config import load_config
from companion.engine import Engine
from companion.records import PSI, Request, State, Z
from lab.demo.story import Story
from lab.loop.dive import TRUE_PSI, commanded
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import Scenario
from lab.rivals import alt_hold
from sim_bridge.physics.thrusters import thrusters_of
from sim_bridge.vehicle import Truth

Array = NDArray[np.float64]

NAMES = {"alt_hold": "ALT_HOLD", "law": "law", "observer": "law + observer", "holdfast": "Holdfast"}
PARTS = {"law": "none", "observer": "observer", "holdfast": ""}
"""The dives of Holdfast, and their compensators; empty: the shipped one."""
AXES = ("surge", "sway", "heave", "yaw")
ARMS_WITHIN_S = 60.0
WORTH = 0.05
"""A part is worth something where it changes the error by more than this share."""

Tell = Callable[[float], None]
"""Takes the time since arming (s) of every tick."""


@dataclass(frozen=True)
class DemoDive:
    """One dive, a row each tick since arming. Errors are truth minus reference, thrust is positive down."""

    t_s: Array
    depth_m: Array
    depth_desired_m: Array
    heading_error_rad: Array
    thrust_n: Array
    """The true heave thrust."""
    command_n: Array
    """The commanded one."""

    @property
    def depth_error_mm(self) -> Array:
        """Depth minus reference."""
        return 1e3 * (self.depth_m - self.depth_desired_m)


class DemoFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What the table and demo.json say of one dive: of all phases together, but for the first field."""

    phase_rms_mm: dict[str, float]
    """Depth error in each phase."""
    depth_rms_mm: float
    depth_peak_mm: float
    heading_rms_deg: float
    thrust_rms_n: float
    """The true heave thrust."""
    chatter_n: float
    """RMS change of the heave thrust command from one tick to the next."""


def dive_holdfast(story: Story, compensator: str, firmware: Path | None, tell: Tell) -> DemoDive:
    """Dive with the companion's engine and this compensator on all axes; empty: the shipped one.

    Raises ValueError where the vehicle does not arm or the engine let go of it.
    """
    config = load_config(overrides=[f"{axis}.compensator={compensator!r}" for axis in AXES if compensator])
    truths: list[Truth] = []
    rows: list[tuple[float, float, float]] = []
    with vehicle_of(story.plant(), story.seed, firmware) as vehicle:
        engine = Engine(config, story.setpoint(story.depth_m), arm=True)
        loop = Lockstep(vehicle, engine, LinkDelay(), story.seed, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        t_s = 0.0
        while t_s < story.end_s:
            engine.aim(story.setpoint(story.depth_m_at(t_s)))
            step = loop.tick()
            sample = step.sample
            if step.truth.armed:
                truths.append(step.truth)
                rows.append((sample.eta_d[Z], sample.eta_d[PSI], sample.delivered.tau[Z]))
                t_s = step.t_s - truths[0].t_s
                tell(t_s)
            elif step.t_s > ARMS_WITHIN_S:
                raise ValueError(f"the vehicle does not arm: {sample.verdict.reason}")
            if t_s > story.waves_s and sample.verdict.state is not State.ACTIVE:
                raise ValueError(f"the controller let go of the vehicle: {sample.verdict.reason}")
    return _dive(truths, *np.array(rows).T)


def dive_alt_hold(story: Story, reference: DemoDive, firmware: Path | None, tell: Tell) -> DemoDive:
    """Dive with ALT_HOLD and its default gains; a ground station sends it the depths of `reference`."""

    def depth_m(t_s: float) -> float:
        return float(np.interp(t_s - alt_hold.ARM_S, reference.t_s, reference.depth_desired_m))

    plant = story.plant()
    scenario = Scenario(
        "demo",
        plant=lambda base, _: base,
        target=lambda t_s: story.setpoint(depth_m(t_s)),
        duration_s=alt_hold.ARM_S + story.end_s + 1.0,
        seed=story.seed,
    )
    nominal = thrusters_of(plant.thrusters)
    dived: list[Truth] = []
    command_n: list[float] = []
    with closing(alt_hold.truths(scenario, plant, LinkDelay(), {}, firmware)) as truths:
        for truth in truths:
            if truth.armed:
                dived.append(truth)
                command_n.append(commanded(truth, nominal)[Z])
                tell(truth.t_s - dived[0].t_s)
    desired_m = np.array([depth_m(truth.t_s) for truth in dived])
    return _dive(dived, desired_m, np.full(len(dived), story.heading_rad), np.array(command_n))


def _dive(
    truths: Sequence[Truth], depth_desired_m: Array, heading_desired_rad: Array, command_n: Array
) -> DemoDive:
    """Return the dive of these truths, the first of which is the first armed one."""
    eta = np.array([truth.eta for truth in truths])
    t_s = np.array([truth.t_s for truth in truths])
    turned = eta[:, TRUE_PSI] - heading_desired_rad
    return DemoDive(
        t_s=t_s - t_s[0],
        depth_m=eta[:, Z],
        depth_desired_m=depth_desired_m,
        heading_error_rad=(turned + np.pi) % (2 * np.pi) - np.pi,
        thrust_n=np.array([truth.tau[Z] for truth in truths]),
        command_n=command_n,
    )


def figures(
    dive: DemoDive, phases: Mapping[str, tuple[float, float]], *, about_mean: bool = False
) -> DemoFigures:
    """Draw the figures of one dive; with `about_mean` depth errors are about their mean in all phases."""

    def within(begin_s: float, end_s: float) -> NDArray[np.bool_]:
        return (dive.t_s >= begin_s) & (dive.t_s < end_s)

    held = within(min(begin for begin, _ in phases.values()), max(end for _, end in phases.values()))
    error_mm = dive.depth_error_mm
    if about_mean:
        error_mm = error_mm - error_mm[held].mean()
    return DemoFigures(
        phase_rms_mm={name: _rms(error_mm[within(*span)]) for name, span in phases.items()},
        depth_rms_mm=_rms(error_mm[held]),
        depth_peak_mm=float(np.abs(error_mm[held]).max()),
        heading_rms_deg=math.degrees(_rms(dive.heading_error_rad[held])),
        thrust_rms_n=_rms(dive.thrust_n[held]),
        chatter_n=_rms(np.diff(dive.command_n[held])),
    )


def worth(part: str, without: DemoFigures, with_it: DemoFigures) -> str:
    """Say in which phases a part of the controller makes the depth error smaller, and in which not."""
    less, more, none = list[str](), list[str](), list[str]()
    for phase, rms_mm in without.phase_rms_mm.items():
        change = with_it.phase_rms_mm[phase] / rms_mm - 1.0
        if abs(change) <= WORTH:
            none.append(phase)
        else:
            (less if change < 0.0 else more).append(f"{phase} {100.0 * change:+.0f} %")
    none_words = f"brings nothing (within {100.0 * WORTH:.0f} %)"
    said = {"lowers the error": less, "raises it": more, none_words: none}
    return f"{part} " + "; it ".join(f"{what}: {', '.join(on)}" for what, on in said.items() if on) + "."


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
