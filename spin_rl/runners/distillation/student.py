"""The student of a distillation: its model and configuration, by what its teacher reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rsl_rl.utils import resolve_class
from tensordict import TensorDict

from spin_rl.groups import HAND_IN_IMAGE, PRIVILEGED, is_encoded, is_seen, replaceable_group
from spin_rl.models import ScandotModel


def build_student(obs: TensorDict, cfg: Mapping[str, Any], num_actions: int) -> ScandotModel:
    """Build the student of a runner's configuration with new weights."""
    student_class, student_cfg = resolve_class(cfg["actor"])
    return student_class(obs, cfg["obs_groups"], "actor", num_actions, **student_cfg)


def student_config(
    teacher: Mapping[str, Any], depth_encoder: Mapping[str, Any], further_groups: Sequence[str] = ()
) -> dict[str, Any]:
    """Describe the student of a teacher: the same model with an image in place of what the teacher sees.

    The latent is as wide as what it stands for, the latent of scandots or the object's columns.

    Args:
        teacher: Metadata of the teacher's policy.
        depth_encoder: Layers of the encoder.
        further_groups: What the student reads besides; flat groups.

    Returns:
        Sections `actor` and `obs_groups` of a runner's configuration.

    Raises:
        ValueError: The teacher reads nothing that an image could replace, or images already, or a further
            group is read already or tells what only an image may.
    """
    groups: list[str] = teacher["obs_groups"]
    try:
        seen = replaceable_group(groups)
    except ValueError as error:
        raise ValueError(f"teacher: {error}") from None
    _check_further(further_groups, groups)
    if depth_encoder.get("hand_window") and HAND_IN_IMAGE not in further_groups:
        raise ValueError(
            f"runner.depth_encoder.hand_window: needs {HAND_IN_IMAGE}, of picking, in runner.further_groups"
        )
    latent = {} if is_encoded(seen) else {"scandot_latent": teacher["obs_dims"][seen]}
    return {
        "actor": dict(teacher["actor"]) | latent | {"depth_encoder": dict(depth_encoder)},
        "obs_groups": {
            "actor": [*("depth" if group == seen else group for group in groups), *further_groups]
        },
    }


def _check_further(further: Any, groups: Sequence[str]) -> None:
    if not isinstance(further, Sequence) or isinstance(further, str):
        raise ValueError(f"runner.further_groups: expected a list of groups, got {further!r}")
    for index, group in enumerate(further):
        if group in groups or group in further[:index]:
            raise ValueError(f"runner.further_groups: {group} is read already")
        if is_seen(str(group)) or group == PRIVILEGED:
            raise ValueError(f"runner.further_groups: {group} tells what a student has to see for itself")
