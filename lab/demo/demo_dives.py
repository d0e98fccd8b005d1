"""The demo's dives in virtual time, by ALT_HOLD and by Holdfast or a part of it, and their figures."""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from companion.config import load_config
from companion.records import PSI, Setpoint, State, Z
from lab.demo.story import Story
from lab.loop.dive import EXACT, Dive, by_autopilot, engaging, recorded, rms
from lab.loop.lockstep import Step
from lab.loop.scenarios import Scenario
from lab.rivals import alt_hold
from sim_bridge.firmware.mode_behaviour import ALT_HOLD
from sim_bridge.vehicle import Truth

NAMES = {
    "alt_hold": "ALT_HOLD",
    "alt_hold_tuned": "ALT_HOLD, tuned",
    **{"law": "law", "observer": "law + observer", "holdfast": "Holdfast"},
}
AUTOPILOT: dict[str, dict[str, float]] = {"alt_hold": {}, "alt_hold_tuned": alt_hold.TUNED}
"""The dives of ALT_HOLD, and the parameters that differ from ArduSub's defaults."""
PARTS = {"law": "none", "observer": "observer", "holdfast": ""}
"""The dives of Holdfast, and their compensators; empty: the shipped one."""
AXES = ("surge", "sway", "heave", "yaw")
ARMS_WITHIN_S = 60.0
WORTH = 0.05
"""A part is worth something where it changes the error by more than this share."""

Tell = Callable[[float], None]
"""Takes the time since arming (s) of every tick."""


class DemoFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What the table and demo.json say of one dive: of all phases together, but for the first field."""

    phase_rms_mm: dict[str, float]
    """Depth error in each phase."""
    depth_rms_mm: float
    depth_peak_mm: float
    heading_rms_deg: float
    thrust_rms_n: float
    """The heave thrust that was asked for."""
    chatter_n: float
    """RMS of its change from one tick to the next."""


def dive_holdfast(story: Story, compensator: str, firmware: Path | None, tell: Tell) -> Dive:
    """Dive with the companion's engine and this compensator on all axes; empty: the shipped one.

    Times of the dive count from arming, here and below. Raises ValueError where the vehicle does not arm or
    the engine released it.
    """
    config = load_config(overrides=[f"{axis}.compensator={compensator!r}" for axis in AXES if compensator])
    start = story.setpoint(story.depth_m)
    steps: list[Step] = []
    with engaging(config, story.plant(), start, story.seed, firmware=firmware) as loop:
        t_s = 0.0
        while t_s < story.end_s:
            loop.engine.aim(story.setpoint(story.depth_m_at(t_s)))
            step = loop.tick()
            if step.truth.armed:
                steps.append(step)
                t_s = step.t_s - steps[0].t_s
                tell(t_s)
            elif step.t_s > ARMS_WITHIN_S:
                raise ValueError(f"the vehicle does not arm: {step.sample.verdict.reason}")
            if t_s > story.waves_s and step.sample.verdict.state is not State.ACTIVE:
                raise ValueError(f"the controller released the vehicle: {step.sample.verdict.reason}")
    return _since_arming(recorded(steps))


def dive_alt_hold(
    story: Story, model: Dive, firmware: Path | None, tell: Tell, parameters: dict[str, float]
) -> Dive:
    """Dive with ALT_HOLD; a ground station sends it the reference depths of `model`."""

    def setpoint(t_s: float) -> Setpoint:
        return story.setpoint(float(np.interp(t_s - alt_hold.ARM_S, model.t_s, model.reference[:, Z])))

    plant = story.plant()
    scenario = Scenario(
        "demo",
        plant=lambda base, _: base,
        target=setpoint,
        duration_s=alt_hold.ARM_S + story.end_s + 1.0,
        seed=story.seed,
    )
    dived: list[Truth] = []
    with closing(alt_hold.truths(scenario, plant, EXACT, parameters, firmware)) as truths:
        for truth in truths:
            if truth.armed:
                dived.append(truth)
                tell(truth.t_s - dived[0].t_s)
    reference = np.array([setpoint(truth.t_s).eta_d for truth in dived])
    return _since_arming(by_autopilot(dived, plant, ALT_HOLD, reference))


def _since_arming(dive: Dive) -> Dive:
    return replace(dive, t_s=dive.t_s - dive.t_s[0])


def figures(
    dive: Dive, phases: Mapping[str, tuple[float, float]], *, about_mean: bool = False
) -> DemoFigures:
    """Draw the figures of one dive; with `about_mean` depth errors are about their mean in all phases."""
    span_s = min(begin_s for begin_s, _ in phases.values()), max(end_s for _, end_s in phases.values())
    if about_mean:
        mean = np.where(np.arange(PSI + 1) == Z, dive.within(*span_s).depth_error_m.mean(), 0.0)
        dive = replace(dive, reference=dive.reference + mean)
    found = dive.within(*span_s).figures(0.0)
    return DemoFigures(
        phase_rms_mm={name: 1e3 * rms(dive.within(*span).depth_error_m) for name, span in phases.items()},
        **{name: found[name] for name in DemoFigures.__struct_fields__[1:]},
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
