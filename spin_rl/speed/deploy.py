"""Latency of a policy on a robot's computer, on one core: network, filter, pilot, and the whole tick."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from spin_rl import robot
from spin_rl.config import from_mapping
from spin_rl.deploy.agent import Agent, Inputs
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.interface import RobotState
from spin_rl.deploy.network import Network
from spin_rl.paths import CONF_DIR
from spin_rl.sensors.depth.filter_config import DepthFilterConfig
from spin_rl.sensors.depth.robot import RobotDepthFilter
from spin_rl.speed.rows import Row

POLICIES = ("nav-cvo", "nav-room", "nav-cvo-depth", "nav-room-depth", "pick-depth")
"""Teachers and students, in places of all kinds with a pilot."""
CAMERA = (480, 848)
"""Rows and columns of the camera's own image."""
_WARM_UP, _LEAST = 20, 200
_UNIT = "ms"


def measure_deploy(files: Sequence[Path], seconds: float, clock: Callable[[], float]) -> list[Row]:
    """Time exported policies with the filter of a real camera, all of its steps on.

    Args:
        files: Exported policies.
        seconds: To measure for, all of it together.
        clock: Time [s]; of the CPU where other work shares it.

    Returns:
        Median and 99th percentile [ms] of the network's step, of the filter (with the reduction of the
        camera's image) and of the whole tick, from the camera's image to the command; of a policy with a
        pilot also of the tick without. The robot never moves and every image is another, so that a pilot
        plans as often as it may and drives out of where it is stuck.
    """
    share = seconds / (2 * len(files) + 1)
    rng = np.random.default_rng(0)
    config = _camera_filter()
    depth_filter = RobotDepthFilter(config)
    rows = _rows("depth filter, 848 x 480", depth_filter, _images(rng), share, clock)
    for file in files:
        network = Network(file)
        contract = network.contract
        groups = _groups(contract, rng)
        rows += _rows(f"{contract.name}: network", network, [groups], share, clock)
        if contract.depth_filter is not None:
            near, far = contract.depth_filter.near_m, contract.depth_filter.far_m
            own = replace(config, near_m=near, far_m=far)
            network.contract = replace(contract, depth_filter=own)
        ticks = {"whole tick": Agent(network)}
        if contract.has_pilot:
            ticks["tick without pilot"] = Agent(network, pilot=False)
        for name, agent in ticks.items():
            rows += _rows(f"{contract.name}: {name}", _tick(agent, groups), _images(rng), share, clock)
    return rows


def _tick(agent: Agent, groups: dict[str, np.ndarray]) -> Callable[[np.ndarray], object]:
    """Return what happens in a tick, for an image of the camera."""
    joints = np.array([robot.STOWED[joint] for joint in robot.JOINTS])
    state = RobotState(0.0, joints, np.zeros(len(joints)), np.zeros(3), np.zeros(2))
    agent.reset(state, np.array([3.0, 1.0]), np.array([0.1, -0.7, 0.8]))
    told = {
        group.name: groups[group.name]
        for group in agent.contract.observations
        if not group.terms and group.source != "camera"
    }

    def tick(image: np.ndarray) -> object:
        depth = agent.reduce(image) if agent.reads_images else None
        return agent.act(Inputs(state, depth, told))

    return tick


def _rows(
    name: str,
    function: Callable[[Any], object],
    arguments: Sequence[object],
    seconds: float,
    clock: Callable[[], float],
) -> list[Row]:
    """Time calls one by one, with the arguments in turn."""
    for call in range(_WARM_UP):
        function(arguments[call % len(arguments)])
    times: list[float] = []
    end = time.perf_counter() + seconds
    while len(times) < _LEAST or time.perf_counter() < end:
        argument = arguments[len(times) % len(arguments)]
        start = clock()
        function(argument)
        times.append(1e3 * (clock() - start))
    spread = (min(times), max(times))
    slow = statistics.quantiles(times, n=100)[-1]
    return [
        Row(name, statistics.median(times), _UNIT, None, None, spread, None),
        Row(f"{name}, 99th percentile", slow, _UNIT, None, None, spread, None),
    ]


def _groups(contract: Contract, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Draw an input of every group; all scandots are valid, which takes longest."""
    groups = {}
    for group in contract.observations:
        values = rng.uniform(0.0, 255.0 if group.dtype == "uint8" else 1.0, (1, group.size))
        groups[group.name] = values.astype(group.dtype)
    return groups


def _images(rng: np.random.Generator) -> list[np.ndarray]:
    """Draw a few images of a camera: a slope with noise, steps and a tenth of holes."""
    images = []
    for _ in range(5):
        image = np.linspace(0.5, 4.0, CAMERA[0])[:, None] + rng.normal(scale=0.02, size=CAMERA)
        image[:, : rng.integers(100, 700)] += 0.5
        image[rng.random(CAMERA) < 0.1] = 0.0
        images.append(image.astype(np.float32))
    return images


def _camera_filter() -> DepthFilterConfig:
    values = OmegaConf.to_container(OmegaConf.load(CONF_DIR / "depth" / "d435i.yaml"))
    assert isinstance(values, dict)
    return from_mapping(DepthFilterConfig, values["filter"], "depth.filter")
