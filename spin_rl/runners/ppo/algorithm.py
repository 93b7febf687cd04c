"""Proximal policy optimization on sequences: a subclass of rsl_rl's PPO.

One class, and so one file: the update, and what of rsl_rl it replaces. The storage is elsewhere, and so are
losses beyond PPO's, in a subclass.
"""

from __future__ import annotations

import math
from itertools import chain
from typing import Annotated, Any

import rsl_rl.algorithms
import torch
from rsl_rl.env import VecEnv
from rsl_rl.utils import resolve_class
from tensordict import TensorDict
from torch import nn

from spin_rl.config import Choice, Range
from spin_rl.models import LSTMState, ScandotModel, ScandotRecurrentModel
from spin_rl.ranges import Epochs, GradNorm, LearningRate, MiniBatches, Share, Weight
from spin_rl.runners.ppo.storage import Batch, SequenceStorage

SCHEDULES = ("adaptive", "fixed", "linear")
MAX_LOST_UPDATES = 3
STATISTICS = ("value", "surrogate", "entropy", "kl", "actor_grad_norm", "critic_grad_norm")


class PPO(rsl_rl.algorithms.PPO):
    """PPO with rsl_rl's losses on unpadded sequences.

    Differences from rsl_rl: recurrent rollouts are not cut and padded, observations are copied before the
    environment may overwrite them, a step with non-finite gradients is left out, advantages are
    normalized over all processes, the standard deviation stays inside its range, and one host
    synchronization per minibatch instead of three.
    """

    actor: ScandotModel
    critic: ScandotModel
    storage: SequenceStorage

    def __init__(
        self,
        actor: ScandotModel,
        critic: ScandotModel,
        storage: SequenceStorage,
        num_learning_epochs: Epochs = 5,
        num_mini_batches: MiniBatches = 4,
        clip_param: Annotated[float, Range(0.0, 10.0, above=True)] = 0.2,
        gamma: Share = 0.99,
        lam: Share = 0.95,
        value_loss_coef: Weight = 1.0,
        entropy_coef: Weight = 5e-4,
        learning_rate: LearningRate = 1e-3,
        min_learning_rate: LearningRate = 1e-5,
        max_learning_rate: LearningRate = 1e-2,
        max_grad_norm: GradNorm = 1.0,
        use_clipped_value_loss: bool = True,
        schedule: Annotated[str, Choice(SCHEDULES)] = "adaptive",
        desired_kl: Annotated[float, Range(0.0, 10.0, above=True)] = 0.01,
        device: str = "cpu",
        multi_gpu_cfg: dict | None = None,
    ) -> None:
        """Initialize as rsl_rl does.

        Args:
            actor: Policy.
            critic: Value function.
            storage: Memory for one rollout.
            num_learning_epochs: Passes over a rollout.
            num_mini_batches: Parts of a rollout, split by environment.
            clip_param: Clip range of the probability ratio, and of the value change if clipped.
            gamma: Discount factor.
            lam: Decay of generalized advantage estimation.
            value_loss_coef: Weight of the value loss.
            entropy_coef: Weight of the entropy bonus.
            learning_rate: Initial learning rate.
            min_learning_rate: Lower bound of "adaptive", and the end of "linear".
            max_learning_rate: Upper bound of "adaptive".
            max_grad_norm: Clip range of the gradient norm, for actor and critic apart.
            use_clipped_value_loss: Clip the change of the value.
            schedule: "adaptive" to the divergence `desired_kl`, "fixed", or "linear" over the run.
            desired_kl: Aim of "adaptive", mean KL(old || new).
            device: Torch device.
            multi_gpu_cfg: Ranks of a data-parallel run, from the runner.
        """
        super().__init__(
            actor,
            critic,
            storage,  # pyright: ignore[reportArgumentType] - the base class only keeps it
            num_learning_epochs=num_learning_epochs,
            num_mini_batches=num_mini_batches,
            clip_param=clip_param,
            gamma=gamma,
            lam=lam,
            value_loss_coef=value_loss_coef,
            entropy_coef=entropy_coef,
            learning_rate=learning_rate,
            max_grad_norm=max_grad_norm,
            use_clipped_value_loss=use_clipped_value_loss,
            schedule=schedule,
            desired_kl=desired_kl,
            device=device,
            multi_gpu_cfg=multi_gpu_cfg,
        )
        parameters = chain(actor.parameters(), critic.parameters())
        self.optimizer = torch.optim.Adam(parameters, lr=learning_rate, fused=True)
        self.initial_learning_rate = learning_rate
        self.min_learning_rate = min_learning_rate
        self.max_learning_rate = max_learning_rate
        self.lost_updates = 0

    @property
    def trained(self) -> dict[str, ScandotModel]:
        """Models that a checkpoint holds, by name."""
        return {"actor": self.actor, "critic": self.critic}

    @property
    def models(self) -> tuple[ScandotModel, ...]:
        """Models whose memory follows the episodes."""
        return (self.actor, self.critic)

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> PPO:
        """Build models, storage and algorithm from the runner's configuration, which is checked already."""
        groups = cfg["obs_groups"]
        actor_class, actor_cfg = resolve_class(cfg["actor"])
        critic_class, critic_cfg = resolve_class(cfg["critic"])
        algorithm_class, algorithm_cfg = resolve_class(cfg["algorithm"])
        actor = actor_class(obs, groups, "actor", env.num_actions, **actor_cfg)
        critic = critic_class(obs, groups, "critic", 1, **critic_cfg)
        used = groups["actor"] + groups["critic"]
        storage = SequenceStorage(env.num_envs, cfg["num_steps_per_env"], obs, used, env.num_actions, device)
        return algorithm_class(
            actor, critic, storage, device=device, multi_gpu_cfg=cfg["multi_gpu"], **algorithm_cfg
        )

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Sample actions (num_envs, num_actions) and store the decision."""
        if self.storage.step == 0:
            self.storage.states = (self._state(self.actor), self._state(self.critic))
        actions = self.actor(obs, stochastic_output=True)
        self.storage.add_decision(
            obs,
            actions,
            self.critic(obs).squeeze(-1),
            self.actor.get_output_log_prob(actions),
            self.actor.output_distribution_params,
        )
        return actions

    def process_env_step(
        self, obs: TensorDict, rewards: torch.Tensor, dones: torch.Tensor, extras: dict[str, torch.Tensor]
    ) -> None:
        """Store the outcome of a step; an episode cut by its time limit gets the value of going on.

        Args:
            obs: Next observations; `act` will see them.
            rewards: Shape (num_envs,).
            dones: Non-zero where an episode ended, shape (num_envs,).
            extras: "time_outs" marks those that ended by the time limit, shape (num_envs,).
        """
        if "time_outs" in extras:
            values = self.storage.values[self.storage.step]
            rewards = rewards + self.gamma * values * extras["time_outs"].to(values.dtype)
        self.storage.add_outcome(rewards, dones)
        self.actor.reset(dones)
        self.critic.reset(dones)

    def compute_returns(self, obs: TensorDict) -> None:
        """Compute returns and normalized advantages by generalized advantage estimation."""
        st = self.storage
        state = self.critic.get_hidden_state()
        next_values = self.critic(obs).squeeze(-1)
        self.critic.reset(hidden_state=state)  # the next rollout starts where this one ended
        advantage = torch.zeros_like(next_values)
        for step in reversed(range(st.num_steps)):
            go_on = self.gamma * ~st.dones[step]
            delta = st.rewards[step] + go_on * next_values - st.values[step]
            advantage = delta + go_on * self.lam * advantage
            torch.add(advantage, st.values[step], out=st.returns[step])
            next_values = st.values[step]
        advantages = st.returns - st.values
        mean = self._mean_of_processes(advantages.mean())
        std = self._mean_of_processes((advantages - mean).square().mean()).sqrt()
        st.advantages = (advantages - mean) / (std + 1e-8)

    def update(self) -> dict[str, float]:
        """Run the epochs over the stored rollout and return mean losses and the number of skipped steps.

        Raises:
            FloatingPointError: Several rollouts in a row allowed no step at all.
        """
        total = self.num_learning_epochs * self.num_mini_batches
        sums: dict[str, float] = {}
        steps = 0
        if self._rollout_is_finite():
            batches = self.storage.mini_batches(self.num_mini_batches)
            for batch in batches * self.num_learning_epochs:
                statistics = self._compute_gradients(batch)
                # The gradient norms are the same in all processes, and so is the decision.
                if not math.isfinite(statistics["actor_grad_norm"] + statistics["critic_grad_norm"]):
                    continue
                self._adapt_learning_rate(statistics["kl"])
                self.optimizer.step()
                self._limit_std()
                steps += 1
                for name, value in statistics.items():
                    sums[name] = sums.get(name, 0.0) + value
            flat = self.storage.observations.flatten(0, 1)
            self.actor.update_normalization(flat)
            self.critic.update_normalization(flat)
        else:
            for model in self.models:
                model.reset()
        self.storage.step = 0
        self.lost_updates = 0 if steps else self.lost_updates + 1
        if self.lost_updates >= MAX_LOST_UPDATES:
            raise FloatingPointError(
                f"Losses or gradients were not finite in {MAX_LOST_UPDATES} whole updates in a row."
            )
        means = {name: value / steps for name, value in sums.items()} if steps else {}
        return means | {"skipped_steps": float(total - steps)}

    def set_progress(self, progress: float) -> None:
        """Set the learning rate of the "linear" and "fixed" schedules; a resumed run may have another.

        Args:
            progress: Part of the run that is over, from 0 to 1.
        """
        if self.schedule == "linear":
            start, end = self.initial_learning_rate, self.min_learning_rate
            self._set_learning_rate(start + (end - start) * min(progress, 1.0))
        elif self.schedule == "fixed":
            self._set_learning_rate(self.initial_learning_rate)

    def extra_state(self) -> dict[str, float]:
        """Return what a checkpoint has to keep beside models, optimizer and learning rate."""
        return {}

    def load_extra_state(self, state: dict[str, float]) -> None:
        """Restore what `extra_state` returned."""

    def _extra_losses(self, batch: Batch) -> dict[str, tuple[float, torch.Tensor]]:
        """Return further losses of the actor by name, each with its weight, after its forward pass."""
        return {}

    def _compute_gradients(self, batch: Batch) -> dict[str, float]:
        """Compute the gradients of one minibatch, averaged over the processes and clipped."""
        states = batch.states
        self.actor(batch.observations, hidden_state=states[0], stochastic_output=True, resets=batch.resets)
        values = self.critic(batch.observations, hidden_state=states[1], resets=batch.resets).squeeze(-1)
        log_prob = self.actor.get_output_log_prob(batch.actions)
        entropy = self.actor.output_entropy.mean()

        ratio = torch.exp(log_prob - batch.log_prob)
        clipped = ratio.clamp(1.0 - self.clip_param, 1.0 + self.clip_param)
        surrogate = -torch.min(batch.advantages * ratio, batch.advantages * clipped).mean()
        value_loss = (values - batch.returns).square()
        if self.use_clipped_value_loss:
            near = batch.values + (values - batch.values).clamp(-self.clip_param, self.clip_param)
            value_loss = torch.max(value_loss, (near - batch.returns).square())
        value_loss = value_loss.mean()
        loss = surrogate + self.value_loss_coef * value_loss - self.entropy_coef * entropy
        extra = self._extra_losses(batch)
        for weight, value in extra.values():
            if weight > 0.0:
                loss = loss + weight * value

        self.optimizer.zero_grad()
        loss.backward()
        if self.is_multi_gpu:
            self.reduce_parameters()
        norms = [
            nn.utils.clip_grad_norm_(model.parameters(), self.max_grad_norm)
            for model in (self.actor, self.critic)
        ]
        with torch.no_grad():
            kl = self.actor.get_kl_divergence(
                batch.distribution, self.actor.output_distribution_params
            ).mean()
            numbers = [value_loss, surrogate, entropy, kl, *norms, *(value for _, value in extra.values())]
            statistics = self._mean_of_processes(torch.stack(numbers))
        return dict(zip((*STATISTICS, *extra), statistics.tolist(), strict=True))

    def _adapt_learning_rate(self, kl: float) -> None:
        if self.schedule != "adaptive":
            return
        if kl > 2.0 * self.desired_kl:
            self._set_learning_rate(max(self.min_learning_rate, self.learning_rate / 1.5))
        elif 0.0 < kl < 0.5 * self.desired_kl:
            self._set_learning_rate(min(self.max_learning_rate, self.learning_rate * 1.5))

    def _set_learning_rate(self, learning_rate: float) -> None:
        self.learning_rate = learning_rate
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate

    @torch.no_grad()
    def _limit_std(self) -> None:
        """Keep the parameter itself in range: outside of it rsl_rl's clamp lets no gradient through."""
        distribution: Any = self.actor.distribution
        if hasattr(distribution, "std_param"):
            distribution.std_param.clamp_(*distribution.std_range)
        elif hasattr(distribution, "log_std_param"):
            distribution.log_std_param.clamp_(*distribution.log_std_range)

    def _rollout_is_finite(self) -> bool:
        """Whether the rollout is fit to learn from: bad observations show in what the models made of them."""
        total = self.storage.returns.sum() + self.storage.log_prob.sum()
        return math.isfinite(self._mean_of_processes(total).item())

    def _mean_of_processes(self, value: torch.Tensor) -> torch.Tensor:
        if self.is_multi_gpu:
            torch.distributed.all_reduce(value)
            value = value / self.gpu_world_size
        return value

    def _state(self, model: ScandotModel) -> LSTMState | None:
        """State of a recurrent model, zeros before its first step."""
        if not isinstance(model, ScandotRecurrentModel):
            return None
        state = model.get_hidden_state()
        if state is None:
            zeros = torch.zeros(1, self.storage.num_envs, model.rnn_hidden_dim, device=self.device)
            state = (zeros, zeros)
        return state
