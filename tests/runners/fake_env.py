"""A tiny environment for tests of training code: points that drive to a goal among scandot tokens."""

from __future__ import annotations

import torch
from tensordict import TensorDict

NUM_TOKENS = 4
NUM_ACTIONS = 2


class FakeEnv:
    """Seeded, restorable, and as unkind as a real one: it writes its observations in place."""

    num_actions = NUM_ACTIONS
    max_episode_length = 20
    device = "cpu"
    restores_episodes = True

    def __init__(self, num_envs: int = 12, seed: int = 0, poisoned_steps: tuple[int, ...] = ()):
        self.num_envs = num_envs
        self.cfg = {}
        self.generator = torch.Generator().manual_seed(seed)
        self.poisoned_steps = poisoned_steps
        self.steps = 0
        self.position = torch.zeros(num_envs, 2)
        self.goal = torch.zeros(num_envs, 2)
        self.tokens = torch.zeros(num_envs, NUM_TOKENS, 32)
        self.time = torch.zeros(num_envs)
        self.episode_return = torch.zeros(num_envs)
        self.totals = torch.zeros(4)  # episodes, successes, return, length
        self.episode_length_buf = self.time
        dims = {"proprio": 5, "goal": 3, "scandots": NUM_TOKENS * 32, "scandots_all": NUM_TOKENS * 32}
        groups = {name: torch.zeros(num_envs, dim) for name, dim in dims.items()}
        self.observations = TensorDict(groups, batch_size=[num_envs])
        self._restart(torch.ones(num_envs, dtype=torch.bool))
        self._observe()

    def get_observations(self) -> TensorDict:
        return self.observations

    def step(self, actions: torch.Tensor):
        before = (self.goal - self.position).norm(dim=1)
        self.position += 0.2 * actions.clamp(-1.0, 1.0)
        after = (self.goal - self.position).norm(dim=1)
        self.time += 1.0
        reached, late = after < 0.3, self.time >= self.max_episode_length
        reward = before - after + 1.0 * reached
        if self.steps in self.poisoned_steps:
            reward[0] = torch.nan
        self.steps += 1
        self.episode_return += reward
        done = reached | late
        ended = torch.stack([done, reached, done * self.episode_return, done * self.time * 0.1])
        self.totals += ended.float().sum(dim=1)
        self._restart(done)
        self._observe()
        return self.observations, reward, done, {"time_outs": late & ~reached}

    def episode_stats(self) -> dict[str, float]:
        episodes, successes, total_return, seconds = self.totals.tolist()
        self.totals.zero_()
        number = max(episodes, 1.0)
        return {
            "episodes": episodes,
            "success_rate": successes / number,
            "collision_rate": 0.0,
            "timeout_rate": (episodes - successes) / number,
            "mean_return": total_return / number,
            "mean_length_s": seconds / number,
            "level": 0.5,
        }

    def dump_non_finite(self, folder) -> list:
        return []

    def state_dict(self) -> dict:
        names = ("position", "goal", "tokens", "time", "episode_return", "totals")
        state = {name: getattr(self, name).clone() for name in names}
        return state | {"rng": self.generator.get_state(), "steps": self.steps}

    def load_state_dict(self, state: dict) -> None:
        self.generator.set_state(state["rng"])
        self.steps = state["steps"]
        for name in ("position", "goal", "tokens", "time", "episode_return", "totals"):
            getattr(self, name).copy_(state[name])
        self._observe()

    def _restart(self, done: torch.Tensor) -> None:
        goal = torch.rand(self.num_envs, 2, generator=self.generator) * 2.0 - 1.0
        tokens = torch.randn(self.num_envs, NUM_TOKENS, 32, generator=self.generator)
        tokens[..., 24:] = (torch.rand(self.num_envs, NUM_TOKENS, 1, generator=self.generator) < 0.5).float()
        tokens[..., :24] *= tokens[..., 24:25]
        self.position[done] = 0.0
        self.goal[done] = goal[done]
        self.tokens[done] = tokens[done]
        self.time[done] = 0.0
        self.episode_return[done] = 0.0

    def _observe(self) -> None:
        self.observations["proprio"][:, :2] = self.position
        self.observations["proprio"][:, 2] = self.time / self.max_episode_length
        self.observations["goal"][:, :2] = self.goal - self.position
        seen = self.tokens * (self.tokens[..., :1] > 0.0)
        self.observations["scandots"].copy_(seen.flatten(1))
        self.observations["scandots_all"].copy_(self.tokens.flatten(1))


def make_config(critic: str = "feed_forward", **algorithm) -> dict:
    """Configuration of a small recurrent actor with a critic of either kind."""
    actor_groups = ["proprio", "goal", "scandots"]
    recurrent = {
        "class_name": "spin_rl.models:ScandotRecurrentModel",
        "rnn_hidden_dim": 16,
        "encoder_hidden": [8],
    }
    feed_forward = {"class_name": "spin_rl.models:ScandotModel", "hidden_dims": [16], "encoder_hidden": [8]}
    distribution = {
        "class_name": "rsl_rl.modules:GaussianDistribution",
        "init_std": 0.6,
        "std_range": [0.1, 2.0],
    }
    defaults = {"num_learning_epochs": 2, "num_mini_batches": 3, "gamma": 0.95}
    return {
        "seed": 1,
        "num_steps_per_env": 8,
        "save_interval": 100,
        "obs_groups": {
            "actor": actor_groups,
            "critic": actor_groups if critic == "recurrent" else ["proprio", "goal", "scandots_all"],
        },
        "actor": {**recurrent, "distribution_cfg": distribution},
        "critic": recurrent if critic == "recurrent" else feed_forward,
        "algorithm": {"class_name": "spin_rl.runners:PPO", **defaults, **algorithm},
    }
