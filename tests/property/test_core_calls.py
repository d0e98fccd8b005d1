"""The core's three calls on any inputs: in their order, finite, neutral without permission."""

# Tuples of four are made by loops here.
# mypy: disable-error-code="arg-type"

import math
from typing import get_type_hints

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion import assembly
from companion.config import load_config
from companion.core import tick
from companion.core.observers import Inputs
from companion.core.permission import Permission, Wanted
from companion.records import PSI, Angles, Setpoint

PARAMETERS = {
    frame: assembly.parameters(load_config(overrides=[f"vehicle.frame={frame}"]))
    for frame in ("vectored", "vectored_6dof")
}
HALF = settings(max_examples=settings().max_examples // 2)
"""Of each frame."""
DT_S, REACH, OURS = 0.02, (0.5, 0.5, 0.5, 0.5, 0.2, 0.2), (True,) * 6

flags = st.tuples(*[st.booleans()] * 4)
delays_s = st.floats(0.0, 0.5)


def four(most):
    return st.tuples(*[st.floats(-most, most)] * 4)


@st.composite
def measured(draw, now_s):
    """Inputs of a tick as the estimator could make them of any telemetry that the decoder lets through."""
    places, rates, at_s = draw(four(1e4)), draw(four(20.0)), now_s - draw(delays_s)
    lost = draw(flags)
    return Inputs(
        now_s=now_s,
        positions=tuple(
            (math.nan if gone else place, at_s) for place, gone in zip(places, lost, strict=True)
        ),
        rates=tuple((math.nan if gone else rate, at_s) for rate, gone in zip(rates, lost, strict=True)),
        begins=tuple(
            place if begins else math.nan for place, begins in zip(places, draw(flags), strict=True)
        ),
        stale=draw(flags),
        telemetry_s=draw(delays_s),
        command_s=draw(delays_s),
        ahead_s=draw(delays_s),
        positioned=draw(st.booleans()),
        learns=draw(flags),
        attitude=(*draw(four(math.pi)), draw(st.floats(-10.0, 10.0))),
        voltage_v=draw(st.floats(10.0, 20.0)),
    )


permissions = st.builds(
    Permission,
    authority=st.sampled_from([0.0, 0.3, 1.0]),
    freeze=st.booleans(),
    active=st.booleans(),
    releases=st.booleans(),
    rests=st.booleans(),
    regained=flags,
    trusts_thrusters=st.booleans(),
    reach=st.just(REACH),
)
wishes = st.builds(
    Wanted,
    target=st.builds(Setpoint, four(1e4), four(2.0), four(2.0)),
    engaged=flags,
    angles=st.builds(Angles, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
)


def ticked(data, parameters, memory, number, permission, excitation=None):
    memory, known = tick.observe(parameters, memory, data.draw(measured(100.0 + number * DT_S)))
    memory, wanted = tick.begin(parameters, memory, known, permission), data.draw(wishes)
    pushed = data.draw(four(50.0)) if excitation is None else excitation
    memory, demand = tick.control(parameters, memory, known, permission, wanted, DT_S, pushed)
    applied = data.draw(st.sampled_from([demand.axes, (0.0,) * 6])) if demand.finite else (0.0,) * 6
    return tick.confirm(parameters, memory, demand, applied, OURS), demand, applied


def test_the_types_hold_the_order():
    """Only `observe` makes what `control` needs, and only `control` what `confirm` needs."""
    made = {
        call.__name__: [*get_type_hints(call)["return"].__args__] for call in (tick.observe, tick.control)
    }
    assert made == {"observe": [tick.Memory, tick.Known], "control": [tick.Memory, tick.Demand]}
    assert get_type_hints(tick.control)["known"] is tick.Known
    assert get_type_hints(tick.confirm)["demand"] is tick.Demand
    assert get_type_hints(tick.confirm)["return"] is tick.Memory


@pytest.mark.parametrize("frame", PARAMETERS)
@HALF
@given(st.data())
def test_finite_inputs_give_finite_axes_within_reach_and_none_without_authority(frame, data):
    parameters = PARAMETERS[frame]
    memory = tick.start(parameters)
    for number in range(data.draw(st.integers(1, 6))):
        before, permission = memory, data.draw(permissions)
        memory, demand, applied = ticked(data, parameters, memory, number, permission)
        assert before is not memory
        assert memory.actuated.command == applied
        assert demand.finite
        assert all(abs(axis) <= most + 1e-12 for axis, most in zip(demand.axes, REACH, strict=True))
        if permission.authority == 0.0:
            assert demand.axes == (0.0,) * 6
        if not demand.wanted.engaged[PSI]:
            assert demand.axes[PSI] == 0.0


@pytest.mark.parametrize("frame", PARAMETERS)
@HALF
@given(st.data(), st.integers(0, 3))
def test_a_number_that_is_not_finite_is_said_and_asks_for_nothing(frame, data, dof):
    parameters = PARAMETERS[frame]
    memory = tick.start(parameters)
    permission = data.draw(permissions)
    excitation = tuple(math.nan if i == dof else 0.0 for i in range(4))
    _, demand, _ = ticked(data, parameters, memory, 0, permission, excitation)
    assert not demand.finite
    assert not any(
        axis != 0.0 and math.isfinite(axis) and permission.authority == 0.0 for axis in demand.axes
    )


@given(st.data())
def test_a_call_gives_the_same_twice_and_changes_nothing_that_it_is_given(data):
    parameters = PARAMETERS["vectored"]
    memory = tick.start(parameters)
    inputs, permission, wanted = data.draw(measured(100.0)), data.draw(permissions), data.draw(wishes)

    def once():
        observed, known = tick.observe(parameters, memory, inputs)
        begun = tick.begin(parameters, observed, known, permission)
        controlled, demand = tick.control(parameters, begun, known, permission, wanted, DT_S)
        return tick.confirm(parameters, controlled, demand, (0.0,) * 6, OURS), demand

    assert repr(once()) == repr(once())
    assert repr(memory) == repr(tick.start(parameters))
