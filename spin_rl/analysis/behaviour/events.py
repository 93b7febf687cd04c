"""The paper's emergent behaviours, by criteria that a trace meets or not.

Section "Emergent Behavior" and Figure "emergent" name three: (a) dynamic obstacles are avoided, and where
there is no way the robot stops and looks around; (b) the arm is lowered under an obstacle that hangs in its
way, in place of a detour; (c) the path is changed when something comes into it. The paper gives no criteria.
These are ours: each has a situation that asks for the behaviour, and what counts as shown in it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from spin_rl.analysis.behaviour.trace import DriveTrace, wrapped

SHOWN, NOT_NEEDED, FAILED = "shown", "not needed", "failed"

MOVING_M_S = 0.1
"""Something moves that is faster."""
DRIVING_M_S, STRAIGHT_RAD = 0.2, np.radians(10.0)
"""The base drives straight on that is faster and has turned less within `BEFORE_S`."""
BEFORE_S = 0.5
STANDING_M_S = 0.05
"""The base stands that is slower."""
REACTION_S = 2.0
"""Within this time a reaction has to begin."""
SLOWER_M_S = 0.2
"""By how much the base has to become slower to react."""
TURN_RAD = np.radians(20.0)
"""By how much it has to turn to react."""
ASIDE_M = 0.15
"""How far aside of the straight line it has to pass to have taken another way."""
LOOK_S = 5.0
"""Within this time it has to stop and look around, for ..."""
STANDING_S = 0.5
LOOK_RAD = 0.5
"""By how much the camera has to turn about the vertical while it stands."""
HAND_M = 0.12
"""The hand passes what it comes so near to, across the floor."""
HAND_HEIGHT_M = 0.08
"""How far the hand reaches above and below the grasp centre."""
ARM_S = 2.0
"""Time over which the arm's height is compared."""
ARM_M = 0.1
"""By how much the hand has to change its height."""

_ARM_PARTS = ("arm", "wrist", "gripper")
_FLOATING = ("arm", "head")


@dataclass(frozen=True)
class Event:
    """A situation of an episode and what became of it.

    Attributes:
        behaviour: One of `BEHAVIOURS`.
        time_s: When the situation began.
        slot: The obstacle.
        result: `SHOWN`, `NOT_NEEDED` (it went well without) or `FAILED`.
    """

    behaviour: str
    time_s: float
    slot: int
    result: str


def _onset(blocks: np.ndarray, window: int) -> int | None:
    """First observation at which something is in the way that was not at the start nor shortly before."""
    for step in np.flatnonzero(blocks):
        if step > 0 and not blocks[max(0, step - window) : step].any():
            return int(step)
    return None


def _entering(trace: DriveTrace) -> Iterator[tuple[int, int]]:
    """Obstacles that move into the way while the base drives straight on, and the observation at which."""
    window = round(BEFORE_S / trace.period)
    for slot in trace.obstacles:
        speed = trace.moves(slot)
        if not (speed > MOVING_M_S).any():
            continue
        step = _onset(trace.in_way(slot), window)
        if step is None:
            continue
        before = slice(max(0, step - window), step + 1)
        straight = np.abs(wrapped(trace.qpos[before, 2] - trace.qpos[step, 2])).max() < STRAIGHT_RAD
        if straight and trace.speed[step] > DRIVING_M_S and (speed[before] > MOVING_M_S).any():
            yield slot, step


def _end(trace: DriveTrace, slot: int) -> str:
    """How the episode ended for one of its situations: with a success, or by this slot, or otherwise."""
    if trace.outcome == "success":
        return "success"
    return "hit" if any(hit == slot for _, hit in trace.hits[:1]) else "other"


def _result(trace: DriveTrace, slot: int, is_shown: bool) -> str | None:
    """Judge a situation; None where the episode failed for another reason."""
    end = _end(trace, slot)
    if end == "success":
        return SHOWN if is_shown else NOT_NEEDED
    return FAILED if end == "hit" or trace.outcome == "timeout" else None


