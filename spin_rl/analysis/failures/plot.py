"""The robots' poses at their failures, from above."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.analysis.failures.analysis import failures_of
from spin_rl.analysis.failures.failure import Failure, scene_of
from spin_rl.scenes.outline import outline
from spin_rl.sim.model import geom_parts
from spin_rl.viewer import style

_PLOTTED = 12
_VIEW_M = 1.2


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw the first failures from above at their last observation, with the robot's collision shape.

    Args:
        result: Of `failures.analyse_failures`.
        path: Image file to write; its folder is made.
    """
    from matplotlib.figure import Figure

    failures = failures_of(result)[:_PLOTTED]
    columns = min(4, max(len(failures), 1))
    rows = max(math.ceil(len(failures) / columns), 1)
    figure = Figure(figsize=(3.2 * columns, 3.6 * rows), layout="constrained")
    figure.suptitle(f"{result['policy']}: {len(failures)} of {len(result['failures'])} failures", fontsize=9)
    model = robot.load_spec().compile()
    for i, failure in enumerate(failures):
        _draw(figure.add_subplot(rows, columns, i + 1), failure, model)
    figure.legend(handles=_legend(), loc="outside lower center", ncols=4, fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    levels = {"low": "low obstacle", "arm": "at arm height", "head": "at head height", "tall": "tall"}
    return [
        *(
            Patch(color="#{:02x}{:02x}{:02x}".format(*style.LEVEL[level]), label=label)
            for level, label in levels.items()
        ),
        Patch(facecolor="none", edgecolor="red", label="what was hit"),
        Line2D([], [], color="red", label="part that hit it"),
        Line2D([], [], color="black", label="robot"),
        Line2D([], [], color="g", marker="*", linestyle="none", label="goal"),
    ]


def _draw(axes: Any, failure: Failure, model: mujoco.MjModel) -> None:
    scene = scene_of(failure)
    for slot, colour in enumerate(style.slot_colours(scene)):
        if scene.active[slot]:
            edge = "red" if slot == failure.slot else "none"
            axes.fill(*outline(scene, slot).T, facecolor=np.array(colour) / 255, edgecolor=edge, alpha=0.8)
    data = mujoco.MjData(model)
    data.qpos[:] = failure.qpos
    mujoco.mj_kinematics(model, data)
    for geom, part in enumerate(geom_parts(model)):
        if part >= 0:
            color = "red" if robot.PARTS[part] in failure.parts else "black"
            axes.plot(*_robot_outline(model, data, geom).T, color=color, linewidth=0.8)
    x, y = failure.qpos[:2]
    axes.plot(*failure.goal, "g*")
    axes.set(xlim=(x - _VIEW_M, x + _VIEW_M), ylim=(y - _VIEW_M, y + _VIEW_M), aspect="equal")
    axes.tick_params(labelsize=6)
    axes.set_xlabel("x [m]", fontsize=6)
    axes.set_ylabel("y [m]", fontsize=6)
    what = ", ".join(failure.contacts) or failure.outcome
    where = f"{failure.condition} seed {failure.seed} world {failure.world}"
    axes.set_title(f"{what}, {failure.time_s:.1f} s\n{where}", fontsize=7)


def _robot_outline(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """Outline of a collision geom of the robot from above [m], closed, shape (n, 2)."""
    size, frame = model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3)
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        local = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)]) * size
        return data.geom_xpos[geom, :2] + (local @ frame.T)[:, :2]
    # A capsule from above: a half circle around either end of its axis.
    axis = frame[:2, 2] * size[1]
    turns = np.arctan2(axis[1], axis[0]) + np.linspace(-0.5 * np.pi, 1.5 * np.pi, 25)
    ends = np.where(np.arange(25)[:, None] <= 12, axis, -axis)
    around = ends + size[0] * np.stack([np.cos(turns), np.sin(turns)], -1)
    return data.geom_xpos[geom, :2] + np.vstack([around, around[:1]])
