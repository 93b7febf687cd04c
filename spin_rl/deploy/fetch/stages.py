"""What leads a fetch from one stage to the next and ends it; see `spin_rl.tasks.fetch.stages`.

Without the simulator's touches: while the robot drives, what hits something with force ends the fetch, as in
the other stages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch.known import Grip, Known, Now
from spin_rl.deploy.fetch.memory import Memory
from spin_rl.deploy.fetch.moves import LIFT, PITCH, ROLL

PLACED, DROPPED, HIT = "placed", "dropped", "it hit something"
NO_TIME = {stage: f"no time left to {stage}" for stage in n.STAGES}
"""Why a fetch ends, by the stage that took too long."""


@dataclass(frozen=True)
class Rules:
    """When stages end; the settings of `fetch.json`, see `FetchConfig`."""

    limits: dict[str, float]
    retries: int
    goal_tolerance_m: float
    home_tolerance_m: float
    place_m: float
    lift_m: float
    hold_s: float
    grasp_force_n: float
    finger_force_n: float
    hard_force_n: float
    fall_m: float
    carry_moves: tuple[str, ...]
    carry_lift_m: float

    def __post_init__(self) -> None:
        """Reject limits of other stages."""
        if set(self.limits) != set(n.STAGES):
            raise ValueError(f"limits: needs {', '.join(n.STAGES)}, got {', '.join(self.limits)}")

    def is_lifted(self, height: float, grip: Grip) -> bool:
        """Whether the object is held up, `height` [m] over where it stood."""
        presses = sum(grip.fingers_n) > self.grasp_force_n and min(grip.fingers_n) > self.finger_force_n
        return height > self.lift_m and presses and not grip.is_supported


def advance(m: Memory, rules: Rules, now: Now) -> str | None:
    """Count a step, and go on to the next stage if it is over; return why the fetch ends, or None.

    A stage that begins has `time` 0.

    Args:
        m: Updated.
        rules: When stages end.
        now: After the step.
    """
    m.time += 1
    m.length += 1
    after, why = _after(m, rules, now)
    limit = round(rules.limits[n.STAGES[m.stage]] / now.period)
    if why is None and after == m.stage and m.time >= limit:
        why = NO_TIME[n.STAGES[m.stage]]
    if why is None and after != m.stage:
        _enter(m, after, now)
    return why


def _after(m: Memory, rules: Rules, now: Now) -> tuple[int, str | None]:
    """Return the stage after this step, and why the fetch ends."""
    known, base = now.known, now.base
    at, grip, stage = known.object_at, known.grip, m.stage
    if grip.hard_n > rules.hard_force_n:
        return stage, HIT
    if stage == n.REACH:
        is_there = math.dist(base[:2], m.goal) < rules.goal_tolerance_m
        return (n.ALIGN if is_there else stage), None
    if stage in (n.ALIGN, n.PICK) and _is_lost(at, known, rules):
        return stage, DROPPED
    if stage == n.ALIGN:
        return (n.PICK if m.ready and known.is_seen else stage), None
    if stage == n.PICK:
        return _after_pick(m, rules, now)
    if stage == n.PLACE and m.phase >= n.RELEASE_PHASE:
        return stage, PLACED if _is_placed(m, rules, known) else None
    m.loose = m.loose + 1 if sum(grip.fingers_n) < n.LOOSE_N else 0
    if m.loose >= n.LOOSE_STEPS:
        again = _retry(m, rules) if stage == n.RETRACT and _is_on_table(at, known) else None
        return (stage, DROPPED) if again is None else (again, None)
    if stage == n.RETRACT:
        return (n.CARRY if m.ready else stage), None
    is_home = stage == n.CARRY and math.dist(base[:2], m.goal) < rules.home_tolerance_m
    return (n.PLACE if is_home else stage), None


def _after_pick(m: Memory, rules: Rules, now: Now) -> tuple[int, str | None]:
    known = now.known
    if known.grip.is_supported:
        # As it leaves the table: held like that, the object stands upright.
        m.grip = (float(now.joints[PITCH]), float(now.joints[ROLL]))
    lifted = rules.is_lifted(known.object_at[2] - m.rest, known.grip)
    m.held = m.held + 1 if lifted else 0
    if m.held >= round(rules.hold_s / now.period):
        return n.RETRACT, None
    if m.time >= round(rules.limits["pick"] / now.period):
        again = _retry(m, rules)
        return (m.stage, NO_TIME["pick"]) if again is None else (again, None)
    return m.stage, None


def _retry(m: Memory, rules: Rules) -> int | None:
    """Return the stage after a failed attempt: another one, or None."""
    if m.retries >= rules.retries:
        return None
    m.retries += 1
    return n.ALIGN


def _enter(m: Memory, stage: int, now: Now) -> None:
    """Begin a stage."""
    m.stage, m.time, m.phase, m.phase_time = stage, 0, 0, 0
    m.ready, m.held, m.loose, m.stuck, m.detour = False, 0, 0, 0, False
    m.mark = float(now.target[LIFT])
    if stage == n.ALIGN:
        m.stand = np.array([*m.goal, 0.0])
        m.is_found = m.is_found and m.retries == 0
    elif stage == n.CARRY:
        m.goal = m.home.copy()
    elif stage == n.PICK:
        m.stand = np.array([*m.stand[:2], now.base[2]])
        m.rest = float(now.known.object_at[2])


def watch(m: Memory, known: Known) -> None:
    """Remember where the object was last seen."""
    if known.is_seen:
        m.is_found, m.found = True, known.object_at


def _is_on_table(at: np.ndarray, known: Known) -> bool:
    """Whether the object's centre is over the table and not below its top."""
    centre, yaw, half = known.table.pos[0], known.table.yaw[0], known.table.half[0]
    dx, dy = at[:2] - centre[:2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    return bool(
        at[2] > centre[2] + half[2]
        and abs(cos * dx + sin * dy) < half[0]
        and abs(cos * dy - sin * dx) < half[1]
    )


def _is_lost(at: np.ndarray, known: Known, rules: Rules) -> bool:
    """Whether the object has fallen off the table."""
    return bool(at[2] < known.table.pos[0, 2] + known.table.half[0, 2] - rules.fall_m)


def _is_placed(m: Memory, rules: Rules, known: Known) -> bool:
    """Whether the object lies at rest on the floor near the robot's start."""
    at = known.object_at
    is_low, is_near = at[2] < 1.1 * known.object_length, math.dist(at[:2], m.home) < rules.place_m
    is_at_rest = known.grip.is_supported and known.object_speed < n.REST_SPEED
    return bool(m.ready and is_low and is_near and is_at_rest)
