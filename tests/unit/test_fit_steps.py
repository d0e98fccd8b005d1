"""The model that `holdfast identify` fits: its steps of a tick do not show in what it finds."""

import numpy as np
import pytest

from companion.config import PRESETS, load_config, load_vehicle, vehicle_of
from companion.core.allocation import T200_N, T200_PWM_US
from companion.identify.fit import fit
from companion.identify.manoeuvre import EXCITATIONS, pushing, sweeping
from companion.identify.model import DELAY, LAG, LINEAR, MASS, QUADRATIC, START, Track, parameters
from companion.identify.sample_table import Streams
from companion.records import Z

TICK_S, STEP_S = 0.02, 0.0005
HEAVE_MASS, HEAVE_LINEAR, HEAVE_QUADRATIC = MASS + Z, LINEAR + Z, QUADRATIC + Z
TRUE = {HEAVE_MASS: 29.0, HEAVE_LINEAR: 12.0, HEAVE_QUADRATIC: 90.0, LAG: 0.12, DELAY: 0.031}


@pytest.fixture(scope="module")
def found():
    """What is found of a vehicle in heave that was followed in steps of half a millisecond, without noise."""
    kind, ticks = EXCITATIONS[Z], round(EXCITATIONS[Z].lasts_s / TICK_S)
    asked = [0.3 * pushing(i * TICK_S, kind) + 0.15 * sweeping(i * TICK_S, kind) for i in range(ticks)]
    sticks = [(i * TICK_S, 0.0, 0.0, u, 0.0, 0.0, 0.0) for i, u in enumerate(asked)]
    t_s = np.arange(0.0, kind.lasts_s, STEP_S)
    late = np.searchsorted(TICK_S * np.arange(ticks), t_s - TRUE[DELAY] + 1e-9, "right") - 1
    static = 4.0 * np.interp(
        400.0 * np.array(asked)[np.maximum(late, 0)], np.array(T200_PWM_US) - 1500.0, T200_N
    )
    v, f, motion = 0.0, 0.0, []
    for u in static.tolist():
        f += (u - f) * STEP_S / TRUE[LAG]
        v += STEP_S * (f - TRUE[HEAVE_LINEAR] * v - TRUE[HEAVE_QUADRATIC] * abs(v) * v) / TRUE[HEAVE_MASS]
        motion.append(v)
    stamps_s = np.arange(0.0071, kind.lasts_s, TICK_S)
    rates = np.interp(stamps_s, t_s + STEP_S, motion)
    attitude = [(at_s, 0.0, 0.0, 0.0) for at_s in stamps_s.tolist()]
    streams = Streams(sticks=sticks, attitude=attitude, down=np.column_stack((stamps_s, rates)))
    base = vehicle_of(load_config())
    return fit([Track(streams.table("", base.vehicle.frame), base.vehicle.frame)], base, excited=[Z]).theta


@pytest.mark.parametrize("name", [HEAVE_MASS, HEAVE_LINEAR, HEAVE_QUADRATIC])
def test_mass_and_damping_are_found(found, name):
    assert found[name] == pytest.approx(TRUE[name], rel=0.02)


@pytest.mark.parametrize("name", [LAG, DELAY])
def test_times_are_found_within_a_millisecond(found, name):
    assert found[name] == pytest.approx(TRUE[name], abs=0.0008)


def test_a_motor_starts_late_stops_at_once_and_ignores_a_brief_reversal():
    asked = [(0.0, 0.0), (1.0, 0.5), (2.0, 0.0), (3.0, 0.5), (4.0, -0.5), (4.1, 0.5), (5.0, -0.5), (6.0, 0.0)]
    sticks = [(t_s, 0.0, 0.0, heave, 0.0, 0.0, 0.0) for t_s, heave in [*asked, (7.0, 0.0)]]
    streams = Streams(sticks=sticks, depth=[(0.5 * i, 1.0) for i in range(14)])
    track = Track(streams.table("", "vectored_6dof"), "vectored_6dof")
    theta = parameters(load_vehicle(PRESETS / "heavy.toml"))
    theta[[LAG, START, DELAY]] = 1e-3, 0.2, 0.0
    heave_n = track.wrench(theta)[:, Z]
    at_s = TICK_S * np.arange(heave_n.size) + 0.5 * TICK_S
    running = ((1.2, 2.0, 1.0), (3.2, 4.0, 1.0), (4.1, 5.0, 1.0), (5.2, 6.0, -1.0))
    way = np.sum([sign * ((begin_s < at_s) & (at_s < end_s)) for begin_s, end_s, sign in running], axis=0)
    settled = np.abs(at_s[:, None] - np.array(running)[:, :2].ravel()).min(axis=1) > TICK_S
    assert np.array_equal(np.sign(np.round(heave_n, 3))[settled], way[settled])
