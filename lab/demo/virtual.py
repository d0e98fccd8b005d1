"""The demo's dives in virtual time: by ALT_HOLD, and by Holdfast with or without a part of it."""

from collections.abc import Callable, Generator
from contextlib import closing
from pathlib import Path

import numpy as np

from companion.config import load_config
from companion.engine import Engine
from companion.records import PSI, Request, State, Z
from lab.demo.story import Story
from lab.demo.timeline import DemoDive, diving
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import LinkDelay, Lockstep, Step
from lab.loop.scenarios import Scenario
from lab.rivals import alt_hold
from sim_bridge.physics.thrusters import thrusters_of
from sim_bridge.vehicle import Truth

AXES = ("surge", "sway", "heave", "yaw")

Tell = Callable[[float, float], None]
"""Takes the time since arming (s) and the depth error (mm) of every tick."""


def dive_holdfast(story: Story, compensator: str, firmware: Path | None, tell: Tell) -> DemoDive:
    """Dive with the companion's engine and this compensator on all axes; empty: the shipped one.

    Raises ValueError where the engine let go of the vehicle.
    """
    steps: list[Step] = []
    with closing(_steps(story, compensator, firmware)) as dived:
        for step in dived:
            steps.append(step)
            t_s = step.t_s - steps[0].t_s
            tell(t_s, 1e3 * (step.truth.eta[Z] - step.sample.eta_d[Z]))
            if t_s > story.waves_s and step.sample.verdict.state is not State.ACTIVE:
                raise ValueError(f"the controller let go of the vehicle: {step.sample.verdict.reason}")
    return diving(
        [step.truth for step in steps],
        np.array([step.sample.eta_d[Z] for step in steps]),
        np.array([step.sample.eta_d[PSI] for step in steps]),
        np.array([step.t_s - steps[0].t_s for step in steps]),
        np.array([step.sample.delivered.tau[Z] for step in steps]),
    )


def _steps(story: Story, compensator: str, firmware: Path | None) -> Generator[Step, None, None]:
    """Give the ticks from the arming on."""
    chosen = [f"{axis}.compensator={compensator!r}" for axis in AXES] if compensator else []
    config = load_config(overrides=chosen)
    armed_s = np.inf
    with vehicle_of(story.plant(), story.seed, firmware) as vehicle:
        engine = Engine(config, story.setpoint(story.depth_m), arm=True)
        loop = Lockstep(vehicle, engine, LinkDelay(), story.seed, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        while vehicle.time_s - armed_s < story.end_s:
            engine.aim(story.setpoint(story.depth_m_at(max(0.0, vehicle.time_s - armed_s))))
            step = loop.tick()
            if step.truth.armed:
                armed_s = min(armed_s, step.t_s)
                yield step


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
                command_n.append(alt_hold.commanded_n(truth, nominal))
                tell(truth.t_s - dived[0].t_s, 1e3 * (truth.eta[Z] - depth_m(truth.t_s)))
    t_s = np.array([truth.t_s for truth in dived])
    desired_m = np.array([depth_m(t) for t in t_s])
    return diving(dived, desired_m, np.full(len(t_s), story.heading_rad), t_s - t_s[0], np.array(command_n))
