"""What a student learns from: sequences of what it saw, with what its teacher would have done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from tensordict import TensorDict

from spin_rl.groups import replaceable_group
from spin_rl.models import LSTMState, ScandotModel


@dataclass
class Sequences:
    """One rollout of some environments; every tensor starts with (num_steps, num_envs), but the state's.

    Attributes:
        observations: What the student sees, by group; images as 8-bit numbers.
        resets: Whether an episode starts at this step, after the first one.
        targets: The teacher's actions in [-1, 1], shape (num_steps, num_envs, num_actions).
        latents: The teacher's latent of what it sees, or its normalized `object`, shape (num_steps, num_envs,
            size).
        state: The student's state before the first step, None of one without memory.
    """

    observations: dict[str, torch.Tensor]
    resets: torch.Tensor
    targets: torch.Tensor
    latents: torch.Tensor
    state: LSTMState | None

    @classmethod
    def allocate(
        cls, obs: TensorDict, student: ScandotModel, num_steps: int, num_actions: int, device: str
    ) -> Sequences:
        """Make zeros.

        Args:
            obs: Observations of one step.
            student: Reads them.
            num_steps: Length.
            num_actions: Actions of the environment.
            device: Torch device.
        """
        num_envs = obs.batch_size[0]
        shape = (num_steps, num_envs)
        groups = {
            name: torch.zeros(*shape, *obs[name].shape[1:], dtype=obs[name].dtype, device=device)
            for name in (*student.flat_dims, *student.encoders)
        }
        hidden: int = getattr(student, "rnn_hidden_dim", 0)
        state = (
            torch.zeros(1, num_envs, hidden, device=device),
            torch.zeros(1, num_envs, hidden, device=device),
        )
        return cls(
            groups,
            torch.zeros(shape, dtype=torch.bool, device=device),
            torch.zeros(*shape, num_actions, device=device),
            torch.zeros(*shape, student.num_latents, device=device),
            state if student.is_recurrent else None,
        )

    @property
    def num_steps(self) -> int:
        """Length."""
        return self.resets.shape[0]

    @property
    def num_envs(self) -> int:
        """Number of environments."""
        return self.resets.shape[1]

    @property
    def num_transitions_per_env(self) -> int:
        """Length; rsl_rl's name for it."""
        return self.num_steps

    def tensors(self) -> list[torch.Tensor]:
        """All memory."""
        return [*self.observations.values(), self.resets, self.targets, self.latents, *(self.state or ())]

    def select(self, index: torch.Tensor, device: str) -> Sequences:
        """Copy some of the environments.

        Args:
            index: Which, on the sequences' device.
            device: Where to.
        """
        return self._map(lambda tensor: tensor.index_select(1, index).to(device, non_blocking=True))

    def empty_like(self, device: str) -> Sequences:
        """Make memory of the same sizes."""
        return self._map(lambda tensor: torch.zeros_like(tensor, device=device))

    def copy_(self, other: Sequences) -> None:
        """Overwrite everything."""
        for own, value in zip(self.tensors(), other.tensors(), strict=True):
            own.copy_(value)

    def _map(self, function: Callable[[torch.Tensor], torch.Tensor]) -> Sequences:
        groups = {name: function(tensor) for name, tensor in self.observations.items()}
        state = self.state and (function(self.state[0]), function(self.state[1]))
        return Sequences(
            groups,
            function(self.resets),
            function(self.targets),
            function(self.latents),
            state or None,
        )


class Recorder:
    """Lets a student act, without exploration, and notes what it saw and what its teacher would do."""

    def __init__(self, student: ScandotModel, teacher: ScandotModel, sequences: Sequences) -> None:
        """Begin with some memory.

        Args:
            student: Acts.
            teacher: Is asked.
            sequences: Memory for the first rollout.
        """
        self.student = student
        self.teacher = teacher
        self._seen = teacher.blocks[replaceable_group(teacher.blocks)]
        self.begin(sequences)

    def begin(self, sequences: Sequences) -> None:
        """Write the next rollout into this memory."""
        self.sequences = sequences
        self.step = 0

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Note a step and return the student's actions, shape (num_envs, num_actions)."""
        record, step = self.sequences, self.step
        if step == 0:
            record.resets[0] = False  # the state before the first step is clear already
            self._keep_state()
        for name, buffer in record.observations.items():
            buffer[step].copy_(obs[name])
        x = self.teacher.encode(obs)
        record.latents[step].copy_(x[..., self._seen])
        record.targets[step].copy_(mean_actions(self.teacher, self.teacher.decode(x)).clamp(-1.0, 1.0))
        return self.student(obs)

    def note_ends(self, dones: torch.Tensor) -> None:
        """Note where episodes ended in the step made, shape (num_envs,), and clear the memories there."""
        self.step += 1
        if self.step < self.sequences.num_steps:
            self.sequences.resets[self.step].copy_(dones)
        self.student.reset(dones)
        self.teacher.reset(dones)

    def _keep_state(self) -> None:
        if self.sequences.state is not None:
            state = self.student.get_hidden_state()
            for index, buffer in enumerate(self.sequences.state):
                buffer.zero_() if state is None else buffer.copy_(state[index])


def mean_actions(model: ScandotModel, output: torch.Tensor) -> torch.Tensor:
    """Actions without exploration, of what a model's `decode` returned."""
    return output if model.distribution is None else model.distribution.deterministic_output(output)
