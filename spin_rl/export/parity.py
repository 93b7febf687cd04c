"""Whether an exported policy does what the trained one does: the same inputs for hundreds of steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
import torch
from rsl_rl.modules import EmpiricalNormalization
from tensordict import TensorDict

from spin_rl.deploy.contract import STATE, Parity
from spin_rl.deploy.network import Network
from spin_rl.groups import is_depth, is_encoded
from spin_rl.models.pointnet import NUM_FLAGS, TOKEN_DIM
from spin_rl.models.scandot import ScandotRecurrentModel

NUM_STEPS = 500
TOLERANCE = 1e-4
_EPISODE_STEPS = 60.0


def agrees(parity: Parity) -> bool:
    """Whether both errors are below the tolerance; not a number is not."""
    return parity.action_error < TOLERANCE and parity.state_error < TOLERANCE


def compare(
    network: Network, actor: ScandotRecurrentModel, num_steps: int = NUM_STEPS, seed: int = 0
) -> Parity:
    """Step both with the same random observations, each with its own memory, with resets in between.

    Flat groups are drawn as the actor's normalization knows them from training, images as planes with noise,
    scandot tokens with some valid ones, none at times.

    Args:
        network: The exported policy.
        actor: The trained one, on the CPU.
        num_steps: Steps to make.
        seed: Of the observations.
    """
    rng = np.random.default_rng(seed)
    dims = {group.name: group.size for group in network.contract.observations}
    resets, action_error, state_error = 0, 0.0, 0.0
    for step in range(num_steps):
        if step == 0 or rng.random() < 1.0 / _EPISODE_STEPS:
            network.reset()
            actor.reset()
            resets += 1
        groups = draw(actor, dims, rng)
        exported = network(groups)
        tensors = {name: torch.from_numpy(value) for name, value in groups.items()}
        trained = actor(TensorDict(tensors, batch_size=[1]))
        action_error = max(action_error, float(np.abs(exported - trained.numpy()[0]).max()))
        state = actor.get_hidden_state()
        assert state is not None
        for name, tensor in zip(STATE, state, strict=True):
            state_error = max(state_error, float(np.abs(network.memory[name] - tensor.numpy()).max()))
    return Parity(num_steps, resets, action_error, state_error)


def draw(
    actor: ScandotRecurrentModel, dims: Mapping[str, int], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Draw the observation groups of a step, each of shape (1, size)."""
    flat = [name for name in dims if not is_encoded(name)]
    mean, std = _statistics(actor, sum(dims[name] for name in flat))
    values = (mean + std * rng.standard_normal(len(mean))).astype(np.float32)
    ends = np.cumsum([dims[name] for name in flat])[:-1]
    groups: dict[str, np.ndarray] = {
        name: part[None] for name, part in zip(flat, np.split(values, ends), strict=True)
    }
    for name in dims:
        if is_depth(name):
            slope = rng.uniform(-100.0, 100.0) * np.linspace(-1.0, 1.0, dims[name])
            image = rng.uniform(0.0, 255.0) + slope + rng.normal(scale=20.0, size=dims[name])
            groups[name] = np.clip(image, 0.0, 255.0).astype(np.uint8)[None]
        elif is_encoded(name):
            groups[name] = _tokens(dims[name] // TOKEN_DIM, rng).reshape(1, -1)
    return groups


def _tokens(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw tokens, shape (count, 32): corners in the local window where their flag is set, else zeros."""
    flags = (rng.random((count, NUM_FLAGS)) < rng.uniform(0.0, 0.6)) & (rng.random((count, 1)) < 0.4)
    corners = rng.uniform(-2.0, 2.0, (count, NUM_FLAGS, 3)) * flags[..., None]
    return np.concatenate([corners.reshape(count, -1), flags], axis=-1).astype(np.float32)


def _statistics(actor: ScandotRecurrentModel, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation of the flat groups in training; 0 and 1 where nobody measured."""
    if not actor.obs_normalization:
        return np.zeros(size), np.ones(size)
    normalizer = cast(EmpiricalNormalization, actor.obs_normalizer)
    return normalizer.mean.numpy().ravel(), normalizer.std.numpy().ravel()
