"""The environment is the loop of the batches: what a policy sees, does and gets there."""

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from companion.config import load_config
from companion.control.law import Motion, law_with
from lab.batch.compiled import compiled
from lab.batch.simulate import simulate
from lab.batch.stand_in import Links
from lab.loop.scenarios import four
from lab.rivals import policy, ppo
from lab.training import handed
from lab.training.environment import GOOD, HELD_OUT, LOST, TRAINING, Dive, HoldfastEnv, bench, near
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

pytestmark = pytest.mark.timeout(1200)  # beside others it compiles for long

BASE = load_plant(DEFAULT_CONFIG)
PARAMETERS = policy.Parameters(100.0, 0.15, 0.02)
OWN = np.full(1, np.nan)
"""The action that leaves the feedback to Holdfast's law."""


def motions(count):
    draw = np.random.default_rng(1).normal
    for _ in range(count):
        e, e_dot, x_dot, x_d_ddot, k_plus_h, d_hat = draw(0.0, (0.01, 0.05, 0.05, 0.1, 3.0, 5.0))
        yield Motion(e, e_dot, x_dot, x_d_ddot, 30.0, k_plus_h, d_hat, 4.0, 8.0, 0.8, True)


def test_the_rival_asks_for_what_its_action_does_in_the_environment():
    alone, inside = ppo.initial(PARAMETERS), handed.initial(PARAMETERS)
    for motion in motions(50):
        seen = policy.observation(PARAMETERS, alone, motion, 0.02)
        alone, asked = ppo.step(PARAMETERS, alone, motion, 0.02)
        inside, given = handed.step(PARAMETERS, inside._replace(action=ppo.action(seen)), motion, 0.02)
        assert inside.seen == seen
        assert inside.remembered == alone
        assert given == asked


def test_without_an_action_the_papers_law_steers():
    state = handed.initial(PARAMETERS)
    for motion in motions(5):
        state, terms = handed.step(PARAMETERS, state, motion, 0.02)
        assert terms == law_with(motion, motion.d_hat)


def test_an_action_is_bounded_to_its_share_of_the_force():
    motion = next(motions(1))
    terms = policy.terms_of(PARAMETERS, motion, 7.0)
    assert terms.feedback == policy.SHARE * PARAMETERS.max_force
    assert terms.d_hat == motion.d_hat


@pytest.mark.compiles
def test_the_network_is_the_same_compiled():
    for motion in motions(5):
        seen = policy.observation(PARAMETERS, ppo.initial(PARAMETERS), motion, 0.02)
        assert compiled(ppo.action)(seen) == pytest.approx(ppo.action(seen), rel=1e-9, abs=1e-12)


def test_the_reward_falls_from_one_at_no_error_to_nothing_where_it_is_lost():
    found = near(np.array([0.0, -GOOD, 0.01, LOST, -3.0]), GOOD, LOST)
    assert found[0] == 1.0
    assert (np.diff(found) <= 0.0).all()
    assert found[2] > 0.5
    assert found[3] == pytest.approx(0.0)
    assert found[4] == 0.0


def test_no_seed_of_the_bench_trains():
    assert max(*TRAINING, *HELD_OUT) < 1000
    assert not set(TRAINING).intersection(HELD_OUT)


@pytest.mark.compiles
def test_gymnasium_finds_no_fault():
    with pytest.warns(UserWarning, match="infinity"):
        check_env(HoldfastEnv(), skip_render_check=True)


@pytest.mark.compiles
def test_with_its_own_law_a_dive_is_that_of_the_batches():
    waves = four(7)[0]
    plant = waves.plant(BASE, 7)
    env = HoldfastEnv(dives=lambda seed: Dive(plant, waves.target, 20.0, 0.02, 0.02), seeds=[7])
    _, dive = env.reset()
    errors = [env.step(OWN)[4]["error"][0] for _ in range(dive["steps"])]
    observer = load_config(overrides=["heave.compensator='observer'"])
    same = simulate(observer, [plant], waves.target, 20.0, [7], Links(0.02, 0.02))
    counted = errors[-round((20.0 - 12.0) / 0.02) - 1 :]
    assert 1e3 * np.sqrt(np.mean(np.square(counted))) == pytest.approx(same["depth_rms_mm"][0], rel=1e-9)


@pytest.mark.compiles
def test_what_is_seen_is_measured_and_not_true():
    env = HoldfastEnv(seeds=[3])
    env.reset()
    for _ in range(50):
        seen, _, _, _, info = env.step(OWN)
    assert seen[0] != pytest.approx(info["error"][0], abs=1e-6)
    assert seen[0] == pytest.approx(info["error"][0], abs=0.03)


@pytest.mark.compiles
def test_a_seed_draws_the_dives_again_and_another_one_others():
    env = HoldfastEnv()

    def begun(seed):
        first, dive = env.reset(seed=seed)
        return dive["seed"], *first, *env.step(np.zeros(1, np.float32))[0]

    assert begun(1) == begun(1)
    assert begun(1)[0] != begun(2)[0]
    assert bench(1).up_s != bench(2).up_s


@pytest.mark.compiles
def test_who_pushes_on_is_lost():
    env = HoldfastEnv(seeds=[5])
    _, dive = env.reset()
    lost, steps = False, 0
    while not lost and steps < dive["steps"] / 4:
        _, reward, lost, ended, info = env.step(np.ones(1, np.float32))
        steps += 1
    assert lost
    assert not ended
    assert info["error"][0] > LOST
    assert 0.0 <= reward < 0.2
