"""What the analysis keeps of an episode that did not reach its goal."""

from __future__ import annotations

from dataclasses import dataclass

from spin_rl.scenes.layout import PoolSpec, Scene


@dataclass(frozen=True)
class Failure:
    """An episode that did not reach its goal; states are those of the last observation.

    Attributes:
        seed: Of the evaluation.
        world: Index in the batch of that seed.
        outcome: `collision`, `timeout` or `non_finite`.
        time_s: Since the start [s].
        travelled_m: Way of the base [m].
        to_go_m: Straight distance to the goal [m].
        way_m: Length of the way to the goal at the start [m]; see `NavEnv.final_way`.
        left_m: Length of the way left [m].
        place: Of the base in one of the paper's corridors: `straight`, or `before`, `in` or `behind` the
            `corner`; None elsewhere.
        forward_m_s: Speed of the base ahead, negative backwards [m/s].
        turn_rad_s: Turning speed of the base, positive to the left [rad/s].
        motion: What the base did: `forward`, `backward`, `turning` (in place) or `still`.
        late_m: Way of the base in the last `watch.LATE_S` [m].
        late_turn_rad: By how much it turned to the left meanwhile, turns to and fro cancelling out [rad].
        manner: What it did meanwhile, see `names.manner_of`.
        parts: Parts of the robot that touched the scene, the nearest to it first.
        hits: What each of them touched, see `names.kind_of`. The rest is about the first of them, and None or
            false without one.
        point_b: Nearest point of the part to what it touched, in the base frame [m], None without one.
        slot: Its slot in the scene, None for the floor.
        moving: Whether it can move.
        behind_corner: Whether it is an obstacle in the second leg of an L.
        seen: `in view` if the camera showed a corner of it at the last observation, else `before` or `never`.
        unseen_s: Time since the camera showed a corner of it [s], None if it never did.
        width_m: Free width of the place [m], see `width.free_width`.
        qpos: State of the robot in `robot.DOF_NAMES` order [m, rad].
        goal: Of the base [m].
        pool: Walls, boxes and cylinders that the scene has slots for.
        slots: What stood where: index, position [m], yaw [rad] and half extents [m] of every active slot.
        condition: Name of the benchmark's row: a cell, a family or a scene. `FailureWatch` leaves it empty.
    """

    seed: int
    world: int
    outcome: str
    time_s: float
    travelled_m: float
    to_go_m: float
    way_m: float
    left_m: float
    place: str | None
    forward_m_s: float
    turn_rad_s: float
    motion: str
    late_m: float
    late_turn_rad: float
    manner: str
    parts: list[str]
    hits: list[str]
    point_b: list[float] | None
    slot: int | None
    moving: bool
    behind_corner: bool
    seen: str | None
    unseen_s: float | None
    width_m: float | None
    qpos: list[float]
    goal: list[float]
    pool: list[int]
    slots: list[list[float]]
    condition: str = ""

    @property
    def contacts(self) -> list[str]:
        """What touched what, the nearest first."""
        return [f"{part} on {hit}" for part, hit in zip(self.parts, self.hits, strict=True)]


def scene_of(failure: Failure) -> Scene:
    """Rebuild what stood where; start, joints and motion are left out."""
    scene = Scene.empty(PoolSpec(*failure.pool))
    scene.goal[:] = failure.goal
    for slot, *values in failure.slots:
        i = int(slot)
        scene.active[i], scene.pos[i], scene.yaw[i], scene.half_size[i] = (
            True,
            values[:3],
            values[3],
            values[4:],
        )
    return scene
