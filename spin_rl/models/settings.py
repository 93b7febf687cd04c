"""What settings of models are: types that constructors use for their arguments, see `config.check_value`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from spin_rl.config import Choice, Length, Range, Rising

Width = Annotated[int, Range(1, 4096)]
"""Outputs of a layer."""

Widths = Annotated[Sequence[Width], Length(0, 16)]
"""Outputs of the layers one after the other; may be empty."""

Activation = Annotated[
    str,
    Choice(("elu", "selu", "relu", "crelu", "lrelu", "tanh", "sigmoid", "softplus", "gelu", "swish", "mish",
            "identity")),
]  # fmt: skip
"""Name of an activation that rsl_rl knows."""

ScandotEncoder = Annotated[str, Choice(("pointnet", "concat"))]
"""How scandots become a latent."""

Deviation = Annotated[float, Range(0.0, 1e6, above=True)]
"""A standard deviation."""

DeviationRange = Annotated[tuple[Deviation, Deviation], Rising()]
"""Lowest and highest standard deviation."""
