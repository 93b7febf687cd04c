"""The policy's action distribution."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from rsl_rl.modules import GaussianDistribution


class PerActionGaussian(GaussianDistribution):
    """Gaussian whose initial standard deviation differs between actions.

    One value for all is too much for the arm and too little for the base: an arm that swings at random ends most
    episodes at a wall before the base has moved.
    """

    def __init__(
        self,
        output_dim: int,
        init_std: Sequence[float] = (1.0,),
        std_range: tuple[float, float] = (1e-6, 1e6),
    ) -> None:
        """Initialize with learned log standard deviations.

        Args:
            output_dim: Number of actions.
            init_std: One value for each action.
            std_range: Lowest and highest standard deviation.

        Raises:
            ValueError: Not one value per action, or a value that is not positive.
        """
        if len(init_std) != output_dim or min(init_std) <= 0.0:
            raise ValueError(
                f"actor.distribution_cfg.init_std needs {output_dim} positive values, got {list(init_std)}."
            )
        super().__init__(output_dim, init_std=1.0, std_range=std_range, std_type="log")
        with torch.no_grad():
            self.log_std_param.copy_(torch.tensor(init_std, dtype=torch.float32).log())
