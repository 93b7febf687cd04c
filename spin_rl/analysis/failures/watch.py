"""Following failed episodes: what the robot hit with what, when, where, and whether it had been seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from spin_rl.analysis.hits import FLOOR, Touch
from spin_rl.analysis.watch import NEVER, Watch
from spin_rl.policy import Policy
from spin_rl.scenes.kinds import DIFFICULTIES, level_of
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.env import NavEnv

HITS = {"low": "low", "tall": "tall", "arm": "arm-height", "head": "head-height"}
"""Kinds of obstacles by the name of their level."""
OTHER_HITS = ("wall", "distractor", "floor")

# Slower than this counts as not moving: of the base's fastest, 6 % forward and 7 % turning.
_STILL_M_S = 0.05
_STILL_RAD_S = 0.1


@dataclass(frozen=True)
class Failure:
    """An episode that did not reach its goal; states are those of the last observation.

    Attributes:
        scenario: Of its cell.
        difficulty: Of its cell.
        seed: Of the evaluation.
        world: Index in the batch of that seed.
        outcome: `collision`, `timeout` or `non_finite`.
        time_s: Since the start [s].
        travelled_m: Way of the base [m].
        to_go_m: Straight distance to the goal [m].
        place: Of the base: `straight` corridor, or `before`, `in` or `behind` the `corner`.
        forward_m_s: Speed of the base ahead, negative backwards [m/s].
        turn_rad_s: Turning speed of the base, positive to the left [rad/s].
        motion: What the base did: `forward`, `backward`, `turning` (in place) or `still`.
        parts: Parts of the robot that touched the scene, the nearest to it first.
        hits: What each of them touched: a kind of `HITS`, or one of `OTHER_HITS`. The rest is about the first
            of them, and None or false without one.
        point_b: Nearest point of the part to what it touched, in the base frame [m], None without one.
        slot: Its slot in the scene, None for the floor.
        moving: Whether it can move.
        behind_corner: Whether it is an obstacle in the second leg of an L.
        seen: `in view` if the camera showed a corner of it at the last observation, else `before` or `never`.
        unseen_s: Time since the camera showed a corner of it [s], None if it never did.
        qpos: State of the robot in `robot.DOF_NAMES` order [m, rad].
        goal: Of the base [m].
        slots: What stood where: index, position [m], yaw [rad] and half extents [m] of every active slot.
    """

    scenario: int
    difficulty: str
    seed: int
    world: int
    outcome: str
    time_s: float
    travelled_m: float
    to_go_m: float
    place: str
    forward_m_s: float
    turn_rad_s: float
    motion: str
    parts: list[str]
    hits: list[str]
    point_b: list[float] | None
    slot: int | None
    moving: bool
    behind_corner: bool
    seen: str | None
    unseen_s: float | None
    qpos: list[float]
    goal: list[float]
    slots: list[list[float]]


class FailureWatch(Watch):
    """Collects the failures of one seed."""

    def __init__(self, policy: Policy, env: NavEnv, seed: int) -> None:
        """Watch a policy in an environment that only it acts in.

        Args:
            policy: The policy.
            env: The environment; its corridors are the generator's.
            seed: What failures are labelled with.
        """
        super().__init__(policy, env)
        self._seed = seed
        self.failures: list[Failure] = []

    def _begin(self) -> None:
        super()._begin()
        self._scenes = self._env.sim.layout.scenes()
        self._travelled = torch.zeros(self._env.num_envs, device=self._env.device)

    def _observe(self, obs: TensorDict) -> None:
        before = self._last["qpos"][:, :2].clone()
        super()._observe(obs)
        self._travelled += (self._last["qpos"][:, :2] - before).norm(dim=-1)

    def _end(self, worlds: torch.Tensor) -> None:
        worlds = worlds[self._env.outcome[worlds] != episode.SUCCESS]
        rows = self._rows(worlds)
        rows["outcome"], rows["travelled"] = (
            values[worlds].cpu().numpy() for values in (self._env.outcome, self._travelled)
        )
        for i, world in enumerate(worlds.tolist()):
            self.failures.append(self._describe(world, {name: values[i] for name, values in rows.items()}))

    def _describe(self, world: int, state: dict[str, np.ndarray]) -> Failure:
        scene, qpos = self._scenes[world], state["qpos"]
        speed, turn = base_velocity(qpos, state["qvel"])
        touches: list[Touch] = []
        if state["outcome"] == episode.COLLISION:
            touches = self._nearest.find(world, state["slot_pos"], qpos, state["parts"])
        slot = touches[0].slot if touches and touches[0].slot != FLOOR else None
        return Failure(
            scenario=scene.scenario,
            difficulty=DIFFICULTIES[scene.difficulty],
            seed=self._seed,
            world=world,
            outcome=episode.OUTCOMES[state["outcome"]],
            # The step that ended the episode came after the last observation.
            time_s=round((self._step + 1) * self._period, 3),
            travelled_m=round(float(state["travelled"]), 3),
            to_go_m=round(float(np.hypot(*(scene.goal - qpos[:2]))), 3),
            place=place_of(scene, qpos[:2]),
            forward_m_s=round(speed, 3),
            turn_rad_s=round(turn, 3),
            motion=motion_of(speed, turn),
            parts=[touch.part for touch in touches],
            hits=[kind_of(scene, touch.slot) for touch in touches],
            point_b=[round(float(value), 4) for value in touches[0].point_b] if touches else None,
            qpos=[round(float(value), 5) for value in qpos],
            goal=[round(float(value), 4) for value in scene.goal],
            slots=_rows_of(scene, state["slot_pos"]),
            **self._describe_slot(scene, slot, state),
        )

    def _describe_slot(self, scene: Scene, slot: int | None, state: dict[str, np.ndarray]) -> dict[str, Any]:
        nothing = {"moving": False, "behind_corner": False, "seen": None, "unseen_s": None}
        if slot is None:
            return nothing | {"slot": None}
        pos, seen_at = state["slot_pos"][slot], int(state["seen_at"][slot])
        steps = None if seen_at == NEVER else self._step - seen_at
        moving = bool(scene.motion_speed[slot] > 0.0)
        # What moves may come out of a wall, and be on neither side of the corner yet.
        stands = scene.home[slot, :2] if moving else pos[:2]
        return {
            "slot": slot,
            "moving": moving,
            "behind_corner": not scene.is_wall[slot] and place_of(scene, stands) == "behind corner",
            "seen": "never" if steps is None else "before" if steps else "in view",
            "unseen_s": None if steps is None else round(steps * self._period, 3),
        }


def kind_of(scene: Scene, slot: int) -> str:
    """Name what a slot of a generated corridor is: a value of `HITS` or one of `OTHER_HITS`.

    Obstacles take the first box slots, distractors the last.
    """
    if slot == FLOOR:
        return "floor"
    if scene.is_wall[slot]:
        return "wall"
    boxes = scene.num_obstacles - int(np.count_nonzero(scene.active & scene.is_cylinder))
    if not scene.is_cylinder[slot] and slot >= scene.pool.first_box + boxes:
        return "distractor"
    height, half = scene.pos[slot, 2], scene.half_size[slot, 2]
    return HITS[level_of(float(height - half), float(height + half))]


def place_of(scene: Scene, point: np.ndarray) -> str:
    """Name the part of a generated corridor that a point (x, y) [m] is in."""
    if scene.bend == 0:
        return "straight"
    outer = 1  # slot of the first leg's outer wall, which bounds the free space at y = -+ half the width
    half_width = abs(scene.pos[outer, 1]) - scene.half_size[outer, 1]
    if abs(point[1]) > half_width:
        return "behind corner"
    return "before corner" if point[0] < scene.goal[0] - half_width else "in corner"


def base_velocity(qpos: np.ndarray, qvel: np.ndarray) -> tuple[float, float]:
    """Return the base's forward [m/s] and turning speed [rad/s] of a state."""
    return float(qvel[0] * np.cos(qpos[2]) + qvel[1] * np.sin(qpos[2])), float(qvel[2])


def motion_of(forward: float, turn: float) -> str:
    """Name what a base with a forward [m/s] and a turning speed [rad/s] does."""
    if abs(forward) >= _STILL_M_S:
        return "forward" if forward > 0.0 else "backward"
    return "turning" if abs(turn) >= _STILL_RAD_S else "still"


def scene_of(failure: Failure) -> Scene:
    """Rebuild what stood where; start, joints and motion are left out."""
    scene = Scene.empty(PoolSpec())
    scene.goal[:], scene.bend = failure.goal, failure.scenario - 1
    for slot, *values in failure.slots:
        i = int(slot)
        scene.active[i], scene.pos[i], scene.yaw[i], scene.half_size[i] = (
            True,
            values[:3],
            values[3],
            values[4:],
        )
    return scene


def _rows_of(scene: Scene, pos: np.ndarray) -> list[list[float]]:
    slots = np.flatnonzero(scene.active)
    table = np.column_stack([slots, pos[slots], scene.yaw[slots], scene.half_size[slots]])
    return np.round(table.astype(float), 4).tolist()
