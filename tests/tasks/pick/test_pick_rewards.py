"""Reward terms of the pick task against tables of cases, and the three rewards against NumPy formulas."""

from functools import cache

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.pick import rewards as pick_rewards
from spin_rl.tasks.pick.config import PickConfig

NO, YES = torch.zeros(2, dtype=torch.bool), torch.tensor([False, True])


def transition(**values) -> pick_rewards.PickTransition:
    """Two worlds in which nothing happens, but for the given values."""
    quiet = {name: torch.zeros(2) for name in ("height", "finger", "table_force", "hard_peak")}
    quiet |= {name: NO for name in ("success", "collision", "inside", "grasped", "pressed", "dropped")}
    quiet |= {"qvel": torch.zeros(2, 19), "action": torch.zeros(2, 10), "last_action": torch.zeros(2, 10)}
    quiet |= {"observations": TensorDict(batch_size=[2])}
    quiet |= {"distance": torch.full((2,), 0.4), "finger_force": torch.zeros(2, 2)}
    return pick_rewards.PickTransition(**quiet | values)


@pytest.mark.parametrize(
    ("term", "values", "wanted"),
    [
        ("reach", {"distance": torch.tensor([0.0, 0.1])}, [1.0, 1.0 - np.tanh(0.5)]),
        ("reach_fine", {"distance": torch.tensor([0.0, 0.1])}, [1.0, 1.0 - np.tanh(2.0)]),
        ("touch", {"finger_force": torch.tensor([[0.0, 3.0], [0.1, 0.2]])}, [1, 2]),
        ("grasp", {"grasped": YES}, [0, 1]),
        ("close", {"inside": YES, "finger": torch.tensor([0.3, 0.3])}, [0, 0.5]),
        ("open", {"inside": YES, "finger": torch.tensor([0.2, 0.2])}, [0.5, 0]),
        ("open", {"finger": torch.tensor([0.5, -0.04])}, [1.0, -0.1]),
        ("lift", {"grasped": YES, "height": torch.tensor([0.06, 0.06])}, [0, 0.5]),
        ("lift", {"grasped": ~NO, "height": torch.tensor([-0.02, 0.3])}, [0, 1]),
        ("success", {"success": YES}, [0, 1]),
        ("collision", {"collision": YES}, [0, 1]),
        ("dropped", {"dropped": YES}, [0, 1]),
        ("table_force", {"table_force": torch.tensor([0.0, 10.0])}, [0, np.tanh(0.5)]),
        ("lift_paper", {"grasped": YES, "height": torch.tensor([0.2, 0.2])}, [0, 1]),
        (
            "lift_paper",
            {"grasped": ~NO, "height": torch.tensor([0.0, 0.1])},
            1 - np.tanh([2.25, 0.75]),
        ),
        ("distance", {"distance": torch.tensor([0.4, 0.7])}, [0.4, 0.7]),
        ("low_paper", {"pressed": YES, "height": torch.tensor([0.1, 0.1])}, [0, 1 - np.tanh(1.5)]),
        ("low_paper", {"pressed": ~NO, "height": torch.tensor([-0.1, 0.0])}, [1, 1]),
        ("time", {}, [1, 1]),
    ],
)
def test_term(term, values, wanted):
    result = pick_rewards.TERMS[term](transition(**values))
    assert result.dtype == torch.float32 and result.tolist() == pytest.approx(list(wanted), abs=1e-6)


@cache
def scales(name):
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return dict(compose("train", ["task=pick", f"reward={name}"]).reward)


def random_transition(n=64):
    g = torch.Generator().manual_seed(1)

    def draw(*shape):
        return torch.rand(*shape, generator=g)

    force = 30 * draw(n, 2) * (draw(n, 2) > 0.4)
    return pick_rewards.PickTransition(
        qvel=draw(n, 19) - 0.5,
        success=draw(n) > 0.7,
        collision=draw(n) > 0.7,
        action=2 * draw(n, 10) - 1,
        last_action=2 * draw(n, 10) - 1,
        observations=TensorDict(batch_size=[n]),
        distance=0.5 * draw(n),
        height=0.4 * draw(n) - 0.1,
        finger=0.65 * draw(n) - 0.05,
        finger_force=force,
        table_force=40 * draw(n),
        hard_peak=torch.zeros(n),
        inside=draw(n) > 0.5,
        grasped=(force.sum(-1) > 10) & (force.min(-1).values > 1),
        pressed=force.sum(-1) > 10,
        dropped=draw(n) > 0.7,
    )


def shaped(d, h, q, f, table, inside, grasp, success, da, speed):
    touching = (f > 0).sum(-1)
    return 0.1 * (
        (1 - np.tanh(5 * d)) + 0.5 * (1 - np.tanh(20 * d)) + 0.25 * touching + 1.0 * grasp
        + 0.5 * inside * (1 - q / 0.6) + 0.2 * (1 - inside) * np.minimum(q / 0.4, 1)
        + 3.0 * grasp * np.clip(h / 0.12, 0, 1) + 3.0 * success - 0.01 * da - 0.5 * np.tanh(table / 20)
    )  # fmt: skip


def positive(d, h, q, f, table, inside, grasp, success, da, speed):
    lift = 1 - np.tanh(15 * np.maximum(0.15 - h, 0))
    return 0.1 * (1 - np.tanh(5 * d)) + 0.5 * grasp + 0.8 * grasp * lift - 0.003 * speed


def printed(d, h, q, f, table, inside, grasp, success, da, speed):
    lift = (1 - np.tanh(15 * np.maximum(h, 0))) * (f.sum(-1) > 10)
    return 0.5 * d + 0.5 * lift - 0.03 * speed


@pytest.mark.parametrize(
    ("name", "formula"), [("pick", shaped), ("pick_paper", positive), ("pick_paper_printed", printed)]
)
def test_whole_reward(name, formula):
    step = random_transition()
    moving = [robot.DOF_NAMES.index(j) for j in ("arm_outer", "arm_inner", "head_pan", "head_tilt")]
    wanted = formula(
        step.distance.numpy(),
        step.height.numpy(),
        step.finger.numpy(),
        step.finger_force.numpy(),
        step.table_force.numpy(),
        step.inside.numpy().astype(float),
        step.grasped.numpy().astype(float),
        step.success.numpy().astype(float),
        ((step.action - step.last_action) ** 2).sum(-1).numpy(),
        step.qvel[:, moving].abs().sum(-1).numpy(),
    )
    total = sum(scale * pick_rewards.TERMS[term](step) for term, scale in scales(name).items())
    np.testing.assert_allclose(total.numpy(), wanted, atol=1e-5)


def test_terms_of_another_task_are_unknown():
    with pytest.raises(ValueError, match=r"reward\.progress: unknown term; choose from reach, "):
        PickConfig(reward={"progress": 1.0})
