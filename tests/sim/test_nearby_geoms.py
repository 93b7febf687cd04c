"""A robot that only knows what is nearby touches and sees the same as one that knows the whole scene."""

import dataclasses

import numpy as np
import pytest
import torch
import warp as wp
from sim_worlds import STOWED

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.scandots import Scandots
from spin_rl.sim.config import SimConfig
from spin_rl.sim.simulation import Simulation

POOL = PoolSpec(num_walls=4, num_boxes=40, num_cylinders=16)
NEARBY = 24


def crowded(seed, moving=False):
    """Things all over 8 m x 8 m, but not where the robot starts."""
    rng = np.random.default_rng(seed)
    scene = Scene.empty(POOL)
    n = POOL.num_slots
    angle, radius = rng.uniform(-np.pi, np.pi, n), rng.uniform(0.75, 4.5, n)
    scene.half_size = rng.uniform([0.03, 0.03, 0.05], [0.15, 0.15, 0.5], (n, 3))
    scene.half_size[POOL.first_cylinder :, 1] = scene.half_size[POOL.first_cylinder :, 0]
    scene.pos = np.stack([radius * np.cos(angle), radius * np.sin(angle), scene.half_size[:, 2]], -1)
    scene.yaw = rng.uniform(-np.pi, np.pi, n)
    scene.active[:] = True
    scene.start_joints = np.array(STOWED)
    if moving:
        slot = POOL.first_box
        scene.home[slot] = scene.pos[slot] = (0.7, 0.0, 0.4)
        scene.half_size[slot] = (0.05, 0.05, 0.4)
        scene.retreat[slot] = (2.0, 0.0)
        scene.motion_speed[slot] = 1.0
    return scene


def simulate(nearby, device, moving=False):
    scenes = [crowded(seed, moving) for seed in range(6)]
    config = dataclasses.replace(SimConfig(), nearby=nearby)
    sim = Simulation(len(scenes), POOL, robot.SPEED_PROFILES["paper"], config, device, moving=moving)
    for world, scene in enumerate(scenes):
        sim.layout.load(scene, world)
    with wp.ScopedDevice(device):
        sim.reset(wp.full(sim.nworld, True, dtype=bool))
        sim.forward()
    return sim


def drive(sim, device, steps=25):
    """Parts that touched, step by step, while the robots drive ahead and turn, each in its own way."""
    sim.views.action.zero_()
    sim.views.action[:, 0] = 1.0
    sim.views.action[:, 1] = torch.linspace(-0.6, 0.6, sim.nworld, device=device)
    touched = []
    with wp.ScopedDevice(device):
        for _ in range(steps):
            sim.advance()
            sim.forward()
            touched.append(sim.views.part_contacts.cpu().numpy().copy())
    return np.array(touched)


@pytest.mark.parametrize("moving", [False, True])
def test_the_same_is_touched_at_the_same_time(device, moving):
    whole, near = (drive(simulate(k, device, moving), device) for k in (POOL.num_slots, NEARBY))
    first = [worlds.any(-1).argmax(0) for worlds in (whole, near)]
    assert whole.any(-1).any(0).sum() >= 3  # some robots hit something
    np.testing.assert_array_equal(first[0], first[1])
    # What comes after a first hit may differ: the solver orders contacts in another way.
    for world, step in enumerate(first[0]):
        np.testing.assert_array_equal(whole[: step + 1, world], near[: step + 1, world])


def test_the_nearest_tokens_are_those_of_the_whole_scene(device):
    sims = [simulate(k, device) for k in (POOL.num_slots, NEARBY)]
    tokens = []
    for sim in sims:
        sensor = Scandots(
            sim.layout,
            sim.data.qpos,
            sim.data.site_xpos,
            sim.data.site_xmat,
            camera_site=sim.mj_model.site("camera_depth_optical_frame").id,
            tan_half_fov=robot.camera_tan_half_fov("portrait"),
        )
        sensor.update()
        tokens.append((sensor.all.numpy(), sensor.visible.numpy()))
    nearby = sims[1].layout.nearby.numpy()
    shown = 0
    for world in range(sims[0].nworld):
        np.testing.assert_array_equal(tokens[1][0][world], tokens[0][0][world][nearby[world]])
        np.testing.assert_array_equal(tokens[1][1][world], tokens[0][1][world][nearby[world]])
        shown += (tokens[1][1][world][:, 24:] > 0).any(-1).sum()
    assert shown > 0


def test_small_pools_are_known_whole(device):
    assert simulate(POOL.num_slots, device).nearby is None
    assert "near_box_0" not in {simulate(POOL.num_slots, device).mj_model.geom(g).name for g in range(20)}


def test_what_is_not_listed_is_counted(device):
    sim = simulate(2, device)
    assert sim.nearby.missed.numpy()[0] > 0
