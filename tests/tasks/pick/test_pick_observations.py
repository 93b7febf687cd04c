"""Observation groups of the pick task against C MuJoCo's kinematics, and what the camera does not see."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp
from nav_worlds import actions, run

from spin_rl import robot
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.tasks.common.objects.config import SightConfig
from spin_rl.tasks.pick.config import PickConfig, PickNoise
from spin_rl.tasks.pick.observations import PRIVILEGED
from spin_rl.tasks.pick.spec import PICK_GROUPS

SIZES = {
    "proprio": 31, "hand": 7, "object_start": 3, "object": 10, "object_at_start": 10,
    "privileged": 40,
}  # fmt: skip


def native(env):
    """C MuJoCo's data of every world, at the current positions."""
    model = env.sim.mj_model
    for qpos in env.sim.data.qpos.numpy():
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        yield data


def base_frame(data):
    """Rotation and origin of the base, from its body."""
    return data.body("base").xmat.reshape(3, 3), data.body("base").xpos * [1, 1, 0]


def blocks(privileged):
    ends = np.cumsum(list(PRIVILEGED.values()))
    assert privileged.shape[1] == ends[-1]
    return dict(zip(PRIVILEGED, np.split(privileged.cpu().numpy(), ends[:-1], axis=1), strict=True))


def test_groups_and_shapes(pick_env):
    obs = pick_env.get_observations()
    assert tuple(obs.keys()) == PICK_GROUPS
    for name, size in SIZES.items():
        assert obs[name].shape == (8, size) and obs[name].dtype == torch.float32, name


def test_frames(pick_env):
    run(pick_env, actions(5, 8, forward=0.5))
    sim = pick_env.sim
    # Anywhere, lying and seen.
    sim.object.views.pos[:, :2] += 0.1
    sim.object.views.quat[:] = torch.nn.functional.normalize(torch.randn(8, 4), dim=-1)
    sim.forward()
    pick_env.sight.update()
    pick_env.observations._seen[:] = True
    obs = {name: value.cpu().numpy() for name, value in pick_env.get_observations().items()}
    privileged = blocks(pick_env.get_observations()["privileged"])
    start = sim.object.start_pose.numpy()
    for world, data in enumerate(native(pick_env)):
        base, origin = base_frame(data)
        gripper = data.site(robot.GRASP_CENTER_SITE).xmat.reshape(3, 3)
        at, grasp = data.body("object").xpos, data.site(robot.GRASP_CENTER_SITE).xpos
        turned = gripper.T @ data.body("object").xmat.reshape(3, 3)
        in_base = base.T @ (at - origin)
        offset = gripper.T @ (at - grasp)
        hand = (base.T @ gripper)[:, [0, 2]].T.ravel()
        np.testing.assert_allclose(obs["hand"][world, :6], hand, atol=1e-5)
        o_i = base.T @ (start[world, :3] - origin)
        np.testing.assert_allclose(obs["object_start"][world], o_i, atol=1e-5)
        back = gripper.T @ (start[world, :3] - grasp)
        told = [1, *o_i, *np.clip(5 * back, -1, 1), *np.clip(20 * back, -1, 1)]
        np.testing.assert_allclose(obs["object_at_start"][world], told, atol=1e-4)
        seen = [1, *in_base, *np.clip(5 * offset, -1, 1), *np.clip(20 * offset, -1, 1)]
        np.testing.assert_allclose(obs["object"][world], seen, atol=1e-4)
        np.testing.assert_allclose(privileged["object"][world], in_base, atol=1e-5)
        np.testing.assert_allclose(privileged["offset"][world], 5 * offset, atol=1e-4)
        np.testing.assert_allclose(privileged["orientation"][world], turned[:, [0, 2]].T.ravel(), atol=1e-5)
        finger = data.qpos[[9, 10]].mean()
        grip = sim.target.numpy()[world, robot.JOINTS.index("gripper_finger")] - finger
        assert obs["hand"][world, 6] == pytest.approx(grip, abs=1e-6)
        assert privileged["grip"][world, 5] == pytest.approx(grip, abs=1e-6)


