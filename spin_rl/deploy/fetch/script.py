"""What the robot does by itself in a fetch; see `spin_rl.tasks.fetch.scripts.kernel`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from spin_rl import robot
from spin_rl.deploy.contract import Profile
from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch.bumper import without_bumps
from spin_rl.deploy.fetch.known import Now
from spin_rl.deploy.fetch.memory import Memory
from spin_rl.deploy.fetch.moves import FINGER, LIFT, Wanted, clamp
from spin_rl.deploy.fetch.phases import LAST_PHASE, POSES, SCRIPTS

_LOW, _HIGH = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
_ZERO = np.array([robot.STOWED[joint] for joint in robot.JOINTS])
_RATES = np.array(n.RATES)


@dataclass(frozen=True)
class Drive:
    """What scripts know of the robot and its policies.

    Attributes:
        profile: How fast the robot is.
        carry_moves: Joints that the navigation policy moves while it carries.
        carry_lift_m: Lowest lift while it carries [m].
        pick_speed: Base speeds at an action of 1 while it picks [m/s, rad/s].
    """

    profile: Profile
    carry_moves: Collection[str]
    carry_lift_m: float
    pick_speed: tuple[float, float]


def targets_of(action: np.ndarray) -> np.ndarray:
    """Return the joints' targets [m, rad] of actions in the absolute mode, shape (8,), not clipped."""
    return _ZERO + action * np.where(action >= 0.0, _HIGH - _ZERO, _ZERO - _LOW)


def actions_of(targets: np.ndarray) -> np.ndarray:
    """Return the actions for targets, shape (8,), not clipped: the inverse."""
    offset = targets - _ZERO
    return offset / np.maximum(np.where(offset >= 0.0, _HIGH - _ZERO, _ZERO - _LOW), 1e-6)


def act(drive: Drive, now: Now, m: Memory, action: np.ndarray) -> np.ndarray:
    """Return the action of a step: a script's, or a policy's as far as the stage leaves it.

    Args:
        drive: Limits.
        now: What scripts read.
        m: Updated.
        action: Of the policy whose stage it is; has no meaning in scripted stages, shape (10,).
    """
    if m.stage == n.REACH:
        return action
    if m.stage == n.PICK:
        # The policy does not see walls.
        speed = np.array(drive.pick_speed)
        safe = without_bumps(now.base, now.known.near, *(speed * action[:2]).tolist())
        return np.array([*(safe / speed), *action[2:]])
    if m.stage == n.CARRY:
        return np.array([*action[:2], *_carry(drive, now, action[2:])])
    return _script(drive, now, m)


def _carry(drive: Drive, now: Now, action: np.ndarray) -> np.ndarray:
    """Change the navigation policy's action of the joints so that the object stays in the hand."""
    target = now.target
    wanted, held = action.copy(), actions_of(target)
    for joint, name in enumerate(robot.JOINTS[:FINGER]):
        if name not in drive.carry_moves:
            wanted[joint] = held[joint]
    fingers = target.copy()
    fingers[FINGER] = now.grip
    wanted[FINGER] = actions_of(fingers)[FINGER]
    most = n.CARRY_LIFT_RATE * now.period
    lift = max(targets_of(wanted)[LIFT], drive.carry_lift_m)
    moved = target.copy()
    moved[LIFT] += clamp(lift - target[LIFT], -most, most)
    wanted[LIFT] = actions_of(moved)[LIFT]
    return wanted


def _script(drive: Drive, now: Now, m: Memory) -> np.ndarray:
    target = now.target
    c = Wanted(target.copy())
    SCRIPTS[m.stage](c, now, m)
    move = without_bumps(now.base, now.known.near, c.forward, c.turn)
    is_stuck = _is_still(*move) and not _is_still(c.forward, c.turn)
    m.stuck = m.stuck + 1 if is_stuck else 0
    if m.stuck >= n.STUCK_STEPS:
        m.stuck, m.detour = 0, not m.detour
    goal = np.clip(c.joints, _LOW, _HIGH)
    most = c.rate * _RATES * now.period
    if m.stage != n.ALIGN or goal[FINGER] < target[FINGER]:
        most[FINGER] = n.AT_ONCE
    is_moving = bool((np.abs(goal - target)[:FINGER] > n.MOVED).any())
    _advance(c, m, is_moving)
    most_forward = drive.profile.forward_max if move[0] >= 0.0 else drive.profile.reverse_max
    speeds = (move[0] / most_forward, move[1] / drive.profile.turn_max)
    return np.array([*speeds, *actions_of(target + np.clip(goal - target, -most, most))])


def _advance(c: Wanted, m: Memory, is_moving: bool) -> None:
    """Go on to the next phase; those that only move joints are done when these have followed."""
    m.phase_time = 0 if is_moving else m.phase_time + 1
    has_settled = m.phase_time >= n.SETTLE
    if m.phase >= LAST_PHASE[m.stage]:
        m.ready = has_settled
    elif c.done or (m.phase in POSES[m.stage] and has_settled):
        m.phase, m.phase_time = m.phase + 1, 0


def _is_still(forward: float, turn: float) -> bool:
    return abs(forward) < n.STILL and abs(turn) < n.STILL
