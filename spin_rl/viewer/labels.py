"""What the views say of a snapshot in words."""

from __future__ import annotations

from spin_rl.scenes.kinds import DIFFICULTIES
from spin_rl.viewer.rollout import Snapshot


def cell_label(snapshot: Snapshot) -> str:
    """Name what is played: the object, or the kind of corridor."""
    scene, target = snapshot.scene, snapshot.target
    if target is not None:
        return target.what.kind
    return f"scenario {scene.scenario}, {DIFFICULTIES[scene.difficulty]}"


def progress_label(snapshot: Snapshot) -> str:
    """Say how far the robot is: with the object, or to the goal."""
    target = snapshot.target
    if target is not None:
        return f"lifted {max(target.height, 0.0):.2f} m, grip {target.force:.0f} N"
    return f"goal in {snapshot.goal_distance:.2f} m"