def test_privileged(pick_env):
    pick_env.set_objects([OBJECTS[i % len(OBJECTS)] for i in range(8)])
    pick_env.reset()
    run(pick_env, [pick_env.sim.views.action.clone()] * 3)
    sim, layout = pick_env.sim, pick_env.sim.layout
    sim.object.views.pos[:, 2] += 0.05
    sim.grasp.views.finger_force[:] = torch.tensor([3.0, 15.0])
    parts = blocks(pick_env.get_observations()["privileged"])
    assert parts["kind"].argmax(1).tolist() == [i % len(OBJECTS) for i in range(8)]
    assert (parts["kind"].sum(1) == 1).all()
    np.testing.assert_allclose(parts["forces"][:, :2], [[0.2, 1.0]] * 8, atol=1e-6)
    height = sim.object.views.pos[:, 2].numpy() - sim.object.start_pose.numpy()[:, 2]
    np.testing.assert_allclose(parts["heights"][:, 0], 10 * height, atol=1e-5)
    top = 2 * layout.pos.numpy()[:, layout.pool.first_box, 2]
    np.testing.assert_allclose(parts["heights"][:, 1], top, atol=2e-3)
    np.testing.assert_allclose(parts["half_extents"], 10 * sim.object.half_extents.numpy(), atol=1e-6)
    np.testing.assert_allclose(parts["time"], [[1 - 3 / 70, 0]] * 8, atol=1e-6)


def in_view(env, data, at):
    """Whether a point is within the image, by C MuJoCo's camera site."""
    site = data.site("camera_depth_optical_frame")
    p = site.xmat.reshape(3, 3).T @ (at - site.xpos)
    tan_x, tan_y = robot.camera_tan_half_fov(env.cfg.camera_mount)
    return 0.1 <= p[2] <= 4.0 and abs(p[0]) <= tan_x * p[2] and abs(p[1]) <= tan_y * p[2]


def test_an_object_out_of_view_is_masked(make_pick_env):
    env = make_pick_env(PickConfig(sight=SightConfig(occlusion=False)), 32, seed=1)
    seen = []
    for _ in range(4):
        obs = env.step(torch.zeros(32, 10))[0]["object"].numpy()
        for world, data in enumerate(native(env)):
            wanted = in_view(env, data, data.body("object").xpos)
            assert obs[world, 0] == wanted
            assert (obs[world] == 0).all() or wanted
            seen.append(wanted)
    assert 0.1 < np.mean(seen) < 0.9


def test_the_table_hides_an_object_below_it(make_pick_env):
    env = make_pick_env(num_envs=32, seed=1)
    seen = env.observations._seen
    assert 4 < seen.sum() < 28
    visible = seen.clone()
    env.sim.object.views.pos[:, 2] -= 0.3  # under the top, whatever the camera's height
    env.sight.update()
    assert not seen[visible].any()


def test_a_detector_does_not_see_what_the_hand_hides(make_pick_env):
    """Grippers start near objects; what is first on the line to an object's centre is C MuJoCo's to say."""
    env = make_pick_env(PickConfig(detector="segmentation", near_share=(1.0, 1.0)), 64, seed=1)
    model, obs = env.sim.mj_model, env.get_observations()["object"].numpy()
    bare, hidden, errors = [], [], []
    for world, data in enumerate(native(env)):
        at, eye = data.body("object").xpos, data.site("camera_depth_optical_frame").xpos
        if not in_view(env, data, at):
            continue
        hit = np.zeros(1, dtype=np.int32)
        drawn = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        mujoco.mj_ray(model, data, eye, at - eye, drawn, 1, -1, hit)
        if model.geom_bodyid[hit[0]] == model.body("object").id:
            base, origin = base_frame(data)
            bare.append(obs[world, 0])
            errors.append(np.linalg.norm(obs[world, 1:4] - base.T @ (at - origin)))
        else:
            hidden.append(obs[world, 0])
    assert len(bare) > 10 and min(bare) == 1.0
    assert np.median(errors) < 0.02 and max(errors) < 0.1, "half a banana: its other end may be hidden"
    assert len(hidden) > 3 and min(hidden) == 0.0, "all of it can be hidden; of the others a part shows"


def test_noise_is_drawn_of_the_object(make_pick_env):
    env = make_pick_env(PickConfig(noise=PickNoise(object_m=0.01)), 64)
    env.observations._seen[:] = True
    draws = torch.stack([env.get_observations()["object"][:, 1:4] for _ in range(20)])
    np.testing.assert_allclose(draws.std(0).mean(0).numpy(), 0.01, rtol=0.1)
    np.testing.assert_allclose(
        draws.mean((0, 1)).numpy(), env.get_observations()["privileged"][:, 10:13].mean(0).numpy(), atol=2e-3
    )
    env.observations._seen[:] = False
    assert (env.get_observations()["object"] == 0).all()


def test_what_was_seen_at_the_start_is_as_wrong_as_o_i(make_pick_env):
    """One draw of the noise for both: a robot has one o_i."""
    env = make_pick_env(PickConfig(noise=PickNoise(object_m=0.01, object_start_m=0.02)), 16)
    for _ in range(3):
        obs = env.step(torch.zeros(16, 10))[0]
        assert torch.equal(obs["object_at_start"][:, 1:4], obs["object_start"])


