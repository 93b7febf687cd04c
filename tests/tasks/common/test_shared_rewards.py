"""Reward terms that tasks share, each against a table of cases, and the check of scales."""

import pytest
import torch
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.tasks.common import rewards

YES_IN_SECOND = torch.tensor([False, True])


def transition(**values) -> rewards.Transition:
    """Two worlds in which nothing happens, but for the given values."""
    quiet = {"qvel": torch.zeros(2, 13), "action": torch.zeros(2, 10), "last_action": torch.zeros(2, 10)}
    quiet["observations"] = TensorDict(batch_size=[2])
    quiet |= {name: torch.zeros(2, dtype=torch.bool) for name in ("success", "collision")}
    return rewards.Transition(**quiet | values)


def of_second(names, **values):
    """Values by name in the second world; zeros elsewhere."""
    result = torch.zeros(2, len(names))
    for name, value in values.items():
        result[1, names.index(name)] = value
    return result


def qvel(**joints):
    return of_second(robot.DOF_NAMES, **joints)


def action(**changes):
    return of_second(robot.ACTIONS, **changes)


@pytest.mark.parametrize(
    ("term", "values", "wanted"),
    [
        (rewards.success, {"success": YES_IN_SECOND}, [0, 1]),
        (rewards.collision, {"collision": YES_IN_SECOND}, [0, 1]),
        (rewards.time, {}, [1, 1]),
        (rewards.joint_velocity, {"qvel": qvel(arm_outer=0.1, arm_inner=-0.2)}, [0, 0.3]),
        (rewards.joint_velocity, {"qvel": qvel(head_pan=-2.0, head_tilt=1.0)}, [0, 3.0]),
        (rewards.joint_velocity, {"qvel": qvel(base_x=1.0, base_yaw=1.0, lift=1.0, wrist_yaw=1.0)}, [0, 0]),
        (rewards.action_rate, {"action": action(base_forward=1.0, lift=-0.5)}, [0, 1.25]),
        (rewards.action_rate, {"last_action": action(head_pan=-1.0)}, [0, 1.0]),
        (rewards.action_rate, {"action": action(lift=0.4), "last_action": action(lift=0.4)}, [0, 0]),
    ],
)
def test_term(term, values, wanted):
    result = term(transition(**values))
    assert result.dtype == torch.float32 and result.tolist() == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("scales", "message"),
    [
        ({"sucess": 1.0}, "reward.sucess: unknown term; choose from success, time"),
        ({"success": float("nan")}, "reward.success: the scale must be a finite number"),
        ({"success": float("-inf")}, "reward.success: the scale must be a finite number"),
        ({"success": "ten"}, "reward.success: the scale must be a finite number, got 'ten'"),
        ({"success": None}, "reward.success: the scale must be a finite number, got None"),
        ({"success": True}, "reward.success: the scale must be a finite number, got True"),
    ],
)
def test_bad_scales_are_named(scales, message):
    with pytest.raises(ValueError, match="reward") as raised:
        rewards.check_scales(scales, ("success", "time"))
    assert str(raised.value).startswith(message)


def test_zero_scales_are_left_out():
    scales = {"success": 10, "time": 0.0, "collision": -1.5}
    assert rewards.check_scales(scales, scales) == {"success": 10.0, "collision": -1.5}


MODULE = """
def seen(step):
    return step.observations["scandots"].sum(-1)

def wide(step):
    return step.action

number = 3
"""


@pytest.fixture
def my_rewards(tmp_path, monkeypatch):
    (tmp_path / "my_rewards_of_a_test.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))
    return "my_rewards_of_a_test"


def test_a_term_from_outside_sees_the_observations(my_rewards):
    scales = {"success": 10.0, f"{my_rewards}.seen": 0.5}
    assert rewards.check_scales(scales, ("success",)) == scales
    observations = TensorDict({"scandots": torch.tensor([[0.0, 0.0], [1.0, 2.0]])}, batch_size=[2])
    step = transition(observations=observations)
    assert rewards.outside_term(f"{my_rewards}.seen")(step).tolist() == [0.0, 3.0]
    with pytest.raises(ValueError, match=r"wide: expected a value per world, shape \(2,\), got \(2, 10\)"):
        rewards.outside_term(f"{my_rewards}.wide")(step)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("number", "expected a function of a step, got 3"),
        ("nothing", "cannot be imported: AttributeError"),
        ("other.term", "cannot be imported: "),
    ],
)
def test_bad_terms_from_outside_are_named(my_rewards, name, message):
    with pytest.raises(ValueError, match=f"^reward.{my_rewards}.{name}: {message}"):
        rewards.check_scales({f"{my_rewards}.{name}": 1.0}, ("success",))
