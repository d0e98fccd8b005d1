"""Vehicles that answer far more strongly than the nominal model: the loop must not swing by itself."""

import numpy as np
import pytest
from virtual import Dive, hold

from companion.types import State, Z

FIRMWARE = "sim-ardusub.toml"
SETTLED_S = 20.0
TRUE_PSI, YAW_RATE = 5, 12
QUIET, ROUGH = (), ("waves.enabled=true",)


def dived(*plant, seconds=60.0, knock=0.0, depth_m=3.0, **arguments):
    """Return a dive from 0.5 m and its steps from engaging on; `knock` is a sudden yaw rate, rad/s."""
    dive = Dive("initial.eta=[0,0,0.5,0,0,0]", *plant, setpoint=hold(depth_m, 0.0), **arguments).until(
        State.ACTIVE
    )
    steps = dive.run(0.5)
    body = dive.vehicle._physics
    body.state = (*body.state[:YAW_RATE], body.state[YAW_RATE] + knock)
    return dive, steps + dive.run(seconds - 0.5)


def spread(steps, since_s=SETTLED_S):
    """Standard deviations of the true depth, mm, and heading, °, from `since_s` after engaging on."""
    eta = np.array([step.truth.eta for step in steps if step.t_s - steps[0].t_s >= since_s])
    return 1e3 * eta[:, Z].std(), np.degrees(np.unwrap(eta[:, TRUE_PSI]).std())


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("plant", "knock"), [(QUIET, 0.0), (ROUGH, 2.0)], ids=["calm", "unquiet"])
def test_the_vehicle_of_the_firmware_s_own_simulator_is_held(plant, knock, seed):
    _, steps = dived(*plant, knock=knock, base=FIRMWARE, seed=seed)
    depth_mm, heading_deg = spread(steps)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert depth_mm <= 10.0
    assert heading_deg <= 1.0
    assert abs(steps[-1].truth.eta[Z] - 3.0) < 0.03
    assert abs(steps[-1].truth.eta[TRUE_PSI]) < np.radians(3.0)
