"""Policies as small files: weights as safetensors, with all that is needed to use them in the header.

There, too, is the file's SHA-256, of the bytes as they are with zeros in its place.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors
import torch
from rsl_rl.utils import resolve_class
from safetensors.torch import load, save
from tensordict import TensorDict

from spin_rl.files import write_atomically
from spin_rl.models import ScandotModel
from spin_rl.policy import METADATA_KEY, find_policy
from spin_rl.runners.checkpoint import find_checkpoint, load_module_state
from spin_rl.runners.config import check_model
from spin_rl.runners.contents import check_checkpoint, check_policy

FORMAT_VERSION = 2
_WITHOUT_CHECKSUM = 1
_CHECKSUM = "sha256"
_NO_DIGEST = b"0" * 64


def save_policy(path: Path, checkpoint: str | Path, facts: dict[str, Any] | None = None) -> dict[str, Any]:
    """Write the actor of a checkpoint as a policy file.

    Args:
        path: Destination, `<name>.safetensors`.
        checkpoint: Checkpoint file or run folder.
        facts: What a reader should know beside it, such as the training command and the hardware.

    Returns:
        The metadata that was written.

    Raises:
        FileNotFoundError: There is no checkpoint.
        ValueError: The name has another suffix, or the checkpoint cannot be read.
    """
    if path.suffix != ".safetensors":
        raise ValueError(f"A policy file is named <name>.safetensors, not {path.name}.")
    policy = read_policy(checkpoint)
    metadata = {**policy.metadata, "version": FORMAT_VERSION, "facts": facts or {}}
    write_policy(path, policy.weights, metadata)
    return metadata


def write_policy(path: Path, weights: Mapping[str, torch.Tensor], metadata: Mapping[str, Any]) -> None:
    """Write a policy file.

    Args:
        path: Destination, `<name>.safetensors`.
        weights: Those of the actor.
        metadata: See `TrainedPolicy`.

    Raises:
        OSError: It cannot be written.
    """
    header = {METADATA_KEY: json.dumps(metadata), _CHECKSUM: _NO_DIGEST.decode()}
    data = save({key: tensor.contiguous() for key, tensor in weights.items()}, header)
    data = data.replace(_NO_DIGEST, hashlib.sha256(data).hexdigest().encode(), 1)
    write_atomically(path, lambda file: file.write(data))


@dataclass(frozen=True)
class TrainedPolicy:
    """A trained actor as it was read, once; see `read_policy`.

    Attributes:
        name: What it was asked for by.
        weights: Those of the actor, on the CPU.
        metadata: obs_groups (names), obs_dims, num_actions, actor (class and arguments), config (whole
            configuration of the run), env_steps, iteration, minutes, and facts where given.
    """

    name: str
    weights: Mapping[str, torch.Tensor]
    metadata: Mapping[str, Any]

    @property
    def config(self) -> Mapping[str, Any]:
        """Configuration of the run, nested; empty where there is none."""
        return self.metadata["config"] or {}

    def build(self, obs: TensorDict | None = None, device: str = "cpu") -> ScandotModel:
        """Build the actor, ready to act.

        Args:
            obs: Observations of the environment that it shall act in, checked against those it was trained
                on.
            device: Torch device.

        Returns:
            The model in evaluation mode; `model(obs)` gives its deterministic actions of shape (num_envs,
            num_actions), `model.reset(dones)` clears the memory of the environments that are done.

        Raises:
            ValueError: It is damaged, or does not fit the observations; one line that names what differs.
        """
        description = self.metadata["actor"]
        dims = {group: self.metadata["obs_dims"][group] for group in self.metadata["obs_groups"]}
        if obs is not None:
            self._check(obs, dims)
        actor = build_model(description, "actor", dims, self.metadata["num_actions"])
        load_module_state(actor, dict(self.weights), "actor", self.name)
        return actor.to(device).eval().requires_grad_(False)

    def _check(self, obs: TensorDict, dims: Mapping[str, int]) -> None:
        # A PointNet takes any number of scandots, as in scenes with more obstacles.
        takes_any_number = self.metadata["actor"].get("encoder", "pointnet") == "pointnet"
        for group, dim in dims.items():
            found = obs[group].shape[-1] if group in obs else None
            if found is None or (found != dim and not (takes_any_number and group.startswith("scandots"))):
                raise ValueError(
                    f"{self.name} reads '{group}' of size {dim}; the environment's has size {found}."
                )


def load_policy(name_or_path: str | Path, obs: TensorDict | None = None, device: str = "cpu") -> ScandotModel:
    """Read a policy and build its actor; see `read_policy` and `TrainedPolicy.build`."""
    return read_policy(name_or_path).build(obs, device)


def build_model(cfg: dict[str, Any], name: str, dims: dict[str, int], output_dim: int) -> ScandotModel:
    """Build a model from a file's description.

    The file names classes: only models and distributions are built from it.

    Args:
        cfg: `class_name` and arguments.
        name: "actor" or "critic".
        dims: Sizes of the observation groups that it reads, in its order.
        output_dim: Number of outputs.

    Raises:
        ValueError: It is no model, or has other arguments; one line that names the key.
    """
    check_model(cfg, name)
    example = TensorDict({group: torch.zeros(1, dim) for group, dim in dims.items()}, batch_size=[1])
    model_class, arguments = resolve_class(cfg)
    return model_class(example, {name: list(dims)}, name, output_dim, **arguments)


def read_policy(name_or_path: str | Path) -> TrainedPolicy:
    """Read weights and metadata of a policy.

    Args:
        name_or_path: Name of a shipped policy, a policy file, a checkpoint or a run's folder.

    Raises:
        FileNotFoundError: There is no such policy.
        ValueError: It is damaged.
    """
    path = find_policy(name_or_path)
    if path.suffix == ".safetensors":
        return TrainedPolicy(str(name_or_path), *_read_policy_file(path))
    found, state = find_checkpoint(path)
    runner, run = check_checkpoint(state, str(found))
    metadata = {
        "version": FORMAT_VERSION,
        "obs_groups": list(runner.obs_groups["actor"]),
        "obs_dims": state["obs_dims"],
        "num_actions": state["num_actions"],
        "actor": runner.actor,
        "config": run,
        **{key: state[key] for key in ("env_steps", "iteration", "minutes")},
    }
    return TrainedPolicy(str(name_or_path), state["actor"], metadata)


def _read_policy_file(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Read and check a file.

    Raises:
        ValueError: It is damaged or none of this project's; one line that names the file.
    """
    try:
        content = path.read_bytes() if path.is_file() else b""
        weights = load(content)
        header = _header(content)
        metadata = json.loads(header[METADATA_KEY])
    # The tensors, the header and the JSON in it each have their own errors.
    except (safetensors.SafetensorError, LookupError, TypeError, ValueError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(f"{path} is not a policy file of this project: {reason}") from error
    version = metadata.get("version") if isinstance(metadata, dict) else None
    if version not in (FORMAT_VERSION, _WITHOUT_CHECKSUM):
        raise ValueError(f"{path} has format version {version}; this program reads {FORMAT_VERSION}.")
    digest = str(header.get(_CHECKSUM, "")).encode()
    if version == FORMAT_VERSION or digest:
        data = content.replace(digest, _NO_DIGEST, 1) if len(digest) == len(_NO_DIGEST) else b""
        if hashlib.sha256(data).hexdigest().encode() != digest:
            raise ValueError(f"{path} is damaged: its content does not have its checksum.")
    check_policy(weights, metadata, str(path))
    return weights, metadata


def _header(content: bytes) -> dict[str, Any]:
    """Metadata of a file in safetensors' format: eight bytes of length, then JSON."""
    length = int.from_bytes(content[:8], "little")
    return json.loads(content[8 : 8 + length])["__metadata__"]
