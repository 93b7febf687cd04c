"""Sums over episodes, kept on the device and read once per training iteration."""

from __future__ import annotations

from typing import Any, Protocol

import torch

from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.common import episode


class Env(Protocol):
    """What statistics read of an environment after a step."""

    sim: Simulation
    outcome: torch.Tensor
    last_transition: Any


class EpisodeStatistics:
    """Outcome rates, returns, lengths and reward terms since the last read; subclasses add sums of a task."""

    def __init__(
        self,
        num_envs: int,
        reward_terms: tuple[str, ...],
        device: str,
        *,
        outcomes: tuple[str, ...] = episode.OUTCOMES,
        sums: tuple[str, ...] = (),
    ) -> None:
        """Allocate the sums.

        Args:
            num_envs: Number of worlds.
            reward_terms: Names of the reward terms in use.
            device: Torch device.
            outcomes: Names of the outcomes, `running` first.
            sums: Names of what `_task_sums` returns.
        """
        self._outcome_names = outcomes
        self._names = (
            [f"outcome/{name}" for name in outcomes]
            + ["return", "length", "steps", *sums]
            + [f"reward/{name}" for name in reward_terms]
        )
        self._sums = torch.zeros(len(self._names), dtype=torch.float64, device=device)
        self._outcomes = torch.arange(len(outcomes), dtype=torch.int32, device=device)
        self._return = torch.zeros(num_envs, device=device)
        self._length = torch.zeros(num_envs, device=device)
        self._control_period = 0.0

    def add(self, env: Env, reward: torch.Tensor, terms: dict[str, torch.Tensor]) -> None:
        """Add one control step of all worlds."""
        self._control_period = env.sim.config.control_period
        done = (env.outcome != episode.RUNNING).float()
        self._return += reward
        self._length += 1.0
        values = torch.cat(
            (
                (env.outcome[:, None] == self._outcomes).float().sum(0),
                torch.stack(
                    (
                        (self._return * done).sum(),
                        (self._length * done).sum(),
                        torch.full((), float(reward.shape[0]), device=reward.device),
                    )
                ),
                self._task_sums(env, done),
                *[value.sum()[None] for value in terms.values()],
            )
        )
        self._sums += values
        self._return *= 1.0 - done
        self._length *= 1.0 - done

    def restart(self, mask: torch.Tensor | None = None) -> None:
        """Forget the running episodes of all worlds or of a mask (num_envs,): they were reset outside."""
        for running in (self._return, self._length):
            if mask is None:
                running.zero_()
            else:
                running.masked_fill_(mask, 0.0)

    def read(self) -> dict[str, float]:
        """Return rates and means since the last call and start over.

        Keys: `episodes`, `<outcome>_rate`, `mean_return`, `mean_length_s`, `reward/<term>` (mean per control
        step, scaled), and those of the task. Rates of no episodes are NaN.
        """
        sums = dict(zip(self._names, self._sums.tolist(), strict=True))
        self._sums.zero_()
        ended = self._outcome_names[1:]
        sums["episodes"] = sum(sums[f"outcome/{name}"] for name in ended)
        stats = {"episodes": sums["episodes"]}
        stats |= {f"{name}_rate": ratio(sums, f"outcome/{name}", "episodes") for name in ended}
        stats["mean_return"] = ratio(sums, "return", "episodes")
        stats["mean_length_s"] = ratio(sums, "length", "episodes") * self._control_period
        stats |= self._task_stats(sums)
        sums["steps"] = max(sums["steps"], 1.0)
        terms = [name for name in self._names if name.startswith("reward/")]
        return stats | {name: ratio(sums, name, "steps") for name in terms}

    def _task_sums(self, env: Env, done: torch.Tensor) -> torch.Tensor:
        """Return what one step adds to the task's sums; `done` is 1 where an episode ended, else 0."""
        return done[:0]

    def _task_stats(self, sums: dict[str, float]) -> dict[str, float]:
        """Return the task's statistics from the sums by name, `episodes` and `steps` among them."""
        return {}


def ratio(sums: dict[str, float], name: str, over: str) -> float:
    """Return one sum divided by another, NaN if that is zero."""
    return sums[name] / sums[over] if sums[over] else float("nan")
