"""The depth encoder against plain arithmetic, and in the models."""

import pytest
import torch
from tensordict import TensorDict
from torch.nn import functional

from spin_rl.config import ConfigError
from spin_rl.models import DepthEncoder, DepthEncoderConfig, ScandotModel, ScandotRecurrentModel
from spin_rl.models.depth_encoder import hand_window

SMALL = {"image": [9, 6], "channels": [4, 3], "kernels": [3, 2], "strides": [2, 1], "hidden": [7]}


def make_observations(*shape, pixels=54):
    generator = torch.Generator().manual_seed(0)
    groups = {
        "proprio": torch.randn(*shape, 5, generator=generator),
        "depth": torch.randint(0, 256, (*shape, pixels), generator=generator, dtype=torch.uint8),
    }
    return TensorDict(groups, batch_size=shape)


def test_default_is_the_papers_kind_and_light():
    encoder = DepthEncoder(DepthEncoderConfig())
    kinds = [type(layer).__name__ for layer in (*encoder.convolutions, *encoder.mlp)]
    assert kinds.count("Conv2d") == 3 and kinds.count("Linear") == 3
    macs = []

    def count(layer, inputs, output):
        macs.append(output[0].numel() * layer.weight[0].numel())

    for layer in (*encoder.convolutions, *encoder.mlp):
        if hasattr(layer, "weight"):
            layer.register_forward_hook(count)
    assert encoder(torch.zeros(1, 87 * 58, dtype=torch.uint8)).shape == (1, 16)
    assert sum(macs) < 1.0e6


def test_image_is_read_row_by_row_and_scaled(device):
    """The first convolution at every place, as products of cut-out squares."""
    torch.manual_seed(0)
    encoder = DepthEncoder(DepthEncoderConfig((9, 6), (4,), (3,), (2,), ()), latent=5).to(device)
    images = make_observations(2)["depth"].to(device)
    convolution = encoder.convolutions[0]
    maps = torch.zeros(2, 4, 4, 2, device=device)
    for row in range(4):
        for column in range(2):
            square = images.view(2, 9, 6)[:, 2 * row : 2 * row + 3, 2 * column : 2 * column + 3] / 255.0
            maps[:, :, row, column] = square.flatten(1) @ convolution.weight.flatten(1).t() + convolution.bias
    expected = functional.relu(maps).flatten(1) @ encoder.mlp[0].weight.t() + encoder.mlp[0].bias
    torch.testing.assert_close(encoder(images), expected)


def test_sequences_are_encoded_image_by_image():
    encoder = DepthEncoder(DepthEncoderConfig((9, 6), (4,), (3,), (2,), (8,)))
    images = make_observations(3, 4)["depth"]
    expected = torch.stack([torch.stack([encoder(image) for image in row]) for row in images])
    torch.testing.assert_close(encoder(images), expected)


@pytest.mark.parametrize("kind", [ScandotModel, ScandotRecurrentModel])
def test_models_read_images_beside_other_groups(kind):
    obs = make_observations(6)
    model = kind(obs, {"actor": ["proprio", "depth"]}, "actor", 2, depth_encoder=SMALL)
    encoded = model.encode(obs)
    assert encoded.shape == (6, 5 + 16) and model.flat_dims == {"proprio": 5}
    torch.testing.assert_close(encoded[:, 5:], model.encoders["depth"](obs["depth"]))
    assert model(obs).shape == (6, 2)
    model.update_normalization(obs)  # images are left alone
    assert model.obs_normalizer.mean.shape == (5,)


def test_a_shortcut_adds_flat_groups_to_the_latent():
    torch.manual_seed(1)
    cfg = DepthEncoderConfig(**SMALL, shortcut=True)
    encoder = DepthEncoder(cfg, 4, num_flat=5)
    images = torch.randint(0, 256, (6, cfg.num_pixels), dtype=torch.uint8)
    flat, change = torch.randn(6, 5), torch.randn(6, 5)
    moved = encoder(images, flat + change) - encoder(images, flat)
    torch.testing.assert_close(moved, change @ encoder.shortcut.weight.T)
    assert (moved.abs() > 1e-4).all()


