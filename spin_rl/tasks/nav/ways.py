# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportInvalidTypeForm=false
# pyright: reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""How far it is to the goal, and how long an episode may take: by the corridor's shape or by a field."""

from typing import Any

import torch
import warp as wp

from spin_rl import robot
from spin_rl.planning.distance_field import DistanceField
from spin_rl.scenes.layout import Layout
from spin_rl.sensors.interface import Sensor
from spin_rl.warp_kernels.distance_field.field import UNREACHABLE, Field, field_at

_LONGEST = 1.2
"""Ways are no longer than so many times the longest that starts are drawn for: they bend around obstacles."""

_ASIDE = wp.constant(0.15)
"""Distance to the points that tell in which direction the way leads [m]."""

wp.set_module_options({"enable_backward": False})


@wp.func
def distance_to_go(x: float, y: float, goal: wp.vec2, bend: int) -> float:
    """Path length left to the goal [m]: straight, or along the two legs of an L-shaped corridor.

    The legs lie along the world's axes, so the length along an L is the Manhattan distance: continuous, and
    shrinking all the way around the corner, where the straight distance would reward driving into the wall.
    """
    dx = goal[0] - x
    dy = goal[1] - y
    if bend != 0:
        return wp.abs(dx) + wp.abs(dy)
    return wp.sqrt(dx * dx + dy * dy)


@wp.struct
class Ways:
    """What says how far it is to the goal in every world.

    A ``field`` without cells leaves it to the corridor's ``bend``; where there is a place to drive to first
    (``has_via``), ways are straight. ``most_steps`` (nworld,) is the time limit of the running episode in
    control
    steps: with a field, ``slack_steps`` and ``steps_per_m`` of its way at full speed, for at most
        ``longest_m``.
    """

    bend: wp.array[int]
    has_via: wp.array[wp.bool]
    field: Field
    most_steps: wp.array[int]
    slack_steps: float
    steps_per_m: float
    longest_m: float


@wp.func
def way_to_go(ways: Ways, w: int, x: float, y: float, goal: wp.vec2, otherwise: float) -> float:
    """Length of the way left to the goal [m]; `otherwise` where the field knows none.

    There is none from where the base's front is under something that the mast cannot pass.
    """
    if ways.has_via[w]:
        return distance_to_go(x, y, goal, 0)
    if ways.field.values.shape[1] == 0:
        return distance_to_go(x, y, goal, ways.bend[w])
    way = field_at(ways.field, w, x, y)
    return wp.where(way < UNREACHABLE, way, otherwise)


@wp.func
def limit_time(ways: Ways, w: int, way: float, speed_scale: float) -> None:
    """Set a world's time limit for a new episode with a way [m] and a factor on the robot's speeds."""
    if ways.field.values.shape[1] > 0:
        steps = ways.slack_steps + ways.steps_per_m * wp.min(way, ways.longest_m) / speed_scale
        ways.most_steps[w] = int(steps)


def corridor_ways(layout: Layout, episode_steps: int) -> Any:
    """Make the struct of scenes without a distance field; every episode may take as long."""
    ways = Ways()
    ways.bend = layout.bend
    ways.has_via = layout.has_via
    with wp.ScopedDevice(layout.device):
        ways.field.values = wp.zeros((0, 0, 0), dtype=float)
        ways.field.origin = wp.zeros(0, dtype=wp.vec2)
        ways.field.goal = wp.zeros(0, dtype=wp.vec2)
        ways.most_steps = wp.full(layout.nworld, episode_steps, dtype=wp.int32)
    return ways


def field_ways(
    layout: Layout,
    field: DistanceField,
    profile: robot.SpeedProfile,
    *,
    longest_m: float,
    period: float,
    slack_s: float,
    slowness: float,
) -> Any:
    """Make the struct of scenes with a distance field.

    Args:
        layout: The scenes.
        field: Their distance fields.
        profile: Speed limits of the robot.
        longest_m: Longest way that starts are drawn for [m].
        period: Control period [s].
        slack_s: Time that every episode has [s].
        slowness: How many times as long as the way takes at full speed it has besides.
    """
    ways = corridor_ways(layout, 0)
    ways.field = field.field
    ways.slack_steps = slack_s / period
    ways.steps_per_m = slowness / profile.forward_max / period
    ways.longest_m = _LONGEST * longest_m
    return ways


def most_steps(ways: Any, slowest: float) -> int:
    """The longest that an episode with a distance field may take in control steps, at a factor on speeds."""
    return int(ways.slack_steps + ways.steps_per_m * ways.longest_m / slowest)


@wp.kernel
def _look_ahead(
    # In
    ways: Ways,
    qpos: wp.array2d(dtype=float),
    goal: wp.array(dtype=wp.vec2),
    # Out
    ahead_out: wp.array2d(dtype=float),
) -> None:
    """Length of the way and its direction in the base frame, one thread per world."""
    w = wp.tid()
    x = qpos[w, 0]
    y = qpos[w, 1]
    here = way_to_go(ways, w, x, y, goal[w], distance_to_go(x, y, goal[w], 0))
    east = way_to_go(ways, w, x + _ASIDE, y, goal[w], here)
    west = way_to_go(ways, w, x - _ASIDE, y, goal[w], here)
    north = way_to_go(ways, w, x, y + _ASIDE, goal[w], here)
    south = way_to_go(ways, w, x, y - _ASIDE, goal[w], here)
    along = wp.vec2(west - east, south - north) / (2.0 * _ASIDE)
    along = along / wp.max(wp.length(along), 1.0)
    c = wp.cos(qpos[w, 2])
    s = wp.sin(qpos[w, 2])
    ahead_out[w, 0] = here
    ahead_out[w, 1] = c * along[0] + s * along[1]
    ahead_out[w, 2] = c * along[1] - s * along[0]


class WayAhead(Sensor):
    """What a map would tell: how long the way to the goal is and where it leads; for critics alone.

    Attributes:
        values: Length of the way [m], and the direction in which it gets shorter, in the base frame, no
            longer than 1, a view, shape (nworld, 3).
    """

    def __init__(self, ways: Any, qpos: wp.array, goal: wp.array) -> None:
        """Allocate.

        Args:
            ways: `Ways` of all worlds.
            qpos: State of the robot, shape (nworld, nq).
            goal: Goals [m], shape (nworld,), vec2.
        """
        self._inputs = [ways, qpos, goal]
        with wp.ScopedDevice(qpos.device):
            self._values = wp.zeros((qpos.shape[0], 3), dtype=float)
        self.values: torch.Tensor = wp.to_torch(self._values)

    def update(self) -> None:
        """Look ahead from where the robots are."""
        wp.launch(
            _look_ahead,
            dim=self._values.shape[0],
            inputs=self._inputs,
            outputs=[self._values],
            device=self._values.device,
        )
