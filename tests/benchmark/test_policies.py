import pytest
import torch
from tensordict import TensorDict

from spin_rl.benchmark import policies
from spin_rl.config import ConfigError
from spin_rl.tasks.fetch.spec import FETCH


def open_fetch(nav, pick):
    return policies.open_for(FETCH, {"policy": nav, "pick": pick})


OBS = TensorDict({"proprio": torch.zeros(5, 31)}, batch_size=[5])


def test_zero_policy():
    policy = policies.open_policy("zero").make(OBS, "cpu")
    policy.reset(torch.ones(5))
    assert torch.equal(policy(OBS), torch.zeros(5, 10))


def test_random_policy_is_in_range_and_repeatable():
    first, second = (policies.open_policy("random").make(OBS, "cpu") for _ in range(2))
    actions = torch.stack([first(OBS) for _ in range(200)])
    assert actions.shape == (200, 5, 10)
    assert -1.0 <= actions.min() < -0.95 and 0.95 < actions.max() <= 1.0
    assert actions.mean().abs() < 0.05
    assert torch.equal(second(OBS), actions[0])


def test_untrained_policies_have_no_configuration():
    assert policies.open_policy("zero").trained == policies.open_policy("random").trained == {}


def test_a_missing_policy_lists_what_there_is():
    with pytest.raises(ConfigError, match=r"^policy: .*'nav-typo'.*zero, random"):
        policies.open_policy("nav-typo")


def test_a_damaged_policy_names_the_key(tmp_path):
    path = tmp_path / "broken.safetensors"
    path.write_bytes(b"nothing of the sort")
    with pytest.raises(ConfigError, match=r"^policy: "):
        policies.open_policy(str(path))


@pytest.mark.parametrize(
    ("nav", "picker", "sees"), [("nav-dvo", "pick-teacher", False), ("nav-cvo-depth", "pick-depth", True)]
)
def test_the_shipped_policy_that_picks_sees_what_the_driver_sees(nav, picker, sees):
    source = open_fetch(nav, None)
    assert source.names == {"policy": nav, "pick": picker}
    trained = source.trained
    assert trained["task"]["depth"]["enabled"] == sees
    assert trained["task"]["sight"]["far_m"] == 4.0 and trained["task"]["scandots"]["window_m"] == 2.0


def test_a_fetch_has_both_policies():
    source = open_fetch("zero", "random")
    assert source.names["pick"] == "random" and "robot" not in source.trained
    obs = TensorDict({"stage": torch.tensor([[0.0], [2.0]])}, batch_size=[2])
    policy = source.make(obs, "cpu")
    policy.reset()
    actions = policy(obs)
    assert not actions[0].any() and actions[1].all()


@pytest.mark.parametrize(
    ("nav", "pick", "message"),
    [
        ("nav-typo", None, "^policy: There is no policy 'nav-typo'"),
        ("zero", "pick-typo", "^pick: There is no policy 'pick-typo'"),
        ("pick-teacher", None, "^policy: pick-teacher was trained with task=pick; .* task=nav$"),
        ("zero", "nav-cvo", "^pick: nav-cvo was trained with task=nav; .* task=pick$"),
    ],
)
def test_policies_that_cannot_fetch_are_refused(nav, pick, message):
    with pytest.raises(ConfigError, match=message):
        open_fetch(nav, pick)
