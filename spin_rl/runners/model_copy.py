"""Copy a model's weights into another whose inputs or layers differ: what is new starts without effect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import torch
from torch import nn

from spin_rl.groups import OBJECT, OBJECT_AT_START, is_depth, is_encoded, is_seen
from spin_rl.models import ScandotModel, ScandotRecurrentModel
from spin_rl.models.depth_encoder import DepthEncoder, DepthEncoderConfig
from spin_rl.runners.interface import Camera

Columns = tuple[list[int], list[int]]
"""Columns of the target and, in the same order, those of the source that they are copied from."""


@torch.no_grad()
def copy_model(
    target: ScandotModel, source: ScandotModel, unlearned: Camera, new_std: tuple[int, ...] = ()
) -> str:
    """Copy one model into another; inputs that the source has not become columns of zeros.

    Args:
        target: New model, changed in place.
        source: Trained model.
        unlearned: Camera that the source never moved: its columns and actions are not copied.
        new_std: Actions that keep the target's standard deviation.

    Returns:
        What was copied and what is new.

    Raises:
        ValueError: What of the source has no place in the target.
    """
    seen = _match_seen(target, source)
    _check(target, source)
    dropped = unlearned.columns_of(source)
    inputs, notes = _match_inputs(target, source, seen, set(dropped))
    flat = _restrict(inputs, target.obs_dim)

    if target.obs_normalization:
        _copy_normalizer(target.obs_normalizer, source.obs_normalizer, flat)
    elif dropped:
        raise ValueError("it does not normalize, so the effect of its camera's pose cannot be taken out")
    for own, other in seen.items():
        if is_depth(own) == is_depth(other):
            _copy_encoder(target.encoders[own], source.encoders[other], flat)
        else:
            guess = _begin_with_guess(target, source, own, other)
            notes.append(f"new encoder of {own}{guess}")

    if isinstance(source, ScandotRecurrentModel):
        assert isinstance(target, ScandotRecurrentModel)  # `_check` has seen to it
        weights = dict(source.lstm.named_parameters())
        for name, parameter in target.lstm.named_parameters():
            if "weight_ih" in name:
                _copy_columns(parameter, weights[name], inputs)
            else:
                parameter.copy_(weights[name])
        notes.append("memory")
    elif target.is_recurrent:
        notes.append("new memory")

    layers = zip(_linear(target.mlp), _linear(source.mlp), strict=True)
    for index, (layer, other) in enumerate(layers):
        layer.bias.copy_(other.bias)
        if index == 0:
            _copy_columns(layer.weight, other.weight, _head_columns(target, source, inputs))
        else:
            layer.weight.copy_(other.weight)
    last = _linear(target.mlp)[-1]
    for action in unlearned.actions if target.distribution is not None else ():
        last.weight[action] = 0.0
        last.bias[action] = 0.0
        notes.append(f"new action {action}")
    if target.distribution is not None and not _copy_std(target.distribution, source.distribution, new_std):
        notes.append("new standard deviations")
    return ", ".join(notes)


def _match_seen(target: ScandotModel, source: ScandotModel) -> dict[str, str]:
    """Pair the encoded groups of the target with those of the source, or with a flat one that it sees."""
    own, other = set(target.encoders), {name for name in source.blocks if is_seen(name)}
    pairs = {name: name for name in own & other}
    left = sorted(other - set(target.blocks))
    free = sorted(own - other)
    fits = len(left) == len(free) == 1 and (is_encoded(left[0]) or is_depth(free[0]))
    if left and not fits:
        raise ValueError(f"it reads {left[0]}, which has no counterpart among {_names(own)}")
    return pairs | dict(zip(free, left, strict=False))


def _match_inputs(
    target: ScandotModel, source: ScandotModel, seen: dict[str, str], dropped: set[int]
) -> tuple[Columns, list[str]]:
    """Pair the columns of what `encode` returns, and describe them."""
    own, other = target.blocks, source.blocks
    columns: Columns = ([], [])
    notes = []
    for name, block in own.items():
        origin = seen.get(name, name)
        if origin not in other:
            notes.append(f"new {name}")
            continue
        size, other_size = block.stop - block.start, other[origin].stop - other[origin].start
        if other_size > size:
            raise ValueError(f"its {origin} has {other_size} columns, the new one's {name} {size}")
        kept = [i for i in range(other_size) if other[origin].start + i not in dropped]
        columns[0].extend(block.start + i for i in kept)
        columns[1].extend(other[origin].start + i for i in kept)
        notes.append(name if origin == name else f"{origin} as {name}")
        if len(kept) < size:
            notes[-1] += f" ({len(kept)} of {size} columns)"
    missing = set(other) - {seen.get(name, name) for name in own}
    if missing:
        raise ValueError(f"it reads {_names(missing)}, which the new one does not")
    return columns, notes


def _copy_encoder(target: nn.Module, source: nn.Module, flat: Columns) -> None:
    """Copy an encoder; of the flat inputs that it reads beside an image, those of the source by column."""
    if isinstance(target, DepthEncoder) and isinstance(source, DepthEncoder):
        target.load_state_dict(_depth_state(target, source, flat))
        return
    layers = zip(_linear(cast(Any, target).mlp), _linear(cast(Any, source).mlp), strict=True)
    for layer, other in layers:
        _widen(layer, other)


def _widen(layer: nn.Linear, other: nn.Linear) -> None:
    """Copy a layer into one that may be wider: what is new has no effect on the source's outputs.

    New outputs keep the weights that they were made with.
    """
    layer.weight[: other.out_features] = 0.0
    layer.weight[: other.out_features, : other.in_features] = other.weight
    layer.bias[: other.out_features] = other.bias


def _depth_state(target: DepthEncoder, source: DepthEncoder, flat: Columns) -> dict[str, torch.Tensor]:
    """The source's weights in the target's shapes; what it does not read has no effect."""
    state = dict(source.state_dict())
    own, other = (
        _read_columns(encoder, side, source) for encoder, side in zip((target, source), flat, strict=True)
    )
    weight = torch.empty_like(_linear(target.mlp)[0].weight)
    _copy_columns(weight, state["mlp.0.weight"], (own, other))
    state["mlp.0.weight"] = weight
    if not source.cfg.hand_window:
        state |= {name: value for name, value in target.state_dict().items() if name.startswith("hand_")}
    if target.shortcut is not None:
        weight = torch.zeros_like(target.shortcut.weight)
        if source.cfg.shortcut:
            _copy_columns(weight, state["shortcut.weight"], flat)
        state["shortcut.weight"] = weight
        state.setdefault("shortcut.bias", torch.zeros_like(target.shortcut.bias))
    return state


def _read_columns(encoder: DepthEncoder, flat: list[int], source: DepthEncoder) -> list[int]:
    """Columns of an encoder's fully connected layers that a source has too, in the same order for both."""
    cfg = encoder.cfg
    size = cfg.num_features + source.cfg.num_hand_features
    first_flat = cfg.num_features + cfg.num_hand_features
    return [*range(size), *(first_flat + i for i in flat if source.cfg.reads_flat)]


