"""Things that move around the robot in C MuJoCo: where they are, what they touch, and that they are seen."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

from spin_rl.deploy.backends.motion import Movers
from spin_rl.deploy.backends.mujoco import TIMESTEP_S, MujocoRobot
from spin_rl.deploy.interface import Command
from spin_rl.deploy.network import Network
from spin_rl.export.describe import describe
from spin_rl.runners.policy_file import read_policy
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.scenes.motion import move_slots, restart_motion
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.warp_kernels.tokens import NUM_CORNERS, TOKEN_SIZE

DATA = Path(__file__).parents[1] / "data"
POOL = PoolSpec(1, 3, 2)


def random_scene(rng):
    """Slots that come out, that slide to and fro, that stay, and one that moves and is not there."""
    scene, n = Scene.empty(POOL), POOL.num_slots
    scene.active[:] = [True, True, True, True, False, True]
    scene.home[:] = scene.pos[:] = rng.uniform((-2.0, -0.5, 0.0), (2.0, 0.5, 1.0), (n, 3))
    scene.retreat[:] = rng.uniform(-1.0, 1.0, (n, 2))
    scene.motion_speed[:] = [0.0, *rng.uniform(0.3, 1.5, n - 1)]
    scene.motion_trigger[:] = [0.0, 1.5, 0.8, 0.0, 1.0, 0.0]
    scene.motion_phase[:] = rng.uniform(size=n)
    return scene


@pytest.mark.parametrize("seed", range(4))
def test_they_move_as_in_the_batched_simulation(seed):
    rng = np.random.default_rng(seed)
    scene, dt = random_scene(rng), 0.02
    layout = Layout(1, POOL, "cpu")
    layout.load(scene)
    everything = wp.array([True], dtype=bool, device="cpu")
    restart_motion(layout, everything)
    qpos = wp.zeros((1, 2), dtype=float, device="cpu")
    ids = wp.array(np.arange(POOL.num_slots), dtype=wp.int32, device="cpu")
    geoms = wp.zeros((1, POOL.num_slots), dtype=wp.vec3, device="cpu")
    movers = Movers(scene)
    assert movers.slots.tolist() == [1, 2, 3, 5]
    base, started, farthest = np.array([-3.0, 0.0]), movers.pos, np.zeros(4)
    for _ in range(250):
        np.testing.assert_allclose(movers.pos, layout.pos.numpy()[0, movers.slots], atol=2e-4)
        base = base + dt * np.array([1.2, 0.1])
        qpos.assign(base[None])
        move_slots(layout, qpos, dt, ids, geoms)
        movers.advance(base, dt)
        farthest = np.maximum(farthest, np.abs(movers.pos - started).max(-1))
    assert (farthest > 0.05).all()


def crossing(contract):
    """The robot in the way of a pole, which is 0.9 m ahead and comes at 0.5 m/s."""
    pole = {"position": [0.9, 0.0], "radius": 0.1, "height": 1.5, "motion": {"to": [0.0, 0.0], "speed": 0.5}}
    scene = {"start": {"position": [0.0, 0.0]}, "goal": [6, 0], "cylinders": [pole]}
    return MujocoRobot(parse_scene(scene), contract)


class Watcher:
    is_over = False
    substeps = steps = 0

    def add_substep(self, data):
        self.substeps += 1
        self.is_over = self.is_over or bool((data.contact.dist < 0.0).any())

    def judge(self, data):
        self.steps += 1


def test_they_are_seen_and_touch_and_the_umpire_presses_the_runstop():
    one = crossing(Network(DATA / "tiny_nav.onnx").contract)
    one.umpire = watcher = Watcher()
    one.command(Command(0.0, 0.0, one.state().joints, np.full(8, 1.0)))
    first = one.depth().image
    one.sleep_until(0.5)
    pole = one.data.geom("cylinder_0")
    np.testing.assert_allclose(pole.xpos[:2], (0.65, 0.0), atol=0.5 * TIMESTEP_S + 1e-6)
    assert (np.abs(one.depth().image - first) > 0.05).any() and not one.state().runstop
    assert (watcher.steps, watcher.substeps) == (1, 250)
    one.sleep_until(1.6)
    assert one.state().runstop and any("cylinder_0" in pair for pair in one.touched)


def test_scandots_tell_where_they_are_now():
    one = crossing(describe(read_policy("nav-cvo"), units=256))
    one.command(Command(0.0, 0.0, one.state().joints, np.full(8, 1.0)))

    def seen():
        """Distances of the corners that are told [m], least and largest."""
        token = one.told()["scandots"].reshape(-1, TOKEN_SIZE)[0]
        is_told = token[-NUM_CORNERS:] > 0.0
        ahead = token[:-NUM_CORNERS].reshape(NUM_CORNERS, 3)[is_told, 0]
        return np.array([ahead.min(), ahead.max()])

    before = seen()
    assert ((0.79 < before) & (before < 1.01)).all()
    one.sleep_until(0.4)
    assert ((0.59 < seen()) & (seen() < 0.81)).all()
