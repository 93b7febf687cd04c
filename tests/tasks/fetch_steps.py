"""The end of a fetch's control step on plain arrays: what it left behind, and what is made of that."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.sim.targets import make_increments
from spin_rl.tasks.common.episode import StepEnd
from spin_rl.tasks.common.rules import rules_of
from spin_rl.tasks.fetch import stages as fetch_stages
from spin_rl.tasks.fetch import state as fetch_state
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.results import FetchEpisodes, read_record
from spin_rl.tasks.pick.episode import Forces

REACH, ALIGN, PICK, RETRACT, CARRY, PLACE = range(len(fetch_state.STAGES))
TABLE = (2.0, 1.0, 0.3)
TABLE_HALF = (0.4, 0.2, 0.3)
TABLE_TOP = 0.6
ON_TABLE = (2.0, 1.0, 0.65)
HALF_EXTENTS = (0.03, 0.03, 0.05)
HELD = (8.0, 8.0)
GOAL, HOME, BASE = (2.0, 0.0), (0.0, 0.0), (1.0, 0.0)


@dataclass
class Left:
    """What a step left behind in one world; by itself nothing of it ends a stage or the fetch."""

    stage: int
    at: tuple[float, float, float] = ON_TABLE
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    table_yaw: float = 0.0
    fingers: tuple[float, float] = HELD
    hard: float = 0.0
    support: bool = False
    part: str | None = None
    seen: bool = False
    ready: bool = False
    phase: int = 0
    loose: int = 0
    retries: int = 0


@dataclass
class Ended:
    """What the end of the step made of it, one row per world."""

    outcome: list[int]
    stage: list[int]
    scrapes: list[int]
    retries: list[int]
    record: FetchEpisodes


def end_step(cfg: FetchConfig, lefts: list[Left], device: str) -> Ended:
    """End one control step that left this behind, one world for each."""
    n = len(lefts)
    with wp.ScopedDevice(device):
        state, record = _state(lefts, device), fetch_state.make_record(n, device)
        bodies = _bodies(cfg, lefts)
        limits = [round(limit / cfg.sim.control_period) for limit in cfg.limits.seconds()]
        rules = rules_of(
            fetch_state.FetchRules,
            cfg,
            limits=wp.array(limits, dtype=wp.int32),
            table_slot=cfg.scene.table_slot,
            must_see=True,
        )
        end = StepEnd()
        end.qpos, end.qvel = wp.zeros_like(bodies.qpos), wp.zeros_like(bodies.qvel)
        end.outcome, end.done = wp.zeros(n, dtype=wp.int32), wp.zeros(n, dtype=bool)
        wp.launch(
            fetch_stages.advance_stages,
            dim=n,
            inputs=[
                bodies,
                _forces(lefts),
                rules,
                make_increments(cfg.manipulation.increments, cfg.sim.control_period, device),
                wp.array([left.seen for left in lefts], dtype=bool),
            ],
            outputs=[
                state,
                record,
                wp.zeros(n, dtype=wp.int32),
                wp.zeros((n, len(robot.ACTIONS)), dtype=float),
                end,
            ],
        )
    lists = {name: getattr(state, name).numpy().tolist() for name in ("stage", "scrapes", "retries")}
    return Ended(outcome=end.outcome.numpy().tolist(), record=read_record(record), **lists)


def _state(lefts: list[Left], device: str) -> fetch_state.FetchState:
    state = fetch_state.make_state(len(lefts), device)
    for name in ("stage", "ready", "phase", "loose", "retries"):
        getattr(state, name).assign([getattr(left, name) for left in lefts])
    state.length.fill_(50)
    state.time.fill_(5)
    state.home.assign([HOME] * len(lefts))
    return state


def _bodies(cfg: FetchConfig, lefts: list[Left]) -> fetch_state.Bodies:
    n, slots = len(lefts), cfg.scene.table_slot + 1
    dofs = len(robot.DOF_NAMES)
    qpos, qvel = np.zeros((n, dofs + 7), np.float32), np.zeros((n, dofs + 6), np.float32)
    qpos[:, :2] = BASE
    qpos[:, dofs : dofs + 3] = [left.at for left in lefts]
    qvel[:, dofs : dofs + 3] = [left.velocity for left in lefts]
    bodies = fetch_state.Bodies()
    bodies.qpos, bodies.qvel = wp.array(qpos), wp.array(qvel)
    bodies.parts = wp.array([[part == left.part for part in robot.PARTS] for left in lefts], dtype=bool)
    bodies.target = wp.zeros((n, len(robot.JOINTS)), dtype=float)
    bodies.object_kind = wp.zeros(n, dtype=wp.int32)
    bodies.object_start = wp.zeros(n, dtype=wp.vec4)
    bodies.half_extents = wp.array([HALF_EXTENTS] * n, dtype=wp.vec3)
    bodies.goal = wp.array([GOAL] * n, dtype=wp.vec2)
    bodies.slots.pos = wp.full((n, slots), wp.vec3(*TABLE), dtype=wp.vec3)
    bodies.slots.half_size = wp.full((n, slots), wp.vec3(*TABLE_HALF), dtype=wp.vec3)
    bodies.slots.yaw = wp.array([[left.table_yaw] * slots for left in lefts], dtype=float)
    return bodies


def _forces(lefts: list[Left]) -> Forces:
    forces = Forces()
    forces.finger = wp.array([left.fingers for left in lefts], dtype=float)
    forces.table = wp.zeros(len(lefts), dtype=float)
    forces.hard = wp.array([left.hard for left in lefts], dtype=float)
    forces.support = wp.array([left.support for left in lefts], dtype=bool)
    return forces
