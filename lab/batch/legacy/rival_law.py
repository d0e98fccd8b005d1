"""Where a rival sits: in heave, in place of the law; all else of the engine is what ships.

So a rival has the same observer, the same predicted state, the same reference, the same inverted thruster
curve and the same three other degrees of freedom. What differs is what it does with them.
"""

from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from lab.batch.legacy.controller import Controller
from lab.batch.legacy.oscillation import Oscillation
from lab.batch.legacy.positioning import inertial_diagonal
from lab.batch.legacy.records import Array, DofSample, Flags, Setpoint, VehicleState, Z


class Motion(NamedTuple):
    """Heave where the next command acts; arrays of any one shape, SI, depth positive down.

    `e`, `e_dot` are measured minus desired; `inertia` (kg) and `drag` (N) are the nominal model's; `free`
    tells that the last command was not cut off. `share` is the delay that the gains bear over the delay that
    there is, 1 at most: a rival draws its gains back by the same powers of it as the shipped law.
    """

    e: Array
    e_dot: Array
    x_dot: Array
    x_d_ddot: Array
    inertia: Array
    drag: Array
    free: Flags
    share: Array | float


class Forces(NamedTuple):
    """The three parts of a rival's force, N down, of the shape of `Motion`'s arrays."""

    feedforward: Array
    feedback: Array
    d_hat: Array


class Law(Protocol):
    """A rival's law in one degree of freedom, over arrays of any shape."""

    def reset(self) -> None:
        """Forget what was learnt."""

    def step(self, motion: Motion, dt_s: float) -> Forces:
        """Return the force for this tick, having learnt for `dt_s` from the motion."""


class RivalController(Controller):
    """The shipped controller with another law in heave; shape (…, 4) as its own."""

    def __init__(self, shipped: Controller, law: Law) -> None:
        never = Oscillation(np.array(np.inf))  # of the shipped law's demand, which goes nowhere in heave
        super().__init__(shipped._model, shipped._gains, shipped.reference, shipped._compensators, never)
        self._swings = shipped._oscillation
        self._law = law

    @property
    def gain_scale(self) -> Array:
        """What is left of the gains, the rival's in heave."""
        return self._swings.gain_scale

    def rest(self, state: VehicleState) -> None:
        """Stay where the vehicle is, with nothing learnt."""
        super().rest(state)
        self._swings.reset()
        self._law.reset()

    def step(
        self, state: VehicleState, J: Array, target: Setpoint, engaged: Flags, free: Flags, dt_s: float
    ) -> DofSample:
        """Return the shipped law's inside, heave replaced by the rival's."""
        ours = super().step(state, J, target, engaged, free, dt_s)
        m = inertial_diagonal(J, self._model.m)[..., Z]
        share = np.minimum(1.0, self._gains.delay_s / np.maximum(state.delays.total_s, 1e-3))
        share = share * self.gain_scale
        motion = Motion(
            e=ours.e[..., Z],
            e_dot=ours.e_dot[..., Z],
            x_dot=ours.x_dot[..., Z],
            x_d_ddot=ours.x_d_ddot[..., Z],
            inertia=m,
            drag=ours.feedforward[..., Z] - m * ours.x_d_ddot[..., Z],
            free=(free & engaged)[..., Z],
            share=np.broadcast_to(share, ours.e.shape)[..., Z],
        )
        theirs = self._law.step(motion, dt_s)
        feedforward, feedback, d_hat = (
            _with_heave(own, rival)
            for own, rival in zip((ours.feedforward, ours.feedback, ours.d_hat), theirs, strict=True)
        )
        tau = (feedforward + feedback + d_hat) * engaged
        self._swings.step(tau, dt_s)
        return replace(ours, tau=tau, feedforward=feedforward, feedback=feedback, d_hat=d_hat)


def _with_heave(own: Array, rival: Array) -> Array:
    mixed = own.copy()
    mixed[..., Z] = rival
    return mixed
