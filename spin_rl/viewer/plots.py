"""Plots of an episode: where the camera looks and how high the arm is, against what is near.

They show what the paper describes in Figures "cam_behavior" (the camera tilts down in tight clutter and looks
ahead where nothing is near) and "whole_body_coord" (the arm is lifted over obstacles).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spin_rl.extras import require
from spin_rl.scenes import kinds
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.outline import distance_to, outline
from spin_rl.viewer import style
from spin_rl.viewer.snapshot import Snapshot

_FAR_M = 2.0
GROUPS = {"low": ("low",), "arm or head height": ("arm", "head", "tall")}
"""Obstacles that the arm must rise above, and those that it must avoid."""


@dataclass(frozen=True)
class Trace:
    """One episode over time; arrays of shape (n,).

    Attributes:
        time: [s].
        pan: Of the camera [rad].
        tilt: Of the camera [rad]; negative looks down.
        lift: Height of the arm above its lowest position [m].
        extension: Of the arm [m].
        distance: For every group of `GROUPS`, distance from the base's origin to the nearest obstacle's
            footprint [m]; infinite where the scene has none.
        stages: Where the task has stages, the time [s] at which each began, and its name.
    """

    time: np.ndarray
    pan: np.ndarray
    tilt: np.ndarray
    lift: np.ndarray
    extension: np.ndarray
    distance: dict[str, np.ndarray]
    stages: list[tuple[float, str]]


def trace_of(snapshots: Sequence[Snapshot]) -> Trace:
    """Measure one episode."""

    def joint(name: str) -> np.ndarray:
        return np.array([snapshot.joint(name) for snapshot in snapshots])

    return Trace(
        time=np.array([snapshot.time for snapshot in snapshots]),
        pan=joint("head_pan"),
        tilt=joint("head_tilt"),
        lift=joint("lift"),
        extension=joint("arm_outer") + joint("arm_inner"),
        distance={
            name: np.concatenate([nearest(s.scene, s.qpos[None, :2], levels) for s in snapshots])
            for name, levels in GROUPS.items()
        },
        stages=[
            (now.time, now.stage)
            for before, now in zip([None, *snapshots], snapshots, strict=False)
            if now.stage is not None and (before is None or before.stage != now.stage)
        ],
    )


def nearest(scene: Scene, points: np.ndarray, levels: Sequence[str]) -> np.ndarray:
    """Distance to the nearest obstacle of some levels, walls left out.

    Args:
        scene: The scene.
        points: Positions [m], shape (n, 2).
        levels: Names of `scenes.kinds.LEVELS`.

    Returns:
        Distances to the footprints [m], 0 inside, infinite where there is no such obstacle, shape (n,).
    """
    result = np.full(len(points), np.inf)
    for slot, level in enumerate(kinds.levels(scene)):
        if scene.active[slot] and not scene.is_wall[slot] and level in levels:
            result = np.minimum(result, distance_to(outline(scene, slot), points))
    return result


def check_plots() -> None:
    """Find out before the episodes whether they can be plotted.

    Raises:
        ConfigError: Matplotlib is missing.
    """
    require("matplotlib", "matplotlib", "plots", "plots")


def write_plots(folder: Path, episodes: Sequence[Sequence[Snapshot]], title: str) -> list[Path]:
    """Write one figure per episode and return the files.

    Args:
        folder: Made if needed.
        episodes: Snapshots of each.
        title: What played.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for i, snapshots in enumerate(episodes):
        path = folder / f"episode_{i + 1:03d}.png"
        figure = plot_episode(trace_of(snapshots), f"{title}, episode {i + 1}: {snapshots[-1].cause}")
        figure.savefig(path, dpi=110)
        paths.append(path)
    return paths


def plot_episode(trace: Trace, title: str) -> Any:
    """Draw one episode: over time on the left, against the distance to the nearest obstacle on the right."""
    matplotlib_figure = require("matplotlib.figure", "matplotlib", "plots", "plots")
    figure = matplotlib_figure.Figure(figsize=(10, 6.6), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(3, 2, sharex="col", width_ratios=(3, 2))
    colours = {
        name: _mpl(colour)
        for name, colour in zip(GROUPS, (style.LEVEL["low"], style.LEVEL["head"]), strict=True)
    }
    for name, distance in trace.distance.items():
        axes[0, 0].plot(trace.time, np.minimum(distance, _FAR_M), color=colours[name], label=name)
    axes[0, 0].set_ylabel(f"nearest obstacle [m]\n(up to {_FAR_M:.0f})")
    axes[0, 0].legend(fontsize=8)
    tilt_colour, pan_colour, arm_colour = "#c0392b", "#7f8c8d", "#16697a"
    angles = {"tilt": (np.degrees(trace.tilt), tilt_colour), "pan": (np.degrees(trace.pan), pan_colour)}
    for name, (values, colour) in angles.items():
        axes[1, 0].plot(trace.time, values, color=colour, label=f"camera {name}")
    axes[1, 0].set_ylabel("camera [degrees]\nnegative tilt looks down")
    axes[1, 0].legend(fontsize=8)
    axes[2, 0].plot(trace.time, trace.lift, color=arm_colour, label="lift")
    axes[2, 0].plot(trace.time, trace.extension, color=arm_colour, linestyle=":", label="extension")
    axes[2, 0].set_ylabel("arm [m]")
    axes[2, 0].legend(fontsize=8)
    axes[2, 0].set_xlabel("time [s]")
    any_distance = np.minimum.reduce(list(trace.distance.values()))
    near = any_distance <= _FAR_M
    axes[0, 1].scatter(any_distance[near], np.degrees(trace.tilt[near]), s=9, color=tilt_colour)
    axes[0, 1].set_ylabel("camera tilt [degrees]")
    axes[1, 1].scatter(any_distance[near], np.degrees(trace.pan[near]), s=9, color=pan_colour)
    axes[1, 1].set_ylabel("camera pan [degrees]")
    for name, distance in trace.distance.items():
        near = distance <= _FAR_M
        axes[2, 1].scatter(distance[near], trace.lift[near], s=9, color=colours[name], label=name)
    axes[2, 1].set_ylabel("lift [m]")
    axes[2, 1].legend(fontsize=8)
    axes[2, 1].set_xlabel("distance of the nearest obstacle [m]")
    for ax in axes.flat:
        ax.grid(alpha=0.25)
    _mark_stages(axes[:, 0], trace.stages)
    return figure


def _mark_stages(axes: Sequence[Any], stages: Sequence[tuple[float, str]]) -> None:
    """Draw a line over time axes where a stage begins, and its name over the first of them."""
    for begin, name in stages:
        for ax in axes:
            ax.axvline(begin, color="0.5", linewidth=0.8)
        # Short stages are side by side: names that lean do not meet.
        over = axes[0].get_xaxis_transform()
        axes[0].annotate(name, (begin, 1.0), (0, 2), over, "offset points", rotation=35)


def _mpl(colour: style.Rgb) -> tuple[float, ...]:
    return tuple(c / 255 for c in colour)