def _begin_with_guess(target: ScandotModel, source: ScandotModel, own: str, other: str) -> str:
    """Let a new encoder with a shortcut say at first that the object is where it was at the start.

    The model then acts as the source does while that is so; the image has to tell when it is not.

    Returns:
        What it begins with, for the description; empty if there is no such guess.
    """
    encoder = target.encoders[own]
    if other != OBJECT or OBJECT_AT_START not in target.flat_dims:
        return ""
    if not isinstance(encoder, DepthEncoder) or encoder.shortcut is None:
        return ""
    blocks = target.blocks[OBJECT_AT_START], source.blocks[OBJECT]
    guess, told = ([*range(block.start, block.stop)] for block in blocks)
    if target.obs_normalization:
        _copy_normalizer(target.obs_normalizer, source.obs_normalizer, (guess, told))
    encoder.shortcut.weight.zero_()
    encoder.shortcut.weight[range(len(guess)), guess] = 1.0
    last = _linear(encoder.mlp)[-1]
    for parameter in (encoder.shortcut.bias, last.weight, last.bias):
        parameter.zero_()
    return f" that begins with {OBJECT_AT_START}"


def _check(target: ScandotModel, source: ScandotModel) -> None:
    """Reject architectures of which one cannot act as the other."""
    if source.is_recurrent and not target.is_recurrent:
        raise ValueError("its LSTM has no counterpart in a feed-forward model")
    if _reads_inputs(source) and not _reads_inputs(target):
        raise ValueError("its MLP reads the observations; give the new one +runner.actor.skip=true")
    facts = [
        ("obs_normalization", lambda model: model.obs_normalization),
        ("layers of the MLP", lambda model: _shape(model.mlp)),
    ]
    if source.is_recurrent:
        facts.append(("rnn_hidden_dim", lambda model: model.rnn_hidden_dim))
    for name, read in facts:
        if read(target) != read(source):
            raise ValueError(f"its {name}: {read(source)}, the new one's: {read(target)}")
    for own, other in _match_seen(target, source).items():
        if is_depth(own) != is_depth(other):
            continue
        encoders = target.encoders[own], source.encoders[other]
        layers: list[Any]
        if is_depth(own):  # the new one may read more than the image
            layers = [(encoder.cfg, f"latent {encoder.latent}") for encoder in encoders]
            fits = (
                _without_additions(layers[0][0]) == _without_additions(layers[1][0])
                and layers[0][1] == layers[1][1]
                and layers[0][0].reads_flat >= layers[1][0].reads_flat
                and layers[0][0].shortcut >= layers[1][0].shortcut
                and layers[1][0].hand_window in (0, layers[0][0].hand_window)
            )
        else:
            mlps = [cast(nn.Sequential, encoder.mlp) for encoder in encoders]
            layers = [[_linear(mlp)[0].in_features, *_shape(mlp)] for mlp in mlps]
            fits = _is_as_wide(*layers)
        if not fits:
            raise ValueError(f"its encoder of {other} is {layers[1]}, the new one's is {layers[0]}")


