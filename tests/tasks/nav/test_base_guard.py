"""The guard: what it lets pass, what it stops, and that its geometry is MuJoCo's."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.config import ScandotsConfig
from spin_rl.tasks.nav.config import GuardConfig, NavConfig
from spin_rl.warp_kernels.guard.trial import overlap as _overlap
from spin_rl.warp_kernels.memory import Thing

BOX = PoolSpec().first_box
GUARDED = NavConfig(guard=GuardConfig(enabled=True), scandots=ScandotsConfig(pieces_from_m=0.3))


def scene_with(*boxes) -> Scene:
    """Boxes, each (position, half size), around a robot at the origin that looks ahead and down."""
    scene = Scene.empty(PoolSpec())
    scene.goal[:] = (6.0, 0.0)
    scene.start_joints[-2:] = (0.0, -0.6)
    for slot, (pos, half) in enumerate(boxes, BOX):
        scene.active[slot] = True
        scene.pos[slot], scene.half_size[slot] = pos, half
    return scene


def drive(env, command, steps):
    """Command the base with the head where it started; return how the first episode ended, or None."""
    action = env.sim.views.action.clone()
    action[:, :2] = torch.tensor(command)
    for _ in range(steps):
        env.step(action)
        if int(env.outcome[0]) != episode.RUNNING:
            return int(env.outcome[0])
    return None


@pytest.mark.parametrize("command", [(1.0, 0.0), (1.0, 0.4), (0.6, -0.3)])
def test_a_box_ahead_is_hit_without_the_guard_alone(make_nav_env, command):
    ahead = scene_with(((1.2, 0.0, 0.15), (0.1, 1.5, 0.15)))
    assert drive(make_nav_env(num_envs=1, scene=ahead), command, 60) == episode.COLLISION
    env = make_nav_env(GUARDED, num_envs=1, scene=ahead)
    assert drive(env, command, 100) is None
    assert bool(env.guard.guarded[0])


def test_on_a_free_floor_every_command_passes(make_nav_env):
    env = make_nav_env(GUARDED, num_envs=4, scene=scene_with(((4.0, 3.0, 0.15), (0.1, 0.1, 0.15))))
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        action = 2.0 * torch.rand(4, 10, generator=generator) - 1.0
        _, _, done, _ = env.step(action.to(env.device))
        assert not env.guard.guarded.any()
        goes_on = done.cpu() == 0  # what ended has the actions of its new start
        torch.testing.assert_close(env.sim.views.action.cpu()[goes_on], action[goes_on])


def test_what_was_never_seen_is_hit(make_nav_env):
    behind = scene_with(((-0.7, 0.0, 0.15), (0.1, 0.6, 0.15)))
    assert drive(make_nav_env(GUARDED, num_envs=1, scene=behind), (-1.0, 0.0), 60) == episode.COLLISION


def test_a_bar_over_the_base_stops_the_mast(make_nav_env):
    bar = scene_with(((1.2, 0.0, 0.9), (0.1, 1.5, 0.1)))
    env = make_nav_env(GUARDED, num_envs=1, scene=bar)
    assert drive(env, (1.0, 0.0), 80) is None
    assert 0.3 < float(env.sim.views.qpos[0, 0]) < 1.2


def test_the_robot_makes_way_for_what_comes(make_nav_env):
    scene = scene_with(((0.7, 0.0, 0.5), (0.1, 0.1, 0.5)))
    scene.home[BOX] = (-1.3, 0.0, 0.5)
    scene.retreat[BOX] = (2.0, 0.0)
    scene.motion_speed[BOX] = 0.06  # the base may reverse at 0.1 m/s
    assert drive(make_nav_env(num_envs=1, scene=scene), (0.0, 0.0), 120) == episode.COLLISION
    env = make_nav_env(GUARDED, num_envs=1, scene=scene)
    assert drive(env, (0.0, 0.0), 120) is None
    assert float(env.sim.views.qpos[0, :2].norm()) > 0.1


def test_the_hulls_hold_the_robot_tightly(make_nav_env):
    env = make_nav_env(GUARDED, num_envs=8, seed=2)
    env.step(torch.rand(8, 10, generator=torch.Generator().manual_seed(1)).to(env.device))
    env.guard.apply()
    model, sim = env.sim.mj_model, env.sim
    low, high = env.guard._low.numpy(), env.guard._high.numpy()
    names = {0: ("base",), 1: ("mast", "head", "head_1"), 2: ("arm", "arm_1", "arm_2", "arm_3", "arm_4")}
    for world in range(8):
        x, y, yaw = sim.data.qpos.numpy()[world, :3]
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        for hull, geoms in names.items():
            points = [
                (surface(model, sim, world, model.geom(name).id) - [x, y, 0]) @ turn.T for name in geoms
            ]
            points = np.concatenate(points)
            assert (points >= low[world, hull] - 1e-4).all() and (points <= high[world, hull] + 1e-4).all()
            np.testing.assert_allclose(points.min(0), low[world, hull], atol=2e-3)
            np.testing.assert_allclose(points.max(0), high[world, hull], atol=2e-3)


def surface(model, sim, world, geom):
    """Points on a geom that reach as far as it does in every direction of a fine fan, (n, 3) in the world."""
    pos, mat = sim.data.geom_xpos.numpy()[world, geom], sim.data.geom_xmat.numpy()[world, geom]
    size = model.geom_size[geom]
    signs = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, -1).T
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        return pos + (signs * size) @ mat.T
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(4000, 3))
    ball = np.concatenate([ball / np.linalg.norm(ball, axis=1, keepdims=True), np.eye(3), -np.eye(3)])
    ends = np.array([[0, 0, size[1]], [0, 0, -size[1]]]) @ mat.T
    return pos + np.concatenate([end + size[0] * ball for end in ends])


@wp.kernel
def _overlaps(a: wp.array2d(dtype=float), b: wp.array2d(dtype=float), out: wp.array(dtype=bool)):
    i = wp.tid()
    thing = Thing()
    thing.place = wp.vec3(b[i, 0], b[i, 1], b[i, 2])
    thing.half = wp.vec2(b[i, 3], b[i, 4])
    out[i] = _overlap(wp.vec2(a[i, 0], a[i, 1]), a[i, 2], wp.vec2(a[i, 3], a[i, 4]), thing, 0.0)


def test_rectangles_overlap_where_mujocos_boxes_do(device):
    rng = np.random.default_rng(3)
    n = 500
    a, b = (
        np.column_stack(
            [rng.uniform(-0.6, 0.6, (n, 2)), rng.uniform(-4, 4, n), rng.uniform(0.02, 0.5, (n, 2))]
        )
        for _ in range(2)
    )
    out = wp.zeros(n, dtype=bool, device=device)
    arrays = [wp.array(each, dtype=float, device=device) for each in (a, b)]
    wp.launch(_overlaps, dim=n, inputs=arrays, outputs=[out], device=device)
    xml = "<mujoco><worldbody>" + 2 * "<body><freejoint/><geom type='box' size='1 1 1'/></body>"
    model = mujoco.MjModel.from_xml_string(xml + "</worldbody></mujoco>")
    data = mujoco.MjData(model)
    told, wanted = out.numpy(), []
    for pair in zip(a, b, strict=True):
        for body, (x, y, yaw, *half) in enumerate(pair):
            model.geom_size[body] = (*half, 1.0)
            data.qpos[7 * body : 7 * body + 7] = (x, y, 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
        mujoco.mj_forward(model, data)
        wanted.append(mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None))
    wanted = np.array(wanted)
    clear = np.abs(wanted) > 1e-3
    assert (told == (wanted < 0.0))[clear].all() and 100 < told.sum() < 400 and clear.sum() > 450
