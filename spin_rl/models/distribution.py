"""The policy's action distribution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import torch
from rsl_rl.modules import GaussianDistribution

from spin_rl.config import Range
from spin_rl.models.settings import Deviation, DeviationRange


class PerActionGaussian(GaussianDistribution):
    """Gaussian whose initial standard deviation differs between actions.

    One value for all is too much for the arm and too little for the base: an arm that swings at random ends
    most episodes at a wall before the base has moved.
    """

    def __init__(
        self,
        output_dim: int,
        init_std: Sequence[Deviation] = (1.0,),
        std_range: DeviationRange = (1e-6, 1e6),
        num_used: Annotated[int, Range(1, 1000)] | None = None,
    ) -> None:
        """Initialize with learned log standard deviations.

        Args:
            output_dim: Number of actions.
            init_std: One value for each action.
            std_range: Lowest and highest standard deviation.
            num_used: Only so many of the actions, the first ones, count in probability, entropy and
                divergence; the environment ignores the others, so what they are must teach nothing. None
                for all.

        Raises:
            ValueError: Not one value per action, a value that is not positive, or an impossible `num_used`.
        """
        if num_used is not None and not 0 < num_used <= output_dim:
            raise ValueError(
                f"actor.distribution_cfg.num_used must be 1 to {output_dim} or none, not {num_used}."
            )
        if len(init_std) != output_dim or min(init_std) <= 0.0:
            raise ValueError(
                f"actor.distribution_cfg.init_std needs {output_dim} positive values, got {list(init_std)}."
            )
        super().__init__(output_dim, init_std=1.0, std_range=std_range, std_type="log")
        with torch.no_grad():
            self.log_std_param.copy_(torch.tensor(init_std, dtype=torch.float32).log())
        self.num_used = num_used

    def sample(self) -> torch.Tensor:
        """Draw actions, shape (..., output_dim).

        The same numbers as `torch.distributions.Normal.sample`, which waits for the device in every step: its
        `torch.normal` checks on the host that no standard deviation is negative.
        """
        normal: Any = self._distribution
        with torch.no_grad():
            return torch.randn_like(normal.loc).mul_(normal.scale).add_(normal.loc)

    @property
    def entropy(self) -> torch.Tensor:
        """Return the entropy of the used actions, shape (...)."""
        normal: Any = self._distribution
        return normal.entropy()[..., : self.num_used].sum(dim=-1)

    def log_prob(self, outputs: torch.Tensor) -> torch.Tensor:
        """Return the log probability of the used ones among actions (..., output_dim), shape (...)."""
        normal: Any = self._distribution
        return normal.log_prob(outputs)[..., : self.num_used].sum(dim=-1)

    def kl_divergence(
        self, old_params: tuple[torch.Tensor, ...], new_params: tuple[torch.Tensor, ...]
    ) -> torch.Tensor:
        """Return KL(old || new) of the used actions, shape (...), of means and standard deviations."""
        old, new = (
            tuple(parameter[..., : self.num_used] for parameter in parameters)
            for parameters in (old_params, new_params)
        )
        return super().kl_divergence(old, new)
