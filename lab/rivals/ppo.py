"""A policy that proximal policy optimization has learnt, in the place of the law's feedback: docs/gym.md.

    action = W₃ tanh(W₂ tanh(W₁ z + b₁) + b₂) + b₃        z = clip((seen − mean)/σ, ±CLIP)

`policy.py` tells what it sees and what its action does. The weights are in `ppo.npz` beside this file.
(Schulman, Wolski, Dhariwal, Radford and Klimov, arXiv:1707.06347.)
"""

from pathlib import Path

import numpy as np

from companion.control.law import Motion, Terms
from lab.rivals.policy import (
    Observation,
    Parameters,
    State,
    answered,
    initial,
    observation,
    terms_of,
)

__all__ = ["Parameters", "State", "initial", "step"]

CLIP = 10.0
_NET = {key: values.astype(float) for key, values in np.load(Path(__file__).with_suffix(".npz")).items()}
MEAN, SIGMA = _NET["mean"], _NET["sigma"]
W1, W2, W3 = _NET["w1"], _NET["w2"], _NET["w3"]
B1, B2, B3 = _NET["b1"], _NET["b2"], _NET["b3"]


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, Terms]:
    """Return the force for this tick."""
    terms = terms_of(parameters, motion, action(observation(parameters, state, motion, dt_s)))
    return answered(parameters, state, terms, dt_s), terms


def action(seen: Observation) -> float:
    """Return the network's answer."""
    z = np.minimum(np.maximum((np.array(seen) - MEAN) / SIGMA, -CLIP), CLIP)
    first = np.tanh(np.sum(W1 * z, axis=1) + B1)
    second = np.tanh(np.sum(W2 * first, axis=1) + B2)
    return float(np.sum(W3[0] * second) + B3[0])
