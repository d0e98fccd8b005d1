"""A number that is not finite is refused where it is computed; a fault that one made can be cleared."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from virtual import Dive, active, hold

from companion.config import ConfigError, load_config
from companion.core.tick import retuned
from companion.engine import Engine
from companion.records import Condition, Request, Setpoint, State

DEADLY = (
    {"rate_noise": 1e-160},
    {"position_noise": 0.0},
    {"rate_noise": float("nan")},
    {"disturbance_noise": 1e200},
    {"mass": 0.0, "learning_rate": 0.0},
)
"""Beyond the ranges, as a program of one's own could hand them over. No mass bears no learning at any delay,
which is refused before the Kalman gain is computed: that case learns nothing."""

WITHIN = (
    "observed.dofs.state",
    "observed.dofs.mean_d",
    "observed.hidden",
    "observed.commands",
    "controlled.axes",
    "actuated.roll",
    "actuated.pitch",
    "actuated.pace",
    "actuated.delivered",
    "limits.pace",
    "watch.pushes",
)
"""Numbers that the core remembers."""

GROWS = ("observed.dofs.state", "observed.dofs.mean_d", "observed.learner.states", "controlled.axes.learnt")
HUGE = 1e300
"""A number that nothing bounds where it is remembered."""


def with_heave(config, **changes):
    return replace(config, heave=replace(config.heave, **changes))


def spoiled(value, by=math.nan):
    """Return a number, or a list or (named) tuple of these, with each number so many times larger."""
    if callable(value) or isinstance(value, bool):
        return value
    if isinstance(value, list):
        return [spoiled(part, by) for part in value]
    if isinstance(value, tuple):
        parts = [spoiled(part, by) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return (value + 1e-6) * by


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("changes", DEADLY)
def test_a_gain_that_is_not_finite_starts_nothing(changes):
    with pytest.raises(ConfigError, match="no finite Kalman gain"):
        Engine(with_heave(load_config(), **changes), Setpoint((0.0,) * 4))


@pytest.mark.parametrize("changes", DEADLY)
def test_a_gain_that_is_not_finite_changes_nothing_while_it_holds(changes):
    dive, untouched = active(), active()
    with pytest.raises(ConfigError, match="no finite Kalman gain"):
        dive.engine.retune(with_heave(dive.engine.config, max_force=10.0, kappa_per_s=9.0, **changes))
    assert dive.engine.config == untouched.engine.config
    same = [one.run(1.0)[-1].sample for one in (dive, untouched)]
    assert same[0].command == same[1].command
    assert dive.state is State.ACTIVE


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize(
    ("path", "by"), [*((path, math.nan) for path in WITHIN), *((path, HUGE) for path in GROWS)]
)
def test_a_fault_of_a_number_that_is_not_finite_can_be_cleared(path, by):
    dive = active("sensors.dvl=true", setpoint=hold(x=0.0, y=0.0))
    dive.engine.memory = within(dive.engine.memory, path.split("."), by)
    dive.run(5.0)
    if dive.state is State.FAULT:
        assert Condition.NON_FINITE not in dive.step.sample.verdict.conditions
        dive.ask(Request.CLEAR_FAULT)
        dive.run(0.5)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)
    dive.run(1.0)
    assert dive.state is State.ACTIVE
    assert dive.step.sample.dofs.engaged == (True,) * 4
    assert np.isfinite(dive.step.sample.dofs.tau).all()


def within(part, names, by):
    """Return a part of the memory in which what is named, in each of several, is spoiled."""
    if not names:
        return spoiled(part, by)
    if not hasattr(part, "_fields"):
        return tuple(within(one, names, by) for one in part)
    first, *rest = names
    return part._replace(**{first: within(getattr(part, first), rest, by)})


def put(engine, parameters):
    """Go on with other parameters, as `Engine.retune` does."""
    engine.memory = retuned(engine.parameters, parameters, engine.memory, engine.last.demand)
    engine.tuning.parameters = parameters


def test_a_fault_that_lasts_as_long_as_its_cause_ends_with_it():
    dive: Dive = active()
    engine = dive.engine
    sound = engine.parameters
    tables = sound.observers._replace(tables=spoiled(sound.observers.tables))
    put(engine, sound._replace(observers=tables))
    with np.errstate(all="ignore"):
        dive.until(State.FAULT)
        dive.ask(Request.CLEAR_FAULT)
        dive.run(1.0)
    assert dive.state is State.FAULT
    put(engine, sound)
    dive.run(5.0)
    dive.ask(Request.CLEAR_FAULT)
    dive.run(0.5)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)
