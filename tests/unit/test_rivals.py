"""The rivals against closed forms, in the shipped engine, and ArduSub's depth hold against its double."""

import numpy as np
import pytest
from msgspec.structs import replace

from companion.core.law import Motion
from companion.core.schedule import Gains
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import Scenario, hold
from lab.rivals import alt_hold, indi, mpc, ppi
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config as load_plant

BASE = load_plant(DEFAULT_CONFIG)
DT_S, MASS_KG = 0.02, 30.0
LAWS = {
    "ppi": (ppi, ppi.Parameters(3.0, 8.0, 4.0, 60.0)),
    "indi": (indi, indi.Parameters(6.0, 60.0, 100.0, 0.15, 0.0)),
}


class Held:
    """A law with its state."""

    def __init__(self, name):
        self.module, self.parameters = LAWS[name]
        self.state = self.module.initial(self.parameters)

    def step(self, motion):
        self.state, tau, d_hat = self.module.step(self.parameters, self.state, motion, DT_S)
        return tau, d_hat


def motion(e=0.0, e_dot=0.0, share=1.0, free=True, d_hat=0.0):
    lam, kappa = 3.0 * share**0.6, 8.0 * share**1.4
    gains = Gains(lam=lam, kappa=kappa, tolerated_s=0.1)
    return Motion(e, e_dot, e_dot + lam * e, e_dot, 0.0, MASS_KG, 0.0, d_hat, gains, share, free)


def pushed(law, force_n, seconds, believed_n):
    """A mass under `force_n` with thrusters of 0.15 s lag, held by `law`: its place and d_hat at the end."""
    z, w, f = 0.1, 0.0, 0.0
    for _ in range(round(seconds / DT_S)):
        tau, d_hat = law.step(motion(z, w, d_hat=-believed_n))
        for _ in range(10):
            f += (tau - f) * 0.1 * DT_S / 0.15
            w += 0.1 * DT_S * (f + force_n) / MASS_KG
            z += 0.1 * DT_S * w
    return z, d_hat


@pytest.mark.parametrize("believed_n", [0.0, 8.0])
@pytest.mark.parametrize("name", LAWS)
def test_a_constant_force_is_found_and_held_also_where_another_is_believed(name, believed_n):
    place_m, d_hat_n = pushed(Held(name), 10.0, 30.0, believed_n)
    assert abs(place_m) < 2e-3
    assert d_hat_n == pytest.approx(-10.0, abs=0.6)


@pytest.mark.parametrize("name", LAWS)
def test_a_predicted_disturbance_is_cancelled_at_once(name):
    law = Held(name)
    assert [law.step(motion(d_hat=d_n))[0] for d_n in (0.0, -8.0)] == pytest.approx([0.0, -8.0], abs=1.0)


@pytest.mark.parametrize("name", LAWS)
def test_it_asks_nothing_at_rest_and_learns_nothing_while_the_command_is_cut_off(name):
    law = Held(name)
    assert law.step(motion())[0] == pytest.approx(0.0)
    for _ in range(50):
        _, d_hat = law.step(motion(0.05, 0.1, free=False))
    assert d_hat == pytest.approx(0.0)


@pytest.mark.parametrize("name", LAWS)
def test_a_late_loop_is_steered_more_softly(name):
    full, _ = Held(name).step(motion(0.05, 0.1))
    late, _ = Held(name).step(motion(0.05, 0.1, share=0.5))
    assert 0.2 * abs(full) < abs(late) < 0.8 * abs(full)


def test_mpc_plans_what_the_quadratic_programme_asks_for():
    """Without bounds that act, its first thrust is that of the least-squares problem."""
    parameters = mpc.Parameters(0.15, 0.3, 1e4, 0.15, 0.0)
    state, asked = mpc.initial(parameters), 0.0
    for _ in range(40):  # the plan is warm, and the motion stands still
        still = state._replace(asked=5.0, thrust=5.0)
        state, asked, _ = mpc.step(parameters, still, motion(0.05, 0.1), 1e-9)
    n, keep = mpc.STEPS, np.exp(-mpc.STEP_S / 0.15)

    def flown(plan):
        f, e_dot, e, found = 5.0, 0.1, 0.05, []
        for u in plan:
            f = u + (f - u) * keep
            e_dot += mpc.STEP_S * f / MASS_KG
            e += mpc.STEP_S * e_dot
            found += [e, 0.15 * e_dot]
        changes = 0.3e-3 * np.diff([5.0, *plan])
        return np.array([*found, *changes])

    free = flown(np.zeros(n))
    A = np.array([flown(unit) - free for unit in np.eye(n)]).T
    best = np.linalg.lstsq(A, -free, rcond=None)[0]
    assert asked == pytest.approx(best[0], rel=0.02)


def test_alt_hold_keeps_depth_and_heading_and_takes_its_target_from_the_station():
    scenario = Scenario("deeper", lambda base, seed: _calm(base), hold(3.0), 16.0, 5)
    dived = alt_hold.dive(scenario, BASE, LinkDelay(), {"PSC_POSZ_P": 4.0})
    late = dived.t_s > 12.0
    assert dived.active[dived.t_s > 5.0].all()
    assert abs(dived.depth_error_m[dived.t_s < 3.0] + 0.5).max() < 0.2  # not armed yet: it floats up
    assert np.abs(dived.depth_error_m[late]).max() < 0.05
    assert np.abs(dived.heading_error_rad[late]).max() < 0.05
    assert np.mean(dived.force[late, 2]) == pytest.approx(BASE.hull.net_buoyancy_n, abs=1.0)


def _calm(base):
    return replace(
        base,
        current=replace(base.current, enabled=False),
        initial=replace(base.initial, eta=(0.0, 0.0, 2.5, 0.0, 0.0, 0.0)),
    )
