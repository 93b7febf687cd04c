"""The failure analysis for people: tables."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np

from spin_rl import robot
from spin_rl.analysis.episodes import condition_of
from spin_rl.analysis.failures.analysis import failures_of
from spin_rl.analysis.failures.failure import Failure
from spin_rl.analysis.failures.names import OBSTACLES
from spin_rl.analysis.failures.plot import plot
from spin_rl.analysis.failures.watch import LATE_S
from spin_rl.benchmark.metrics import wilson_interval
from spin_rl.benchmark.tables.reach import align, title
from spin_rl.planning.distance_field import BASE_HALF_WIDTH_M

__all__ = ["headline", "plot", "table"]

_CONDITIONS = {"reach": "cell", "rooms": "family", "scenes": "scene"}
_TIME_BINS_S = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, math.inf)
_WIDTH_BINS_M = (0.0, 2.0 * BASE_HALF_WIDTH_M, 0.55, 1.0, math.inf)
_RECENT_S = 1.0
_LISTED = 12
_MOST = 3


def table(result: dict[str, Any]) -> str:
    """Format a result of `failures.analyse_failures` for the terminal."""
    failures = failures_of(result)
    condition = _CONDITIONS[result["benchmark"]]
    heading = title("Failures", result, f"{result['rows'][0]['episodes']} episodes per {condition}")
    episodes = sum(row["episodes"] for row in result["rows"])
    blocks = [[heading], _by_condition(result, condition), _by_contact(failures, episodes)]
    blocks += [_by_time(failures, result["durations_s"]), _by_sight(failures), _by_motion(failures)]
    blocks += [_by_side(failures), _by_width(failures), _by_place(failures), _timeouts(failures)]
    return "\n\n".join("\n".join(block) for block in [*blocks, _first(result)] if block)


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    episodes, failures = sum(row["episodes"] for row in result["rows"]), failures_of(result)
    outcomes = Counter(failure.outcome for failure in failures)
    parts = Counter(failure.parts[0] for failure in failures if failure.parts)
    text = f"{len(failures)} of {episodes} episodes failed"
    text += "".join(f", {count} by {outcome}" for outcome, count in outcomes.most_common())
    return text + "".join(f", {part} first in {count}" for part, count in parts.most_common(1))


def _by_condition(result: dict[str, Any], name: str) -> list[str]:
    failures, body = failures_of(result), []
    for row in result["rows"]:
        count = row["episodes"]
        collisions, timeouts = (round(row[f"{kind}_rate"] * count) for kind in ("collision", "timeout"))
        failed = round((1.0 - row["success_rate"]) * count)
        mine = [failure for failure in failures if failure.condition == condition_of(row)]
        first = _most(failure.contacts[0] for failure in mine if failure.contacts)
        cells = [str(collisions), str(timeouts), str(row["non_finite"]), first]
        body.append([condition_of(row), *_rate(failed, count), *cells])
    return align([[name, "failures", "rate", "95%", "collision", "timeout", "non-finite", "mostly"], *body])


def _by_contact(failures: list[Failure], episodes: int) -> list[str]:
    counts = Counter(
        pair for failure in failures for pair in zip(failure.parts, failure.hits, strict=True)
    ).most_common()
    if not counts:
        return []
    body = [[part, hit, *_rate(count, episodes)] for (part, hit), count in counts]
    note = "rate: of all episodes; where several parts touch at once, each has a count"
    return [*align([["part", "touched", "failures", "rate", "95%"], *body]), note]


def _by_time(failures: list[Failure], durations: list[float]) -> list[str]:
    collisions = [failure.time_s for failure in failures if failure.outcome == "collision"]
    body = []
    for low, high in pairwise(_TIME_BINS_S):
        # An episode of low seconds ended in the bin before.
        running = sum(low < duration for duration in durations)
        inside = sum(low < time <= high for time in collisions)
        if running:
            body.append([_bin(low, high, "s"), *_rate(inside, running), str(running)])
    note = "rate: of the episodes that were still running when the bin began"
    return [*align([["time", "collisions", "rate", "95%", "running"], *body]), note]


def _by_sight(failures: list[Failure]) -> list[str]:
    """What the camera had shown of the obstacle, beside the same for walls."""

    def label(failure: Failure) -> str:
        if failure.unseen_s is None:
            return "never seen"
        if failure.unseen_s == 0.0:
            return "in view"
        return f"seen up to {_RECENT_S:g} s ago" if failure.unseen_s <= _RECENT_S else "seen longer ago"

    labels = ("in view", f"seen up to {_RECENT_S:g} s ago", "seen longer ago", "never seen")
    lines = []
    for what, kinds in (("obstacle", OBSTACLES), ("wall", ("wall",))):
        hit = [failure for failure in failures if failure.hits and failure.hits[0] in kinds]
        counts = Counter(label(failure) for failure in hit)
        if hit:
            body = [[name, *_rate(counts[name], len(hit))] for name in labels]
            lines += align([[what, "collisions", "share", "95%"], *body])
    return [*lines, "at the last observation before the collision"] if lines else []


def _by_motion(failures: list[Failure]) -> list[str]:
    collisions = [failure for failure in failures if failure.outcome == "collision"]
    body = []
    for motion, count in Counter(failure.motion for failure in collisions).most_common():
        those = [failure for failure in collisions if failure.motion == motion]
        speed, turn = (
            np.median(np.abs([getattr(failure, name) for failure in those]))
            for name in ("forward_m_s", "turn_rad_s")
        )
        first = _most((failure.parts[0] for failure in those), len(robot.PARTS))
        body.append([motion, *_rate(count, len(collisions)), f"{speed:.2f} m/s", f"{turn:.2f} rad/s", first])
    header = ["base", "collisions", "share", "95%", "median speed", "and turning", "part that touched first"]
    return align([header, *body]) if body else []


def _by_side(failures: list[Failure]) -> list[str]:
    """Which end of the base touched, and what it did; the wheels' axis is nearer to the front."""
    middle = robot.load_spec().geom("base").pos[0]
    touched = [failure for failure in failures if failure.parts and failure.parts[0] == "base"]
    sides = Counter(
        ("front" if failure.point_b[0] > middle else "rear", failure.motion)
        for failure in touched
        if failure.point_b is not None
    )
    body = [[end, motion, *_rate(count, len(touched))] for (end, motion), count in sides.most_common()]
    return align([["end of the base", "base", "collisions", "share", "95%"], *body]) if body else []


