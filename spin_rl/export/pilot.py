"""What an exported policy says of its pilot: guard and planner of the training, and the robot's geoms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spin_rl import robot
from spin_rl.config import from_keys
from spin_rl.deploy.pilot.settings import Guard, Planner, Shape
from spin_rl.sensors.clearance import robot_shapes
from spin_rl.tasks.nav.guard import HULLS


def describe_pilot(task: Mapping[str, Any]) -> tuple[Guard | None, Planner | None, tuple[Shape, ...]]:
    """Describe a task's guard and planner, and the robot that they guard; None and none of a task without."""
    if not task.get("guard"):
        return None, None, ()
    guard = from_keys(Guard, task["guard"], "task.guard")
    planner = from_keys(Planner, task["planner"], "task.planner") if task.get("planner") else None
    return guard, planner, _shapes() if guard.enabled else ()


def _shapes() -> tuple[Shape, ...]:
    """Return the robot's collision geoms."""
    model = robot.load_spec().compile()
    shapes = robot_shapes(model, "cpu")
    half_size, radius = shapes.half_size.numpy().tolist(), shapes.radius.numpy().tolist()
    described = []
    for index, geom in enumerate(shapes.geom.numpy().tolist()):
        body = model.body(int(model.geom_bodyid[geom])).name
        part = model.geom(geom).name.partition("_")[0]
        pos, quat = (tuple(values[geom].tolist()) for values in (model.geom_pos, model.geom_quat))
        described.append(Shape(HULLS[part], body, pos, quat, tuple(half_size[index]), radius[index]))
    return tuple(described)
