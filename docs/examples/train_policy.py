"""Train a depth policy in Holdfast's environment with stable-baselines3's PPO: docs/gym.md.

The hyperparameters are published: vitorsmends/bluerov2_gym, config/training_config.yaml, section ppo.
Every EVERY steps the policy dives held-out seeds; the best one is written as `ppo.npz`, the curve as CSV.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from lab.training.environment import HELD_OUT, HoldfastEnv

EVERY, DIVES, ENVS = 200_000, 12, 8
SETTLED = 448  # ticks: the bench measures from 12 s after boot on


def dived(env, policy):
    """Dive once: return the mean reward, depth RMS (mm) and the RMS change of the force (N a tick)."""
    seen, dive = env.reset()
    rewards, errors, forces, over = [], [], [], False
    while not over:
        seen, reward, lost, ended, info = env.step(policy(seen))
        over = lost or ended
        rewards.append(reward)
        errors.append(info["error"][0])
        forces.append(info["force"][0])
    late = np.array(errors)[SETTLED:] if not lost else np.array([1.0])
    chatter = np.sqrt(np.mean(np.diff(forces[SETTLED:] or [0, 0, 0]) ** 2))
    return sum(rewards) / dive["steps"], 1e3 * np.sqrt(np.mean(late**2)), chatter


def evaluated(policy):
    """Return the means over the same held-out dives each time."""
    return np.mean([dived(HoldfastEnv(seeds=[seed]), policy) for seed in HELD_OUT[:DIVES]], axis=0)


def read(model, normal):
    """Return the policy's network, and the scales of what it sees."""
    net = {key: value.numpy() for key, value in model.policy.state_dict().items()}
    layers = ("mlp_extractor.policy_net.0", "mlp_extractor.policy_net.2", "action_net")
    weights = {f"w{i}": net[f"{layer}.weight"] for i, layer in enumerate(layers, 1)}
    biases = {f"b{i}": net[f"{layer}.bias"] for i, layer in enumerate(layers, 1)}
    mean, sigma = normal.obs_rms.mean, np.sqrt(normal.obs_rms.var + normal.epsilon)
    return {"mean": mean.astype(np.float32), "sigma": sigma.astype(np.float32), **weights, **biases}


def acting(net):
    """Return the policy as a function of what is seen: without exploration."""

    def policy(seen):
        z = np.clip((seen - net["mean"]) / net["sigma"], -10.0, 10.0)
        hidden = np.tanh(net["w2"] @ np.tanh(net["w1"] @ z + net["b1"]) + net["b2"])
        return np.clip(net["w3"] @ hidden + net["b3"], -1.0, 1.0)

    return policy


class Evaluation(BaseCallback):
    """Dives held-out seeds now and then; keeps the best, writes the curve."""

    def __init__(self, out):
        super().__init__()
        self.out, self.best, self.due = out, -np.inf, 0
        self.began_s = time.monotonic()

    def _on_rollout_start(self):
        if self.num_timesteps < self.due:
            return
        self.due += EVERY
        net = read(self.model, self.training_env)
        found = evaluated(acting(net))
        line = [self.num_timesteps, time.monotonic() - self.began_s, time.process_time(), *found]
        with (self.out / "curve.csv").open("a") as curve:
            curve.write(",".join(f"{value:.5g}" for value in line) + "\n")
        steps, wall_s, cpu_s, reward, depth_mm, chatter_n = line
        print(
            f"{steps:9} steps {wall_s:6.0f} s (CPU {cpu_s:6.0f} s):"
            f" reward {reward:.4f}  depth {depth_mm:.2f} mm  chatter {chatter_n:.2f} N",
            flush=True,
        )
        if found[0] > self.best:
            self.best = found[0]
            np.savez(self.out / "ppo.npz", **net)

    def _on_step(self):
        return True


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=4.0, help="of training, by the clock")
    parser.add_argument("--out", type=Path, default=Path("out/ppo"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    env = DummyVecEnv([HoldfastEnv] * ENVS)
    env = VecNormalize(env, norm_obs=True, norm_reward=True, clip_obs=10.0, clip_reward=10.0, gamma=0.99)
    env.seed(1)
    model = PPO(
        "MlpPolicy", env, seed=1, device="cpu",
        learning_rate=3e-4, n_steps=4096 // ENVS, batch_size=256, n_epochs=10, gamma=0.99, gae_lambda=0.95,
        clip_range=0.2, ent_coef=0.01, vf_coef=0.5, max_grad_norm=0.5,
        policy_kwargs={"log_std_init": -1.0, "net_arch": {"pi": [256, 256], "vf": [256, 256]}},
    )  # fmt: skip
    ends_s = time.monotonic() + 3600.0 * arguments.hours

    class InTime(BaseCallback):
        def _on_step(self):
            return time.monotonic() < ends_s

    model.learn(1_000_000_000, callback=[Evaluation(arguments.out), InTime()])
    model.save(arguments.out / "last.zip")
    env.save(str(arguments.out / "last.pkl"))


if __name__ == "__main__":
    main()