def _by_width(failures: list[Failure]) -> list[str]:
    body = []
    for low, high in pairwise(_WIDTH_BINS_M):
        those = [f for f in failures if low < (math.inf if f.width_m is None else f.width_m) <= high]
        hits = [failure for failure in those if failure.outcome == "collision"]
        how = _most(f"{failure.parts[0]} {failure.motion}" for failure in hits if failure.parts)
        counts = [str(len(hits)), str(sum(failure.outcome == "timeout" for failure in those))]
        if those:
            body.append([_bin(low, high, "m"), *_rate(len(those), len(failures)), *counts, how])
    if not body:
        return []
    note = (
        "free width: from what was hit (else was nearest) across the base's point to what is opposite; "
        f"the base is {_WIDTH_BINS_M[1]:.2f} m wide"
    )
    header = ["free width", "failures", "share", "95%", "collision", "timeout", "part and motion"]
    return [*align([header, *body]), note]


def _by_place(failures: list[Failure]) -> list[str]:
    inside = [failure for failure in failures if failure.place is not None]
    counts = Counter((failure.place, failure.outcome) for failure in inside).most_common()
    body = [[str(place), outcome, *_rate(count, len(inside))] for (place, outcome), count in counts]
    behind = sum(failure.behind_corner for failure in inside)
    moving = sum(failure.moving for failure in inside)
    if not body:
        return []
    note = f"obstacles behind the corner were hit in {behind} failures, obstacles that can move in {moving}"
    return [*align([["place in the paper's corridors", "outcome", "failures", "share", "95%"], *body]), note]


def _timeouts(failures: list[Failure]) -> list[str]:
    """How far those came whose time was up, and what they did at the end."""
    late = [failure for failure in failures if failure.outcome == "timeout"]
    body = []
    for manner, count in Counter(failure.manner for failure in late).most_common():
        those = [failure for failure in late if failure.manner == manner]
        left = np.median([failure.left_m / max(failure.way_m, 1e-3) for failure in those])
        straight, driven, turned = (
            np.median(np.abs([getattr(failure, name) for failure in those]))
            for name in ("to_go_m", "late_m", "late_turn_rad")
        )
        body.append(
            [manner, *_rate(count, len(late)), f"{left:.0%}", f"{straight:.1f} m"]
            + [f"{driven:.1f} m", f"{turned / (2.0 * math.pi):.1f}"]
        )
    if not body:
        return []
    note = f"medians; driven, rounds: in the last {LATE_S:g} s; way left: of the way at the start"
    header = ["timeouts", "count", "share", "95%", "way left", "goal in", "driven", "rounds"]
    return [*align([header, *body]), note]


def _first(result: dict[str, Any]) -> list[str]:
    body = []
    for entry, failure in zip(result["failures"][:_LISTED], failures_of(result), strict=False):
        what = ", ".join(failure.contacts) or f"{failure.outcome}, {failure.to_go_m:.1f} m to go"
        speed = f"{failure.forward_m_s:+.2f} m/s {failure.turn_rad_s:+.2f} rad/s"
        body.append([f"{failure.time_s:.1f} s", what, speed, failure.seen or "-", entry["play"]])
    if not body:
        return []
    header = ["time", "what", "base", "seen", f"spin-play policy={result['policy']} ..."]
    more = len(result["failures"]) - len(body)
    return [*align([header, *body]), *([f"and {more} more"] if more else [])]


def _bin(low: float, high: float, unit: str) -> str:
    return f"{low:.2g} to {high:.2g} {unit}" if high < math.inf else f"over {low:.2g} {unit}"


def _most(things: Any, count: int = _MOST) -> str:
    """The most frequent of some things with their numbers."""
    return ", ".join(f"{thing} {n}" for thing, n in Counter(things).most_common(count))


def _rate(count: int, total: int) -> list[str]:
    low, high = wilson_interval(count, total)
    return [str(count), f"{count / total:.1%}", f"{low:.1%} to {high:.1%}"]
