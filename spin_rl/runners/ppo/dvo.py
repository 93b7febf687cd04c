"""Decoupled visuomotor optimization, phase 1b: learn to see what a policy that sees everything needs.

Source: SPIN section 2.1.2, DVO. Phase 1a is plain PPO on all local scandots with the camera frozen.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from spin_rl.models import ScandotModel
from spin_rl.ranges import Share, Weight
from spin_rl.runners.interface import Camera
from spin_rl.runners.policy_file import TrainedPolicy, read_policy
from spin_rl.runners.ppo.algorithm import PPO
from spin_rl.runners.ppo.storage import Batch
from spin_rl.runners.warm_start import camera_was_frozen


class Teacher:
    """A trained policy of phase 1a that names the robot's actions in the states that another one visits."""

    def __init__(self, model: ScandotModel, num_actions: int, camera: Camera, blind: bool) -> None:
        """Freeze the policy.

        Args:
            model: The policy; its memory is its own.
            num_actions: Actions of the environment.
            camera: The environment's camera; its actions are not the teacher's to name.
            blind: The teacher never saw the camera move: it shall not see it now, but the means of its own
                training instead.
        """
        self.model = model.eval().requires_grad_(False)
        device = next(model.parameters()).device
        robot = [action for action in range(num_actions) if action not in camera.actions]
        self.actions = torch.tensor(robot, device=device)
        self._hidden: dict[str, tuple[torch.Tensor, torch.Tensor]] = {}
        if blind:
            places = iter(camera.columns_of(model))
            mean = model.obs_normalizer.state_dict()["_mean"][0]
            for group in model.flat_dims:
                columns = torch.tensor(camera.columns.get(group, ()), dtype=torch.long, device=device)
                if len(columns):
                    values = mean[[next(places) for _ in columns]]
                    self._hidden[group] = (columns, values)

    @classmethod
    def load(
        cls, source: str | Path, obs: TensorDict, num_actions: int, camera: Camera, device: str
    ) -> Teacher:
        """Read a policy.

        Args:
            source: Name of a shipped policy, a policy file, a checkpoint or a run's folder.
            obs: Observations of the environment.
            num_actions: Its number of actions.
            camera: Its camera.
            device: Torch device.

        Raises:
            FileNotFoundError: There is no such policy.
            ValueError: It does not fit; one line that names what differs.
        """
        policy = read_policy(source)
        check_teacher(policy)
        if policy.metadata["num_actions"] != num_actions:
            raise ValueError(
                f"teacher: {source} has {policy.metadata['num_actions']} actions, the environment "
                f"{num_actions}."
            )
        try:
            model = policy.build(obs, device)
        except ValueError as error:
            raise ValueError(f"teacher: {error}") from None
        return cls(model, num_actions, camera, blind=camera_was_frozen(policy))

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return the robot's actions in [-1, 1], shape (num_envs, number of them), and go on in memory."""
        if self._hidden:
            obs = obs.clone(recurse=False)
            for group, (columns, values) in self._hidden.items():
                obs[group] = obs[group].index_copy(-1, columns, values.expand(*obs.batch_size, -1))
        return self.model(obs).index_select(-1, self.actions).clamp(-1.0, 1.0)


def check_teacher(policy: TrainedPolicy) -> None:
    """Reject a policy that cannot teach: a teacher sees all scandots, and what it sees is normalized.

    Raises:
        ValueError: It cannot teach; one line that says why.
    """
    groups = policy.metadata["obs_groups"]
    if "scandots_all" not in groups:
        raise ValueError(
            f"teacher: {policy.name} reads {', '.join(groups)}; a teacher reads scandots_all, train one with "
            "algo=dvo1a."
        )
    if camera_was_frozen(policy) and not policy.metadata["actor"].get("obs_normalization", True):
        raise ValueError(
            f"teacher: {policy.name} was trained with a frozen camera and without obs_normalization."
        )


