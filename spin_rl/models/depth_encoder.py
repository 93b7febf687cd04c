"""Encoder that compresses a depth image into one latent vector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, cast

import torch
from torch import nn
from torch.nn import functional

from spin_rl.config import Range, from_mapping
from spin_rl.models.pointnet import token_mlp
from spin_rl.models.settings import Width

Pixels = Annotated[int, Range(1, 1000)]

_HAND_CHANNELS, _HAND_KERNEL, _HAND_STRIDE = (16, 32), 3, 2
"""Of the convolutions that read a window around the hand."""
_HAND_SCALE = 10.0
"""Of depths from the hand's, in a window: a tenth of the image's range is 1 and cut off."""


@dataclass(frozen=True)
class DepthEncoderConfig:
    """Layers of the encoder.

    Attributes:
        image: Rows and columns of the image.
        channels: Output channels of each convolution.
        kernels: Side of the square kernel of each convolution.
        strides: Its stride.
        hidden: Outputs of the fully connected layers before the latent's.
        reads_flat: The fully connected layers also read the model's flat groups. Where a pixel is in the base
            frame depends on how the head is turned, which `proprio` tells.
        shortcut: A linear layer adds the flat groups to the latent: what they tell already, the image only
            has to correct.
        hand_window: Rows and columns of a window around the hand that further convolutions read, 0 for none.
            There a pixel's place is its offset from the hand in the camera's axes, wherever the hand is.
    """

    image: tuple[Pixels, Pixels] = (87, 58)
    channels: tuple[Width, ...] = (16, 32, 32)
    kernels: tuple[Pixels, ...] = (8, 4, 3)
    strides: tuple[Pixels, ...] = (4, 2, 1)
    hidden: tuple[Width, ...] = (128, 64)
    reads_flat: bool = False
    shortcut: bool = False
    hand_window: Annotated[int, Range(0, 256)] = 0

    def __post_init__(self) -> None:
        """Reject layers that do not fit each other or the image."""
        if not 0 < len(self.channels) == len(self.kernels) == len(self.strides) <= 16 >= len(self.hidden):
            raise ValueError("depth_encoder.channels, kernels and strides must have the same length (<= 16).")
        sizes = (*self.image, *self.channels, *self.kernels, *self.strides, *self.hidden)
        if min(*sizes, 1) < 1 or self.hand_window < 0:
            raise ValueError("depth_encoder: sizes must be positive.")
        if self.hand_window and self.hand_map_side < 1:
            raise ValueError(f"depth_encoder.hand_window: nothing is left of {self.hand_window} pixels.")
        if min(self.map_size) < 1:
            raise ValueError(f"depth_encoder: the convolutions leave nothing of a {self.image} image.")

    @property
    def map_size(self) -> tuple[int, int]:
        """Rows and columns after the convolutions."""
        rows, columns = self.image
        for kernel, stride in zip(self.kernels, self.strides, strict=True):
            rows, columns = ((size - kernel) // stride + 1 for size in (rows, columns))
        return rows, columns

    @property
    def hand_map_side(self) -> int:
        """Rows and columns that the further convolutions leave of the window."""
        side = self.hand_window
        for _ in _HAND_CHANNELS:
            side = (side - _HAND_KERNEL) // _HAND_STRIDE + 1
        return side

    @property
    def num_features(self) -> int:
        """Numbers that the convolutions leave of an image."""
        rows, columns = self.map_size
        return self.channels[-1] * rows * columns

    @property
    def num_hand_features(self) -> int:
        """Numbers that the further convolutions leave of the window around the hand."""
        return _HAND_CHANNELS[-1] * self.hand_map_side**2 if self.hand_window else 0

    @property
    def num_pixels(self) -> int:
        """Numbers in an image."""
        return self.image[0] * self.image[1]


class DepthEncoder(nn.Module):
    """Convolutions, then fully connected layers to the latent.

    Images are 8-bit, 0 to 255 for 0 to 1, as they are stored, and converted only where they are used.

    Source: SPIN supplement, network architecture (58 x 87 pixels, 3 convolutions, 3 fully connected layers).
    """

    def __init__(self, cfg: DepthEncoderConfig, latent: int = 16, num_flat: int = 0) -> None:
        """Build the layers; `num_flat` numbers are read beside the image if the configuration says so."""
        super().__init__()
        self.cfg = cfg
        self.latent = latent
        self.convolutions = _convolutions(cfg.channels, cfg.kernels, cfg.strides)
        channels = _HAND_CHANNELS if cfg.hand_window else ()
        number = len(channels)
        self.hand_convolutions = _convolutions(channels, (_HAND_KERNEL,) * number, (_HAND_STRIDE,) * number)
        num_inputs = cfg.num_features + cfg.num_hand_features + (num_flat if cfg.reads_flat else 0)
        self.mlp = token_mlp(num_inputs, cfg.hidden, latent, "relu")
        self.shortcut = nn.Linear(num_flat, latent) if cfg.shortcut else None

    @property
    def _dtype(self) -> torch.dtype:
        return cast(nn.Linear, self.mlp[0]).weight.dtype

    def forward(
        self, images: torch.Tensor, flat: torch.Tensor | None = None, hand: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Encode images as (..., latent).

        Args:
            images: Shape (..., rows * columns), uint8.
            flat: Flat inputs, normalized, shape (..., num_flat); may be None where they are not read.
            hand: `HAND_IN_IMAGE`, shape (..., 3); may be None where no window around it is read.
        """
        batch = images.shape[:-1]
        rows, columns = self.cfg.image
        pixels = images.reshape(-1, rows, columns, 1).to(self._dtype) / 255.0
        # Strides of channels-last memory, for which convolutions learn faster on the CPU.
        pixels = pixels.permute(0, 3, 1, 2)
        features = self.convolutions(pixels).flatten(1)
        if self.cfg.hand_window:
            assert hand is not None
            window = hand_window(pixels, hand.flatten(0, -2), self.cfg.hand_window)
            features = torch.cat((features, self.hand_convolutions(window).flatten(1)), -1)
        if self.cfg.reads_flat:
            assert flat is not None
            features = torch.cat((features, flat.flatten(0, -2)), -1)
        latent = self.mlp(features).view(*batch, self.latent)
        if self.shortcut is not None:
            assert flat is not None
            latent = latent + self.shortcut(flat)
        return latent


