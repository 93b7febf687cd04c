"""Sums over episodes, kept on the device and read once per training iteration."""

from __future__ import annotations

from typing import Protocol

import torch

from spin_rl import robot
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks import episode
from spin_rl.tasks.rewards import Transition


class _Env(Protocol):
    sim: Simulation
    outcome: torch.Tensor
    last_transition: Transition | None


class EpisodeStatistics:
    """Outcome rates, returns, lengths, collisions by part and reward terms since the last read."""

    def __init__(self, num_envs: int, reward_terms: tuple[str, ...], device: str) -> None:
        """Allocate the sums.

        Args:
            num_envs: Number of worlds.
            reward_terms: Names of the reward terms in use.
            device: Torch device.
        """
        self._names = (
            [f"outcome/{name}" for name in episode.OUTCOMES]
            + ["return", "length", "goal_distance", "steps"]
            + [f"part/{name}" for name in robot.PARTS]
            + [f"reward/{name}" for name in reward_terms]
        )
        self._sums = torch.zeros(len(self._names), dtype=torch.float64, device=device)
        self._outcomes = torch.arange(len(episode.OUTCOMES), dtype=torch.int32, device=device)
        self._return = torch.zeros(num_envs, device=device)
        self._length = torch.zeros(num_envs, device=device)
        self._control_period = 0.0

    def add(self, env: _Env, reward: torch.Tensor, terms: dict[str, torch.Tensor]) -> None:
        """Add one control step of all worlds."""
        step = env.last_transition
        assert step is not None
        self._control_period = env.sim.config.control_period
        done = (env.outcome != episode.RUNNING).float()
        self._return += reward
        self._length += 1.0
        collided = (env.outcome == episode.COLLISION).float()
        parts = (env.sim.views.part_contacts * collided[:, None]).sum(0)
        values = torch.cat(
            (
                (env.outcome[:, None] == self._outcomes).float().sum(0),
                torch.stack(
                    (
                        (self._return * done).sum(),
                        (self._length * done).sum(),
                        (step.goal_distance * done).sum(),
                        torch.full((), float(reward.shape[0]), device=reward.device),
                    )
                ),
                parts,
                *[value.sum()[None] for value in terms.values()],
            )
        )
        self._sums += values
        self._return *= 1.0 - done
        self._length *= 1.0 - done

    def restart(self) -> None:
        """Forget the episodes that run: all worlds were reset from outside."""
        self._return.zero_()
        self._length.zero_()

    def read(self) -> dict[str, float]:
        """Return rates and means since the last call and start over.

        Keys: `episodes`, `<outcome>_rate`, `mean_return`, `mean_length_s`, `final_distance_m`,
        `collisions/<part>` (share of all episodes that ended with that part touching), `reward/<term>` (mean
        per control step, scaled). Rates of no episodes are NaN.
        """
        sums = dict(zip(self._names, self._sums.tolist(), strict=True))
        self._sums.zero_()
        episodes = sum(sums[f"outcome/{name}"] for name in episode.OUTCOMES[1:])
        steps = max(sums["steps"], 1.0)

        def per_episode(key: str) -> float:
            return sums[key] / episodes if episodes else float("nan")

        stats = {"episodes": episodes}
        stats |= {f"{name}_rate": per_episode(f"outcome/{name}") for name in episode.OUTCOMES[1:]}
        stats["mean_return"] = per_episode("return")
        stats["mean_length_s"] = per_episode("length") * self._control_period
        stats["final_distance_m"] = per_episode("goal_distance")
        stats |= {f"collisions/{part}": per_episode(f"part/{part}") for part in robot.PARTS}
        stats |= {name: sums[name] / steps for name in self._names if name.startswith("reward/")}
        return stats
