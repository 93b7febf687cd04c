"""What the views say of a snapshot in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from spin_rl.scenes.kinds import DIFFICULTIES
from spin_rl.viewer.snapshot import Snapshot, Target


def cell_label(snapshot: Snapshot) -> str:
    """Name what is played: the kind of corridor of the paper, the object, both, or nothing."""
    scene, target = snapshot.scene, snapshot.target
    names = []
    if snapshot.scandots is not None and scene.scenario:
        names.append(f"scenario {scene.scenario}, {DIFFICULTIES[scene.difficulty]}")
    if target is not None:
        names.append(target.what.kind)
    return ", ".join(names)


def progress_label(snapshot: Snapshot) -> str:
    """Say how far the robot is: to the goal, or with the object; in a fetch, what its stage is about."""
    target = snapshot.target
    if target is None or snapshot.stage == "reach":
        return f"goal in {snapshot.goal_distance:.2f} m"
    if snapshot.stage == "align":
        return f"{target.what.kind} {target_label(target)}"
    grip = f"grip {target.force:.0f} N"
    if snapshot.stage == "carry":
        return f"start in {snapshot.goal_distance:.2f} m, {grip}"
    if snapshot.stage == "place":
        return f"object {snapshot.put_distance:.2f} m from start, {grip}"
    return f"lifted {max(target.height, 0.0):.2f} m, {grip}"


def target_label(target: Target) -> str:
    """Say whether the camera sees the object."""
    return "seen" if target.seen else "not seen"


def summary(last: Sequence[Snapshot]) -> str:
    """Count the successes of episodes, and say in which stages of a fetch the others failed.

    Args:
        last: The last snapshot of every episode.
    """
    if last[0].stage is not None:
        aim = "fetches done"
    else:
        aim = "episodes reached the goal" if last[0].target is None else "episodes held the object up"
    failed = Counter(snapshot.cause for snapshot in last if snapshot.outcome != "success")
    causes = ", ".join(f"{count} {cause}" for cause, count in failed.most_common())
    shown = f" ({causes})" if causes and last[0].stage is not None else ""
    return f"{len(last) - failed.total()} of {len(last)} {aim}{shown}"
