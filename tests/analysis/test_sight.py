"""What head poses show, against rays of C MuJoCo; and whole analyses of scenes with known answers."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.analysis.sight import judge, report
from spin_rl.analysis.sight.analysis import analyse_sight
from spin_rl.analysis.sight.driver import SeesAll
from spin_rl.analysis.sight.heads import Poses, cameras_in_base, make_body, make_heads
from spin_rl.analysis.sight.options import SightOptions
from spin_rl.analysis.sight.record import SightWatch
from spin_rl.benchmark import registry
from spin_rl.benchmark.reach import Cell, run_cells
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common.config import CurriculumConfig
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.warp_kernels.sight import look
from spin_rl.warp_kernels.slots import slots_of

POSES = Poses((-3.14, -2.2, -1.57, 0.0, 1.0), (-1.45, -0.9, -0.4, 0.2))
TAN = {"portrait": np.tan(np.deg2rad((43.5, 29.0))), "landscape": np.tan(np.deg2rad((29.0, 43.5)))}
AHEAD, BEHIND, UP = (0.0, -0.6), (-3.14, -0.6), (0.0, 0.6)


def put_anywhere(env, seed):
    """Robots at random poses and with random arms in their corridors."""
    rng = np.random.default_rng(seed)
    qpos = env.sim.views.qpos
    low, high = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
    for world in range(env.num_envs):
        held = dict(zip(robot.JOINTS, rng.uniform(low, high), strict=True))
        held |= {"arm_extension": rng.uniform(0.0, 0.15)}
        values = robot.qpos_from_joints(env.sim.mj_model, held)[:13]
        values[:3] = rng.uniform((0.0, -0.2, -np.pi), (2.0, 0.2, np.pi))
        qpos[world, :13] = torch.as_tensor(values, dtype=torch.float32)
    env.sim.forward()


def shown_by_rays(scene, qpos, pose, mount, *, body):
    """Of every slot, the corners that mj_ray reaches: True, False, or None where 2 mm decide."""
    model = native_model(scene)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    data.qpos[-2:] = pose
    mujoco.mj_kinematics(model, data)
    site = data.site(robot.CAMERA_SITE)
    origin, frame = site.xpos, site.xmat.reshape(3, 3)
    groups = np.array([1, 1, body, 0, 0, 0], dtype=np.uint8)  # what collides is larger than what is drawn
    groups[model.geom("floor").group] = 1
    yaw = qpos[2]
    to_base = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])

    def sees(point, margin=0.015):
        in_cam = frame.T @ (point - origin)
        if in_cam[2] < 0.1 or (np.abs(in_cam[:2]) > TAN[mount] * in_cam[2]).any():
            return False
        if np.abs(to_base @ (point[:2] - qpos[:2])).max() > 2.0:
            return False
        length = np.linalg.norm(point - origin)
        hit = mujoco.mj_ray(
            model, data, origin, (point - origin) / length, groups, 1, -1, np.zeros(1, np.int32)
        )
        return hit < 0.0 or hit >= length - margin

    result = {}
    for slot in np.flatnonzero(scene.active & ~scene.is_wall):
        c, s = np.cos(scene.yaw[slot]), np.sin(scene.yaw[slot])
        corners = []
        for signs in np.ndindex(2, 2, 2):
            x, y, z = (2 * np.array(signs) - 1) * scene.half_size[slot]
            point = scene.pos[slot] + (c * x - s * y, s * x + c * y, z)
            answers = {sees(point, margin) for margin in (0.012, 0.018)}
            answers |= {sees(point + 0.003 * step) for step in np.concatenate((np.eye(3), -np.eye(3)))}
            corners.append(answers)
        if {True} in corners:
            result[slot] = True
        elif all(answers == {False} for answers in corners):
            result[slot] = False
    return result


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_poses_show_what_rays_of_mujoco_reach(make_nav_env, mount):
    env = make_nav_env(num_envs=6, seed=2)
    env.set_cells([1, 2] * 3, [2] * 6)
    env.reset()
    put_anywhere(env, 3)
    layout = env.sim.layout
    slots = slots_of(layout)
    shown = wp.zeros((*layout.active.shape, 1), dtype=wp.uint32, device=env.device)
    body, heads = make_body(env.sim), make_heads(POSES, mount, 0.1, env.device)
    arguments = (slots, slots, layout.is_wall, layout.nearby, env.sim.data.qpos, body, heads)
    look(*arguments, window=2.0, shown_out=shown)
    got = shown.numpy()[..., 0]
    compared, seen, hidden_by_body = 0, 0, 0
    for world, scene in enumerate(layout.scenes()):
        qpos = env.sim.views.qpos[world].numpy(force=True).astype(float)
        for index in range(0, len(POSES), 2):
            pose = POSES.table[index]
            expected = shown_by_rays(scene, qpos, pose, mount, body=1)
            without = shown_by_rays(scene, qpos, pose, mount, body=0)
            for slot, answer in expected.items():
                assert bool(got[world, slot] >> index & 1) == answer, (world, slot, pose)
                compared, seen = compared + 1, seen + answer
                hidden_by_body += without.get(slot, False) and not answer
    assert compared > 150 and seen > 20 and hidden_by_body > 0


def test_cameras_are_where_the_simulation_has_them(nav_env):
    qpos, site = nav_env.sim.views.qpos, nav_env.sim.mj_model.site(robot.CAMERA_SITE).id
    qpos[:, :3] = 0.0
    nav_env.sim.forward()
    poses = qpos[:, -2:].numpy(force=True).astype(float)
    positions, rotations = cameras_in_base(poses)
    np.testing.assert_allclose(nav_env.sim.data.site_xpos.numpy()[:, site], positions, atol=1e-5)
    np.testing.assert_allclose(nav_env.sim.data.site_xmat.numpy()[:, site], rotations, atol=1e-5)


class Driver:
    """Drives straight ahead or back, stowed."""

    def __init__(self, forward):
        self._forward = forward

    def __call__(self, obs):
        action = torch.zeros(obs.batch_size[0], len(robot.ACTIONS), device=obs.device)
        action[:, 0] = self._forward
        return action

    def reset(self, dones=None):
        pass


def scene_with_box(x, low=0.0, high=0.2) -> Scene:
    scene = Scene.empty(PoolSpec())
    scene.start_joints[:] = [robot.STOWED[joint] for joint in robot.JOINTS]
    scene.goal[:] = (np.sign(x) * 4.0, 0.0)
    slot = scene.pool.first_box
    scene.pos[slot], scene.half_size[slot] = (x, 0.0, 0.5 * (low + high)), (0.05, 0.1, 0.5 * (high - low))
    scene.active[slot] = True
    return scene


def watch(make_nav_env, scene, forward, robot_profile="reversing"):
    cfg = NavConfig(robot_profile=robot_profile, episode_s=5.0)
    env = make_nav_env(cfg, num_envs=2, scene=scene)
    poses = Poses((-3.14, 0.0), (-0.6, 0.6))
    watched = SightWatch(Driver(forward), env, poses, lead_s=0.8, near_m=0.03)
    run_cells(env, watched, (Cell("scene", "scene"),), 2, report=lambda line: None)
    watched.finish()
    options = SightOptions((0.0,), (0.0,))
    (record,) = watched.records
    return poses, judge.find_events(record, len(poses), options, 0.1)


@pytest.mark.parametrize(
    ("x", "forward", "needed"), [(1.2, 1.0, {AHEAD}), (-1.4, -1.0, {BEHIND})], ids=["ahead", "behind"]
)
def test_a_box_on_the_floor_is_seen_by_who_looks_there(make_nav_env, x, forward, needed):
    poses, events = watch(make_nav_env, scene_with_box(x), forward)
    assert events.world.tolist() == [0, 1]
    seen = judge.held(events)
    assert {tuple(pose) for pose, sees in zip(poses.table, seen[0], strict=True) if sees} == needed
    # At 0.4 m/s it counts where 0.32 m, and the margin, are left; and a start takes time.
    room = abs(x) - 0.05 - (0.0595 if x > 0 else 0.2875)
    expected = (room - 0.03 - 0.32) / 0.4 / 0.1
    assert expected < events.step[0] < expected + 5


def test_a_box_beside_the_way_is_not_decisive(make_nav_env):
    scene = scene_with_box(1.2)
    scene.pos[scene.pool.first_box, 1] = 0.4
    _, events = watch(make_nav_env, scene, 1.0)
    assert len(events.world) == 0


def test_what_hangs_above_the_robot_is_not_decisive(make_nav_env):
    _, events = watch(make_nav_env, scene_with_box(1.2, 1.5, 1.7), 1.0)
    assert len(events.world) == 0


def test_a_policy_is_shown_what_its_camera_does_not_see(nav_env):
    given = []
    driver = SeesAll(lambda obs: given.append(obs) or torch.zeros(8, 10))
    obs = nav_env.get_observations()
    driver(obs)
    assert (given[0]["scandots"] == obs["scandots_all"]).all() and (
        obs["scandots"] != obs["scandots_all"]
    ).any()


def test_an_analysis_by_the_map_is_whole(device, tmp_path):
    options = SightOptions(pans=(-3.14, 0.0), tilts=(-1.0, -0.6))
    cfg = NavConfig(episode_s=20.0, curriculum=CurriculumConfig(enabled=False, start=1.0))
    result = analyse_sight(
        registry.find("reach", "nav"),
        lambda obs, device: Driver(0.0),
        cfg,
        options,
        1,
        [0],
        device,
        policy_name="map",
    )
    # Nothing stops it: it comes to every goal.
    assert all(row["success_rate"] == 1.0 for row in result["rows"])
    (group,) = result["groups"]
    assert group["episodes"] == 6 and group["decisive"] > 0.5
    held, swing, around, everywhere = group["cameras"]
    assert held["unseen"] == np.min(group["unseen"]) and np.array(group["unseen"]).shape == (2, 2)
    assert everywhere["unseen"] <= min(held["unseen"], swing["unseen"], around["unseen"])
    assert around["difference"]["mean"] == pytest.approx(held["unseen"] - around["unseen"])
    # Looking back shows nothing of what lies ahead.
    assert min(group["unseen"][0]) > min(group["unseen"][1])
    text = report.table(result)
    assert "best constant" in text and "looks around" in text and "corridors" in report.headline(result)
    report.write_csv(result, tmp_path / "sight.csv")
    lines = (tmp_path / "sight.csv").read_text().splitlines()
    assert lines[0] == "places,pan,tilt,unseen" and len(lines) == 5
    report.plot(result, tmp_path / "sight.png")
    assert (tmp_path / "sight.png").stat().st_size > 5000
