"""A Gymnasium environment: a policy steers a simulated vehicle of six degrees of freedom, a tick a step.

Vehicle, water, delays, sensors and observers are those of `lab.batch`: what is seen is what Holdfast's law
sees, never the truth. An episode is a dive of the bench, of a vehicle of its ensemble. docs/gym.md describes
it. Needs the extra `gym`.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from companion.config import Config, load_config
from companion.records import AXES, Array, Setpoint
from lab.batch.compiled import cached, slotted
from lab.batch.settings import companion_of
from lab.batch.simulate import targets_of
from lab.batch.stand_in import ENGAGED_S, TICK_S, drawn, refuse, timing, vehicle_of
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import four, positioned
from lab.rivals.policy import OBSERVED
from lab.training import loop
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant

Single = npt.NDArray[np.float32]

TRAINING, HELD_OUT = range(900), range(900, 1000)
"""Seeds to train with and to choose by; those from 1000 on are the bench's: to judge by."""

LONGEST_DELAY_S = 0.041
"""Each way: the bench adds nothing or this."""

GOOD, LOST = 0.002, 1.0
"""Below GOOD an error hardly costs, at LOST the episode ends; m or rad."""

STILL, WILD = 0.005, 0.6
"""Likewise a change of the force in a tick, of max_force; no policy can exceed WILD."""

STEADY = 0.1
"""What of the reward is for a steady force."""


class Dive(NamedTuple):
    """What an episode dives: `target` gives the setpoint at each time (s) since boot."""

    plant: SimConfig
    target: Callable[[float], Setpoint]
    duration_s: float
    up_s: float
    down_s: float


def bench(seed: int) -> Dive:
    """Draw one of the bench's scenarios with its vehicle, and a delay of the link up to the bench's."""
    draw = np.random.default_rng((seed, 6))
    scenario = four(seed)[draw.integers(4)]
    extra_s = draw.uniform(0.0, LONGEST_DELAY_S - 0.001)
    plant = scenario.plant(load_plant(DEFAULT_CONFIG), seed)
    return Dive(plant, scenario.target, scenario.duration_s, 0.001 + extra_s, 0.001 + extra_s)


class HoldfastEnv(gymnasium.Env[Single, Single]):
    """An episode a dive, a step a tick of 20 ms.

    Action, by steered axis: the law's feedback, −1..1 of `policy.SHARE` max_force (north, east, down, yaw).
    The model's forces and the observer's d̂ are added. Observation: `policy.observation` of each steered axis.
    Reward, the mean over the axes: `near` of the true error, and with the share STEADY of the force's change.
    """

    def __init__(
        self,
        axes: Sequence[str] = ("heave",),
        dives: Callable[[int], Dive] = bench,
        seeds: Sequence[int] = TRAINING,
    ) -> None:
        """Let a policy steer `axes`, among surge, sway, heave and yaw; Holdfast's law steers the others.

        Each episode draws one of `seeds`. With surge or sway the vehicle gets a DVL and a current.
        """
        self._dofs = [AXES.index(axis) for axis in axes]
        self._places = bool({"surge", "sway"}.intersection(axes))
        self._dives, self._seeds = dives, seeds
        config = settings(axes)
        self._most = np.array([getattr(config, axis).max_force for axis in axes])
        companion, built = companion_of(config)
        self._loop, self._companion = cached(slotted(loop.ticks, built=built)), companion
        self._actions = np.full((1, len(AXES)), math.nan)
        self._seen, self._told = np.zeros((len(AXES), OBSERVED)), np.zeros((2, len(AXES)))
        self._dive: Iterator[int] = iter(())
        self._last = 0
        self.action_space = spaces.Box(-1.0, 1.0, (len(axes),), np.float32)
        self.observation_space = spaces.Box(-np.inf, np.inf, (len(axes) * OBSERVED,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Single, dict[str, Any]]:
        """Begin a dive, engaged and at rest; info has its seed and its length in steps."""
        super().reset(seed=seed)
        chosen = self._seeds[int(self.np_random.integers(len(self._seeds)))]
        dive = self._dives(chosen)
        plant = positioned(dive.plant) if self._places else dive.plant
        refuse(plant)
        at = timing(chosen, dive.up_s, dive.down_s, LinkDelay().jitter_s)
        ticks = round(dive.duration_s / TICK_S) - round(ENGAGED_S / TICK_S)
        targets = targets_of(dive.target, (ENGAGED_S + TICK_S * np.arange(1, ticks + 1)).tolist())
        self._last = len(targets) - 1
        self._actions[:] = math.nan
        self._dive = self._loop(
            vehicle_of(plant, at), drawn(plant, chosen, len(targets)), self._companion, at, targets,
            self._actions, self._seen, self._told,
        )  # fmt: skip
        next(self._dive)
        return self._observation(), {"seed": chosen, "steps": self._last}

    def step(self, action: Single) -> tuple[Single, float, bool, bool, dict[str, Any]]:
        """Steer for a tick; info has the true errors (m, rad) and the forces asked for (N, N·m)."""
        before = self._told[1, self._dofs]
        self._actions[0, self._dofs] = action
        index = next(self._dive)
        error, force = self._told[0, self._dofs], self._told[1, self._dofs]
        steady = near((force - before) / self._most, STILL, WILD)
        reward = float(np.mean((1.0 - STEADY) * near(error, GOOD, LOST) + STEADY * steady))
        lost = not bool((np.abs(error) < LOST).all())
        return self._observation(), reward, lost, index == self._last, {"error": error, "force": force}

    def _observation(self) -> Single:
        return self._seen[self._dofs].astype(np.float32).ravel()


def near(values: Array, good: float, bad: float) -> Array:
    """Return 1 for zero and 0 for ±`bad` or more: logarithmic beyond `good`."""
    return np.maximum(0.0, 1.0 - np.log1p(np.abs(values) / good) / math.log1p(bad / good))


def settings(axes: Sequence[str]) -> Config:
    """Return the shipped configuration, with the law that a policy steers and the observer's d on `axes`."""
    return load_config(
        overrides=[
            "laws.handed.module='lab.training.handed'",
            *(f"{axis}.law='handed'" for axis in AXES),
            *(f"{axis}.compensator='observer'" for axis in axes),
        ]
    )
