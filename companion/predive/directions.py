"""Which way each motor pushes: from turning and sinking after small pulses on the axes, one after the other.

A pulse goes one way for PULSE_S, then the other, so that the vehicle comes back. Each measured rate is fitted
by what the pulse would make of an undamped vehicle (its integral) and of one that is all damping (the pulse
itself), a constant and a drift. What the pulses made at their turn is linear in the motors' shares:

    g_jm = Σ_k s_k B_mk M_kj        j: axis pulsed, m: rate measured, k: motor

There are fewer equations than motors where the frame has more motors than axes: of all shares that explain
the answers, those nearest to 1 are taken, which still names a single motor that is reversed or dead.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from companion.arrays import Array
from companion.core.allocation import FACTORS, HORIZONTAL, PER_NEWTON, PUSH, interpolated
from companion.records import AXES, AxisCommand

PULSE_S, REST_S, FIT_S = 0.3, 1.2, 1.0
"""Time of a pulse each way, of the rest after it, and from its start to the end of the fit."""
DEMANDS: Final = {"surge": 0.2, "sway": 0.2, "heave": 0.2, "yaw": 0.12}
"""Tuned, as those times, so that waves of tests/closed_loop/test_inspection.py hide no reversed motor."""
INERTIA_TILT: Final = (0.45, 0.37)
"""Roll and pitch of a BlueROV2 with its added mass, kg m² (docs/ardusub.md, "Vehicles")."""

ANSWERS: Final = {"surge": ("r",), "sway": ("r",), "yaw": ("r",), "heave": ("p", "q", "w")}
MAX_SHARE: Final = 5.0
"""ArduSub's own vehicle answers 2.6 times as strongly; more is noise."""


class RateSample(NamedTuple):
    """Body rates (rad/s) and depth rate (m/s, down) that came at `t_s`."""

    t_s: float
    name: str
    value: float


def command(axis: str, since_s: float) -> AxisCommand:
    """Return what is sent `since_s` after a pulse on `axis` began."""
    if since_s >= 2.0 * PULSE_S:
        return AxisCommand()
    return AxisCommand(**{axis: DEMANDS[axis] if since_s < PULSE_S else -DEMANDS[axis]})


def shares(
    frame: str,
    samples: Mapping[str, Sequence[RateSample]],
    starts_s: Mapping[str, float],
    *,
    inertia: Mapping[str, float],
    lag_s: float,
    delay_s: float,
) -> tuple[float, ...]:
    """Return each motor's share of the push it should give: 1 right, -1 reversed, 0 dead; NaN if unknown.

    `samples` and `starts_s` by pulsed axis; `inertia` (kg, kg m²) of "w" and "r"; `delay_s` both ways.
    """
    factors = np.array(FACTORS[frame])
    levers = np.array(PER_NEWTON)[:, None] * factors.T
    inertias = {"p": INERTIA_TILT[0], "q": INERTIA_TILT[1], **inertia}
    per_motor = np.full(len(factors), np.nan)
    for group in (slice(0, HORIZONTAL), slice(HORIZONTAL, len(factors))):
        A, g = [], []
        for axis, measured in ANSWERS.items():
            pushes = factors[group, AXES.index(axis)]
            if not pushes.any():
                continue
            for name in measured:
                row = levers[_RATES[name], group] * pushes
                answer = _answer(samples[axis], name, starts_s[axis], axis, lag_s, delay_s)
                if answer is None or not levers[_RATES[name], group].any():
                    continue
                scale = np.abs(row).sum()
                A.append(row / scale)
                g.append(answer * inertias[name] / scale)
        if A:
            missing = np.array(g) - np.array(A).sum(-1)
            found = 1.0 + np.linalg.lstsq(np.array(A), missing, rcond=1e-6)[0]
            per_motor[group] = np.clip(found, -MAX_SHARE, MAX_SHARE)
    return tuple(per_motor.tolist())


_RATES = {"w": 2, "r": 3, "p": 4, "q": 5}


def _answer(
    samples: Sequence[RateSample], name: str, start_s: float, axis: str, lag_s: float, delay_s: float
) -> float | None:
    """Return the moment (N·m) or force (N) behind one rate, per unit of inertia and newton of one motor."""
    fitted = [(s.t_s - start_s, s.value) for s in samples if s.name == name and s.t_s - start_s <= FIT_S]
    if len(fitted) < 8:
        return None
    t_s, y = np.array(fitted).T
    impulse, push = _pulse(t_s - delay_s, DEMANDS[axis], lag_s)
    X = np.stack((impulse, push, np.ones_like(t_s), t_s), axis=-1)
    undamped, damped, *_ = np.linalg.lstsq(X, y, rcond=None)[0]
    (turned,), (pushed,) = _pulse(np.array([PULSE_S]), DEMANDS[axis], lag_s)
    return float(undamped + damped * pushed / turned)


def _pulse(t_s: Array, demand: float, lag_s: float) -> tuple[Array, Array]:
    """Return the impulse up to `t_s` (N s) and the force (N) of one motor that follows a pulse with a lag."""
    newtons = 0.5 * (interpolated(demand, PUSH) - interpolated(-demand, PUSH))
    impulse, push = np.zeros_like(t_s), np.zeros_like(t_s)
    for weight, at_s in ((1.0, 0.0), (-2.0, PULSE_S), (1.0, 2.0 * PULSE_S)):
        late_s = np.maximum(t_s - at_s, 0.0)
        rising = 1.0 - np.exp(-late_s / lag_s)
        impulse += weight * newtons * (late_s - lag_s * rising)
        push += weight * newtons * rising
    return impulse, push
