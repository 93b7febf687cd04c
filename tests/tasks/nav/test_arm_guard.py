"""The guard's part for the arm: where it foresees it, and what the policy is told when it stands."""

import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.tasks.nav.arm_guard import Bodies, Joints, hulls_soon
from spin_rl.tasks.nav.config import GuardConfig, NavConfig
from spin_rl.warp_kernels.guard.hulls import FIRST_ARM_HULL, NUM_HULLS, Shapes, hulls_of, measure_hulls

WORLDS = 32
GUARDED = NavConfig(guard=GuardConfig(enabled=True))
LOW, HIGH = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)


@wp.kernel
def _foresee(
    shapes: Shapes,
    joints: Joints,
    bodies: Bodies,
    hull_low: wp.array2d(dtype=wp.vec3),
    hull_high: wp.array2d(dtype=wp.vec3),
    action: wp.array2d(dtype=float),
    qpos: wp.array2d(dtype=float),
    low_out: wp.array3d(dtype=float),
    high_out: wp.array3d(dtype=float),
):
    w = wp.tid()
    soon = hulls_soon(w, hulls_of(w, hull_low, hull_high), shapes, joints, bodies, action, qpos)
    for hull in range(NUM_HULLS):
        for axis in range(3):
            low_out[w, hull, axis] = soon.low[hull, axis]
            high_out[w, hull, axis] = soon.high[hull, axis]


def put(env, base, joints):
    """Put robots at base poses (n, 3) with joints (n, 8), and measure the boxes around them."""
    sim, guard = env.sim, env.guard
    columns = [robot.JOINTS.index(joint) for joint, _ in robot.DOF_SOURCE]
    shares = [share for _, share in robot.DOF_SOURCE]
    qpos = np.concatenate([base, joints[:, columns] * shares], -1)
    sim.views.qpos.copy_(torch.as_tensor(qpos, dtype=torch.float32))
    sim.forward()
    poses = (sim.data.geom_xpos, sim.data.geom_xmat, sim.data.qpos)
    measure_hulls(guard._shapes, *poses, guard._low, guard._high)
    return guard._low.numpy().copy(), guard._high.numpy().copy()


@pytest.mark.parametrize("moved", [*robot.JOINTS[:6], None])
def test_small_moves_bring_the_arm_where_kinematics_do(make_nav_env, moved):
    env = make_nav_env(GUARDED, num_envs=WORLDS, capture=False)
    sim, guard = env.sim, env.guard
    rng = np.random.default_rng(3)
    base = rng.uniform(-3.0, 3.0, (WORLDS, 3))
    joints = rng.uniform(LOW + 0.02, HIGH - 0.02, (WORLDS, 8))
    move = rng.uniform(-0.01, 0.01, (WORLDS, 8)) * [moved in (None, joint) for joint in robot.JOINTS]
    low, high = put(env, base, joints)
    actions = [
        [robot.action_of(joint, at) for joint, at in zip(robot.JOINTS, row, strict=True)]
        for row in joints + move
    ]
    sim.views.action[:, 2:] = torch.tensor(actions, dtype=torch.float32, device=env.device)
    bodies = Bodies()
    bodies.geom_pos, bodies.geom_frame = sim.data.geom_xpos, sim.data.geom_xmat
    bodies.anchor, bodies.axis = sim.data.xanchor, sim.data.xaxis
    soon = [wp.zeros((WORLDS, int(NUM_HULLS), 3), dtype=float, device=env.device) for _ in range(2)]
    wp.launch(
        _foresee,
        dim=WORLDS,
        inputs=[guard._shapes, guard._joints, bodies, guard._low, guard._high, sim.action, sim.data.qpos],
        outputs=soon,
        device=env.device,
    )
    low_then, high_then = put(env, base, joints + move)
    arm = slice(int(FIRST_ARM_HULL), None)
    wanted = np.minimum(low, low_then)[:, arm], np.maximum(high, high_then)[:, arm]
    # Geoms keep their directions in what is foreseen: the ends of long ones turn by a millimetre more.
    for told, then, now in zip(soon, wanted, (low, high), strict=True):
        np.testing.assert_allclose(told.numpy()[:, arm], then, atol=1.5e-3)
        assert np.abs(then - now[:, arm]).max() > (2e-3 if moved is None else 5e-4)


def test_an_arm_a_hair_beyond_its_limit_is_told_within_it(make_nav_env):
    env = make_nav_env(GUARDED, num_envs=2)
    env.guard._recovery_left.fill_(1)  # then it stands
    env.sim.views.qpos[:, 4:6] = -1e-3
    env.sim.views.action[:] = 0.5
    env.guard.apply()
    action = env.sim.views.action.cpu()
    assert action[:, 3].tolist() == [-1.0, -1.0]
    assert action.abs().max() <= 1.0 and (action[:, 8:] == 0.5).all()
