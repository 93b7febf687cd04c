"""The scripts of a fetch, phase by phase; see `spin_rl.tasks.fetch.scripts.phases`, which says why."""

from __future__ import annotations

import math

import numpy as np

from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch.known import Now
from spin_rl.deploy.fetch.memory import Memory
from spin_rl.deploy.fetch.moves import (
    ARM,
    FINGER,
    LIFT,
    LIFT_MAX,
    PAN,
    PITCH,
    ROLL,
    TILT,
    YAW,
    Wanted,
    clamp,
    drive_to,
    fold,
    lift_of,
    look,
    sweep,
    wrapped,
)


def align(c: Wanted, now: Now, m: Memory) -> None:
    """Find the object, get the hand out of its way, stand before it, turn beside it, and unfold."""
    base, at = now.base, m.found
    if now.known.grip.holds and m.phase == 0:
        m.is_found = False
        c.joints[FINGER] = now.grip
        c.joints[LIFT] = max(c.joints[LIFT] - n.LOWER_RATE * now.period, 0.0)
        return
    c.joints[FINGER] = n.OPEN
    if m.phase == 0:
        if m.is_found:
            look(c, base, at)
            c.done = m.time >= n.SETTLE
        else:
            sweep(c, m.time, now.period)
        return
    look(c, base, at)
    if m.phase == 1:
        c.joints[LIFT] = clamp(lift_of(at[2] + n.ABOVE_M, -n.PICK_PITCH), 0.0, LIFT_MAX)
    elif m.phase == 2:
        c.joints[ARM] = 0.0
    elif m.phase == 3:
        fold(c)
    elif m.phase == 4:
        yaw = now.known.table.yaw[0]
        way = n.STAND_M + (n.DETOUR_M if m.detour else 0.0)
        drive_to(c, base, at[:2] - way * np.array([math.cos(yaw), math.sin(yaw)]))
        if m.detour and c.done:
            m.detour = c.done = False
    elif m.phase == 5:
        off = wrapped(math.atan2(at[1] - base[1], at[0] - base[0]) - base[2] + 0.5 * math.pi)
        c.turn = clamp(2.0 * off, -0.8, 0.8)
        c.done = abs(off) < n.TURN_TOLERANCE and abs(now.turning) < 0.1
    elif m.phase == 6:
        c.joints[YAW], c.joints[PITCH], c.joints[ROLL] = 0.0, n.PICK_PITCH, 0.0
    elif m.phase_time > n.SETTLE:
        sweep(c, m.phase_time, now.period)


def retract(c: Wanted, now: Now, m: Memory) -> None:
    """Lift the object further, arm in, back to the middle of the corridor, and take it over the base."""
    base, stand = now.base, m.stand
    c.rate = n.CARRY_RATE
    c.joints[FINGER] = now.grip
    if m.phase == 0:
        c.joints[LIFT] = min(m.mark + n.RAISE_M, LIFT_MAX)
    elif m.phase == 1:
        c.joints[ARM] = 0.0
    elif m.phase == 2:
        off = wrapped(stand[2] - base[2])
        c.turn = clamp(2.0 * off, -0.6, 0.6)
        c.done = abs(off) < 2.0 * n.TURN_TOLERANCE and abs(now.turning) < 0.1
    elif m.phase == 3:
        dx, dy = stand[:2] - base[:2]
        ahead = dx * math.cos(base[2]) + dy * math.sin(base[2]) - n.BACK_M
        c.forward = clamp(1.5 * ahead, -0.1, 0.2)
        c.done = abs(ahead) < n.NEAR_M
    elif m.phase == 4:
        fold(c)


def place(c: Wanted, now: Now, m: Memory) -> None:
    """Turn away from the corridor, hold the object ahead of the base, lower it, open, raise the hand."""
    c.rate = n.CARRY_RATE
    c.joints[PAN], c.joints[TILT] = 0.0, n.LOOK_TILT
    c.joints[FINGER] = now.grip if m.phase < n.RELEASE_PHASE else n.OPEN
    if m.phase == 0:
        _go_home(c, now, m)
        c.joints[LIFT] = max(c.joints[LIFT], n.PLACE_LIFT_M)
    elif m.phase == 1:
        c.joints[LIFT] = max(c.joints[LIFT], n.PLACE_LIFT_M)
        c.joints[ARM] = n.PLACE_ARM_M
    elif m.phase == 2:
        c.joints[YAW] = n.PLACE_YAW + clamp(m.grip[0] + n.PLACE_SPREAD, -0.6, 0.0)
        c.joints[PITCH], c.joints[ROLL] = m.grip
    elif m.phase == 3:
        c.done = now.known.grip.stands
        if not c.done and c.joints[LIFT] > 0.0:
            c.joints[LIFT] = max(c.joints[LIFT] - n.LOWER_RATE * now.period, 0.0)
        elif not c.done:
            c.joints[PITCH] = max(c.joints[PITCH] - n.DEEPEN_RATE * now.period, n.DEEPEST_PITCH)
    elif m.phase == 4:
        c.done = m.phase_time >= n.OPENING_STEPS
        m.mark = c.joints[LIFT]
    elif m.phase == 5:
        c.joints[LIFT] = m.mark + n.UP_M


def _go_home(c: Wanted, now: Now, m: Memory) -> None:
    """Drive the rest of the way, then turn away from the corridor."""
    spot = np.array([m.home[0], clamp(m.home[1], -n.FAR_SIDE_M, 0.5 * n.ASIDE_M)])
    if math.dist(now.base[:2], spot) > n.ASIDE_M and m.time * now.period < n.HOMING_S:
        drive_to(c, now.base, spot)
        c.done = False
    else:
        off = wrapped(math.pi - now.base[2])
        c.turn = clamp(2.0 * off, -0.6, 0.6)
        c.done = abs(off) < 2.0 * n.TURN_TOLERANCE


SCRIPTS = {n.ALIGN: align, n.RETRACT: retract, n.PLACE: place}
"""Scripts by their stage; each changes what is wanted, and the memory."""
LAST_PHASE = {n.ALIGN: 7, n.RETRACT: 4, n.PLACE: 5}
POSES = {n.ALIGN: (1, 2, 3, 6), n.RETRACT: (0, 1), n.PLACE: (1, 2)}
"""Phases that only move joints, by stage."""
