"""The pilot beside the simulation's guard and planner, and beside MuJoCo's camera."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.backends.mujoco import MujocoRobot
from spin_rl.deploy.kinematics import Frame, Kinematics
from spin_rl.deploy.pilot.arm import ArmMotion
from spin_rl.deploy.pilot.body import Body
from spin_rl.deploy.pilot.costmap import Costmap
from spin_rl.deploy.pilot.eye import Eye
from spin_rl.deploy.pilot.guard import filtered
from spin_rl.deploy.pilot.pilot import Pilot
from spin_rl.deploy.pilot.route import Route
from spin_rl.deploy.pilot.trial import Drive, Trial
from spin_rl.detection.deproject import Intrinsics
from spin_rl.export.describe import describe
from spin_rl.planning.distance_field import DistanceField, GridSpec
from spin_rl.runners.policy_file import read_policy
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.tasks.common.config import ScandotsConfig
from spin_rl.tasks.common.proprioception import joints
from spin_rl.tasks.nav.config import GuardConfig, NavConfig, PlannerConfig
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE

TASK = {"guard": vars(GuardConfig(enabled=True)), "planner": vars(PlannerConfig(enabled=True))}
GUARDED = NavConfig(guard=GuardConfig(enabled=True), scandots=ScandotsConfig(pieces_from_m=0.3))
BOX, NUM_BOXES = PoolSpec().first_box, 5
KINEMATICS = Kinematics()


@pytest.fixture(scope="module")
def contract():
    return describe(read_policy("nav-room"), units=256, pilot=TASK)


def test_the_contract_says_what_the_task_does(contract):
    foreseen = {"foresee_s"}  # the pilot does not expect things to go on moving
    assert (
        vars(contract.guard).items() == {k: v for k, v in TASK["guard"].items() if k not in foreseen}.items()
    )
    assert vars(contract.planner) == TASK["planner"]
    assert contract.camera.image == (87, 58) and contract.depth_filter is None
    plain = describe(read_policy("nav-cvo"), units=256)
    assert not plain.has_pilot and not plain.shapes and plain.camera.image is None


def test_the_cameras_rays_are_those_of_the_detectors_camera(contract):
    eye = Eye(contract.camera)
    camera = Intrinsics.from_fov((87, 58), robot.camera_tan_half_fov("portrait"))
    pixels = np.stack(np.meshgrid(np.arange(87), np.arange(58), indexing="ij"), -1)
    wanted = 1.7 * camera.rays(pixels).reshape(-1, 3)
    np.testing.assert_allclose(eye.points(np.full((87, 58), 1.7)), wanted, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_points_of_mujocos_images_are_on_its_boxes_and_floor_and_not_on_the_robot(contract, seed):
    rng = np.random.default_rng(seed)
    low = np.array([0.8, -0.4, 0.0])
    scene = parse_scene(
        {
            "start": {"position": [0.1, -0.2], "yaw": 0.3},
            "goal": [3.0, 0.0],
            "boxes": [{"position": [1.0, 0.0], "size": [0.4, 0.8, 0.6]}],
        }
    )
    agent = Agent.__new__(Agent)
    agent.contract = contract
    one = MujocoRobot(scene, replace(contract, scandots=None))
    at = rng.uniform(robot.JOINT_LOWER, robot.JOINT_UPPER)
    at[-1] = rng.uniform(-1.4, -0.3)
    one.data.qpos[: len(robot.DOF_NAMES)] = robot.qpos_from_joints(
        one.model, dict(zip(robot.JOINTS, at, strict=True))
    )
    one.data.qpos[:3] = scene.start
    state, image = one.state(), agent.reduce(one.depth().image)
    pilot = Pilot(contract)
    pilot.reset(state.base, np.array([3.0, 0.0]))
    pilot.see(image, state.joints, state.base)
    window = pilot.costmap.around(state.base[:2], 20.0)
    middle = window.middle[window.layers > 0]
    beyond = np.maximum(low[:2] - middle, middle - (1.2, 0.4)).max(-1)
    assert (beyond < 0.01).all()  # edges are put half a pixel further, which is 8 mm here
    bodies = KINEMATICS.bodies(state.joints)
    points = KINEMATICS.sites(bodies)[robot.CAMERA_SITE].to_base(Eye(contract.camera).points(image))
    own = pilot._body.pose(bodies).holds(points, 0.04)
    assert own.sum() < len(points)


def boxes_around(rng):
    """Boxes that do not touch the robot's own place."""
    scene = Scene.empty(PoolSpec())
    scene.goal[:] = (6.0, 0.0)
    for slot in range(BOX, BOX + NUM_BOXES):
        angle, away = rng.uniform(-1.3, 1.3), rng.uniform(0.6, 0.9)
        half = rng.uniform((0.03, 0.03, 0.05), (0.3, 0.3, 0.6))
        bottom = rng.choice([0.0, 0.3, 0.9])
        scene.active[slot] = True
        scene.pos[slot] = (away * np.cos(angle), away * np.sin(angle), bottom + half[2])
        scene.half_size[slot] = half
    return scene


