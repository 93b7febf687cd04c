"""Encoders that compress scandot tokens into one latent vector."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from rsl_rl.utils import resolve_nn_activation
from torch import nn

TOKEN_DIM = 32
"""Numbers in a scandot token: eight corners x, y, z [m] in the base frame, then eight validity flags."""
NUM_FLAGS = 8
"""Validity flags at the end of a token, one for each corner of the bounding box."""


def token_mlp(input_dim: int, hidden: Sequence[int], output_dim: int, activation: str) -> nn.Sequential:
    """Build linear layers with an activation between them; `hidden` may be empty."""
    layers: list[nn.Module] = []
    for width in hidden:
        layers += [nn.Linear(input_dim, width), resolve_nn_activation(activation)]
        input_dim = width
    return nn.Sequential(*layers, nn.Linear(input_dim, output_dim))


class PointNet(nn.Module):
    """Permutation-invariant latent of a set of tokens: one MLP for all, then the maximum over the valid ones.

    Source: SPIN section 2.1 (z = P(s)) and supplement, implementation details (latent of size 16).
    """

    def __init__(
        self,
        token_dim: int = 32,
        hidden: Sequence[int] = (64, 64),
        latent: int = 16,
        activation: str = "relu",
    ) -> None:
        super().__init__()
        self.latent = latent
        self.mlp = token_mlp(token_dim, hidden, latent, activation)

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        """Encode tokens (..., num_tokens, token_dim) as (..., latent); zeros where no token is valid.

        A token is valid if any of its flags, its last eight numbers, is set.
        """
        valid = tokens[..., -NUM_FLAGS:].amax(dim=-1) > 0
        # Choosing the valid ones needs their number on the host, and ONNX has no maximum of segments.
        if tokens.is_cuda or torch.compiler.is_exporting():
            per_token = self.mlp(tokens).masked_fill(~valid.unsqueeze(-1), -torch.inf)
            largest = per_token.max(dim=-2).values
        else:
            # Most tokens are masked: cost follows the number of valid ones.
            index = valid.flatten().nonzero().squeeze(1)
            chosen = self.mlp(tokens.flatten(0, -2).index_select(0, index))
            counts = valid.sum(dim=-1)
            largest = torch.segment_reduce(chosen, "max", lengths=counts.flatten(), axis=0)
            largest = largest.view(*counts.shape, self.latent)
        return torch.where(valid.any(dim=-1, keepdim=True), largest, 0.0)


class NoPointNet(nn.Module):
    """Latent of the concatenated tokens, an ablation of the paper: it depends on the order of the obstacles.

    Source: SPIN section 3, baseline NoPointNet.
    """

    def __init__(
        self,
        num_tokens: int,
        token_dim: int = 32,
        hidden: Sequence[int] = (64, 64),
        latent: int = 16,
        activation: str = "relu",
    ) -> None:
        super().__init__()
        self.latent = latent
        self.mlp = token_mlp(num_tokens * token_dim, hidden, latent, activation)

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        """Encode tokens of shape (..., num_tokens, token_dim) as (..., latent)."""
        return self.mlp(tokens.flatten(-2))


def make_scandot_encoder(
    kind: str, group: str, size: int, hidden: Sequence[int], latent: int
) -> PointNet | NoPointNet:
    """Build the encoder of an observation group.

    Args:
        kind: "pointnet" or "concat".
        group: Name of the group.
        size: Its numbers per environment.
        hidden: Hidden layers.
        latent: Size of the latent.

    Raises:
        ValueError: The group is not a whole number of tokens.
    """
    num_tokens, rest = divmod(size, TOKEN_DIM)
    if rest:
        raise ValueError(f"Observation group '{group}' is not a whole number of {TOKEN_DIM}-float tokens.")
    if kind == "pointnet":
        return PointNet(TOKEN_DIM, hidden, latent)
    return NoPointNet(num_tokens, TOKEN_DIM, hidden, latent)
