"""What falls silent is frozen at its last value and said to be absent; it starts anew when it comes back."""

import numpy as np
import pytest
from virtual import active

from companion.records import PSI, ZERO, Request, State, X, Z
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry

DVL = ("sensors.dvl=true",)
ALL = ("depth_m", "depth_rate_mps", "heading_rad", "heading_rate_radps", "roll_rad", "pitch_rad")


def reported(step):
    """The telemetry's State of a step."""
    state = samples.records(step.sample)[0]
    assert isinstance(state, telemetry.State)
    return state


def test_after_the_link_is_lost_nothing_is_invented():
    dive = active("waves.enabled=true", *DVL)
    assert reported(dive.step).absent == ()
    last = dive.step.sample.state.eta
    dive.fault("link_cut", 20.0)
    steps = dive.run(16.0)
    frozen = steps[60:]  # 1.2 s: the longest of the timeouts is 1 s
    for step in frozen:
        state = step.sample.state
        assert state.eta == frozen[0].sample.state.eta
        assert state.eta_ahead == state.eta
        assert state.eta_dot == state.eta_dot_ahead == state.disturbance == ZERO
        assert (state.p, state.q) == (0.0, 0.0)
    assert np.abs(np.subtract(frozen[0].sample.state.eta, last)).max() < 0.3
    assert set(reported(dive.step).absent) >= {*ALL, "x_m", "y_m", "armed", "mode", "voltage_v"}
    for record in samples.records(dive.step.sample)[1:5]:
        assert {"x", "x_dot", "e", "e_dot"} <= set(record.absent)


def test_only_what_is_silent_is_absent():
    never = active("current.enabled=true")
    assert not any(any(step.sample.state.eta[:2]) for step in never.run(3.0)), "a place that never came"
    dive = active(*DVL)
    dive.fault("message_stopped", 20.0, message="LOCAL_POSITION_NED")
    dive.run(3.0)
    for one in (never, dive):
        assert reported(one.step).absent == ("x_m", "x_rate_mps", "y_m", "y_rate_mps")
    dive.fault("message_stopped", 20.0, message="ATTITUDE")
    dive.run(3.0)
    assert "heading_rad" in reported(dive.step).absent
    assert "depth_m" not in reported(dive.step).absent


def test_a_short_silence_is_predicted_over():
    """Half of attitude_timeout_s, while it turns: the heading goes on."""
    dive = active(setpoint=None, seconds=5.0)
    dive.knock(0.6)
    dive.run(0.1)
    dive.fault("message_stopped", 0.25, message="ATTITUDE")
    steps = dive.run(0.2)
    assert not steps[-1].sample.state.stale[PSI]
    headings = [step.sample.state.eta[PSI] for step in steps]
    assert len(set(headings)) == len(headings)


@pytest.mark.parametrize("plant", [(), DVL])
def test_it_starts_anew_when_the_link_returns_and_engages_without_a_step(plant):
    dive = active("current.enabled=true", "current.speed_m_s=0.3", *plant)
    dive.fault("link_cut", 2.0)
    dive.run(2.5)
    assert dive.state is State.FAULT
    state, truth = dive.step.sample.state, dive.step.truth
    held = [X, 1, Z, PSI] if plant else [Z, PSI]
    assert np.abs(state.eta - truth.eta[[0, 1, 2, 5]])[held].max() < 0.15
    assert not any(state.stale[dof] for dof in held)
    assert "depth_m" not in reported(dive.step).absent
    dive.ask(Request.CLEAR_FAULT)
    dive.run(0.1)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)
    thrust = np.array([step.sample.requested.tau for step in dive.run(0.5)])
    assert np.abs(thrust[:5]).max() < 15.0
    assert dive.step.sample.verdict.state is State.ACTIVE
