"""What tests of the runtime share. They need NumPy, onnxruntime and pytest alone."""

from dataclasses import replace

import numpy as np
import pytest
from fake_robot import DATA

from spin_rl.deploy.agent import Agent
from spin_rl.deploy.network import Network


class ScriptedNetwork:
    """A network that returns what it is given to; it keeps what it was asked.

    Attributes:
        actions: To return, one after the other, the last one for ever.
        seen: Groups of every step.
    """

    def __init__(self, contract, actions=((0.5, *[0.0] * 9),)):
        self.contract = contract
        self.actions = [np.array(action, dtype=float) for action in actions]
        self.seen = []

    def reset(self):
        self.seen.clear()

    def __call__(self, groups):
        self.seen.append(groups)
        return self.actions[min(len(self.seen), len(self.actions)) - 1]


def without_images(contract):
    """The same of a policy that reads no images."""
    groups = tuple(group for group in contract.observations if group.source != "camera")
    return replace(
        contract,
        observations=groups,
        observation_names=tuple(group.name for group in groups),
        camera=replace(contract.camera, image=None, focal_px=None, range_m=None),
        depth_filter=None,
    )


@pytest.fixture(scope="session")
def nav_network():
    return Network(DATA / "tiny_nav.onnx")


@pytest.fixture(scope="session")
def pick_network():
    return Network(DATA / "tiny_pick.onnx")


@pytest.fixture
def scripted(nav_network):
    """Makes an agent of the navigation policy's contract whose actions are given."""

    def make(*actions, speed_scale=1.0, **changes):
        contract = replace(nav_network.contract, **changes)
        return Agent(ScriptedNetwork(contract, actions or ((0.5, *[0.0] * 9),)), speed_scale)

    return make
