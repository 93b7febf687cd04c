"""Simulations with given scenes, shared by the tests of the simulation."""

import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sim.config import SimConfig
from spin_rl.sim.simulation import Simulation

POOL = PoolSpec()
STOWED = tuple(robot.STOWED[joint] for joint in robot.JOINTS)


def scene_with(box=None, half_size=0.1, start=(0.0, 0.0, 0.0), joints=STOWED) -> Scene:
    """An empty world, or one with a single box at a place."""
    scene = Scene.empty(POOL)
    scene.start = np.array(start)
    scene.start_joints = np.array(joints)
    if box is not None:
        scene.pos[POOL.first_box] = box
        scene.half_size[POOL.first_box] = half_size
        scene.active[POOL.first_box] = True
    return scene


def simulate(scenes, device, config=None, profile="paper", **options) -> Simulation:
    """A simulation of one world per scene, at their starts."""
    config = config or SimConfig()
    sim = Simulation(len(scenes), POOL, robot.SPEED_PROFILES[profile], config, device, **options)
    for world, scene in enumerate(scenes):
        sim.layout.load(scene, world)
    restart(sim)
    return sim


def restart(sim):
    with wp.ScopedDevice(sim.device):
        sim.reset(wp.full(sim.nworld, True, dtype=bool))
        sim.forward()


def advance(sim, steps=1):
    with wp.ScopedDevice(sim.device):
        for _ in range(steps):
            sim.advance()
