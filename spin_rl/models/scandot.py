"""Actors and critics that read proprioception, goal and scandots or depth; subclasses of rsl_rl's model."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any, cast

import torch
from rsl_rl.models import MLPModel
from rsl_rl.utils import unpad_trajectories
from tensordict import TensorDict
from torch import nn

from spin_rl.groups import HAND_IN_IMAGE, is_depth, is_encoded
from spin_rl.models.depth_encoder import make_depth_encoder
from spin_rl.models.lstm import LSTMState, ResettableLSTM
from spin_rl.models.pointnet import TOKEN_DIM, make_scandot_encoder, token_mlp
from spin_rl.models.settings import Activation, ScandotEncoder, Width, Widths

NORMALIZED_LIMIT = 100.0
"""What the normalizer takes in is cut off here, either way: one wild world must not rule its statistics."""


class ScandotModel(MLPModel):
    """Feed-forward model: flat groups, normalized, with a latent for each group to encode, then an MLP.

    Groups to encode are those whose name starts with "scandots", by a PointNet, or with "depth", by
    convolutions. Scandots are in metres with zeros for what is not seen, and images are in a known range, so
    only the other groups are normalized.
    """

    def __init__(
        self,
        obs: TensorDict,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        hidden_dims: Widths = (256, 128),
        activation: Activation = "elu",
        obs_normalization: bool = True,
        distribution_cfg: dict | None = None,
        encoder: ScandotEncoder = "pointnet",
        encoder_hidden: Widths = (64, 64),
        scandot_latent: Width = 16,
        depth_encoder: Mapping[str, Any] | None = None,
    ) -> None:
        """Build the model.

        Args:
            obs: Observations, each group of shape (num_envs, dim).
            obs_groups: Names of the groups for each observation set.
            obs_set: The set that this model reads, "actor" or "critic".
            output_dim: Number of outputs.
            hidden_dims: Hidden layers between the input (or the LSTM) and the output; may be empty.
            activation: Activation of these layers, a name known to rsl_rl.
            obs_normalization: Normalize the flat groups by running statistics.
            distribution_cfg: Output distribution of rsl_rl; None for a plain output.
            encoder: "pointnet", or "concat" for the paper's NoPointNet ablation.
            encoder_hidden: Hidden layers of the scandot encoder.
            scandot_latent: Size of the latent of each group that is encoded.
            depth_encoder: Layers of the depth encoder, keys of `DepthEncoderConfig`.

        Raises:
            ValueError: A group has no flat shape.
        """
        groups = obs_groups[obs_set]
        self.num_latents = scandot_latent * sum(map(is_encoded, groups))
        # rsl_rl's MLP needs a hidden layer; an output straight from the latent replaces it below.
        super().__init__(
            obs,
            obs_groups,
            obs_set,
            output_dim,
            list(hidden_dims) or [1],
            activation,
            obs_normalization,
            distribution_cfg,
        )
        if not hidden_dims:
            num_outputs = cast(nn.Linear, self.mlp[-1]).out_features
            self.mlp = token_mlp(self._get_latent_dim(), (), num_outputs, activation)
        encoders: dict[str, nn.Module] = {}
        for group in filter(is_encoded, groups):
            size = obs[group].shape[-1]
            if is_depth(group):
                made = make_depth_encoder(depth_encoder or {}, group, size, scandot_latent, self.obs_dim)
                encoders[group] = made
                if made.cfg.hand_window and HAND_IN_IMAGE not in groups:
                    raise ValueError(
                        f"depth_encoder.hand_window needs the observation group {HAND_IN_IMAGE}."
                    )
            else:
                encoders[group] = make_scandot_encoder(encoder, group, size, encoder_hidden, scandot_latent)
        self.encoders = nn.ModuleDict(encoders)

    @property
    def blocks(self) -> dict[str, slice]:
        """Columns of each group, normalized or encoded, in what `encode` returns."""
        sizes: dict[str, int] = {**self.flat_dims}
        sizes |= {group: cast(int, encoder.latent) for group, encoder in self.encoders.items()}
        ends = itertools.accumulate(sizes.values())
        return {group: slice(end - size, end) for (group, size), end in zip(sizes.items(), ends, strict=True)}

    def forward(
        self,
        obs: TensorDict,
        masks: torch.Tensor | None = None,
        hidden_state: LSTMState | None = None,
        stochastic_output: bool = False,
        resets: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute the output, and the distribution if `stochastic_output`.

        Args:
            obs: One step with groups of shape (num_envs, dim), or sequences of shape (num_steps,
                num_envs, dim).
            masks: rsl_rl's mask of padded episodes, shape (num_steps, num_episodes); excludes `resets`.
            hidden_state: State before the first step of sequences.
            stochastic_output: Sample from the distribution.
            resets: True where an episode starts in a sequence, shape (num_steps, num_envs).

        Returns:
            Outputs of shape (..., output_dim) or, of padded episodes, as if they had not been cut.
        """
        if masks is not None and not self.is_recurrent:
            obs = unpad_trajectories(obs, masks)
        output = self.decode(self.encode(obs), masks, hidden_state, resets)
        if self.distribution is None:
            return output
        if stochastic_output:
            self.distribution.update(output)
            return self.distribution.sample()
        return self.distribution.deterministic_output(output)

    def encode(self, obs: TensorDict | Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Concatenate the normalized flat groups and, last, the latents."""
        flat = self.obs_normalizer(torch.cat([obs[group] for group in self.obs_groups], dim=-1))
        latents = [
            encoder(obs[group], flat, obs[HAND_IN_IMAGE] if HAND_IN_IMAGE in self.flat_dims else None)
            if is_depth(group)
            else encoder(obs[group].unflatten(-1, (-1, TOKEN_DIM)))
            for group, encoder in self.encoders.items()
        ]
        return torch.cat([flat, *latents], dim=-1)

    def update_normalization(self, obs: TensorDict) -> None:
        """Learn the statistics of the flat groups from a batch of observations, cut off at a limit."""
        if self.obs_normalization:
            flat = torch.cat([obs[group] for group in self.obs_groups], dim=-1)
            normalizer: Any = self.obs_normalizer
            normalizer.update(flat.clamp(-NORMALIZED_LIMIT, NORMALIZED_LIMIT))

    def get_hidden_state(self) -> LSTMState | None:
        """Return the memory; None without one, or before the first step."""
        return None

    def decode(
        self,
        x: torch.Tensor,
        masks: torch.Tensor | None = None,
        hidden_state: LSTMState | None = None,
        resets: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Map what `encode` returned to the output before its distribution; arguments as of `forward`."""
        return self.mlp(self._latent(x, masks, hidden_state, resets))

    def as_jit(self) -> nn.Module:
        """Not supported: rsl_rl's exporters know neither scandot tokens nor the partial normalization."""
        raise NotImplementedError("Scandot models have no TorchScript export.")

    def as_onnx(self, verbose: bool = False) -> nn.Module:
        """Not supported: rsl_rl's exporters know neither scandot tokens nor the partial normalization."""
        raise NotImplementedError("Scandot models have no export by rsl_rl.")

    def _latent(
        self,
        x: torch.Tensor,
        masks: torch.Tensor | None,
        hidden_state: LSTMState | None,
        resets: torch.Tensor | None,
    ) -> torch.Tensor:
        return x

    def _get_obs_dim(
        self, obs: TensorDict, obs_groups: dict[str, list[str]], obs_set: str
    ) -> tuple[list[str], int]:
        """Keep rsl_rl's fields, observation groups and their dimension, for the flat groups."""
        flat = [group for group in obs_groups[obs_set] if not is_encoded(group)]
        self.flat_dims = {group: obs[group].shape[-1] for group in flat}
        if not flat:
            raise ValueError(f"Observation set '{obs_set}' needs a group beside the scandots and depth.")
        return super()._get_obs_dim(obs, {obs_set: flat}, obs_set)

    def _get_latent_dim(self) -> int:
        return self.obs_dim + self.num_latents


class ScandotRecurrentModel(ScandotModel):
    """Recurrent model: an LSTM between the encoded observations and the MLP.

    Source: SPIN supplement, network architecture (LSTM with 256 units over proprioception, goal and latent).
    With a skip connection the MLP reads the observations too, so that it can start as a feed-forward model.
    """

    is_recurrent: bool = True

    def __init__(
        self,
        obs: TensorDict,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        hidden_dims: Widths = (),
        activation: Activation = "elu",
        obs_normalization: bool = True,
        distribution_cfg: dict | None = None,
        encoder: ScandotEncoder = "pointnet",
        encoder_hidden: Widths = (64, 64),
        scandot_latent: Width = 16,
        depth_encoder: Mapping[str, Any] | None = None,
        rnn_hidden_dim: Width = 256,
        skip: bool = False,
    ) -> None:
        """Build the model.

        Args:
            obs: As all up to `depth_encoder`, see `ScandotModel`.
            obs_groups: Names of the groups for each observation set.
            obs_set: The set that this model reads.
            output_dim: Number of outputs.
            hidden_dims: Hidden layers between the LSTM and the output.
            activation: Activation of these layers.
            obs_normalization: Normalize the flat groups.
            distribution_cfg: Output distribution.
            encoder: "pointnet" or "concat".
            encoder_hidden: Hidden layers of the scandot encoder.
            scandot_latent: Size of the latent of each group that is encoded.
            depth_encoder: Layers of the depth encoder.
            rnn_hidden_dim: Units of the LSTM.
            skip: The MLP reads the encoded observations and the LSTM's output, not only the latter.
        """
        self.rnn_hidden_dim = rnn_hidden_dim
        self.skip = skip
        super().__init__(
            obs,
            obs_groups,
            obs_set,
            output_dim,
            hidden_dims,
            activation,
            obs_normalization,
            distribution_cfg,
            encoder,
            encoder_hidden,
            scandot_latent,
            depth_encoder,
        )
        self.lstm = ResettableLSTM(self.obs_dim + self.num_latents, rnn_hidden_dim)

    def reset(self, dones: torch.Tensor | None = None, hidden_state: LSTMState | None = None) -> None:
        """Clear the state of the environments that are done, or of all; or replace it by `hidden_state`."""
        self.lstm.reset(dones)
        if hidden_state is not None:
            self.lstm.state = hidden_state

    def get_hidden_state(self) -> LSTMState | None:
        """Return the LSTM's state; None before the first step."""
        return self.lstm.state

    def detach_hidden_state(self, dones: torch.Tensor | None = None) -> None:
        """Cut the gradient through the state."""
        if self.lstm.state is not None:
            self.lstm.state = (self.lstm.state[0].detach(), self.lstm.state[1].detach())

    def _latent(
        self,
        x: torch.Tensor,
        masks: torch.Tensor | None,
        hidden_state: LSTMState | None,
        resets: torch.Tensor | None,
    ) -> torch.Tensor:
        out = self._remember(x, masks, hidden_state, resets)
        if not self.skip:
            return out
        return torch.cat([x if masks is None else unpad_trajectories(x, masks), out], dim=-1)

    def _remember(
        self,
        x: torch.Tensor,
        masks: torch.Tensor | None,
        hidden_state: LSTMState | None,
        resets: torch.Tensor | None,
    ) -> torch.Tensor:
        if x.dim() == 2:
            return self.lstm.step(x)
        if hidden_state is None:
            raise ValueError("Sequences need the hidden state before their first step.")
        if masks is not None:
            return unpad_trajectories(self.lstm.rnn(x, hidden_state)[0], masks)
        if resets is None:
            raise ValueError("Sequences need the steps at which an episode starts.")
        return self.lstm.sequence(x, hidden_state, resets)

    def _get_latent_dim(self) -> int:
        return self.rnn_hidden_dim + (self.obs_dim + self.num_latents if self.skip else 0)
