"""Where to look: at the unknown thing that is nearest soon; against C MuJoCo's camera."""

import mujoco
import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.nav.config import NavConfig

POSE = (0.0, 0.5)  # up: it shows neither box
BOXES = ((1.2, 0.6, 0.3), (-1.6, -0.2, 0.9))


def make(make_nav_env, pose=POSE):
    scene = Scene.empty(PoolSpec())
    scene.start_joints[:] = [*(robot.STOWED[joint] for joint in robot.JOINTS[:-2]), *pose]
    scene.goal[:] = (4.0, 0.0)
    for i, centre in enumerate(BOXES):
        slot = scene.pool.first_box + i
        scene.pos[slot], scene.half_size[slot], scene.active[slot] = centre, (0.1, 0.1, 0.1), True
    cfg = NavConfig(camera_pose=pose, teach_gaze=True, robot_profile="reversing", stop_on_collision=False)
    return make_nav_env(cfg, num_envs=2, scene=scene)


def drive(env, forward, steps):
    action = torch.zeros(2, 10, device=env.device)
    action[:, 0] = forward
    for _ in range(steps):
        obs = env.step(action)[0]
    return obs["gaze"].cpu().numpy()


def off_axis(env, gaze, centre):
    """Angle [rad] of a point from the camera's axis in C MuJoCo, with the head where the actions send it."""
    model = robot.load_spec().compile()
    data = mujoco.MjData(model)
    held = dict(robot.STOWED)
    for joint, action in zip(robot.CAMERA_JOINTS, gaze, strict=False):
        index = robot.JOINTS.index(joint)
        bound = robot.JOINT_UPPER[index] if action >= 0.0 else robot.JOINT_LOWER[index]
        held[joint] = robot.STOWED[joint] + abs(action) * (bound - robot.STOWED[joint])
    data.qpos[:] = robot.qpos_from_joints(model, held)
    data.qpos[:3] = env.sim.views.qpos[0, :3].cpu().numpy()
    mujoco.mj_forward(model, data)
    site = model.site(robot.CAMERA_SITE).id
    ray = np.array(centre) - data.site_xpos[site]
    return np.arccos(ray @ data.site_xmat[site].reshape(3, 3)[:, 2] / np.linalg.norm(ray))


def halfway_down(centre):
    return (*centre[:2], 0.5 * centre[2])


@pytest.mark.parametrize(("forward", "wanted"), [(0.5, BOXES[0]), (-0.8, BOXES[1])])
def test_the_thing_on_the_way_and_the_floor_below_it_are_in_the_middle_of_the_image(
    make_nav_env, forward, wanted
):
    env = make(make_nav_env)
    gaze = drive(env, forward, 6)
    assert gaze[:, 2].tolist() == [1.0, 1.0] and gaze[0] == pytest.approx(gaze[1], abs=0.02)
    other = next(box for box in BOXES if box != wanted)
    assert off_axis(env, gaze[0], halfway_down(wanted)) < 0.15 < off_axis(env, gaze[0], other)
    assert off_axis(env, gaze[0], halfway_down(wanted)) < off_axis(env, gaze[0], wanted)


def test_what_was_seen_is_not_looked_for(make_nav_env):
    """A camera at the box ahead leaves the one behind, though that is farther away."""
    env = make(make_nav_env, pose=(0.4, -0.6))
    gaze = drive(env, 0.5, 3)
    assert gaze[0, 2] == 1.0 and off_axis(env, gaze[0], halfway_down(BOXES[1])) < 0.15


@pytest.mark.parametrize(("forward", "ahead"), [(0.5, 1.0), (-0.8, -1.0)])
def test_where_everything_is_known_it_looks_where_the_base_drives(make_nav_env, forward, ahead):
    env = make(make_nav_env)
    env.sim.layout.active.zero_()
    gaze = drive(env, forward, 6)
    x, y = env.sim.views.qpos[0, :2].tolist()
    assert gaze[0, 2] == 1.0 and off_axis(env, gaze[0], (x + ahead, y, 0.3)) < 0.1


def test_nothing_is_said_where_nothing_is_near_and_the_base_stands(make_nav_env):
    env = make(make_nav_env)
    env.sim.layout.active.zero_()
    assert not drive(env, 0.0, 1).any()


def test_rates_are_no_places_to_look(make_nav_env):
    with pytest.raises(ValueError, match=r"task\.teach_gaze: needs camera_action=target"):
        NavConfig(teach_gaze=True, camera_action="rate")
