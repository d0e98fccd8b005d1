"""No step in thrust where somebody engages, releases or changes the law: in nominal newtons of what is sent.

With sensors that carry no noise: that alone makes 2 N a tick (RMS) of any law.
"""

import numpy as np
import pytest
from builders import STILL_SENSORS, pulled
from virtual import Dive, Somebody, active, hold, shared

from companion.config import ConfigError, load_config
from companion.records import Request, Setpoint, State

STEP_N = np.array([2.0, 2.0, 2.0, 0.24])
"""N and N·m from one tick to the next: 2 % of what heave and yaw can give."""

LEARNS = {"network": 160.0, "integrator": 400.0, "predictor": 160.0}
QUIET = tuple(f"sensors.{noise}=0.0" for noise in STILL_SENSORS)
PULLED = (*QUIET, pulled(12))


def bump(before, act, seconds=1.0):
    """The largest step by axis in what `act` makes of the thrust: beside the same dive without it."""
    tau = []
    for acts in (False, True):
        one = before()
        if acts:
            act(one)
        tau.append([step.sample.delivered for step in one.run(seconds)])
    made = np.array(tau[1]) - np.array(tau[0])
    return np.abs(np.diff(made, axis=0, prepend=np.zeros((1, 4)))).max(0)


def configured(compensator, *more):
    learns = LEARNS.get(compensator, 0.0)
    return load_config(
        overrides=[f'heave.compensator="{compensator}"', f"heave.learning_rate={learns}", *more]
    )


@pytest.mark.parametrize(("old", "new"), [("network", "observer"), ("integrator", "predictor")])
def test_another_compensator_goes_on_where_the_last_one_was(old, new):
    """unit/test_taking_over.py has each after each other."""

    def holding():
        old_law = [f'heave.compensator="{old}"', f"heave.learning_rate={LEARNS.get(old, 0.0)}"]
        return active(*PULLED, companion=old_law, seconds=8.0)

    step_n = bump(holding, lambda dive: dive.engine.retune(configured(new)))
    assert (step_n < STEP_N).all(), step_n


def test_other_gains_act_without_a_step_and_what_was_learnt_is_kept():
    """Amid a move, where error and rate are not zero."""
    gains = configured("predictor", "heave.lambda_per_s=2.0", "heave.kappa_per_s=5.0", "yaw.mass=0.7")

    @shared
    def moving():
        dive = active(*PULLED, seconds=8.0)
        dive.loop.engine.aim(hold(z=2.5))
        dive.run(1.0)
        return dive

    # Later the softer dive is compared with what the stiffer one answers to the link's jitter: 2 N a tick.
    step_n = bump(moving, lambda dive: dive.engine.retune(gains), seconds=0.5)
    assert (step_n < STEP_N).all(), step_n
    dive = moving()
    learnt = dive.step.sample.dofs.weight_norm[2]
    dive.engine.retune(gains)
    dive.run(0.02)
    assert dive.step.sample.dofs.weight_norm[2] == pytest.approx(learnt, rel=0.1)
    dive.run(10.0)
    assert dive.step.truth.eta[2] == pytest.approx(2.5, abs=0.05)


def test_what_is_built_in_cannot_change_while_running():
    dive = active(seconds=0.1)
    with pytest.raises(ConfigError, match=r"network.*cannot change"):
        dive.engine.retune(load_config(overrides=["network.units=12"]))
    assert dive.engine.config == load_config()


STAY = Setpoint((np.nan,) * 4)
PULLED_HARD = (*QUIET, pulled(40))


@pytest.mark.parametrize(("vehicle", "seconds"), [(QUIET, 1.5), (PULLED, 0.12)], ids=["at rest", "sinking"])
def test_engaging_starts_from_nothing(vehicle, seconds):
    """And rises as smoothly as the law asks: what sinks at 15 cm/s is braked within half a second."""

    def ready():
        dive = Dive("parameters.FS_PILOT_INPUT=1", *vehicle, arm=False, engage=False, seed=2, setpoint=STAY)
        dive.run(2.5)
        dive.tap.to_vehicle.append(Somebody().arm())
        return dive.until(State.READY)

    step_n = bump(ready, lambda dive: dive.ask(Request.ENGAGE), seconds)
    assert (step_n < STEP_N).all(), step_n


def test_letting_go_is_a_ramp():
    step_n = bump(lambda: active(*PULLED_HARD, seconds=8.0), lambda dive: dive.ask(Request.STOP), 1.2)
    assert (step_n < STEP_N).all(), step_n
