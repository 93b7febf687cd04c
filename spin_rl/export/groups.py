"""Every observation group that can be exported: its terms with their units and scaling.

Scales are not written down a second time: they are probed from the formulas that training uses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.deploy.contract import FLOAT32, UINT8, Camera, Group, Term
from spin_rl.deploy.observations import CLOSE_PER_M, NEAR_PER_M
from spin_rl.groups import HAND_IN_IMAGE, OBJECT, OBJECT_AT_START, is_depth
from spin_rl.tasks.common import formulas
from spin_rl.tasks.common.depth import MOST_OUTSIDE
from spin_rl.tasks.common.proprioception import PROPRIO

_XYZ = ("x", "y", "z")


def describe_group(name: str, size: int, camera: Camera) -> Group:
    """Describe an observation group of a policy.

    Args:
        name: Name of the group.
        size: Its columns.
        camera: The policy's camera.

    Raises:
        ConfigError: No robot could tell what it is, nor does a simulation for policies.
    """
    if is_depth(name):
        return Group(name, UINT8, size, "camera")
    if name.startswith("scandots"):
        return Group(name, FLOAT32, size, "simulation")
    if name == OBJECT:
        return Group(name, FLOAT32, size, "detector")
    if name not in _TERMS:
        raise ConfigError(f"policy: it reads {name!r}, which cannot be exported")
    source = "detector" if name.startswith(OBJECT) else "robot"
    return Group(name, FLOAT32, size, source, tuple(_TERMS[name](camera)))


def _proprio(camera: Camera) -> list[Term]:
    labels = {
        "joint_position": robot.JOINTS,
        "joint_velocity": robot.JOINTS,
        "base_velocity": ("forward", "turning"),
        "end_effector": _XYZ,
        "last_action": robot.ACTIONS,
    }
    units = {
        "joint_position": "m, rad",
        "joint_velocity": "m/s, rad/s",
        "base_velocity": "m/s, rad/s",
        "end_effector": "m, base frame",
        "last_action": "1, as it was sent",
    }
    probed = {"joint_position": formulas.joint_position, "joint_velocity": formulas.joint_velocity}
    return [_term(name, labels[name], units[name], probed.get(name)) for name in PROPRIO]


def _goal(camera: Camera) -> list[Term]:
    scale = 1.0 / formulas.GOAL_SCALE_M
    return [_scaled("goal", ("x", "y", "distance"), "m, base frame", scale)]


def _hand(camera: Camera) -> list[Term]:
    labels = [f"{axis} axis, {part}" for axis in ("x", "z") for part in _XYZ]
    return [
        _term("hand_axes", labels, "1, base frame"),
        _term("grip", ("target of the fingers minus where they are",), "rad"),
    ]


def _object_start(camera: Camera) -> list[Term]:
    return [_term("object_start", _XYZ, "m, base frame")]


def _object_at_start(camera: Camera) -> list[Term]:
    unit = "m from the grasp centre, in its axes"
    return [
        _term("object_is_told", ("always",), "1"),
        _term("object_start", _XYZ, "m, base frame"),
        _scaled("object_start_near", _XYZ, unit, NEAR_PER_M, 1.0),
        _scaled("object_start_close", _XYZ, unit, CLOSE_PER_M, 1.0),
    ]


def _hand_in_image(camera: Camera) -> list[Term]:
    if camera.range_m is None:
        raise ConfigError(f"policy: {HAND_IN_IMAGE} has no meaning without images")
    near, far = camera.range_m
    depth = Term("hand_depth", ("depth",), "m", (1.0 / (far - near),), (-near / (far - near),))
    return [_scaled("hand_pixel", ("right", "down"), "half images", 1.0, MOST_OUTSIDE), depth]


_TERMS: dict[str, Callable[[Camera], list[Term]]] = {
    "proprio": _proprio,
    "goal": _goal,
    "hand": _hand,
    "object_start": _object_start,
    OBJECT_AT_START: _object_at_start,
    HAND_IN_IMAGE: _hand_in_image,
}


def _term(
    name: str,
    labels: Sequence[str],
    unit: str,
    formula: Callable[[torch.Tensor], torch.Tensor] | None = None,
) -> Term:
    """Describe columns that a linear formula, or none, scales."""
    if formula is None:
        return _scaled(name, labels, unit, 1.0)
    bias, one = (formula(torch.full((1, len(labels)), value, dtype=torch.float64))[0] for value in (0.0, 1.0))
    return Term(name, tuple(labels), unit, tuple((one - bias).tolist()), tuple(bias.tolist()))


def _scaled(name: str, labels: Sequence[str], unit: str, scale: float, clip: float | None = None) -> Term:
    count = len(labels)
    return Term(name, tuple(labels), unit, (scale,) * count, (0.0,) * count, clip)