def surface(scene, step=0.02):
    """Points all over the sides of a scene's boxes, and within them."""
    points = []
    for pos, half in zip(scene.pos[scene.active], scene.half_size[scene.active], strict=True):
        axes = [
            np.linspace(-h, h, max(round(2 * h / step), 1) + 1) + p for p, h in zip(pos, half, strict=True)
        ]
        points.append(np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3))
    return np.concatenate(points)


class Glass:
    """A camera that sees through everything, so that things reach no further down than they were told to."""

    def sees_through(self, points, depth, camera):
        return np.ones(len(points), dtype=bool)


def told(points) -> Costmap:
    costmap = Costmap(np.full(2, -6.0), 12.0, 0.06, memory_s=10.0, period_s=0.1)
    eye: Any = Glass()
    costmap.see(eye, np.zeros((87, 58)), Frame(np.zeros(3), np.eye(3)), points)
    return costmap


@pytest.fixture(scope="module")
def guarded(make_nav_env):
    """Worlds whose guard knows all boxes, after one look at random commands, and the commands of before."""
    rng = np.random.default_rng(0)
    scenes = [boxes_around(rng) for _ in range(64)]
    env = make_nav_env(GUARDED, num_envs=64, scene=scenes)
    env.reset()
    memory, device = env.guard._memory, env.device
    shape = memory.seen_at.shape
    known = np.zeros(shape, dtype=np.int32) - 1
    known[:, BOX : BOX + NUM_BOXES] = 0
    memory.seen_at.assign(known)
    half = np.array([scene.half_size for scene in scenes])
    pose = np.array([np.column_stack([scene.pos[:, :2], scene.yaw]) for scene in scenes])
    memory.high.assign(half)
    memory.low.assign(-half)
    memory.pose.assign(pose)
    memory.velocity.zero_()
    memory.step.zero_()
    nearby = np.full(env.sim.layout.nearby.shape, -1, dtype=np.int32)
    nearby[:, :NUM_BOXES] = np.arange(BOX, BOX + NUM_BOXES)
    env.sim.layout.nearby.assign(nearby)
    speed = rng.uniform((-0.1, -0.8), (0.7, 0.8), (64, 2)).astype(np.float32)
    env.sim.base_velocity.assign(speed)
    asked = rng.uniform(-1.0, 1.0, (64, 10)).astype(np.float32)
    asked[:, 0] = np.abs(asked[:, 0])
    asked[:, 3] = 1.0  # arms go out
    env.sim.views.action.copy_(torch.tensor(asked, device=device))
    env.guard.apply()
    return env, scenes, speed, asked


def test_the_hulls_are_those_of_the_simulations_guard(contract, guarded):
    env = guarded[0]
    at = joints(env.sim.views.qpos).cpu().double().numpy()
    for world in range(0, 64, 7):
        hulls = Body(contract.shapes).pose(KINEMATICS.bodies(at[world])).hulls
        np.testing.assert_allclose(hulls.low, env.guard._low.numpy()[world], atol=1e-5)
        np.testing.assert_allclose(hulls.high, env.guard._high.numpy()[world], atol=1e-5)


