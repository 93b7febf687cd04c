"""Parameters of the scene families, with the defaults of the code."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.layout import PoolSpec

HALF_SQUARE_M = 6.0
"""Every scene of a family lies within +- this in x and y."""

BLOCKED_M = 0.17
"""Distance to obstacles below which no way leads through scenes of families: pieces closer than twice this,
less than the base is wide, close a passage; those that `gap` or a doorway leaves are open."""


@dataclass(frozen=True)
class Shares:
    """How often each family is drawn; in proportion, they need not sum to 1."""

    corridor: float = 0.25
    room: float = 0.25
    doorway: float = 0.15
    field: float = 0.15
    crossing: float = 0.1
    open: float = 0.1
    shuttle: float = 0.0

    def __post_init__(self) -> None:
        """Reject shares that leave nothing to draw."""
        values = dataclasses.astuple(self)
        _require(
            all(map(math.isfinite, values)) and min(values) >= 0.0 and sum(values) > 0.0,
            f"scene.shares must not be negative and not all be 0, got {values}",
        )


@dataclass(frozen=True)
class FurnitureParams:
    """What stands in rooms, doorways' rooms and crossings' halls.

    Attributes:
        density: Pieces per square metre of floor, one draw per world; fewer where they do not fit.
        empty_share: Share of worlds without any.
        hanging_share: Share of lamps and beams that hang in the room, half of them above the robot.
    """

    density: tuple[float, float] = (0.0, 1.2)
    empty_share: float = 0.1
    hanging_share: float = 0.09


@dataclass(frozen=True)
class CorridorParams:
    """Corridors with up to two corners; obstacles are those of `GeneratorParams`.

    Attributes:
        paper_share: Share of corridors that are the paper's instead, see `FamilyParams.paper`.
        corners: Fewest and most corners: none is straight, one an L, two a Z or a U.
        leg: Length of a leg between corners or ends.
        obstacles_per_m: Obstacles per metre of leg, one draw per world.
        dead_end_share: Share of corners, or of straight corridors' sides, with a dead end beside the way.
        dead_end: Length of a dead end.
    """

    paper_share: float = 0.4
    corners: tuple[int, int] = (0, 2)
    leg: tuple[float, float] = (2.4, 4.0)
    obstacles_per_m: tuple[float, float] = (0.0, 1.2)
    dead_end_share: float = 0.4
    dead_end: tuple[float, float] = (0.7, 1.5)


@dataclass(frozen=True)
class RoomParams:
    """One room with furniture.

    Attributes:
        size: Length of each side.
        wing_share: Share of L-shaped rooms, which have a wing at one side.
    """

    size: tuple[float, float] = (3.0, 8.0)
    wing_share: float = 0.25


@dataclass(frozen=True)
class DoorwayParams:
    """Two or three furnished rooms side by side with doorways between them.

    Attributes:
        length: Of all rooms together.
        width: Of the rooms.
        door_width: Free width of a doorway.
        three_share: Share of worlds with three rooms, where the length has room for them.
    """

    length: tuple[float, float] = (6.0, 11.0)
    width: tuple[float, float] = (3.0, 7.0)
    door_width: tuple[float, float] = (0.75, 1.0)
    three_share: float = 0.5


@dataclass(frozen=True)
class FieldParams:
    """Boxes and posts on an open floor.

    Attributes:
        things: Fewest and most of them; fewer where they do not fit.
        size: Side of the square that they stand in.
        floating_share: Share of boxes that float at the height of arm or head.
    """

    things: tuple[int, int] = (10, 60)
    size: tuple[float, float] = (8.0, 11.0)
    floating_share: float = 0.25


@dataclass(frozen=True)
class CrossingParams:
    """A hall between two lanes, with openings out of which things move across the hall.

    Attributes:
        length: Of the hall.
        width: Of the hall.
        lane: Width of the lanes on either side.
        stations: Places along the hall with an opening, each on the left, the right or both sides.
        opening: Width of an opening.
        mover_share: Share of openings with a mover.
        patrolling_share: Share of movers that go to and fro; the others wait for the robot.
        floating_share: Share of movers at the height of the head; the others stand on the floor.
        half_size: Half the size of a mover.
        trigger: Distance of the base from where a waiting mover goes at which it starts.
        speed: Of movers [m/s].
    """

    length: tuple[float, float] = (7.0, 11.0)
    width: tuple[float, float] = (1.4, 2.4)
    lane: tuple[float, float] = (1.3, 2.0)
    stations: tuple[int, int] = (2, 3)
    opening: tuple[float, float] = (0.8, 1.2)
    mover_share: float = 0.7
    patrolling_share: float = 0.5
    floating_share: float = 0.0
    half_size: tuple[float, float] = (0.1, 0.25)
    trigger: tuple[float, float] = (1.0, 2.2)
    speed: tuple[float, float] = (0.3, 0.8)


@dataclass(frozen=True)
class WalkerParams:
    """Somebody who walks to and fro in rooms, rooms with doorways and fields.

    Attributes:
        share: Share of their worlds with one.
        half_size: Half the size across.
        way: Length of the walk.
        speed: Of walking [m/s].
    """

    share: float = 0.3
    half_size: tuple[float, float] = (0.12, 0.25)
    way: tuple[float, float] = (0.8, 3.0)
    speed: tuple[float, float] = (0.3, 0.8)


@dataclass(frozen=True)
class ShuttleParams:
    """Corridors too narrow to turn in, with a goal ahead and then one behind; things come out of the walls.

    Attributes:
        width: Of the corridor; the base, which turns about its wheels, needs 0.56 m to turn round.
        passage: Width that low things leave.
        ahead: From the start to the first goal.
        back: From the start back to the second goal.
        floating_share: Share of things that float; the others are as low obstacles in corridors.
        floating: Between these heights.
        trigger: Distance of the base at which a thing comes out.
        speed: At which it does [m/s].
    """

    width: tuple[float, float] = (0.53, 0.56)
    passage: float = 0.44
    ahead: tuple[float, float] = (1.2, 1.5)
    back: tuple[float, float] = (2.2, 2.9)
    floating_share: float = 0.5
    floating: tuple[float, float] = (0.75, 1.35)
    trigger: tuple[float, float] = (1.0, 1.25)
    speed: tuple[float, float] = (0.8, 1.2)


@dataclass(frozen=True)
class FamilyParams(GeneratorParams):
    """Distribution of scenes from all families. Pairs are (low, high) of a uniform draw; lengths in metres.

    What it inherits holds for all families (walls, goal clearance, start pose) or for the obstacles in
    corridors, whose width is drawn between `width` and `easy_width`. Inherited parameters that mean nothing
    here must keep their defaults.

    Attributes:
        shares: How often each family is drawn.
        pool: Slots of every world; furniture and things stop where they run out.
        way: Length of the way from start to goal.
        gap: What pieces of furniture and things leave between each other, unless they touch.
        close_share: Share of them that may also stand so close to others that nothing fits between.
        furniture: What stands in rooms, doorways' rooms and crossings' halls.
        corridor: Shapes of corridors.
        room: Rooms.
        doorway: Rooms with doorways.
        field: Boxes and posts on open floor.
        crossing: Halls with things that move.
        walker: Who walks in rooms and fields.
        shuttle: Corridors to drive through ahead and back.
    """

    width: float = 0.9
    easy_width: float = 2.0
    wall_height: tuple[float, float] = (1.0, 2.5)
    start_tries: int = 64
    shares: Shares = dataclasses.field(default_factory=Shares)
    pool: PoolSpec = dataclasses.field(
        default_factory=lambda: PoolSpec(num_walls=14, num_boxes=54, num_cylinders=12)
    )
    way: tuple[float, float] = (0.5, 10.0)
    gap: float = 0.55
    close_share: float = 0.5
    furniture: FurnitureParams = dataclasses.field(default_factory=FurnitureParams)
    corridor: CorridorParams = dataclasses.field(default_factory=CorridorParams)
    room: RoomParams = dataclasses.field(default_factory=RoomParams)
    doorway: DoorwayParams = dataclasses.field(default_factory=DoorwayParams)
    field: FieldParams = dataclasses.field(default_factory=FieldParams)
    crossing: CrossingParams = dataclasses.field(default_factory=CrossingParams)
    walker: WalkerParams = dataclasses.field(default_factory=WalkerParams)
    shuttle: ShuttleParams = dataclasses.field(default_factory=ShuttleParams)

    def __post_init__(self) -> None:
        """Reject values that cannot make a scene within the square."""
        super().__post_init__()
        for name in _MEANINGLESS:
            default = getattr(GeneratorParams, name)
            _require(
                getattr(self, name) == default,
                f"scene.{name} has no meaning with scene.shares: leave it at {default}",
            )
        _require(
            0.0 <= self.close_share <= 1.0, f"scene.close_share must be in [0, 1], got {self.close_share}"
        )
        _require(self.gap >= 0.5, f"scene.gap must be at least 0.5 m, got {self.gap}")
        _check_range("way", self.way, 0.2, 20.0)
        for group in GROUPS:
            values = getattr(self, group)
            for entry in dataclasses.fields(values):
                value, name = getattr(values, entry.name), f"{group}.{entry.name}"
                if isinstance(value, tuple):
                    _check_range(name, value, *_LIMITS[name])
                else:
                    _require(0.0 <= value <= 1.0, f"scene.{name} must be in [0, 1], got {value}")
        crossing = self.crossing
        across = crossing.width[1] + 2.0 * crossing.lane[1] + 4.0 * self.wall_thickness
        _require(
            across <= 2.0 * HALF_SQUARE_M,
            f"scene.crossing.width and lane reach {across:.1f} m across, more than {2.0 * HALF_SQUARE_M}",
        )
        _require(
            crossing.half_size[1] <= 0.5 * crossing.opening[0] - 0.1
            and 2.0 * crossing.half_size[1] + self.gap <= crossing.lane[0],
            f"scene.crossing.half_size must fit through opening and into lane, got {crossing.half_size}",
        )
        shuttle = self.shuttle
        _require(
            0.42 <= shuttle.passage <= shuttle.width[0] - 0.05,
            "scene.shuttle.passage must be at least 0.42 and leave 0.05 m of width for things, got "
            f"{shuttle.passage}",
        )
        _require(
            self.pool.num_walls >= 14 and self.pool.num_boxes >= 16 and self.pool.num_cylinders >= 3,
            "scene.pool needs at least 14 walls, 16 boxes and 3 cylinders, got "
            f"{self.pool.num_walls}, {self.pool.num_boxes} and {self.pool.num_cylinders}",
        )

    @property
    def moves(self) -> bool:
        """Whether anything can move."""
        walked = self.shares.room + self.shares.doorway + self.shares.field
        crossed = self.shares.crossing * self.crossing.mover_share
        paper = self.shares.corridor * self.corridor.paper_share
        return (
            crossed > 0.0
            or walked * self.walker.share > 0.0
            or self.shares.shuttle > 0.0
            or (paper > 0.0 and super().moves)
        )

    @property
    def paper(self) -> GeneratorParams:
        """Corridors as of the paper's tables, 1 m wide, with the obstacles and start poses given here."""
        given = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(GeneratorParams)}
        own = ("width", "easy_width")
        return GeneratorParams(**given | {name: getattr(GeneratorParams, name) for name in own})


