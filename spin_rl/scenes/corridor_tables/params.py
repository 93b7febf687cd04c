# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""Parameters of fetch scenes, on the host and as the struct that their kernel reads."""

import math
from dataclasses import dataclass, field, fields
from functools import lru_cache

import warp as wp

from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.layout import PoolSpec
from spin_rl.warp_kernels.structs import struct_of


@dataclass(frozen=True)
class FetchTableParams:
    """Distribution of the table at the corridor's end and of what stands on it. Pairs are (low, high).

    Lengths in metres. "Along" is the direction of the corridor's last leg.

    Attributes:
        top: Height of the table's top.
        edge_distance: From the goal along to the table's front edge.
        depth: Size of the table along.
        half_width: Half its size across.
        inset: From the front edge along to the object's centre.
        aside: Largest offset of the object across, either way.
        edge_margin: Distance from the object to the table's other edges, at least.
        size_factor: Factor on the object's nominal size.
        mass_factor: Factor on its nominal mass.
        friction: Sliding friction of the fingertips' pads.
    """

    top: tuple[float, float] = (0.35, 0.95)
    edge_distance: tuple[float, float] = (0.65, 0.75)
    depth: tuple[float, float] = (0.5, 0.6)
    half_width: tuple[float, float] = (0.3, 0.48)
    inset: tuple[float, float] = (0.2, 0.3)
    aside: float = 0.1
    edge_margin: float = 0.02
    size_factor: tuple[float, float] = (0.9, 1.1)
    mass_factor: tuple[float, float] = (0.8, 1.2)
    friction: tuple[float, float] = (1.0, 1.4)

    def __post_init__(self) -> None:
        """Reject tables that the robot cannot stand at."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            pair = value if isinstance(value, tuple) else (value, value)
            _require(
                len(pair) == 2 and all(map(math.isfinite, pair)) and 0.0 <= pair[0] <= pair[1],
                f"scene.table.{entry.name} must be {'(low, high)' if pair is value else 'a number'}, "
                f"not negative, got {value}",
            )
        for name, low, high in _LIMITS:
            pair = getattr(self, name)
            _require(
                low <= pair[0] and pair[1] <= high,
                f"scene.table.{name} must lie in [{low}, {high}], got {pair}",
            )


# Within these the object is in reach of a robot that can turn in front of the table.
_LIMITS = (
    ("top", 0.3, 1.0),
    ("edge_distance", 0.38, 1.0),
    ("depth", 0.25, 1.0),
    ("half_width", 0.15, 2.0),
    ("inset", 0.13, 0.3),
    ("size_factor", 0.5, 1.2),
    ("mass_factor", 0.1, 10.0),
    ("friction", 0.1, 10.0),
)


@dataclass(frozen=True)
class FetchSceneParams:
    """Distribution of fetch scenes.

    Attributes:
        corridor: The corridor with its clutter, the start, and the goal where the robot stands to pick.
        table: The table beyond the goal.
    """

    corridor: GeneratorParams = field(
        default_factory=lambda: GeneratorParams(
            beyond_goal=(1.4, 1.6), goal_clearance=0.5, start_gripper_finger=(-0.05, 0.15)
        )
    )
    table: FetchTableParams = field(default_factory=FetchTableParams)

    def __post_init__(self) -> None:
        """Reject tables that do not fit the corridor."""
        corridor, table = self.corridor, self.table
        _require(
            table.half_width[1] < 0.5 * corridor.width,
            f"scene.table.half_width must be below half of scene.corridor.width, got {table.half_width}",
        )
        back = table.edge_distance[1] + table.depth[1]
        _require(
            corridor.beyond_goal[0] >= back,
            f"scene.corridor.beyond_goal must be at least {back:.2f} for the table, "
            f"got {corridor.beyond_goal}",
        )
        _require(not corridor.moves, "scene.corridor: obstacles cannot move in fetch scenes")

    @property
    def pool(self) -> PoolSpec:
        """Slots for the corridor's obstacles, its distractors and the table."""
        usual = PoolSpec()
        corridor = self.corridor
        boxes = corridor.hard_obstacles + corridor.max_distractors + 1
        return PoolSpec(usual.num_walls, max(usual.num_boxes, boxes), usual.num_cylinders)

    @property
    def table_slot(self) -> int:
        """The slot that is the table: obstacles take those before, distractors the last ones."""
        return self.pool.first_box + self.corridor.hard_obstacles


@wp.struct
class FetchTableStruct:
    """`FetchTableParams` as the kernel reads them."""

    top: wp.vec2
    edge_distance: wp.vec2
    depth: wp.vec2
    half_width: wp.vec2
    inset: wp.vec2
    aside: float
    edge_margin: float
    size_factor: wp.vec2
    mass_factor: wp.vec2
    friction: wp.vec2


@lru_cache(maxsize=8)
def table_struct(params: FetchTableParams) -> FetchTableStruct:
    """The kernel's copy of the parameters."""
    return struct_of(FetchTableStruct, params)


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)
