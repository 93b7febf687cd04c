"""Where to look: at the unknown thing that is nearest soon; against C MuJoCo's camera."""

import mujoco
import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.nav.config import NavConfig

POSE = (0.0, 0.5)  # up: it shows neither box
BOXES = ((0.9, 0.4, 0.3), (-1.1, -0.2, 0.9))


GOAL = (4.0, 0.0)


def make(make_nav_env, pose=POSE, goal=GOAL, boxes=BOXES, **settings):
    scene = Scene.empty(PoolSpec())
    scene.start_joints[:] = [*(robot.STOWED[joint] for joint in robot.JOINTS[:-2]), *(pose or POSE)]
    scene.goal[:] = goal
    for i, centre in enumerate(boxes):
        slot = scene.pool.first_box + i
        scene.pos[slot], scene.half_size[slot], scene.active[slot] = centre, (0.1, 0.1, 0.1), True
    drives = {"robot_profile": "reversing", "stop_on_collision": False}
    cfg = NavConfig(camera_pose=pose, **{"teach_gaze": True} | drives | settings)
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


def along_the_way(env, goal):
    """A point 1 m ahead, as high as floor and walls from the base on are in the image."""
    base = env.sim.views.qpos[0, :2].cpu().numpy()
    way = np.array(goal) - base
    return (*(base + way / np.linalg.norm(way)), 0.3)


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
    """Where the camera shows the box ahead, it may look along the way to the goal again."""
    env = make(make_nav_env, pose=(0.4, -0.6))
    gaze = drive(env, 0.5, 6)
    assert gaze[0, 2] == 1.0 and off_axis(env, gaze[0], along_the_way(env, GOAL)) < 0.1


def test_what_will_not_be_near_is_not_looked_for(make_nav_env):
    """The box behind is unknown, too, and nearer than the goal; but the base drives away from it."""
    env = make(make_nav_env, boxes=BOXES[1:])
    gaze = drive(env, 0.5, 6)
    assert off_axis(env, gaze[0], along_the_way(env, GOAL)) < 0.1


@pytest.mark.parametrize("goal", [GOAL, (-3.0, 1.0), (-2.0, -2.0)])
def test_where_everything_is_known_it_looks_along_the_way(make_nav_env, goal):
    """Also while the base stands, and behind it: the head turns by more than half a turn."""
    env = make(make_nav_env, goal=goal, boxes=())
    gaze = drive(env, 0.0, 1)
    assert gaze[0, 2] == 1.0 and off_axis(env, gaze[0], along_the_way(env, goal)) < 0.1


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_a_thing_high_up_is_in_the_image(make_nav_env, mount):
    """Half way down to the floor it would be above the image of the camera that is less high."""
    high = (0.9, 0.0, 1.5)
    env = make(make_nav_env, pose=(-3.1, -0.5), boxes=(high,), camera_mount=mount)
    gaze = drive(env, 0.5, 6)
    half_image = np.arctan(robot.camera_tan_half_fov(mount)[0])
    assert off_axis(env, gaze[0], high) < 0.8 * half_image < off_axis(env, gaze[0], (high[0], 0.0, 0.0))


def test_rates_are_no_places_to_look(make_nav_env):
    with pytest.raises(ValueError, match=r"task\.teach_gaze: needs task\.camera_action=target"):
        NavConfig(teach_gaze=True, camera_action="rate")


@pytest.mark.parametrize(
    ("bearing", "pan"), [(0.3, 0.3), (1.7, 1.5), (1.9, 1.5), (2.0, -3.9), (3.0, 3.0 - 2 * np.pi)]
)
def test_a_bearing_that_the_head_does_not_reach_is_met_as_near_as_it_can(make_nav_env, bearing, pan):
    """It turns from -3.9 to 1.5 rad: what is a little left of its limit is not looked for all around."""
    goal = (5.0 * np.cos(bearing), 5.0 * np.sin(bearing))
    env = make(make_nav_env, goal=goal, boxes=())
    gaze = drive(env, 0.0, 1)
    sent = gaze[0, 0] * (1.5 if gaze[0, 0] > 0 else 3.9)
    assert sent == pytest.approx(pan, abs=0.12)  # the head is not over the base's origin


def test_a_camera_that_follows_the_gaze_shows_what_was_to_be_seen(make_nav_env):
    """Against the true places: the head arrives there, whatever the policy says, and then along the way."""
    env = make(make_nav_env, pose=None, boxes=BOXES[:1], teach_gaze=False, camera_action="gaze")
    assert "gaze" not in env.get_observations()
    action = torch.zeros(2, 10, device=env.device)
    action[:, -2:] = -1.0
    for _ in range(12):
        env.step(action)
    head = env.sim.views.qpos[0, 11:13].cpu().numpy()
    sent = [robot.action_of(joint, at) for joint, at in zip(robot.CAMERA_JOINTS, head, strict=True)]
    assert off_axis(env, sent, along_the_way(env, GOAL)) < 0.15
    assert env.scandots.visible.numpy()[0].any()
