"""Settings of a fetch: what they change, and which are refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from fetch_worlds import CARRY, NUM_WORLDS, PICK, enter, idle, stand_at, table_yaw

from spin_rl import robot
from spin_rl.benchmark.policies import open_for
from spin_rl.benchmark.settings import for_policy
from spin_rl.runners.policy_file import build_model, read_policy, write_policy
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.tasks.common import episode
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.fetch.config import CARRY_SIM, FetchConfig, StageLimits
from spin_rl.tasks.fetch.spec import FETCH


def test_the_detector_finds_what_is_in_view(make_fetch_env):
    """Within the errors of docs/detection.md; nothing where the camera looks away."""
    env = make_fetch_env(FetchConfig(detector="segmentation"), seed=3)
    truth = env.sim.object.views.pos
    pan, tilt = robot.DOF_NAMES.index("head_pan"), robot.DOF_NAMES.index("head_tilt")
    for world in range(NUM_WORLDS):
        yaw = table_yaw(env, world)
        along = torch.tensor([math.cos(yaw), math.sin(yaw)])
        stand_at(env, truth[world, :2] - 0.7 * along, world, yaw)
        away = world == 3
        env.sim.views.qpos[world, pan] = math.pi / 2 if away else 0.0
        drop = 1.35 - float(truth[world, 2])
        env.sim.views.qpos[world, tilt] = 0.0 if away else -math.atan2(drop, 0.7)
    env.sim.forward()
    env.sight.update()
    obs = env.get_observations()
    assert obs["object"][:, 0].tolist() == [1.0, 1.0, 1.0, 0.0]
    found = torch.as_tensor(env.sight.at.numpy())
    assert ((found - truth).norm(dim=1)[:3] < 0.03).all()
    assert ((found - truth).norm(dim=1)[:3] > 1e-4).all(), "it is measured, not told"
    assert (obs["object"][3] == 0.0).all()


def test_images_are_scaled_for_picking_in_that_stage_alone(make_fetch_env):
    cfg = FetchConfig(depth=DepthConfig(), pick_range_m=(0.5, 1.5))
    env = make_fetch_env(cfg, seed=3)
    enter(env, PICK, 1)
    enter(env, CARRY, 2)
    obs = env.get_observations()
    images = obs["depth"].cpu().numpy()
    metres = env.depth.pipeline.filter.depth.numpy().reshape(NUM_WORLDS, -1)
    assert (metres == 0).any(), "holes are far"
    for world in range(NUM_WORLDS):
        near, far = (0.5, 1.5) if world == 1 else (0.2, 4.0)
        scaled = np.where(metres[world] > 0, np.clip((metres[world] - near) / (far - near), 0, 1), 1)
        np.testing.assert_allclose(images[world], 255 * scaled, atol=0.51)
    located = env.depth.locate(env.observations._pick.grasp_centre, (0.0, 1.0))
    torch.testing.assert_close(
        obs["hand_in_image"][:, 2], located[:, 2] - 0.5, msg="always in picking's range"
    )


@pytest.fixture
def no_pointnet(tmp_path):
    """A policy that reads nav-cvo's observations as the paper's NoPointNet does, and learned nothing."""
    known = dict(read_policy("nav-cvo").metadata)
    runner = known["config"]["runner"] | {"actor": known["actor"] | {"encoder": "concat"}}
    metadata = known | {"actor": runner["actor"], "config": known["config"] | {"runner": runner}}
    dims = {group: known["obs_dims"][group] for group in known["obs_groups"]}
    weights = build_model(metadata["actor"], "actor", dims, known["num_actions"]).state_dict()
    file = tmp_path / "no-pointnet.safetensors"
    write_policy(file, weights, metadata)
    return str(file)


def test_a_policy_of_a_fixed_number_of_tokens_is_not_told_of_the_table(make_fetch_env, no_pointnet):
    source = open_for(FETCH, {"policy": no_pointnet, "pick": "zero"})
    cfg = FETCH.configure(for_policy(compose("eval", ["task=fetch"]), source.trained, ["task=fetch"]))
    assert not cfg.tell_table
    env = make_fetch_env(FetchConfig(tell_table=False), seed=3)
    obs, table = env.get_observations(), env.cfg.scene.table_slot
    for group, sensed in (("scandots", env.scandots.visible), ("scandots_all", env.scandots.all)):
        np.testing.assert_array_equal(obs[group], np.delete(sensed.numpy(), table, 1).reshape(len(obs), -1))
    # What is left are the slots of navigation, each a thing of the same kind.
    for kind in ("is_wall", "is_cylinder"):
        left = np.delete(getattr(env.sim.layout, kind).numpy(), table)
        np.testing.assert_array_equal(left, getattr(Scene.empty(PoolSpec()), kind))
    policy = source.make(obs, env.device)
    policy.reset()
    action = policy(obs)
    assert action.isfinite().all() and action.any()
    told = make_fetch_env(seed=3).get_observations()
    with pytest.raises(ValueError, match="reads 'scandots' of size 512; the environment's has size 544"):
        source.make(told, env.device)


def test_the_whole_fetch_has_a_limit(make_fetch_env):
    env = make_fetch_env(FetchConfig(episode_s=0.5), num_envs=2)
    outcomes = []
    for _ in range(5):
        env.step(idle(env))
        outcomes.append(int(env.outcome[0]))
    assert outcomes == [episode.RUNNING] * 4 + [episode.TIMEOUT]
    assert env.results().cause(0) == "reach timeout"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FetchConfig(retries=-1), r"task\.retries"),
        (lambda: FetchConfig(carry_moves=("head_pan",)), r"task\.carry_moves"),
        (lambda: FetchConfig(camera_pose=(0.0, -1.6)), r"task\.camera_pose: -1.6 is outside"),
        (lambda: FetchConfig(pick_range_m=(1.0, 0.5)), r"task\.pick_range_m must be two depths"),
        (lambda: FetchConfig(pick_range_m=(0.5, 1.0)), r"task\.pick_range_m changes nothing"),
        (
            lambda: FetchConfig(tell_table=False, sim=replace(CARRY_SIM, nearby=16)),
            r"task\.tell_table=false",
        ),
        (lambda: FetchConfig(detector="yolo"), r"task\.detector must be one of none, segmentation"),
        (lambda: FetchConfig(object="cup"), r"task\.object must be any or"),
        (lambda: FetchConfig(carry_lift_m=0.2), r"task\.carry_lift_m"),
        (lambda: FetchConfig(reward={"success": 1.0}), r"reward\.success"),
        (lambda: StageLimits(pick=0.0), r"task\.limits\.pick"),
    ],
)
def test_impossible_configurations_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_configuration_file_has_the_defaults_of_the_code():
    assert FETCH.configure(compose("eval", ["task=fetch"])) == FetchConfig()
