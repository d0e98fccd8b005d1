"""The model that `holdfast identify` fits: its steps of a tick do not show in what it finds."""

import numpy as np
import pytest

from companion.config import load_config
from companion.control.allocation import T200_N, T200_PWM_US
from companion.identify.fit import (
    DELAY,
    LAG,
    LATER,
    LINEAR,
    MASS,
    QUADRATIC,
    fit,
)
from companion.identify.manoeuvre import EXCITATIONS, Measured, Sent, Stretch, pushing, sweeping
from companion.records import ZERO, Z

TICK_S, STEP_S = 0.02, 0.0005
TRUE = {MASS: 29.0, LINEAR: 12.0, QUADRATIC: 90.0, LAG: 0.12, DELAY: 0.031, LATER: 0.004}
"""The delay is that to the rate's stamp; the position's is 4 ms less."""


@pytest.fixture(scope="module")
def found():
    """What is found of a vehicle in heave that was followed in steps of half a millisecond, without noise."""
    kind, ticks = EXCITATIONS[Z], round(EXCITATIONS[Z].lasts_s / TICK_S)
    asked = [0.3 * pushing(i * TICK_S, kind) + 0.15 * sweeping(i * TICK_S, kind) for i in range(ticks)]
    stretch = Stretch(Z, 0.0, ZERO)
    stretch.sent = [Sent(i * TICK_S, (0.0, 0.0, u, 0.0, 0.0, 0.0), 16.0) for i, u in enumerate(asked)]
    t_s = np.arange(0.0, kind.lasts_s, STEP_S)
    late = np.searchsorted(TICK_S * np.arange(ticks), t_s - TRUE[DELAY] + 1e-9, "right") - 1
    static = 4.0 * np.interp(
        400.0 * np.array(asked)[np.maximum(late, 0)], np.array(T200_PWM_US) - 1500.0, T200_N
    )
    q, v, f, motion = 3.0, 0.0, 0.0, []
    for u in static.tolist():
        f += (u - f) * STEP_S / TRUE[LAG]
        q += 0.5 * STEP_S * v
        v += STEP_S * (f - TRUE[LINEAR] * v - TRUE[QUADRATIC] * abs(v) * v) / TRUE[MASS]
        q += 0.5 * STEP_S * v
        motion.append((q, v))
    t_s, (place, rate) = t_s + STEP_S, np.array(motion).T
    stamps_s = np.arange(0.0071, kind.lasts_s, TICK_S)
    stretch.positions = [
        Measured(*pair) for pair in zip(stamps_s, np.interp(stamps_s + TRUE[LATER], t_s, place), strict=True)
    ]
    stretch.rates = [Measured(*pair) for pair in zip(stamps_s, np.interp(stamps_s, t_s, rate), strict=True)]
    (heave,) = fit([stretch], load_config())["t200"]
    return {name: heave.values[name].value for name in TRUE}


@pytest.mark.parametrize("name", [MASS, LINEAR, QUADRATIC])
def test_mass_and_damping_are_found(found, name):
    assert found[name] == pytest.approx(TRUE[name], rel=0.02)


@pytest.mark.parametrize("name", [LAG, DELAY, LATER])
def test_times_are_found_within_a_millisecond(found, name):
    assert found[name] == pytest.approx(TRUE[name], abs=0.0008)
