"""What the scripts of a fetch know: all that they read, and no more than a robot could."""

import numpy as np
import pytest
import torch
import warp as wp
from fetch_worlds import ALIGN, CARRY, NUM_WORLDS, PICK, PLACE, RETRACT, enter, stand_at, state, table_yaw

from spin_rl.tasks.fetch.scripts import kernel


@pytest.fixture(scope="module")
def env(make_fetch_env):
    return make_fetch_env(seed=11)


def distance_to_slots(scene, at):
    """Horizontal distance of a point to every slot of a host scene [m]."""
    offset = at - scene.pos[:, :2]
    c, s = np.cos(scene.yaw), np.sin(scene.yaw)
    local = np.stack([c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]], -1)
    box = np.linalg.norm(np.maximum(np.abs(local) - scene.half_size[:, :2], 0.0), axis=1)
    round_ = np.linalg.norm(offset, axis=1) - scene.half_size[:, 0]
    return np.where(scene.is_cylinder, round_, box)


def test_tells_the_pose_the_table_and_what_is_near(env):
    env.reset()
    for world in range(NUM_WORLDS):
        stand_at(env, env.goal[world] - torch.tensor([0.3 * world, 0.0]), world, 0.2 * world)
    env.sim.views.qpos[:, 9:11] = torch.tensor([0.1, 0.3])
    env.sim.views.qvel[:, 2] = 0.7
    env._knowledge.update()
    known = env._knowledge.known
    np.testing.assert_allclose(known.base.numpy(), env.sim.views.qpos[:, :3].cpu())
    np.testing.assert_allclose(known.finger.numpy(), 0.2, rtol=1e-6)
    np.testing.assert_allclose(known.turning.numpy(), 0.7, rtol=1e-6)
    near = known.near.active.numpy()
    for world, scene in enumerate(env.sim.layout.scenes()):
        assert known.table_yaw.numpy()[world] == pytest.approx(table_yaw(env, world))
        distance = distance_to_slots(scene, env.sim.views.qpos[world, :2].cpu().numpy())
        np.testing.assert_array_equal(near[world], scene.active & (distance < 1.0))
        for name in ("pos", "yaw", "half_size"):
            there = getattr(known.near, name).numpy()[world][near[world]]
            np.testing.assert_allclose(there, getattr(scene, name)[near[world]], rtol=1e-6)
    assert near.any(1).all() and not near.all(1).any()


@pytest.mark.parametrize(
    ("fingers", "rests", "hand_n", "holds", "supported"),
    [
        (3.0, False, 0.0, True, False),
        (3.0, True, 0.0, False, True),
        (1.5, False, 0.0, False, False),
        (3.0, False, 2.5, True, True),
        (0.0, False, 1.5, False, False),
    ],
)
def test_tells_what_hangs_in_the_hand_and_what_stands(env, fingers, rests, hand_n, holds, supported):
    forces = env.sim.grasp.views
    forces.finger_force[:] = torch.tensor([0.5 * fingers, 0.5 * fingers])
    forces.object_support[:] = rests
    forces.table_force[:] = hand_n
    env._knowledge.update()
    assert env._knowledge.known.holds.numpy().tolist() == [holds] * NUM_WORLDS
    assert env._knowledge.known.supported.numpy().tolist() == [supported] * NUM_WORLDS


@pytest.mark.parametrize(("stage", "phase"), [(ALIGN, 4), (RETRACT, 2), (PLACE, 3), (PICK, 0), (CARRY, 0)])
def test_scripts_act_on_what_is_known_and_on_nothing_else(env, stage, phase):
    """The same actions in a world that has changed, as long as nobody tells; others if it is told."""

    def script():
        enter(env, stage, range(NUM_WORLDS), phase)
        state(env, "stuck").zero_()
        state(env, "is_found").fill_(True)
        env.sim.views.action[:] = 0.5
        wp.launch(
            kernel.script_actions,
            dim=NUM_WORLDS,
            inputs=[env._drive, env._knowledge.known],
            outputs=[env._state, env.sim.action],
            device=env.device,
        )
        return env.sim.views.action.clone()

    env.reset()
    env._knowledge.update()
    before = script()
    sim, forces = env.sim, env.sim.grasp.views
    sim.views.qpos += 0.3
    sim.views.qvel += 0.3
    wp.to_torch(sim.layout.yaw).add_(0.5)
    wp.to_torch(sim.layout.pos)[:, :, :2] = sim.views.qpos[:, None, :2]
    forces.finger_force[:] = 5.0
    forces.object_support.logical_not_()
    assert torch.equal(script(), before)
    env._knowledge.update()
    assert not torch.equal(script(), before)