GROUPS = ("furniture", "corridor", "room", "doorway", "field", "crossing", "walker", "shuttle")
"""Nested parameters that are one for all worlds' draws of a family or of furniture."""

_MEANINGLESS = (
    "length", "first_leg", "first_obstacle", "corner_share", "hard_obstacles", "max_distractors", "start_y",
)  # fmt: skip
# What a family's code can build inside the square.
_LIMITS = {
    "furniture.density": (0.0, 2.0),
    "corridor.corners": (0, 2),
    "corridor.leg": (2.4, 4.5),
    "corridor.obstacles_per_m": (0.0, 2.0),
    "corridor.dead_end": (0.5, 1.5),
    "room.size": (2.5, 8.0),
    "doorway.length": (5.0, 11.7),
    "doorway.width": (2.5, 11.7),
    "doorway.door_width": (0.7, 1.5),
    "field.things": (0, 66),
    "field.size": (2.0, 11.0),
    "crossing.length": (5.0, 11.7),
    "crossing.width": (1.2, 4.0),
    "crossing.lane": (1.0, 4.0),
    "crossing.stations": (1, 4),
    "crossing.opening": (0.6, 1.5),
    "crossing.half_size": (0.05, 0.5),
    "crossing.trigger": (0.5, 5.0),
    "crossing.speed": (0.05, 1.5),
    "shuttle.width": (0.5, 1.0),
    "shuttle.ahead": (0.8, 3.0),
    "shuttle.back": (1.2, 5.0),
    "shuttle.floating": (0.3, 1.4),
    "shuttle.trigger": (0.5, 2.0),
    "shuttle.speed": (0.05, 3.0),
    "walker.half_size": (0.05, 0.5),
    "walker.way": (0.3, 6.0),
    "walker.speed": (0.05, 1.5),
}


def scene_class(values: Mapping[str, Any]) -> type[GeneratorParams]:
    """Class of a navigation scene's configuration: with `shares` it is one of families."""
    return FamilyParams if "shares" in values else GeneratorParams


def _check_range(name: str, value: tuple[float, float], low: float, high: float) -> None:
    _require(
        len(value) == 2 and all(map(math.isfinite, value)) and low <= value[0] <= value[1] <= high,
        f"scene.{name} must be (low, high) within [{low}, {high}], got {value}",
    )


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)
