"""Distillation of a policy that sees scandots or the object into one that sees depth, on sequences.

Source: SPIN section 2.2 (L2 on the actions of phase 1, DAgger, student initialized from its teacher) and
supplement, asynchronous DAgger training (the actor is frozen at first).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import rsl_rl.algorithms
import torch
from rsl_rl.env import VecEnv
from rsl_rl.utils import resolve_class
from tensordict import TensorDict
from torch import nn

from spin_rl.config import Choice, Range
from spin_rl.models import ScandotModel
from spin_rl.ranges import Epochs, GradNorm, LearningRate, MiniBatches, Weight
from spin_rl.runners.checkpoint import weights_digest
from spin_rl.runners.distillation.sequences import Recorder, Sequences, mean_actions
from spin_rl.runners.distillation.student import build_student
from spin_rl.runners.interface import Camera
from spin_rl.runners.model_copy import copy_model
from spin_rl.runners.policy_file import load_policy
from spin_rl.runners.ppo.algorithm import MAX_LOST_UPDATES
from spin_rl.runners.ppo.dvo import action_error

SCHEDULES = ("fixed", "linear")
STATISTICS = ("actions", "robot", "camera", "latent", "grad_norm", "skipped_steps")


class Distillation(rsl_rl.algorithms.Distillation):
    """DAgger with backpropagation through a whole rollout.

    Differences from rsl_rl: minibatches of whole sequences in place of one batch per step, episode starts
    inside them, the teacher's latent, a student that acts without exploration, a frozen actor at first, and
    steps with non-finite gradients are left out without waiting for the device.
    """

    student: ScandotModel
    teacher: ScandotModel
    max_grad_norm: float

    def __init__(
        self,
        student: ScandotModel,
        teacher: ScandotModel,
        sequences: Sequences,
        camera_actions: Sequence[int] = (),
        num_learning_epochs: Epochs = 1,
        num_mini_batches: MiniBatches = 4,
        freeze_iterations: Annotated[int, Range(0, 10**9)] = 1000,
        latent_loss: Weight = 0.0,
        learning_rate: LearningRate = 1e-3,
        min_learning_rate: LearningRate = 1e-4,
        schedule: Annotated[str, Choice(SCHEDULES)] = "fixed",
        max_grad_norm: GradNorm = 1.0,
        device: str = "cpu",
        multi_gpu_cfg: dict | None = None,
    ) -> None:
        """Initialize.

        Args:
            student: Learns, and acts.
            teacher: Says what it would do in the states that the student visits; it is left as it is.
            sequences: Memory for one rollout; where another process collects, a description on "meta".
            camera_actions: Actions that move the camera, for the statistics.
            num_learning_epochs: Passes over a rollout.
            num_mini_batches: Parts of a rollout, split by environment.
            freeze_iterations: Iterations in which only the encoder learns.
            latent_loss: Weight of the mean squared difference between the student's latent and what it
                stands for, beyond the paper.
            learning_rate: Of Adam, at the start.
            min_learning_rate: At the end of the "linear" schedule.
            schedule: "fixed", or "linear" over the run.
            max_grad_norm: Clip range of the gradient norm.
            device: Torch device.
            multi_gpu_cfg: Ranks of a data-parallel run, from the runner.
        """
        super().__init__(
            student,
            teacher,
            sequences,  # pyright: ignore[reportArgumentType] - the base class only keeps it
            num_learning_epochs=num_learning_epochs,
            gradient_length=sequences.num_steps,
            learning_rate=learning_rate,
            max_grad_norm=max_grad_norm,
            device=device,
            multi_gpu_cfg=multi_gpu_cfg,
        )
        self.teacher.eval().requires_grad_(False)
        self.optimizer = torch.optim.Adam(student.parameters(), lr=learning_rate, fused=True)
        self.sequences = sequences
        self.recorder = Recorder(self.student, self.teacher, sequences)
        self.num_mini_batches = num_mini_batches
        self.freeze_iterations = freeze_iterations
        self.latent_loss = latent_loss
        self.schedule = schedule
        self.initial_learning_rate = learning_rate
        self.min_learning_rate = min_learning_rate
        self.lost_updates = 0
        num_actions = sequences.targets.shape[-1]
        robot = [action for action in range(num_actions) if action not in camera_actions]
        self._robot = torch.tensor(robot, dtype=torch.long, device=device)
        self._camera = torch.tensor(list(camera_actions), dtype=torch.long, device=device)

    @property
    def trained(self) -> dict[str, ScandotModel]:
        """Models that a checkpoint holds, by name."""
        return {"actor": self.student}

    @property
    def models(self) -> tuple[ScandotModel, ...]:
        """Models whose memory follows the episodes."""
        return (self.student, self.teacher)

    @property
    def actor_is_frozen(self) -> bool:
        """Whether the next update changes nothing but the encoder."""
        return self.num_updates < self.freeze_iterations

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> Distillation:
        """Build the models, the student as its teacher but for the encoder, and the algorithm.

        Raises:
            FileNotFoundError: There is no such teacher.
            ValueError: It does not fit; one line that says why.
        """
        algorithm_class, algorithm_cfg = resolve_class(cfg["algorithm"])
        source = algorithm_cfg.pop("teacher")
        try:
            teacher = load_policy(source, obs)
            student = build_student(obs, cfg, env.num_actions)
            copy_model(student, teacher, Camera())
        except ValueError as error:
            raise ValueError(f"teacher: {source} cannot be distilled: {error}") from None
        memory = "meta" if getattr(env, "is_remote", False) else device
        sequences = Sequences.allocate(obs, student, cfg["num_steps_per_env"], env.num_actions, memory)
        return algorithm_class(
            student,
            teacher,
            sequences,
            camera_actions=Camera.of(env).actions,
            device=device,
            multi_gpu_cfg=cfg["multi_gpu"],
            **algorithm_cfg,
        )

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Let the student act, without exploration, and store what it saw and what the teacher would do.

        Args:
            obs: Observations of both.

        Returns:
            Actions, shape (num_envs, num_actions).
        """
        return self.recorder.act(obs)

    def process_env_step(
        self, obs: TensorDict, rewards: torch.Tensor, dones: torch.Tensor, extras: dict[str, torch.Tensor]
    ) -> None:
        """Note where episodes ended, shape (num_envs,); the other arguments are not used."""
        self.recorder.note_ends(dones)

    def update(self) -> dict[str, float]:
        """Learn from the rollout just made; see `learn`."""
        self.recorder.begin(self.sequences)
        return self.learn(self.sequences)

    def learn(self, sequences: Sequences) -> dict[str, float]:
        """Learn from sequences; return mean losses, the number of skipped steps and `actor_is_frozen`.

        Raises:
            FloatingPointError: Several calls in a row allowed no step at all.
        """
        frozen = self.actor_is_frozen
        self._freeze_actor(frozen)
        self.num_updates += 1
        records = []
        for _ in range(self.num_learning_epochs):
            order = torch.randperm(sequences.num_envs, device=sequences.resets.device)
            for index in order.tensor_split(self.num_mini_batches):
                records.append(self._learn_from(sequences.select(index, self.device)))
        table = torch.stack(records)
        if self.is_multi_gpu:
            torch.distributed.all_reduce(table)
            table = table / self.gpu_world_size
        rows = table.tolist()  # the only wait for the device
        done = [row for row in rows if math.isfinite(row[STATISTICS.index("grad_norm")])]
        self.lost_updates = 0 if done else self.lost_updates + 1
        if self.lost_updates >= MAX_LOST_UPDATES:
            raise FloatingPointError(
                f"Losses or gradients were not finite in {MAX_LOST_UPDATES} whole updates in a row."
            )
        means = {
            name: sum(column) / len(done)
            for name, column in zip(STATISTICS, zip(*done, strict=True), strict=False)
        }
        return means | {"skipped_steps": float(len(rows) - len(done)), "actor_is_frozen": float(frozen)}

    def set_progress(self, progress: float) -> None:
        """Set the schedule's learning rate; the configured one holds for a resumed run too.

        Args:
            progress: Part of the run that is over, from 0 to 1.
        """
        start = self.initial_learning_rate
        end = self.min_learning_rate if self.schedule == "linear" else start
        self.learning_rate = start + (end - start) * min(progress, 1.0)
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate

    def extra_state(self) -> dict[str, Any]:
        """Return what a checkpoint has to keep beside models, optimizer and learning rate."""
        return {"updates": self.num_updates, "teacher": weights_digest(self.teacher)}

    def load_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what `extra_state` returned.

        Raises:
            ValueError: The run began with another teacher.
        """
        # Old checkpoints do not tell which teacher they had.
        if state.get("teacher") not in (None, weights_digest(self.teacher)):
            raise ValueError(
                "teacher: its weights are not those that this run began with; a run's folder stands for its "
                "newest checkpoint, so name the same file as then."
            )
        self.num_updates = int(state["updates"])

    def _freeze_actor(self, frozen: bool) -> None:
        """Let the optimizer pass over all but the encoders: a parameter without gradient is left alone."""
        encoders = {id(parameter) for parameter in self.student.encoders.parameters()}
        for parameter in self.student.parameters():
            parameter.requires_grad_(not frozen or id(parameter) in encoders)

    def _learn_from(self, batch: Sequences) -> torch.Tensor:
        """Make one optimizer step; return `STATISTICS` without waiting for the device."""
        student = self.student
        x = student.encode(batch.observations)
        output = student.decode(x, hidden_state=batch.state, resets=batch.resets)
        errors = action_error(mean_actions(student, output), batch.targets).square().mean(dim=(0, 1))
        latent = (x[..., -student.num_latents :] - batch.latents).square().mean()
        loss = errors.mean()
        if self.latent_loss > 0.0:
            loss = loss + self.latent_loss * latent

        self.optimizer.zero_grad()
        loss.backward()
        if self.is_multi_gpu:
            self.reduce_parameters()
        norm = nn.utils.clip_grad_norm_(student.parameters(), self.max_grad_norm)
        skipped = (~norm.isfinite()).float()
        # Adam leaves out a step where this is not zero; it is set from outside, as by torch's GradScaler.
        self.optimizer.found_inf = skipped  # pyright: ignore[reportAttributeAccessIssue]
        self.optimizer.step()
        robot, camera = errors.index_select(0, self._robot), errors.index_select(0, self._camera)
        numbers = (errors.mean(), robot.mean(), camera.sum() / max(len(camera), 1), latent, norm, skipped)
        return torch.stack(numbers).detach()