def action_error(actions: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Differences between actions and targets in [-1, 1]; beyond a limit that a target is at is no error."""
    error = actions - targets
    outside = (targets * error > 0.0) & (targets.abs() >= 1.0)
    return error.masked_fill(outside, 0.0)


class ImitationPPO(PPO):
    """PPO on a reward for acting as a teacher does, with a supervised loss that fades out.

    The reward is `task_reward` times the task's, less `imitation_reward` times the distance between the
    robot's actions and the teacher's in the same state (paper: the distance alone). The camera's actions
    are not compared: they are worth what they let the policy know. The supervised loss is the mean squared
    error of the mean actions, for which being further out than a teacher at the limit is no error; it
    helps at first, but moves the policy so far that an adaptive learning rate falls, so it ends.
    """

    def __init__(
        self,
        *args: Any,
        teacher: Teacher,
        task_reward: Weight = 1.0,
        imitation_reward: Weight = 0.05,
        imitation_loss: Weight = 0.5,
        imitation_anneal: Share = 0.5,
        bootstrap_ends: bool = False,
        **settings: Any,
    ) -> None:
        """Initialize as PPO.

        Args:
            args: As of PPO.
            teacher: Its policy, from a configuration the name or path of it.
            task_reward: Factor on the environment's reward.
            imitation_reward: Penalty per unit of distance between the actions, at each step.
            imitation_loss: Weight of the supervised loss at the start.
            imitation_anneal: Part of the run over which that weight falls to zero, linearly.
            bootstrap_ends: Every end of an episode counts as an interruption, with the value of going on.
                Of penalties alone a policy would otherwise learn to end its episodes early.
            settings: As of PPO.
        """
        super().__init__(*args, **settings)
        self.imitation_loss, self.imitation_anneal = imitation_loss, imitation_anneal
        self.progress = 0.0
        self.teacher = teacher
        self.task_reward = task_reward
        self.imitation_reward = imitation_reward
        self.bootstrap_ends = bootstrap_ends
        self.storage.targets = self.storage.actions.new_zeros(*self.storage.dones.shape, len(teacher.actions))

    @property
    def models(self) -> tuple[ScandotModel, ...]:
        """Actor, critic and teacher."""
        return (*super().models, self.teacher.model)

    @property
    def imitation_weight(self) -> float:
        """Current weight of the supervised loss."""
        return self.imitation_loss * max(0.0, 1.0 - self.progress / self.imitation_anneal)

    def set_progress(self, progress: float) -> None:
        """Take note of the part of the run that is over; it never falls, as when a run is resumed."""
        super().set_progress(progress)
        self.progress = max(self.progress, min(progress, 1.0))

    def extra_state(self) -> dict[str, float]:
        """Return how far the supervised loss has faded."""
        return {"progress": self.progress}

    def load_extra_state(self, state: dict[str, float]) -> None:
        """Restore it."""
        self.progress = state["progress"]

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> PPO:
        """Build everything, the teacher too."""
        teacher = Teacher.load(cfg["algorithm"]["teacher"], obs, env.num_actions, Camera.of(env), device)
        return PPO.construct_algorithm(
            obs, env, cfg | {"algorithm": cfg["algorithm"] | {"teacher": teacher}}, device
        )

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Sample actions, and note what the teacher would do."""
        assert self.storage.targets is not None
        self.storage.targets[self.storage.step].copy_(self.teacher(obs))
        return super().act(obs)

    def process_env_step(
        self, obs: TensorDict, rewards: torch.Tensor, dones: torch.Tensor, extras: dict[str, torch.Tensor]
    ) -> None:
        """Store the outcome of a step with the reward for imitation; see `PPO.process_env_step`."""
        distance = self._distance(self.storage.step)
        rewards = self.task_reward * rewards - self.imitation_reward * distance
        if self.bootstrap_ends:
            extras = extras | {"time_outs": dones > 0}
        super().process_env_step(obs, rewards, dones, extras)
        self.teacher.model.reset(dones)

    def update(self) -> dict[str, float]:
        """Learn from the rollout; adds the mean reward for imitation of a step, and the loss's weight."""
        distance = self._mean_of_processes(self._distance(slice(None)).mean()).item()
        losses = super().update()
        return losses | {
            "imitation_weight": self.imitation_weight,
            "Reward/imitation": -self.imitation_reward * distance,
            "Reward/teacher_distance": distance,
        }

    def _distance(self, step: int | slice) -> torch.Tensor:
        """Distance between the robot's actions, as executed, and the teacher's, shape (..., num_envs)."""
        assert self.storage.targets is not None
        own = self.storage.actions[step].index_select(-1, self.teacher.actions).clamp(-1.0, 1.0)
        return (own - self.storage.targets[step]).norm(dim=-1)

    def _extra_losses(self, batch: Batch) -> dict[str, tuple[float, torch.Tensor]]:
        assert batch.targets is not None
        actions = self.actor.output_mean.index_select(-1, self.teacher.actions)
        return {"imitation": (self.imitation_weight, action_error(actions, batch.targets).square().mean())}
