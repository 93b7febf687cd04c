"""What belongs to the camera among actions and observations."""

import torch

from spin_rl.tasks.common.proprioception import PROPRIO, camera_columns, proprio_columns
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def test_a_frozen_camera_holds_its_columns_and_no_others(device):
    env = NavEnv(NavConfig(camera_pose=(0.0, -0.6), stop_on_collision=False), num_envs=4, device=device)
    generator = torch.Generator().manual_seed(0)
    seen = []
    for _ in range(12):
        obs = env.step(2 * torch.rand(4, env.num_actions, generator=generator).to(device) - 1)[0]
        seen.append(obs["proprio"].cpu())
    spread = torch.stack(seen).flatten(0, 1).std(0)
    # Joints settle within the servos' tolerance.
    still = tuple((spread < 1e-2).nonzero().flatten().tolist())
    assert still == tuple(sorted(env.camera_columns["proprio"]))
    assert [env.num_actions - 2, env.num_actions - 1] == list(env.camera_actions)


def test_every_column_of_proprio_has_a_name():
    columns = proprio_columns()
    assert list(columns.values()) == list(range(sum(PROPRIO.values())))
    assert columns["joint_position/head_pan"] == 6 and columns["last_action/base_forward"] == 21
    named = [columns[f"{block}/{joint}"] for block in ("joint_position", "joint_velocity", "last_action")
             for joint in ("head_pan", "head_tilt")]  # fmt: skip
    assert camera_columns() == {"proprio": tuple(named)}
