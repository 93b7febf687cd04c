"""The guard: what it lets pass, what it stops, and that its geometry is MuJoCo's."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.config import ScandotsConfig
from spin_rl.tasks.nav.config import GuardConfig, NavConfig
from spin_rl.warp_kernels.guard.trial import gap_between, overlap
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
    """Command the base, or more joints, the others staying; return how the first episode ended, or None."""
    action = env.sim.views.action.clone()
    action[:, : len(command)] = torch.tensor(command)
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
    guarded = []
    for _ in range(100):
        assert drive(env, command, 1) is None
        guarded.append(bool(env.guard.guarded[0]))
    assert any(guarded)


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


@pytest.mark.parametrize(("y", "speed"), [(0.2, 0.4), (0.15, 0.5)])
def test_a_slow_robot_gets_out_of_the_way_of_what_is_faster_if_it_foresees_it(make_nav_env, y, speed):
    scene = scene_with(((1.9, y, 0.5), (0.15, 0.15, 0.5)))
    scene.home[BOX] = (-3.0, y, 0.5)
    scene.retreat[BOX] = (4.9, 0.0)
    scene.motion_speed[BOX] = speed  # the base reaches 0.3 m/s ahead and 0.1 backwards
    ends = {}
    for foresee_s in (0.0, 3.0):
        guard = replace(GUARDED.guard, foresee_s=foresee_s)
        cfg = replace(GUARDED, guard=guard, robot_profile="re1")
        ends[foresee_s] = drive(make_nav_env(cfg, num_envs=1, scene=scene), (0.0, 0.0), 90)
    assert ends == {0.0: episode.COLLISION, 3.0: None}


def test_what_is_near_already_may_be_left_but_not_come_nearer(make_nav_env):
    guard = replace(GUARDED.guard, margin_m=0.3)  # in front of the base is less
    scene = scene_with(((0.35, 0.0, 0.1), (0.1, 0.5, 0.1)))
    scene.start_joints[-1] = -1.2
    env = make_nav_env(replace(GUARDED, guard=guard), num_envs=1, scene=scene)
    assert drive(env, (1.0, 0.0), 30) is None
    assert abs(float(env.sim.views.qpos[0, 0])) < 0.05
    assert drive(env, (-1.0, 0.0), 30) is None
    assert float(env.sim.views.qpos[0, 0]) < -0.15
    assert not env.guard.guarded.any()


OUT, DOWN = (0.0, 0.0, -1.0, 1.0), (0.0, 0.0, -1.0, 0.58)
"""Actions of base, lift and arm: the arm goes out low, the lift goes down with the arm out."""


@pytest.mark.parametrize(
    ("command", "lift", "extension", "shelf"),
    [
        (OUT, 0.0, 0.0, ((-0.05, -0.8, 0.6), (0.3, 0.15, 0.6))),
        (DOWN, 0.8, 0.3, ((-0.05, -0.6, 0.15), (0.3, 0.3, 0.15))),
    ],
)
def test_the_arm_stands_before_it_moves_into_what_was_seen(make_nav_env, command, lift, extension, shelf):
    scene = scene_with(shelf)
    scene.start_joints[:2] = (lift, extension)
    scene.start_joints[-2:] = (-1.57, -0.6)  # looks where the arm is
    assert drive(make_nav_env(num_envs=1, scene=scene), command, 60) == episode.COLLISION
    env = make_nav_env(GUARDED, num_envs=1, scene=scene)
    assert drive(env, command, 60) is None
    lift_now, outer, inner = env.sim.views.qpos[0, 3:6].tolist()
    assert abs(lift_now - lift) + abs(outer + inner - extension) > 0.1
    back = (*command[:2], 0.0, 0.0)  # the policy may take the arm back
    drive(env, back, 30)
    assert abs(env.sim.views.qpos[0, 4].item()) < 0.01


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
def _compare(
    a: wp.array2d(dtype=float),
    b: wp.array2d(dtype=float),
    overlaps: wp.array(dtype=bool),
    gaps: wp.array(dtype=float),
):
    i = wp.tid()
    thing = Thing()
    thing.place = wp.vec3(b[i, 0], b[i, 1], b[i, 2])
    thing.half = wp.vec2(b[i, 3], b[i, 4])
    centre = wp.vec2(a[i, 0], a[i, 1])
    half = wp.vec2(a[i, 3], a[i, 4])
    overlaps[i] = overlap(centre, a[i, 2], half, thing, 0.0)
    gaps[i] = gap_between(centre, half, thing)


def compare(device, a, b):
    """Whether rectangles of x, y, yaw and half extents overlap, and how far the aligned ones are apart."""
    overlaps = wp.zeros(len(a), dtype=bool, device=device)
    gaps = wp.zeros(len(a), dtype=float, device=device)
    arrays = [wp.array(each, dtype=float, device=device) for each in (a, b)]
    wp.launch(_compare, dim=len(a), inputs=arrays, outputs=[overlaps, gaps], device=device)
    return overlaps.numpy(), gaps.numpy()


def rectangles(n, seed, *, aligned=False):
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(-4, 4, n)
    return np.column_stack(
        [rng.uniform(-0.6, 0.6, (n, 2)), 0.0 * yaw if aligned else yaw, rng.uniform(0.02, 0.5, (n, 2))]
    )


def mujoco_distances(a, b):
    """Signed distances of upright boxes with these rectangles [m], negative where they overlap."""
    xml = "<mujoco><worldbody>" + 2 * "<body><freejoint/><geom type='box' size='1 1 1'/></body>"
    model = mujoco.MjModel.from_xml_string(xml + "</worldbody></mujoco>")
    data = mujoco.MjData(model)
    distances = []
    for pair in zip(a, b, strict=True):
        for body, (x, y, yaw, *half) in enumerate(pair):
            model.geom_size[body] = (*half, 2.0)
            data.qpos[7 * body : 7 * body + 7] = (x, y, 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
        mujoco.mj_forward(model, data)
        distances.append(mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None))
    return np.array(distances)


def test_rectangles_overlap_where_mujocos_boxes_do(device):
    a, b = rectangles(500, 3), rectangles(500, 4)
    told, wanted = compare(device, a, b)[0], mujoco_distances(a, b)
    clear = np.abs(wanted) > 1e-3
    assert (told == (wanted < 0.0))[clear].all() and 100 < told.sum() < 400 and clear.sum() > 450


def test_rectangles_are_in_each_other_as_deep_as_mujocos_boxes(device):
    a, b = rectangles(300, 5, aligned=True), rectangles(300, 6)
    told, wanted = compare(device, a, b)[1], mujoco_distances(a, b)
    inside = wanted < -1e-3
    np.testing.assert_allclose(told[inside], wanted[inside], atol=2e-3)
    assert (told[~inside] <= wanted[~inside] + 1e-3).all() and 50 < inside.sum() < 250
