"""Start a training from another policy's weights, also where its inputs or its architecture differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from spin_rl.models import ScandotModel
from spin_rl.policy import find_policy
from spin_rl.runners.checkpoint import find_checkpoint, load_module_state
from spin_rl.runners.contents import check_checkpoint
from spin_rl.runners.interface import Camera
from spin_rl.runners.model_copy import copy_model
from spin_rl.runners.policy_file import TrainedPolicy, build_model
from spin_rl.runners.ppo.algorithm import PPO


def warm_start(
    algorithm: PPO,
    source: TrainedPolicy,
    camera: Camera,
    camera_pose: Sequence[float] | None = None,
    critic: bool = True,
    camera_action: str = "target",
) -> str:
    """Copy what fits of another policy into new models; what is new starts without effect.

    The actor then acts as the source does wherever both see the same, except that a camera which the
    source never moved starts at action zero, and its pose without effect; so does the pose of one that is now
    held where the source's was not, since a constant tells nothing and may be one that was never trained
    with. Inputs are matched by group:
    `scandots_all` of the source becomes `scandots` where the new actor reads only these, and the other way
    round; where it reads `depth` instead, the latent of a new encoder takes the place of the source's, or of
    its `object`.
    Camera actions keep their configured standard deviation, the others take the source's.

    Args:
        algorithm: Algorithm with new models.
        source: The policy to start from.
        camera: The environment's camera.
        camera_pose: Where the environment holds it, pan and tilt [rad]; None where it moves.
        critic: Also copy the critic, where the source is a checkpoint whose critic fits.
        camera_action: What the environment's camera actions say; where the source's said something else,
            what it learned of them is nothing here.

    Returns:
        One line: what was copied and what is new.

    Raises:
        ValueError: The actor cannot be mapped; one line that names what differs.
    """
    unlearned = _unlearned(camera, source, camera_pose)
    if camera_pose is None and (_task_of(source).get("camera_action") or "target") != camera_action:
        unlearned = Camera(actions=camera.actions, columns=unlearned.columns)
    try:
        notes = copy_model(algorithm.actor, source.build(), unlearned, camera.actions)
    except ValueError as error:
        raise ValueError(f"init: {source.name} cannot start the actor: {error}{_origin(source)}") from None
    line = f"Initialized from {source.name} (iteration {source.metadata['iteration']}); actor: {notes}"
    if not critic:
        return f"{line}; critic: new, its reward is another"
    try:
        model = _load_critic(source.name)
        notes = copy_model(algorithm.critic, model, unlearned)
    except ValueError as error:
        notes = f"new, {error}"
    return f"{line}; critic: {notes}"


def camera_was_frozen(policy: TrainedPolicy) -> bool:
    """Tell whether a policy's camera was held at a pose in training."""
    return _pose_of(policy) is not None


def _pose_of(policy: TrainedPolicy) -> Sequence[float] | None:
    return _task_of(policy).get("camera_pose")


def _task_of(policy: TrainedPolicy) -> Mapping[str, Any]:
    task = policy.config.get("task")
    return task if isinstance(task, Mapping) else {}


def _origin(policy: TrainedPolicy) -> str:
    """The configuration in which a policy's networks are most likely to fit."""
    algo = policy.config.get("algo")
    name = algo.get("name") if isinstance(algo, Mapping) else None
    return f"; it was trained with algo={name}" if name else ""


def _unlearned(camera: Camera, source: TrainedPolicy, pose: Sequence[float] | None) -> Camera:
    """What of a camera the source has not learned, or has learned in vain where it is held at a pose."""
    before = _pose_of(source)
    if pose is None:
        return Camera() if before is None else camera
    return Camera() if before is not None and list(before) == list(pose) else Camera(columns=camera.columns)


def _load_critic(source: str) -> ScandotModel:
    """Build the critic of a checkpoint."""
    path = find_policy(source)
    if path.suffix == ".safetensors":
        raise ValueError("a policy file holds none")
    path, state = find_checkpoint(path)
    runner, _ = check_checkpoint(state, str(path))
    if runner.critic is None or "critic" not in state:
        raise ValueError("the checkpoint holds none")
    groups = runner.obs_groups.get("critic", ())
    if not set(groups) <= set(state["obs_dims"]):
        raise ValueError("the checkpoint does not tell what it reads")
    dims = {group: state["obs_dims"][group] for group in groups}
    model = build_model(runner.critic, "critic", dims, 1)
    load_module_state(model, state["critic"], "critic", str(path))
    return model
