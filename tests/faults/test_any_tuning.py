"""Within the ranges any configuration, and any live tuning, stays finite and inside the envelope."""

from random import Random

import numpy as np
import pytest
from tools.fuzz_engine import TUNINGS, configuration, order
from virtual import DEPTH_M, Dive, hold

from companion.io.command_queue import CommandQueue, ReceivedCommand
from companion.records import Condition

LASTS_S = 5


@pytest.mark.parametrize(
    ("seed", "fixed"), [*((seed, []) for seed in range(4)), (12, ["supervisor.max_depth_m=0.5"])]
)
def test_what_the_ranges_allow_stays_finite_and_inside_the_envelope(seed, fixed):
    """The dive itself keeps `lab.studies.promises`; of these configurations none is refused."""
    rng = Random(seed)
    config = configuration(rng, ["fence.enabled=false", *fixed])
    plant = ("waves.enabled=true", f"sensors.dvl={str(rng.random() < 0.5).lower()}")
    dive = Dive(*plant, config=config, setpoint=hold(min(DEPTH_M, config.supervisor.max_depth_m)))
    queue = CommandQueue(config)
    for _ in range(LASTS_S):
        for step in dive.loop.run(1.0):
            assert Condition.NON_FINITE not in step.sample.verdict.conditions
            assert np.isfinite(step.sample.dofs.tau).all()
        queue.put(ReceivedCommand(*order(rng, TUNINGS), lambda _: None, True))
        while queue.prepare():
            pass
        queue.before_tick(dive.engine, dive.t_s)