def _convolutions(
    channels: tuple[int, ...], kernels: tuple[int, ...], strides: tuple[int, ...]
) -> nn.Sequential:
    layers: list[nn.Module] = []
    inputs = 1
    for width, kernel, stride in zip(channels, kernels, strides, strict=True):
        layers += [nn.Conv2d(inputs, width, kernel, stride), nn.ReLU()]
        inputs = width
    return nn.Sequential(*layers)


def hand_window(pixels: torch.Tensor, hand: torch.Tensor, side: int) -> torch.Tensor:
    """Cut a square around the hand out of images, to fractions of a pixel; depths are from the hand's.

    Args:
        pixels: Shape (num, 1, rows, columns), 0 to 1.
        hand: `HAND_IN_IMAGE`, shape (num, 3).
        side: Rows and columns of the squares.

    Returns:
        Shape (num, 1, side, side), -1 to 1. Beyond the image's edge the edge goes on.
    """
    rows, columns = pixels.shape[-2:]
    steps = torch.arange(side, device=pixels.device) - 0.5 * (side - 1)
    x = hand[:, 0, None, None] + 2.0 / columns * steps
    y = hand[:, 1, None, None] + 2.0 / rows * steps[:, None]
    grid = torch.stack(torch.broadcast_tensors(x, y), -1)
    window = functional.grid_sample(pixels, grid, padding_mode="border", align_corners=False)
    return (_HAND_SCALE * (window - hand[:, 2, None, None, None])).clamp(-1.0, 1.0)


def make_depth_encoder(
    values: Mapping[str, Any], group: str, size: int, latent: int, num_flat: int
) -> DepthEncoder:
    """Build the encoder of an observation group.

    Args:
        values: Keys of `DepthEncoderConfig`.
        group: Name of the group.
        size: Its numbers per environment.
        latent: Size of the latent.
        num_flat: Size of the model's flat groups together.

    Raises:
        ConfigError: A setting is unknown or impossible.
        ValueError: The group is no image of this size.
    """
    cfg = from_mapping(DepthEncoderConfig, values, "depth_encoder")
    if size != cfg.num_pixels:
        raise ValueError(
            f"Observation group '{group}' has {size} pixels; depth_encoder.image is {cfg.image}."
        )
    return DepthEncoder(cfg, latent, num_flat)
