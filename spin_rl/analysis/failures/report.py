"""The failure analysis for people: tables, and the robots' poses from above."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.analysis.failures.analysis import failures_of
from spin_rl.analysis.failures.watch import HITS, Failure, scene_of
from spin_rl.benchmark.metrics import wilson_interval
from spin_rl.benchmark.tables import reach as report
from spin_rl.sim.model import geom_parts
from spin_rl.viewer import style

_TIME_BINS_S = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, math.inf)
_RECENT_S = 1.0
_LISTED = 12
_PLOTTED = 12
_VIEW_M = 1.2


def table(result: dict[str, Any]) -> str:
    """Format a result of `failures.analyse_failures` for the terminal."""
    failures = failures_of(result)
    episodes = sum(row["episodes"] for row in result["rows"])
    seeds = ", ".join(str(seed) for seed in result["seeds"])
    title = (
        f"Failures: {result['policy']}, {result['rows'][0]['episodes']} episodes per cell (seeds {seeds}), "
        f"robot {result['robot']}, camera {result['camera_mount']}{report.conditions_note(result)}"
    )
    blocks = [[title], _by_cell(result), _by_contact(failures, episodes)]
    blocks += [_by_time(failures, result["durations_s"]), _by_sight(failures), _by_motion(failures)]
    blocks += [_by_side(failures), _by_place(failures), _first(result)]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    episodes, failures = sum(row["episodes"] for row in result["rows"]), failures_of(result)
    outcomes = Counter(failure.outcome for failure in failures)
    parts = Counter(failure.parts[0] for failure in failures if failure.parts)
    text = f"{len(failures)} of {episodes} episodes failed"
    text += "".join(f", {count} by {outcome}" for outcome, count in outcomes.most_common())
    return text + "".join(f", {part} first in {count}" for part, count in parts.most_common(1))


def _by_cell(result: dict[str, Any]) -> list[str]:
    body = []
    for row in result["rows"]:
        count = row["episodes"]
        collisions, timeouts = (round(row[f"{name}_rate"] * count) for name in ("collision", "timeout"))
        failed = round((1.0 - row["success_rate"]) * count)
        name = f"{row['scenario']} {row['difficulty']}"
        body.append([name, *_rate(failed, count), str(collisions), str(timeouts), str(row["non_finite"])])
    return report.align([["cell", "failures", "rate", "95%", "collision", "timeout", "non-finite"], *body])


def _by_contact(failures: list[Failure], episodes: int) -> list[str]:
    counts = Counter(
        pair for failure in failures for pair in zip(failure.parts, failure.hits, strict=True)
    ).most_common()
    if not counts:
        return []
    body = [[part, hit, *_rate(count, episodes)] for (part, hit), count in counts]
    note = "rate: of all episodes; where several parts touch at once, each has a count"
    return [*report.align([["part", "touched", "failures", "rate", "95%"], *body]), note]


def _by_time(failures: list[Failure], durations: list[float]) -> list[str]:
    collisions = [failure.time_s for failure in failures if failure.outcome == "collision"]
    body = []
    for low, high in pairwise(_TIME_BINS_S):
        # An episode of low seconds ended in the bin before.
        running = sum(low < duration for duration in durations)
        inside = sum(low < time <= high for time in collisions)
        if running:
            label = f"{low:g} to {high:g} s" if high < math.inf else f"over {low:g} s"
            body.append([label, *_rate(inside, running), str(running)])
    note = "rate: of the episodes that were still running when the bin began"
    return [*report.align([["time", "collisions", "rate", "95%", "running"], *body]), note]


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
    for title, kinds in (("obstacle", tuple(HITS.values())), ("wall", ("wall",))):
        hit = [failure for failure in failures if failure.hits and failure.hits[0] in kinds]
        counts = Counter(label(failure) for failure in hit)
        if hit:
            body = [[name, *_rate(counts[name], len(hit))] for name in labels]
            lines += report.align([[title, "collisions", "share", "95%"], *body])
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
        parts = Counter(failure.parts[0] for failure in those).most_common()
        body.append(
            [motion, *_rate(count, len(collisions)), f"{speed:.2f} m/s", f"{turn:.2f} rad/s"]
            + [", ".join(f"{part} {n}" for part, n in parts)]
        )
    header = ["base", "collisions", "share", "95%", "median speed", "and turning", "part that touched first"]
    return report.align([header, *body]) if body else []


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
    return report.align([["end of the base", "base", "collisions", "share", "95%"], *body]) if body else []


def _by_place(failures: list[Failure]) -> list[str]:
    counts = Counter((failure.place, failure.outcome) for failure in failures).most_common()
    body = [[place, outcome, *_rate(count, len(failures))] for (place, outcome), count in counts]
    behind = sum(failure.behind_corner for failure in failures)
    moving = sum(failure.moving for failure in failures)
    if not body:
        return []
    note = f"obstacles behind the corner were hit in {behind} failures, obstacles that can move in {moving}"
    return [*report.align([["where the base was", "outcome", "failures", "share", "95%"], *body]), note]


def _first(result: dict[str, Any]) -> list[str]:
    body = []
    for entry, failure in zip(result["failures"][:_LISTED], failures_of(result), strict=False):
        what = ", ".join(f"{part} on {hit}" for part, hit in zip(failure.parts, failure.hits, strict=True))
        what = what or f"{failure.outcome}, {failure.to_go_m:.1f} m to go"
        speed = f"{failure.forward_m_s:+.2f} m/s {failure.turn_rad_s:+.2f} rad/s"
        body.append([f"{failure.time_s:.1f} s", what, speed, failure.seen or "-", entry["play"]])
    if not body:
        return []
    header = ["time", "what", "base", "seen", f"spin-play policy={result['policy']} ..."]
    more = len(result["failures"]) - len(body)
    return [*report.align([header, *body]), *([f"and {more} more"] if more else [])]


def _rate(count: int, total: int) -> list[str]:
    low, high = wilson_interval(count, total)
    return [str(count), f"{count / total:.1%}", f"{low:.1%} to {high:.1%}"]


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw the first failures from above at their last observation, with the robot's collision shape.

    Args:
        result: Of `failures.analyse_failures`.
        path: Image file to write; its folder is made.
    """
    from matplotlib.figure import Figure

    failures = failures_of(result)[:_PLOTTED]
    columns = min(4, max(len(failures), 1))
    rows = max(math.ceil(len(failures) / columns), 1)
    figure = Figure(figsize=(3.2 * columns, 3.6 * rows), layout="constrained")
    figure.suptitle(f"{result['policy']}: {len(failures)} of {len(result['failures'])} failures", fontsize=9)
    model = robot.load_spec().compile()
    for i, failure in enumerate(failures):
        _draw(figure.add_subplot(rows, columns, i + 1), failure, model)
    figure.legend(handles=_legend(), loc="outside lower center", ncols=4, fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    levels = {"low": "low obstacle", "arm": "at arm height", "head": "at head height", "tall": "tall"}
    return [
        *(Patch(color=np.array(style.LEVEL[level]) / 255, label=label) for level, label in levels.items()),
        Patch(facecolor="none", edgecolor="red", label="what was hit"),
        Line2D([], [], color="red", label="part that hit it"),
        Line2D([], [], color="black", label="robot"),
        Line2D([], [], color="g", marker="*", linestyle="none", label="goal"),
    ]


def _draw(axes: Any, failure: Failure, model: mujoco.MjModel) -> None:
    from spin_rl.viewer.plan import footprint

    scene = scene_of(failure)
    for slot, colour in enumerate(style.slot_colours(scene)):
        if scene.active[slot]:
            edge = "red" if slot == failure.slot else "none"
            axes.fill(*footprint(scene, slot).T, facecolor=np.array(colour) / 255, edgecolor=edge, alpha=0.8)
    data = mujoco.MjData(model)
    data.qpos[:] = failure.qpos
    mujoco.mj_kinematics(model, data)
    for geom, part in enumerate(geom_parts(model)):
        if part >= 0:
            color = "red" if robot.PARTS[part] in failure.parts else "black"
            axes.plot(*_outline(model, data, geom).T, color=color, linewidth=0.8)
    x, y = failure.qpos[:2]
    axes.plot(*failure.goal, "g*")
    axes.set(xlim=(x - _VIEW_M, x + _VIEW_M), ylim=(y - _VIEW_M, y + _VIEW_M), aspect="equal")
    axes.tick_params(labelsize=6)
    axes.set_xlabel("x [m]", fontsize=6)
    axes.set_ylabel("y [m]", fontsize=6)
    what = ", ".join(f"{part} on {hit}" for part, hit in zip(failure.parts, failure.hits, strict=True))
    cell = f"{failure.scenario} {failure.difficulty} seed {failure.seed} world {failure.world}"
    axes.set_title(f"{what or failure.outcome}, {failure.time_s:.1f} s\n{cell}", fontsize=7)


def _outline(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """Outline of a collision geom of the robot from above [m], closed, shape (n, 2)."""
    size, frame = model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3)
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        local = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)]) * size
        return data.geom_xpos[geom, :2] + (local @ frame.T)[:, :2]
    # A capsule from above: a half circle around either end of its axis.
    axis = frame[:2, 2] * size[1]
    turns = np.arctan2(axis[1], axis[0]) + np.linspace(-0.5 * np.pi, 1.5 * np.pi, 25)
    ends = np.where(np.arange(25)[:, None] <= 12, axis, -axis)
    outline = ends + size[0] * np.stack([np.cos(turns), np.sin(turns)], -1)
    return data.geom_xpos[geom, :2] + np.vstack([outline, outline[:1]])
