"""The classical stack as a policy: whole episodes in a small room, with and without somebody who steps in."""

import numpy as np
import pytest

from spin_rl import robot
from spin_rl.baselines.registry import BASELINES
from spin_rl.benchmark import policies
from spin_rl.benchmark.reach import in_usual_pool
from spin_rl.config import ConfigError
from spin_rl.policy import make_in
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.sensors.lidar import LidarConfig
from spin_rl.tasks.common.episode import SUCCESS
from spin_rl.tasks.fetch.spec import FETCH
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.nav.spec import NAV

WALLS = [
    {"position": [1.5, 1.55], "size": [5.2, 0.1, 1.0]},
    {"position": [1.5, -1.55], "size": [5.2, 0.1, 1.0]},
    {"position": [-1.05, 0.0], "size": [0.1, 3.0, 1.0]},
    {"position": [4.05, 0.0], "size": [0.1, 3.0, 1.0]},
]
SOMEBODY = {"position": [1.9, -1.2], "radius": 0.2, "height": 1.7}


def room(**thing):
    """A room with a box in the way; the robot starts the wrong way round."""
    scene = parse_scene(
        {
            "start": {"position": [0.0, 0.0], "yaw": 2.5},
            "goal": [3.0, 0.2],
            "walls": WALLS,
            "boxes": [{"position": [1.2, 0.4], "size": [0.3, 0.5, 0.5]}],
            "cylinders": [SOMEBODY | thing],
        }
    )
    return in_usual_pool(scene)


def drive(scenes, device, steps=300):
    """Outcomes of the first episodes, and the largest action of a joint."""
    cfg = NavConfig(lidar=LidarConfig(enabled=True), stop_on_collision=True)
    env = NavEnv(cfg, len(scenes), device, scene=scenes)
    policy = make_in(env, policies.open_policy("classical").make)
    obs = env.reset()
    policy.reset()
    outcome, joints = np.zeros(len(scenes), dtype=int), 0.0
    for _ in range(steps):
        actions = policy(obs)
        joints = max(joints, float(actions[:, 2:].abs().max()))
        obs, _, done, _ = env.step(actions)
        policy.reset(done)
        outcome = np.where(outcome == 0, env.outcome.numpy(force=True), outcome)
        if outcome.all():
            break
    return outcome, joints, policy


def test_it_reaches_the_goal_past_what_lies_and_what_steps_in(device):
    stepping = {"motion": {"to": [1.9, -0.3], "speed": 0.8, "trigger": 1.4}}
    outcome, joints, policy = drive([room(), room(**stepping)], device)
    assert (outcome == SUCCESS).all()
    assert joints == 0.0  # the arm stays stowed
    assert (policy.map_error < 0.05).all()
    # The map's middle is halfway to the goal, in the frame of the start.
    goal = policy.maps.frame.origin.numpy() + 0.5 * policy.settings.map.side_m
    np.testing.assert_allclose(goal, 0.5 * turned((3.0, 0.2), 2.5)[None].repeat(2, axis=0), atol=0.05)


def turned(point, yaw):
    """A point in the frame of a start at the origin."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * point[0] + s * point[1], c * point[1] - s * point[0]])


def test_a_world_that_ended_waits_for_its_map_with_others(device):
    cfg = NavConfig(lidar=LidarConfig(enabled=True))
    env = NavEnv(cfg, 4, device, scene=[room()] * 4)
    policy = make_in(env, policies.open_policy("classical").make)
    obs, mapped = env.reset(), []
    run = policy._mapping.run
    policy._mapping.run = lambda worlds, *rest: mapped.append(worlds.tolist()) or run(worlds, *rest)
    policy.reset()
    policy(obs)
    ended = env.outcome.new_tensor([1, 0, 0, 0])
    policy.reset(ended)
    assert not policy(obs)[0].any()  # it stands still
    policy.reset(ended.roll(1))
    policy(obs)
    assert mapped == [[True] * 4, [True, True, False, False]]


@pytest.mark.parametrize(
    ("cfg", "message"),
    [
        (NavConfig(), "^task.lidar.enabled: policy=classical drives by the lidar"),
        (
            NavConfig(lidar=LidarConfig(enabled=True), goal_range_m=2.0),
            "^task.goal_range_m: policy=classical",
        ),
    ],
)
def test_tasks_without_what_it_needs_are_refused(cfg, message):
    source = policies.open_for(NAV, {"policy": "classical"})
    assert source.task == "nav" and BASELINES["classical"].task == "nav"
    with pytest.raises(ConfigError, match=message):
        source.check(cfg)


def test_it_does_not_fetch():
    with pytest.raises(ConfigError, match=r"^policy: classical takes no turns with others"):
        policies.open_for(FETCH, {"policy": "classical", "pick": "zero"})
    assert policies.of_task(FETCH) == ("zero", "random")
    assert policies.of_task(NAV) == ("classical", "classical-map", "zero", "random")


def test_the_footprint_is_that_of_the_stowed_robot():
    import mujoco

    from spin_rl.baselines.lidar_stack.settings import FollowerSettings

    low_x, low_y, high_x, high_y = FollowerSettings().footprint
    model = robot.load_spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, dict(robot.STOWED))
    mujoco.mj_forward(model, data)
    corners = []
    for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity):
        centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
        corners.append(data.geom_xpos[geom] + (centre + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T)
    corners = np.concatenate(corners)
    # Bounding boxes of tilted round geoms stand out of them.
    np.testing.assert_allclose((low_x, low_y), corners.min(axis=0)[:2], atol=0.03)
    np.testing.assert_allclose((high_x, high_y), corners.max(axis=0)[:2], atol=0.03)