def _is_as_wide(own: list[Any], other: list[Any]) -> bool:
    """Whether an encoder of inputs, outputs and activations holds another one with the same inputs."""
    if own[0] != other[0] or len(own) != len(other):
        return False
    pairs = zip(own, other, strict=True)
    return all(a == b or (isinstance(a, int) and isinstance(b, int) and a > b) for a, b in pairs)


def _without_additions(cfg: DepthEncoderConfig) -> DepthEncoderConfig:
    """The layers of an encoder, whatever it reads beside the image as a whole."""
    return replace(cfg, reads_flat=False, shortcut=False, hand_window=0)


def _head_columns(target: ScandotModel, source: ScandotModel, inputs: Columns) -> Columns:
    """Pair the columns of the MLP's first layer: observations, if it reads them, then the LSTM's output."""
    own, other = inputs if _reads_inputs(source) else ([], [])
    if isinstance(source, ScandotRecurrentModel):
        size = source.rnn_hidden_dim
        starts = [_linear(model.mlp)[0].in_features - size for model in (target, source)]
        own = [*own, *range(starts[0], starts[0] + size)]
        other = [*other, *range(starts[1], starts[1] + size)]
    return own, other


def _reads_inputs(model: ScandotModel) -> bool:
    return not isinstance(model, ScandotRecurrentModel) or model.skip


def _copy_columns(target: torch.Tensor, source: torch.Tensor, columns: Columns) -> None:
    target.zero_()
    target[:, columns[0]] = source[:, columns[1]].to(target.device)


def _restrict(columns: Columns, size: int) -> Columns:
    """Keep the pairs of the target's first columns."""
    pairs = [pair for pair in zip(*columns, strict=True) if pair[0] < size]
    return [own for own, _ in pairs], [other for _, other in pairs]


def _copy_normalizer(target: nn.Module, source: nn.Module, columns: Columns) -> None:
    own, other = target.state_dict(), source.state_dict()
    own["count"].copy_(other["count"])
    for name in ("_mean", "_var", "_std"):
        own[name][:, columns[0]] = other[name][:, columns[1]].to(own[name].device)


def _copy_std(target: nn.Module, source: nn.Module | None, kept: tuple[int, ...]) -> bool:
    """Copy standard deviations that are parameters, whether as such or as logarithms; tell if they are."""
    own = dict(target.named_parameters())
    other = {} if source is None else dict(source.named_parameters())
    if "std_param" in other:
        std = other["std_param"]
    elif "log_std_param" in other:
        std = other["log_std_param"].exp()
    else:
        return False
    copied = [action for action in range(len(std)) if action not in kept]
    if "std_param" in own:
        own["std_param"][copied] = std[copied].to(own["std_param"])
    elif "log_std_param" in own:
        own["log_std_param"][copied] = std[copied].log().to(own["log_std_param"])
    else:
        return False
    return True


def _linear(mlp: nn.Sequential) -> list[nn.Linear]:
    return [layer for layer in mlp if isinstance(layer, nn.Linear)]


def _shape(mlp: nn.Sequential) -> list[Any]:
    """Outputs of the linear layers, and the kinds of what is between them."""
    return [layer.out_features if isinstance(layer, nn.Linear) else type(layer).__name__ for layer in mlp]


def _names(groups: set[str]) -> str:
    return ", ".join(sorted(groups)) or "none"
