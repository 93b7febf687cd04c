"""Noise and filter in a row, and the configuration group `depth`."""

import dataclasses

import numpy as np
import pytest
import warp as wp
import yaml

from spin_rl.config import ConfigError, from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.sensors.depth.filter import DepthFilter
from spin_rl.sensors.depth.noise import DepthNoise
from spin_rl.sensors.depth.pipeline import DepthConfig, DepthPipeline

TAN = (0.949, 0.554)


def load(name):
    return yaml.safe_load((CONF_DIR / "depth" / f"{name}.yaml").read_text())


def names(cls):
    return {f.name for f in dataclasses.fields(cls)}


@pytest.mark.parametrize("name", ["ideal", "d435i"])
def test_configuration_files_are_complete(name):
    values = load(name)
    config = from_mapping(DepthConfig, values, "depth")
    for part in ("noise", "filter"):
        assert set(values[part]) == names(type(getattr(config, part)))
    assert (config == DepthConfig()) == (name == "ideal")


@pytest.mark.parametrize(
    "values, key",
    [
        ({"noise": {"dropout": 2.0}}, "depth.noise.dropout"),
        ({"filter": {"blur": 2.0}}, "depth.filter.blur"),
        ({"noise": {"patches": 0.5}}, "depth.noise.patches"),
        ({"noise": {"fog": 1.0}}, "depth.noise.fog"),
    ],
)
def test_errors_name_the_key(values, key):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        from_mapping(DepthConfig, values, "depth")


def test_measures_then_filters_and_restarts_both(device):
    config = from_mapping(DepthConfig, load("d435i"), "depth")
    ideal = wp.zeros((3, 87, 58), dtype=float, device=device)
    seed = wp.array([3], dtype=wp.int32, device=device)
    pipeline = DepthPipeline(ideal, config, tan_half_fov=TAN, seed=seed)
    noise = DepthNoise(ideal, config.noise, tan_half_fov=TAN, seed=seed)
    filtered = DepthFilter(noise.depth, config.filter, stereo_along_rows=False)
    rng = np.random.default_rng(0)
    for mask in ([True] * 3, [False] * 3, [False, True, False], [False] * 3):
        mask = wp.array(mask, dtype=bool, device=device)
        for part in (pipeline, noise, filtered):
            part.begin(mask)
        ideal.assign(np.repeat(rng.uniform(1.0, 3.0, (3, 29, 2)), 3, axis=1).repeat(29, axis=2))
        pipeline.update()
        noise.update()
        filtered.update()
        np.testing.assert_array_equal(pipeline.policy.numpy(), filtered.policy.numpy())
    assert 0.0 < pipeline.policy.numpy().std()


def test_ideal_camera_shows_the_exact_image(device):
    image = np.random.default_rng(0).uniform(0.1, 5.0, (2, 87, 58)).astype(np.float32)
    image[:, 3:6] = 0.0
    config = from_mapping(DepthConfig, load("ideal"), "depth")
    seed = wp.zeros(1, dtype=wp.int32, device=device)
    pipeline = DepthPipeline(wp.array(image, dtype=float, device=device), config, tan_half_fov=TAN, seed=seed)
    pipeline.update()
    expected = np.where(image > 0.0, np.clip((image - 0.2) / 3.8, 0.0, 1.0), 1.0)
    np.testing.assert_allclose(pipeline.policy.numpy(), expected, atol=1e-6)
