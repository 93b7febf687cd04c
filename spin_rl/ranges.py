"""What settings of commands, runners and algorithms may be: types for their fields, see `config`."""

from __future__ import annotations

from typing import Annotated

from spin_rl.config import Range

Count = Annotated[int, Range(1, 10**9)]
NumEnvs = Annotated[int, Range(1, 2**18)]
"""Worlds of a process."""
NumSteps = Annotated[int, Range(1, 10_000)]
"""Environment steps of a rollout."""
Minutes = Annotated[float, Range(0.0, 1e6, above=True)]
Seed = Annotated[int, Range(0, 2**30)]
"""Of 32-bit generators, with room for the seeds that are made of it."""

Epochs = Annotated[int, Range(1, 1000)]
"""Passes over a rollout."""
MiniBatches = Annotated[int, Range(1, 2**18)]
"""Parts of a rollout."""
LearningRate = Annotated[float, Range(0.0, 1.0, above=True)]
GradNorm = Annotated[float, Range(0.0, 1e6, above=True)]
Share = Annotated[float, Range(0.0, 1.0, above=True)]
"""A discount or another part of one."""
Weight = Annotated[float, Range(0.0, 1000.0)]
"""Of a loss or of a reward."""