def start_errors(env):
    """What is wrong with o_i in every world [m], in the base frame; draws noise."""
    sim = env.sim
    o_i = env.get_observations()["object_start"].cpu().numpy()
    bases = [base_frame(data) for data in native(env)]
    start = sim.object.start_pose.numpy()[:, :3]
    return np.stack([o_i[w] - base.T @ (start[w] - origin) for w, (base, origin) in enumerate(bases)])


def in_world(env, error):
    """Turn errors (num_envs, 3) from base frames into the world."""
    return np.stack([base_frame(data)[0] @ error[w] for w, data in enumerate(native(env))])


def test_an_error_of_the_start_is_drawn_once_an_episode(make_pick_env):
    env = make_pick_env(PickConfig(noise=PickNoise(object_start_m=0.02)), 64, seed=4)
    turn = torch.zeros(64, 10)
    turn[:, :2] = 0.3

    def errors(steps):
        """Errors over some steps while the robot drives and turns, in the world."""
        rows = []
        for _ in range(steps):
            env.step(turn)
            rows.append(in_world(env, start_errors(env)))
        return np.stack(rows)

    first = errors(3)
    np.testing.assert_allclose(first, np.broadcast_to(first[:1], first.shape), atol=1e-5)
    assert first[0].std() == pytest.approx(0.02, rel=0.2)  # 192 numbers
    assert (np.abs(first[0]).max(1) > 1e-4).all() and len(np.unique(first[0][:, 0])) == 64
    # A new episode has another error, the neighbours' stay.
    with wp.ScopedDevice(env.device):
        env._launch_reset(wp.array(np.arange(64) == 5, dtype=bool))
    env.get_observations()
    second = errors(2)
    others = np.arange(64) != 5
    np.testing.assert_allclose(second[-1][others], first[0][others], atol=1e-5)
    np.testing.assert_allclose(second[-1][5], second[0][5], atol=1e-5)
    assert np.abs(second[-1][5] - first[0][5]).max() > 1e-3
    # o_t has no part in it.
    env.observations._seen[:] = True
    obs = env.get_observations()
    torch.testing.assert_close(obs["object"][:, 1:4], obs["privileged"][:, 10:13])
    # The same numbers again, however many were drawn before.
    env.reseed(4)
    env.reset()
    np.testing.assert_array_equal(errors(1)[0], first[0])


def test_the_depth_image_shows_the_object_where_it_is_seen(make_pick_env):
    env = make_pick_env(PickConfig(depth=DepthConfig()), 8, seed=3)
    obs = env.step(env.sim.views.action.clone())[0]
    seen = obs["object"][:, 0].bool()
    assert 2 < seen.sum() < 8
    env.sim.object.views.pos[:, 2] -= 5.0
    env.sim.forward()
    env.depth.update()
    changed = (env.depth.observe() != obs["depth"]).sum(1)
    assert (changed[seen] > 3).all() and changed[~seen].median() == 0


def test_the_hand_is_where_the_image_shows_it(make_pick_env):
    """Against a pinhole camera in NumPy; and a can in the hand is drawn at that place, at that depth."""
    env = make_pick_env(PickConfig(depth=DepthConfig()), 8, seed=3)
    run(env, actions(4, 8))
    env.set_objects(["can"] * 8)
    env.reset()
    sim, n = env.sim, 8
    sim.object.views.pos[:] = env.observations.grasp_centre
    sim.forward()
    env.depth.update()
    obs = env.get_observations()
    images = obs["depth"].view(n, 87, 58).cpu().numpy() / 255.0
    tan_rows, tan_columns = robot.camera_tan_half_fov(env.cfg.camera_mount)
    shown = 0
    for world, data in enumerate(native(env)):
        camera = data.site("camera_depth_optical_frame")
        grasp = data.site(robot.GRASP_CENTER_SITE).xpos
        x, y, z = camera.xmat.reshape(3, 3).T @ (grasp - camera.xpos)
        place = np.array([-y / tan_columns, x / tan_rows]) / max(z, 0.05)
        expected = [*np.clip(place, -3, 3), (z - 0.2) / 3.8]
        located = obs["hand_in_image"][world].cpu().numpy()
        np.testing.assert_allclose(located, expected, atol=1e-4)
        if z > 0.2 and np.abs(located[:2]).max() < 0.95:
            column, row = (int((1 + p) / 2 * size) for p, size in zip(located, (58, 87), strict=False))
            nearer = located[2] - images[world, row, column]
            assert nearer > 0.0  # a side of the can, or what hides it
            shown += nearer < 0.06 / 3.8
    assert shown > 1
