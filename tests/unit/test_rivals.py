"""The rivals against closed forms, in the shipped engine, and ArduSub's depth hold against its double."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from companion.config import load_config
from companion.records import DofSample, Setpoint, Z
from lab.loop.lockstep import Link, Lockstep
from lab.loop.scenarios import Scenario, four, hold
from lab.rivals import alt_hold, alt_hold_batch
from lab.rivals.l1 import L1, L1Gains
from lab.rivals.law import Forces, Law, Motion, RivalEngine
from lab.rivals.ppi import PPI, PPIGains
from lab.rivals.super_twisting import SuperTwisting, TwistGains
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

BASE = load_plant(DEFAULT_CONFIG)
DT_S, MASS_KG = 0.02, 30.0
LAWS: dict[str, Callable[[], Law]] = {
    "ppi": lambda: PPI(PPIGains(3.0, 8.0, 4.0, 60.0)),
    "l1": lambda: L1(L1Gains(3.0, 8.0, 3.0, 60.0, 100.0, 0.15, 0.0)),
    "super_twisting": lambda: SuperTwisting(TwistGains(3.0, 6.0, 0.2, 0.5, 60.0)),
}


def motion(e: Any = 0.0, e_dot: Any = 0.0, **changes: Any) -> Motion:
    e, e_dot = np.asarray(e, float), np.asarray(e_dot, float)
    plain = Motion(
        e=e,
        e_dot=e_dot,
        x_dot=e_dot,
        x_d_ddot=np.zeros_like(e),
        inertia=np.full_like(e, MASS_KG),
        drag=np.zeros_like(e),
        free=np.ones(e.shape, bool),
        share=1.0,
    )
    return plain._replace(**changes)


def total(forces: Forces) -> Any:
    return forces.feedforward + forces.feedback + forces.d_hat


def pushed(law: Law, force_n: float, seconds: float, start_m: float = 0.0) -> tuple[float, float]:
    """A mass under `force_n` with thrusters of 0.15 s lag, held by `law`: its place and d_hat at the end."""
    z, w, f, forces = start_m, 0.0, 0.0, Forces(*np.zeros(3))
    for _ in range(round(seconds / DT_S)):
        forces = law.step(motion(z, w), DT_S)
        for _ in range(10):
            f += (float(total(forces)) - f) * 0.1 * DT_S / 0.15
            w += 0.1 * DT_S * (f + force_n) / MASS_KG
            z += 0.1 * DT_S * w
    return z, float(forces.d_hat)


@pytest.mark.parametrize("name", LAWS)
def test_a_constant_force_is_found_and_held(name: str) -> None:
    place_m, d_hat_n = pushed(LAWS[name](), 10.0, 30.0, start_m=0.1)
    assert abs(place_m) < 2e-3
    assert d_hat_n == pytest.approx(-10.0, abs=0.6)


@pytest.mark.parametrize("name", LAWS)
def test_forgets_when_reset_and_starts_from_nothing(name: str) -> None:
    law = LAWS[name]()
    first = total(law.step(motion(0.02, 0.1), DT_S))
    for _ in range(50):
        law.step(motion(0.05, 0.1), DT_S)
    law.reset()
    assert total(law.step(motion(0.02, 0.1), DT_S)) == pytest.approx(first)
    law.reset()
    assert total(law.step(motion(), DT_S)) == pytest.approx(0.0)


@pytest.mark.parametrize("name", LAWS)
def test_learns_nothing_while_the_command_is_cut_off(name: str) -> None:
    law = LAWS[name]()
    for _ in range(50):
        forces = law.step(motion(0.05, 0.1, free=np.zeros((), bool)), DT_S)
    assert forces.d_hat == pytest.approx(0.0)


@pytest.mark.parametrize("name", LAWS)
def test_a_late_loop_is_steered_more_softly(name: str) -> None:
    full = total(LAWS[name]().step(motion(0.05, 0.1), DT_S))
    late = total(LAWS[name]().step(motion(0.05, 0.1, share=0.5), DT_S))
    assert 0.2 * abs(full) < abs(late) < 0.8 * abs(full)


@pytest.mark.parametrize("name", LAWS)
def test_a_batch_gives_what_single_dives_give(name: str) -> None:
    rng = np.random.default_rng(0)
    e, e_dot = rng.normal(0.0, 0.02, (40, 3)), rng.normal(0.0, 0.05, (40, 3))
    together, single = LAWS[name](), [LAWS[name]() for _ in range(3)]
    for i in range(40):
        batch = total(together.step(motion(e[i], e_dot[i]), DT_S))
        each = [total(law.step(motion(e[i, j], e_dot[i, j]), DT_S)) for j, law in enumerate(single)]
        np.testing.assert_allclose(batch, each, rtol=1e-12)


class Constant:
    """A rival that pushes with 7 N, whatever happens."""

    def __init__(self) -> None:
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def step(self, motion: Motion, dt_s: float) -> Forces:
        return Forces(1.0 + 0.0 * motion.e, 2.0 + 0.0 * motion.e, 4.0 + 0.0 * motion.e)


def test_a_rival_replaces_the_law_in_heave_alone() -> None:
    config, law = load_config(), Constant()
    engine = RivalEngine(config, Setpoint(np.full(4, np.nan)), law)
    loop = Lockstep(Vehicle(BASE, 1), engine, Link(), 1, config.loop.rate_hz)
    sample: DofSample = list(loop.run(0.5))[-1].sample.dofs
    assert law.resets > 0
    assert (sample.feedforward[Z], sample.feedback[Z], sample.d_hat[Z]) == (1.0, 2.0, 4.0)
    assert sample.tau[Z] == 0.0  # not engaged
    np.testing.assert_array_equal(sample.d_hat[:2], sample.d_observer[:2])


def test_alt_hold_keeps_depth_and_heading_and_takes_its_target_from_the_station() -> None:
    scenario = Scenario("deeper", lambda base, seed: _calm(base), hold(3.0), 16.0, 5)
    dived = alt_hold.dive(scenario, BASE, Link(), {"PSC_POSZ_P": 4.0})
    late = dived.t_s > 12.0
    assert dived.active[dived.t_s > 5.0].all()
    assert abs(dived.depth_error_m[dived.t_s < 3.0] + 0.5).max() < 0.2  # not armed yet: it floats up
    assert np.abs(dived.depth_error_m[late]).max() < 0.05
    assert np.abs(dived.heading_error_rad[late]).max() < 0.05
    assert np.mean(dived.thrust_n[late]) == pytest.approx(BASE.hull.net_buoyancy_n, abs=1.0)


@pytest.mark.parametrize("scenario", [0, 2])
def test_fast_alt_hold_agrees_with_the_whole_double(scenario: int) -> None:
    gains = {"PSC_POSZ_P": 5.0, "PSC_VELZ_P": 20.0, "PSC_ACCZ_P": 1.0, "PSC_ACCZ_I": 0.3}
    dives = [four(seed)[scenario] for seed in (1, 2)]
    duration_s = 32.0
    short = [Scenario(one.name, one.plant, one.target, duration_s, one.seed) for one in dives]
    full = [alt_hold.dive(one, BASE, Link(), gains).figures() for one in short]
    plants, seeds = [one.plant(BASE, one.seed) for one in short], [one.seed for one in short]
    fast = alt_hold_batch.simulate(plants, short[0].target, duration_s, seeds, np.full(2, 0.003), gains)
    for figure in ("depth_rms_mm", "chatter_n"):
        assert fast[figure].mean() == pytest.approx(np.mean([one[figure] for one in full]), rel=0.2)


def _calm(base: SimConfig) -> SimConfig:
    return replace(
        base,
        current=replace(base.current, enabled=False),
        initial=replace(base.initial, eta=(0.0, 0.0, 2.5, 0.0, 0.0, 0.0)),
    )
