"""The MuJoCo model that all worlds share, and whose geoms are which part of the robot."""

from __future__ import annotations

import mujoco

from spin_rl import robot
from spin_rl.scenes.builder import add_pool
from spin_rl.scenes.layout import PoolSpec
from spin_rl.scenes.objects.shapes import add_object
from spin_rl.sim.config import SimConfig


def compile_model(pool: PoolSpec, config: SimConfig, *, with_object: bool) -> mujoco.MjModel:
    """Compile the robot, the grasping one if there is an object, and an empty pool of scene geoms."""
    spec = robot.load_grasp_spec() if with_object else robot.load_spec()
    add_pool(spec, pool, config.nearby)
    if with_object:
        add_object(spec)
    spec.option.timestep = config.timestep
    spec.option.iterations = config.iterations
    spec.option.ls_iterations = config.ls_iterations
    if config.impratio is not None:
        spec.option.impratio = config.impratio
    return spec.compile()


def geom_parts(model: mujoco.MjModel) -> list[int]:
    """Return the index into `robot.PARTS` of every geom, -1 where it is no collision geom of the robot."""
    parts = []
    for geom in range(model.ngeom):
        collides = model.geom_bodyid[geom] > 0 and (model.geom_contype[geom] or model.geom_conaffinity[geom])
        name = model.geom(geom).name.rstrip("0123456789").rstrip("_")
        parts.append(robot.PARTS.index(name) if collides and name in robot.PARTS else -1)
    return parts