def avoidance(trace: DriveTrace) -> Iterator[Event]:
    """(a) Something moves into the way; the base slows down or turns within `REACTION_S`, and succeeds."""
    for slot, step in _entering(trace):
        last = step + round(REACTION_S / trace.period)
        slower = trace.speed[step] - trace.speed[step : last + 1].min() >= SLOWER_M_S
        turned = np.abs(wrapped(trace.qpos[step : last + 1, 2] - trace.qpos[step, 2])).max() >= TURN_RAD
        result = _result(trace, slot, bool(slower or turned))
        if result is not None:
            yield Event("avoidance", step * trace.period, slot, result)


def stop_and_look(trace: DriveTrace) -> Iterator[Event]:
    """(a) Something moves into the way; the base stands and the camera sweeps, then it succeeds."""
    length = round(STANDING_S / trace.period)
    gaze = trace.qpos[:, 2] + trace.joint("head_pan")
    for slot, step in _entering(trace):
        last = min(step + round(LOOK_S / trace.period), trace.steps)
        stands = trace.speed < STANDING_M_S
        is_shown = any(
            stands[begin : begin + length].all() and np.ptp(gaze[begin : begin + length]) >= LOOK_RAD
            for begin in range(step, last - length + 1)
        )
        result = _result(trace, slot, is_shown)
        if result is not None:
            yield Event("stop and look", step * trace.period, slot, result)


def rerouting(trace: DriveTrace) -> Iterator[Event]:
    """(c) Something moves into the way; the base turns off and passes it aside of the line it was on."""
    for slot, step in _entering(trace):
        last = step + round(REACTION_S / trace.period)
        turned = np.abs(wrapped(trace.qpos[step : last + 1, 2] - trace.qpos[step, 2])).max() >= TURN_RAD
        abreast = step + int(trace.distance(slot, trace.qpos[:, :2])[step:].argmin())
        moved = trace.qpos[abreast, :2] - trace.qpos[step, :2]
        yaw = trace.qpos[step, 2]
        aside = abs(float(np.cos(yaw) * moved[1] - np.sin(yaw) * moved[0]))
        result = _result(trace, slot, bool(turned and aside >= ASIDE_M))
        if result is not None:
            yield Event("rerouting", step * trace.period, slot, result)


def arm_clearance(trace: DriveTrace) -> Iterator[Event]:
    """(b) The hand passes under or over something that floats and that it would have hit `ARM_S` before.

    Passing at a height that it had anyway is "not needed"; a collision of arm, wrist or gripper with
    something that floats is "failed"; one of another part is neither. What else an episode fails by later
    does not count.
    """
    hit = trace.hits[0] if trace.hits else None
    back = round(ARM_S / trace.period)
    for slot in trace.obstacles:
        if trace.level[slot] not in _FLOATING:
            continue
        if hit is not None and hit[1] == slot:
            if hit[0] in _ARM_PARTS:
                yield Event("arm clearance", (trace.steps - 1) * trace.period, slot, FAILED)
            continue
        passing = np.flatnonzero(trace.distance(slot, trace.hand[:, :2]) <= HAND_M)
        if not len(passing):
            continue
        step = int(passing[0])
        bottom, top = trace.height_of(slot)
        low, high = bottom - HAND_HEIGHT_M, top + HAND_HEIGHT_M
        now, before = trace.hand[step, 2], trace.hand[max(0, step - back) : step + 1, 2]
        would_hit = (before > low) & (before < high)
        is_shown = would_hit.any() and np.abs(before[would_hit] - now).max() >= ARM_M and not low < now < high
        yield Event("arm clearance", step * trace.period, slot, SHOWN if is_shown else NOT_NEEDED)


BEHAVIOURS: Mapping[str, Callable[[DriveTrace], Iterator[Event]]] = MappingProxyType(
    {
        "avoidance": avoidance,
        "stop and look": stop_and_look,
        "arm clearance": arm_clearance,
        "rerouting": rerouting,
    }
)
"""Behaviours by name, in the order of the paper's figure."""


def events_of(trace: DriveTrace) -> list[Event]:
    """All events of an episode, in the order of their time."""
    found = [event for find in BEHAVIOURS.values() for event in find(trace)]
    return sorted(found, key=lambda event: event.time_s)