@pytest.mark.parametrize("reads_flat", [False, True])
def test_the_latent_depends_on_flat_groups_if_they_are_read(reads_flat):
    """On the normalized ones; sequences as step by step."""
    obs = make_observations(3, 4)
    torch.manual_seed(0)
    settings = SMALL | {"reads_flat": reads_flat}
    model = ScandotModel(obs[0], {"actor": ["proprio", "depth"]}, "actor", 2, depth_encoder=settings)
    encoder = model.encoders["depth"]
    assert encoder.mlp[0].in_features == 3 * 3 * 1 + 5 * reads_flat
    model.update_normalization(obs.flatten())
    encoded = model.encode(obs)
    flat = model.obs_normalizer(obs["proprio"])
    torch.testing.assert_close(encoded[..., 5:], encoder(obs["depth"], flat if reads_flat else None))
    torch.testing.assert_close(encoded, torch.stack([model.encode(step) for step in obs]))
    moved = obs.clone()
    moved["proprio"][..., 2] += 1.0
    change = (model.encode(moved) - encoded)[..., 5:].abs().amax(-1)
    assert (change > 1e-4).all() if reads_flat else (change == 0.0).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kernel": [3]}, "depth_encoder.kernel: unknown key"),
        ({"kernels": [3]}, "must have the same length"),
        ({"strides": [2, 0]}, r"depth_encoder.strides\[1\]: expected a whole number from 1"),
        ({"kernels": [3, 5]}, "leave nothing of a"),
        ({"image": [9, 7]}, "'depth' has 54 pixels"),
        ({"channels": "many"}, "depth_encoder.channels: expected a list"),
    ],
)
def test_impossible_settings_are_named(settings, message):
    obs = make_observations(2)
    with pytest.raises((ConfigError, ValueError), match=message) as error:
        ScandotModel(obs, {"actor": ["proprio", "depth"]}, "actor", 2, depth_encoder=SMALL | settings)
    assert "\n" not in str(error.value)


def at_pixel(row, column, depth, image=(9, 6)):
    """`hand_in_image` of a hand in the middle of a pixel."""
    return torch.tensor([(2 * column + 1) / image[1] - 1, (2 * row + 1) / image[0] - 1, depth])


def test_the_window_is_cut_around_the_hand_with_depths_from_it():
    images = torch.linspace(0.3, 0.45, 54).view(1, 1, 9, 6)
    window = hand_window(images, at_pixel(4, 2, 0.36)[None], 3)
    torch.testing.assert_close(window, 10 * (images[:, :, 3:6, 1:4] - 0.36), atol=1e-5, rtol=0.0)
    # Between pixels: their mean. Beyond the edge: the edge. Far from the hand: the end of the scale.
    window = hand_window(images, at_pixel(4, 2.5, 0.36)[None], 1)
    torch.testing.assert_close(window[0, 0, 0, 0], 10 * (images[0, 0, 4, 2:4].mean() - 0.36))
    window = hand_window(images, at_pixel(0, 0, 0.9)[None], 3)
    assert (window == -1.0).all()
    window = hand_window(images, at_pixel(0, 0, 0.31)[None], 3)
    torch.testing.assert_close(window[0, 0, 0], window[0, 0, 1])


def test_window_features_move_with_the_hand():
    """What lies around the hand is the same wherever both are in the image; the rest of it is not."""
    torch.manual_seed(2)
    cfg = DepthEncoderConfig(**SMALL, hand_window=7)
    encoder = DepthEncoder(cfg, 4)
    assert encoder.mlp[0].in_features == cfg.num_features + 32
    image = torch.zeros(1, 9, 6, dtype=torch.uint8)  # beyond its edges all is as near as there
    image[:, 2:5, 1:4] = torch.randint(80, 100, (1, 3, 3), dtype=torch.uint8)
    moved = image.roll((2, 1), (1, 2))
    hands = at_pixel(3, 2, 0.35), at_pixel(5, 3, 0.35)
    with torch.no_grad():
        encoder.mlp[0].weight[:, : cfg.num_features] = 0.0
        both = [encoder(i.flatten(1), None, h[None]) for i, h in zip((image, moved), hands, strict=True)]
        other = encoder(moved.flatten(1), None, hands[0][None])
    torch.testing.assert_close(*both)
    assert not torch.allclose(other, both[0], atol=1e-3)


def test_models_hand_the_place_of_the_hand_on():
    obs = make_observations(6)
    obs["hand_in_image"] = 0.3 * torch.randn(6, 3)
    layers = SMALL | {"hand_window": 7}
    groups = {"actor": ["proprio", "hand_in_image", "depth"]}
    model = ScandotRecurrentModel(obs, groups, "actor", 2, depth_encoder=layers)
    expected = model.encoders["depth"](obs["depth"], None, obs["hand_in_image"])
    torch.testing.assert_close(model.encode(obs)[:, 8:], expected)
    with pytest.raises(ValueError, match=r"^depth_encoder\.hand_window needs the .* hand_in_image"):
        ScandotModel(obs, {"actor": ["proprio", "depth"]}, "actor", 2, depth_encoder=layers)
    with pytest.raises(ValueError, match=r"^depth_encoder\.hand_window: nothing is left of 4 pixels"):
        DepthEncoderConfig(**SMALL, hand_window=4)