def test_the_same_commands_are_free_but_for_margins(contract, guarded):
    """Cells hold boxes around points 2 cm apart, so that the two differ where something just passes."""
    env, scenes, speed, asked = guarded
    stopped = env.guard.guarded.cpu().numpy()
    at = joints(env.sim.views.qpos).cpu().double().numpy()
    base = env.sim.views.qpos[:, :3].cpu().double().numpy()
    scale = env.sim.dynamics.speed_scale.numpy()
    same = 0
    for world, scene in enumerate(scenes):
        drive = Drive.of(contract, float(scale[world]))
        hulls = Body(contract.shapes).pose(KINEMATICS.bodies(at[world])).hulls
        command = drive.command_of(asked[world, :2].astype(float))
        now, margin = speed[world].astype(float), contract.guard.margin_m
        trial = Trial(told(surface(scene)), hulls, base[world], now, drive, margin)
        free = bool(trial.is_free(command[None], 5)[0])
        same += free != stopped[world]
        if free:
            np.testing.assert_array_equal(filtered(command, 5, trial), command)
    assert 10 < stopped.sum() < 54 and same >= 61


def test_the_same_arms_stand_but_for_margins(contract, guarded):
    env, scenes, speed, asked = guarded
    done = env.sim.views.action.cpu().numpy()
    stood = (np.abs(done[:, 2:8] - np.clip(asked[:, 2:8], -1.0, 1.0)) > 1e-5).any(axis=1)
    at = joints(env.sim.views.qpos).cpu().double().numpy()
    base = env.sim.views.qpos[:, :3].cpu().double().numpy()
    body = Body(contract.shapes)
    arm = ArmMotion(contract, body, KINEMATICS)
    same = 0
    for world, scene in enumerate(scenes):
        hulls = body.pose(KINEMATICS.bodies(at[world])).hulls
        drive, now = Drive.of(contract, 1.0), speed[world].astype(float)
        trial = Trial(told(surface(scene)), hulls, base[world], now, drive, contract.guard.margin_m)
        soon = arm.soon(hulls, at[world], asked[world].astype(float))
        same += trial.arm_goes_in(soon) == stood[world]
    assert 6 < stood.sum() < 58 and same >= 61


def test_ways_are_those_of_the_simulations_planner(contract, device):
    rng = np.random.default_rng(2)
    pool = PoolSpec(0, 60, 0)
    scene = Scene.empty(pool)
    centre, half = rng.uniform(-5.0, 5.0, (60, 2)), rng.uniform(0.01, 0.03, (60, 2))
    far = np.linalg.norm(centre - (3.0, 1.0), axis=-1) > 1.2
    scene.active[:60] = far
    scene.pos[:60, :2], scene.pos[:60, 2] = centre, 0.5
    scene.half_size[:60] = np.column_stack([half, np.full(60, 0.5)])
    start, scene.goal[:] = np.array([-4.0, -1.0]), (3.0, 1.0)
    layout = Layout(1, pool, device)
    for name in Layout._PER_WORLD:
        getattr(layout, name).assign(np.array([getattr(scene, name)]))
    cfg = PlannerConfig(enabled=True)
    grid = GridSpec.square(cfg.size_m, cfg.cell_m)
    fields = DistanceField(layout, device, grid, clearance_m=cfg.clearance_m, blocked_m=cfg.blocked_m)
    route = Route(contract.planner, start, scene.goal.astype(float), 0.1)
    fields.field.origin.assign(route.origin[None].astype(np.float32))
    fields.update(layout.goal, wp.full(1, True, dtype=bool, device=device))
    theirs = fields.field.values.numpy()[0]

    class Given(Costmap):
        def boxes(self):
            return centre[far], half[far]

    costmap = Given(route.origin, cfg.size_m, 0.06, memory_s=10.0, period_s=0.1)
    costmap.changed = True
    for _ in range(30):
        route.update(costmap, start)
    mine = route.field.values
    reached = (theirs < route.field.at(start[None])[0]) & (mine < UNREACHABLE)
    assert reached.sum() > 4000
    np.testing.assert_allclose(mine[reached], theirs[reached], atol=0.03)
