"""Depth images as observations: on only where they are wanted, and without effect on anything else."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from nav_worlds import actions, assert_same, run

from spin_rl.config import ConfigError
from spin_rl.sensors.depth.noise import DepthNoiseConfig
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.sensors.depth.size import image_shape
from spin_rl.tasks.common.compose import with_depth
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.spec import NAV, NAV_GROUPS

NUM_ENVS = 4
NOISY = DepthConfig(noise=DepthNoiseConfig(noise_per_m=0.01, dropout=0.05, latency_steps=(0, 2)))
# Episodes end within the few steps of a test.
CONFIG = NavConfig(depth=NOISY, episode_s=0.5)


@pytest.fixture(scope="module")
def env(make_nav_env):
    return make_nav_env(CONFIG, NUM_ENVS, seed=5)


def records(env, steps=8):
    env.reseed(5)
    env.reset()
    return run(env, actions(steps, NUM_ENVS))


def test_image_is_the_policys_input_in_8_bits(env):
    image = env.reset()["depth"]
    assert image.dtype == torch.uint8 and image.shape == (NUM_ENVS, 87 * 58)
    pixels = env.depth.pipeline.policy.numpy().reshape(NUM_ENVS, -1)
    np.testing.assert_allclose(image.cpu().numpy() / 255.0, pixels, atol=0.5 / 255.0 + 1e-6)
    assert image.float().std() > 10.0
    assert not torch.equal(image[0], image[1])


def test_everything_else_is_as_without_images(env, make_nav_env):
    plain = make_nav_env(replace(CONFIG, depth=None), NUM_ENVS, seed=5)
    assert plain.depth is None and tuple(plain.get_observations().keys()) == NAV_GROUPS
    with_images, without = records(env), records(plain)
    for step in with_images:
        del step["depth"]
    assert_same(with_images, without)


def test_same_seed_gives_the_same_images_and_graph_equals_eager(env, make_nav_env):
    first = records(env)
    assert any(step["done"].any() for step in first)
    assert_same(first, records(env))
    assert_same(first, records(make_nav_env(CONFIG, NUM_ENVS, seed=5, capture=False)))
    env.reseed(6)
    assert not np.array_equal(env.reset()["depth"].cpu().numpy(), first[0]["depth"])


def test_resumed_worlds_do_not_repeat_their_noise(env, make_nav_env):
    """The counter of the camera's episodes is part of the environment's state."""
    records(env)
    other = make_nav_env(CONFIG, NUM_ENVS, seed=5)
    other.load_state_dict(env.state_dict())
    env.load_state_dict(env.state_dict())
    assert torch.equal(env.depth.counter, other.depth.counter) and int(env.depth.counter.min()) > 1
    assert torch.equal(env.get_observations()["depth"], other.get_observations()["depth"])


def test_images_are_on_where_a_model_reads_them():
    values = {
        "task": {"name": "nav", "camera_mount": "landscape", "depth": {"enabled": False}},
        "runner": {
            "obs_groups": {"actor": ["proprio", "goal", "depth"], "critic": ["scandots"]},
            "actor": {"depth_encoder": {"hidden": [8]}},
            "critic": {},
        },
        "robot": {"profile": "paper"},
        "scene": {},
        "sim": {},
        "depth": {"filter": {"far_m": 3.0}},
    }
    assert NAV.configure(values).depth is None
    changed = with_depth(values)
    assert NAV.configure(changed).depth.filter.far_m == 3.0
    assert changed["runner"]["actor"]["depth_encoder"] == {"image": [58, 87], "hidden": [8]}
    assert changed["runner"]["critic"] == {} and values["task"]["depth"] == {"enabled": False}
    values["runner"]["obs_groups"]["actor"] = ["proprio", "goal", "scandots"]
    assert with_depth(values) == values


def test_shape_follows_the_mount(make_nav_env):
    assert image_shape("portrait") == (87, 58)
    config = replace(CONFIG, camera_mount="landscape", depth=DepthConfig())
    assert (
        make_nav_env(config, 1).depth.pipeline.policy.shape == (1, *image_shape("landscape")) == (1, 58, 87)
    )


def test_settings_are_checked_by_name():
    assert NAV.as_trained(["depth=d435i"]).depth is None
    assert NAV.as_trained(["depth=d435i", "task.depth.enabled=true"]).depth.noise.dropout > 0.0
    for override, message in (
        ("+depth.noise.drop=1", "depth.noise.drop: unknown key"),
        ("depth.noise.dropout=2", "depth.noise.dropout must be"),
        ("+task.depth.noise=1", "task.depth.noise: unknown key"),
        ("task.depth.enabled=1", "task.depth.enabled: expected true or false"),
    ):
        with pytest.raises(ConfigError, match=message):
            NAV.as_trained([override])
