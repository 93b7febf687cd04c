"""Sampling of actions, against Torch's own normal distribution."""

import pytest
import torch
from torch.distributions import Normal

from spin_rl.models import PerActionGaussian


@pytest.mark.parametrize("shape", [(1, 2), (7, 10), (512, 10), (4, 8, 10)])
def test_sample_is_that_of_torch(shape):
    mean = torch.randn(shape, generator=torch.Generator().manual_seed(1), requires_grad=True)
    gaussian = PerActionGaussian(shape[-1], [0.1 + 0.2 * action for action in range(shape[-1])])
    gaussian.update(mean)
    torch.manual_seed(5)
    expected = Normal(mean, gaussian.std).sample()
    after = torch.rand(3)
    torch.manual_seed(5)
    sample = gaussian.sample()
    assert torch.equal(sample, expected)
    assert torch.equal(torch.rand(3), after)  # it takes as much from the generator
    assert not sample.requires_grad
