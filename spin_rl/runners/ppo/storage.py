"""Rollout memory that keeps environments as whole sequences, episode ends inside."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import cast

import torch
from tensordict import TensorDict

from spin_rl.models import LSTMState


@dataclass
class Batch:
    """Whole rollouts of some environments; every tensor starts with (num_steps, num_envs)."""

    observations: TensorDict
    resets: torch.Tensor
    actions: torch.Tensor
    values: torch.Tensor
    returns: torch.Tensor
    advantages: torch.Tensor
    log_prob: torch.Tensor
    distribution: tuple[torch.Tensor, ...]
    states: tuple[LSTMState | None, LSTMState | None]
    targets: torch.Tensor | None = None


class SequenceStorage:
    """One rollout of all environments, written in place.

    rsl_rl's storage cuts rollouts into episodes, pads each of them to the full length, and keeps the
    hidden states of every step. Models that clear their state inside a sequence need neither: this one
    keeps the state before the first step, and only the observation groups that a model reads.

    All tensors have the shape (num_steps, num_envs, ...).
    """

    def __init__(
        self,
        num_envs: int,
        num_steps: int,
        obs: TensorDict,
        groups: Iterable[str],
        num_actions: int,
        device: str,
    ) -> None:
        shape = (num_steps, num_envs)
        self.num_envs = num_envs
        self.num_steps = num_steps
        self.observations = TensorDict(
            {
                name: torch.zeros(*shape, *obs[name].shape[1:], dtype=obs[name].dtype, device=device)
                for name in sorted(set(groups))
            },
            batch_size=shape,
        )
        self.actions = torch.zeros(*shape, num_actions, device=device)
        self.rewards, self.values, self.log_prob, self.returns, self.advantages = torch.zeros(
            5, *shape, device=device
        )
        self.dones = torch.zeros(shape, dtype=torch.bool, device=device)
        self.distribution: tuple[torch.Tensor, ...] = ()
        self.states: tuple[LSTMState | None, LSTMState | None] = (None, None)
        self.targets: torch.Tensor | None = None  # a teacher's actions, of algorithms that have one
        self.step = 0

    def add_decision(
        self,
        obs: TensorDict,
        actions: torch.Tensor,
        values: torch.Tensor,
        log_prob: torch.Tensor,
        distribution: tuple[torch.Tensor, ...],
    ) -> None:
        """Copy what was seen and decided at this step; before the environment overwrites its observations."""
        if not self.distribution:
            self.distribution = tuple(p.new_zeros(self.num_steps, *p.shape) for p in distribution)
        for name, buffer in self.observations.items():
            buffer[self.step].copy_(obs[name])
        self.actions[self.step].copy_(actions)
        self.values[self.step].copy_(values)
        self.log_prob[self.step].copy_(log_prob)
        for buffer, parameter in zip(self.distribution, distribution, strict=True):
            buffer[self.step].copy_(parameter)

    def add_outcome(self, rewards: torch.Tensor, dones: torch.Tensor) -> None:
        """Copy what followed, and go on to the next step."""
        self.rewards[self.step].copy_(rewards)
        self.dones[self.step].copy_(dones)
        self.step += 1

    def mini_batches(self, number: int) -> list[Batch]:
        """Split the environments at random into `number` parts of (nearly) equal size."""
        resets = torch.zeros_like(self.dones)
        resets[1:] = self.dones[:-1]  # the state before the first step is clear already
        order = torch.randperm(self.num_envs, device=self.dones.device)
        return [self._select(index, resets) for index in order.tensor_split(number)]

    def _select(self, index: torch.Tensor, resets: torch.Tensor) -> Batch:
        def pick(buffer: torch.Tensor) -> torch.Tensor:
            return buffer.index_select(1, index)

        observations = {name: pick(cast(torch.Tensor, buffer)) for name, buffer in self.observations.items()}
        actor, critic = (state and (pick(state[0]), pick(state[1])) for state in self.states)
        return Batch(
            TensorDict(observations, batch_size=(self.num_steps, len(index))),
            pick(resets),
            pick(self.actions),
            pick(self.values),
            pick(self.returns),
            pick(self.advantages),
            pick(self.log_prob),
            tuple(pick(parameter) for parameter in self.distribution),
            (actor, critic),
            None if self.targets is None else pick(self.targets),
        )
