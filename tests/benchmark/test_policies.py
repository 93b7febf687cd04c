import pytest
import torch
from tensordict import TensorDict

from spin_rl.benchmark import policies
from spin_rl.config import ConfigError

OBS = TensorDict({"proprio": torch.zeros(5, 31)}, batch_size=[5])


def test_zero_policy():
    policy = policies.open_policy("zero")[0](OBS, "cpu")
    policy.reset(torch.ones(5))
    assert torch.equal(policy(OBS), torch.zeros(5, 10))


def test_random_policy_is_in_range_and_repeatable():
    first, second = (policies.open_policy("random")[0](OBS, "cpu") for _ in range(2))
    actions = torch.stack([first(OBS) for _ in range(200)])
    assert actions.shape == (200, 5, 10)
    assert -1.0 <= actions.min() < -0.95 and 0.95 < actions.max() <= 1.0
    assert actions.mean().abs() < 0.05
    assert torch.equal(second(OBS), actions[0])


def test_untrained_policies_have_no_configuration():
    assert policies.open_policy("zero")[1] == policies.open_policy("random")[1] == {}


def test_a_missing_policy_lists_what_there_is():
    with pytest.raises(ConfigError, match=r"^policy: .*'nav-typo'.*zero, random"):
        policies.open_policy("nav-typo")


def test_a_damaged_policy_names_the_key(tmp_path):
    path = tmp_path / "broken.safetensors"
    path.write_bytes(b"nothing of the sort")
    with pytest.raises(ConfigError, match=r"^policy: "):
        policies.open_policy(str(path))
