"""A trained actor as an ONNX graph: its memory is an input and an output, normalization is inside."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator
from typing import Any, cast

import torch
from torch import nn

from spin_rl.config import ConfigError
from spin_rl.deploy.contract import ACTION_OUTPUT, STATE
from spin_rl.extras import require
from spin_rl.groups import is_depth
from spin_rl.models.scandot import ScandotModel, ScandotRecurrentModel

OPSET = 20
"""The lowest that has everything, `GridSample` on images among it."""


class SteppedActor(nn.Module):
    """One step of a recurrent actor, deterministic, with its memory as arguments."""

    def __init__(self, actor: ScandotRecurrentModel, groups: tuple[str, ...]) -> None:
        """Keep the actor; `groups` names its observation groups in the order of the arguments."""
        super().__init__()
        self._actor = actor
        self._groups = groups

    def forward(self, *arguments: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Take the groups, each of shape (1, size), h and c, (1, 1, units); return actions, h and c."""
        *observations, h, c = arguments
        actor = self._actor
        x = actor.encode(dict(zip(self._groups, observations, strict=True)))
        out, (h, c) = actor.lstm.rnn(x.unsqueeze(0), (h, c))
        latent = torch.cat([x, out.squeeze(0)], -1) if actor.skip else out.squeeze(0)
        output = actor.mlp(latent)
        distribution = cast(Any, actor.distribution)
        return output if distribution is None else distribution.deterministic_output(output), h, c


def recurrent(actor: ScandotModel, name: str) -> ScandotRecurrentModel:
    """Return an actor as what can be exported.

    Raises:
        ConfigError: It has no memory.
    """
    if not isinstance(actor, ScandotRecurrentModel):
        raise ConfigError(f"policy: {name} has no recurrent memory; only recurrent policies can be exported")
    return actor


def example_inputs(actor: ScandotRecurrentModel, dims: dict[str, int]) -> tuple[torch.Tensor, ...]:
    """Return zeros in the shape of a step's inputs: the groups in `dims`, then the memory."""
    groups = (
        torch.zeros(1, size, dtype=torch.uint8 if is_depth(group) else torch.float32)
        for group, size in dims.items()
    )
    return (*groups, *(torch.zeros(1, 1, actor.rnn_hidden_dim) for _ in STATE))


def make_graph(actor: ScandotRecurrentModel, dims: dict[str, int]) -> Any:
    """Export an actor.

    Args:
        actor: In evaluation mode, on the CPU.
        dims: Size of every observation group that it reads, in its order.

    Returns:
        The `onnx.ModelProto`, with inputs and outputs named after the groups and `contract.STATE`.

    Raises:
        ConfigError: A package of the extra `export` is missing.
    """
    for package in ("onnx", "onnxscript"):
        require(package, package, "export", "policy")
    step = SteppedActor(actor, tuple(dims)).eval()
    with _quiet():
        program = torch.onnx.export(
            step,
            example_inputs(actor, dims),
            dynamo=True,
            opset_version=OPSET,
            input_names=[*dims, *STATE],
            output_names=[ACTION_OUTPUT, *STATE.values()],
            verbose=False,
        )
    assert program is not None
    return _without_traces(program.model_proto)


def _without_traces(model: Any) -> Any:
    """Remove what the exporter notes of every node: where in which file on this machine it came from."""
    graphs = [model.graph, *model.functions]
    for graph in graphs:
        graph.ClearField("metadata_props")
        for value in getattr(graph, "value_info", ()):
            value.ClearField("metadata_props")
        for node in graph.node:
            node.ClearField("metadata_props")
            graphs.extend(attribute.g for attribute in node.attribute if attribute.HasField("g"))
    return model


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the exporter from warning of its own insides."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
