"""Scenes and snapshots that the viewer's tests share."""

from dataclasses import replace

import numpy as np

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.scenes.objects.shapes import KINDS, SceneObject
from spin_rl.tasks.fetch.config import STAGES
from spin_rl.viewer.snapshot import Scandots, Snapshot, Target

POOL = PoolSpec()


def scene() -> Scene:
    """A straight corridor along x with a low box, a box at head height and a post."""
    result = Scene.empty(POOL)
    box, cylinder = POOL.first_box, POOL.first_cylinder
    slots = {
        0: ((2.0, 0.6, 0.75), (2.5, 0.05, 0.75)),
        1: ((2.0, -0.6, 0.75), (2.5, 0.05, 0.75)),
        box: ((1.0, 0.3, 0.1), (0.1, 0.2, 0.1)),
        box + 1: ((2.0, -0.3, 1.2), (0.1, 0.2, 0.15)),
        cylinder: ((3.0, 0.3, 0.5), (0.1, 0.1, 0.5)),
    }
    for slot, (pos, half) in slots.items():
        result.pos[slot], result.half_size[slot], result.active[slot] = pos, half, True
    result.yaw[box] = 0.3
    result.goal[:] = (3.5, 0.0)
    return result


def snapshot(time=0.0, base=(0.0, 0.0, 0.0), outcome="running", **joints) -> Snapshot:
    """The stowed robot; `joints` are those of the MJCF."""
    qpos = np.zeros(len(robot.DOF_NAMES))
    for dof, (joint, share) in zip(robot.DOF_NAMES[3:], robot.DOF_SOURCE, strict=True):
        qpos[robot.DOF_NAMES.index(dof)] = share * robot.STOWED[joint]
    qpos[:3] = base
    for name, value in joints.items():
        qpos[robot.DOF_NAMES.index(name)] = value
    dots = Scandots(np.array([[1.0, 0.3, 0.2], [1.2, 0.4, 0.0]]), np.array([True, False]))
    return Snapshot(scene=SCENE, episode=0, time=time, qpos=qpos, scandots=dots, outcome=outcome)


def pick_snapshot(kind="banana", pose=(1.0, 0.9, 0.8, 0.5, 0.5, 0.5, 0.5), seen=True, **options) -> Snapshot:
    """An object of nominal size somewhere in the air, in a task without corridors."""
    half = np.array(KINDS[kind].half_extents)
    what = SceneObject(kind, half, mass=0.1, friction=1.2, start_pose=np.array([1.0, 0.9, 0.7, 0.0]))
    target = Target(what, np.array(pose), seen, force=12.0)
    return replace(snapshot(**options), scandots=None, target=target)


def fetch_snapshot(stage, kind="banana", **options) -> Snapshot:
    """A stage of a fetch in the corridor."""
    return replace(snapshot(**options), target=pick_snapshot(kind).target, stage=stage, stages=STAGES)


SCENE = scene()
