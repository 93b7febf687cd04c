"""The reward for information: what comes near counts once, for or against, by whether it had been seen."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
import warp as wp

from spin_rl import robot
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.sensors.awareness import Awareness
from spin_rl.sensors.memory import SeenThings
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.spec import NAV

NEAR = 0.7
BOX, CYLINDER, WALL = range(3)


class Place:
    """A box, a cylinder and a wall 3 m ahead of two worlds; a test moves the base and says what is seen."""

    def __init__(self, device):
        self.pos = np.tile([[3.0, 0.0, 0.5], [3.0, 1.0, 0.5], [3.0, -1.0, 0.5]], (2, 1, 1)).astype(np.float32)
        self.layout = SimpleNamespace(
            pos=wp.array(self.pos, dtype=wp.vec3, device=device),
            yaw=wp.zeros((2, 3), dtype=float, device=device),
            half_size=wp.full((2, 3), wp.vec3(0.2, 0.1, 0.5), dtype=wp.vec3, device=device),
            active=wp.full((2, 3), True, dtype=wp.bool, device=device),
            is_cylinder=wp.array([False, True, False], dtype=wp.bool, device=device),
            is_wall=wp.array([False, False, True], dtype=wp.bool, device=device),
        )
        nearby = wp.array(np.tile(np.arange(3, dtype=np.int32), (2, 1)), dtype=wp.int32, device=device)
        self.qpos = wp.zeros((2, 3), dtype=float, device=device)
        self.visible = wp.zeros((2, 3, 32), dtype=float, device=device)
        self.step = wp.zeros(2, dtype=wp.int32, device=device)
        scandots = SimpleNamespace(visible=self.visible)
        self.seen = SeenThings(self.layout, nearby, self.qpos, scandots, self.step, 100)
        self.awareness = Awareness(self.layout, self.qpos, self.seen, NEAR, period=0.1)

    def show(self, *seen):
        """An observation in which some slots are seen, as pairs of world and slot."""
        flags = np.zeros((2, 3, 32), dtype=np.float32)
        for world, slot in seen:
            flags[world, slot, 24] = 1.0
        self.visible.assign(flags)
        self.step.assign(self.step.numpy() + 1)
        self.seen.update()

    def move(self, slot, by):
        self.pos[:, slot] += by
        self.layout.pos.assign(self.pos)

    def stand(self, x, y=0.0):
        """Bring the base there; returns the gain of that step."""
        self.qpos.assign(np.tile(np.float32([x, y, 0.0]), (2, 1)))
        self.awareness.update()
        return self.awareness.gain.numpy().tolist()


@pytest.fixture
def place(device):
    return Place(device)


def test_what_was_seen_gains_and_what_was_not_loses_once_and_when_it_is_near(place):
    place.show((0, BOX))
    assert place.stand(2.05) == [0.0, 0.0]  # 0.75 m from its face
    assert place.stand(2.15) == [1.0, -1.0]
    place.show((0, BOX), (1, BOX))
    assert place.stand(2.3) == [0.0, 0.0]
    assert place.stand(1.0) == [0.0, 0.0] and place.stand(2.3) == [0.0, 0.0]


def test_a_cylinder_is_as_near_as_its_side_and_walls_are_nothing(place):
    place.show((0, CYLINDER), (0, WALL), (1, WALL))
    assert place.stand(2.05, 1.0) == [0.0, 0.0]
    assert place.stand(2.15, 1.0) == [1.0, -1.0]
    assert place.stand(2.9, -1.0) == [0.0, 0.0]


def test_what_has_moved_is_known_for_half_a_second(place):
    place.show((0, BOX), (1, BOX))
    place.move(BOX, (0.2, 0.0, 0.0))
    for _ in range(4):
        place.show()
    place.show((1, BOX))
    place.move(BOX, (-0.1, 0.0, 0.0))
    place.show()  # 6 steps after the first world saw it, 1 after the second one did
    assert place.stand(2.3) == [-1.0, 1.0]


def test_what_has_not_moved_stays_known(place):
    place.show((0, BOX))
    for _ in range(50):
        place.show()
    place.move(BOX, (0.04, 0.0, 0.0))
    assert place.stand(2.3) == [1.0, -1.0]


def test_an_episode_begins_anew_where_it_ended_and_keeps_the_gain_of_its_last_step(place, device):
    place.show((0, BOX), (1, BOX))
    place.stand(2.3)
    mask = wp.array([True, False], dtype=bool, device=device)
    place.seen.begin(mask)
    place.awareness.begin(mask)
    assert place.awareness.gain.numpy().tolist() == [1.0, 1.0]
    assert place.stand(2.3) == [-1.0, 0.0]


def test_the_environment_rewards_what_its_camera_had_shown(make_nav_env):
    """A box beside the way, driven past with the camera on it, and with the camera turned away."""
    gains = {}
    for name, pose in (("ahead", (0.0, -0.6)), ("behind", (-3.14, -0.2))):
        cfg = NavConfig(camera_pose=pose, reward={"information": 0.5}, stop_on_collision=False)
        scene = Scene.empty(PoolSpec())
        scene.start_joints[:] = [*(robot.STOWED[joint] for joint in robot.JOINTS[:-2]), *pose]
        scene.goal[:] = (4.0, 0.0)
        slot = scene.pool.first_box
        scene.pos[slot], scene.half_size[slot], scene.active[slot] = (1.5, 0.5, 0.2), (0.1, 0.1, 0.2), True
        env = make_nav_env(cfg, num_envs=2, scene=scene)
        action = torch.zeros(2, 10, device=env.device)
        action[:, 0] = 1.0
        total = torch.zeros(2, device=env.device)
        for _ in range(20):
            total += env.step(action)[1]
        gains[name] = total.tolist()
    assert gains == {"ahead": [0.5, 0.5], "behind": [-0.5, -0.5]}


def test_the_reward_of_the_shipped_variant():
    scales = NAV.configure(compose("train", ["reward=informed"])).reward
    assert scales.pop("information") == 0.5
    assert scales == NAV.configure(compose("train")).reward
