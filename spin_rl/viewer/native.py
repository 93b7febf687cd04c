"""A window of MuJoCo's own viewer, where there is a display."""

from __future__ import annotations

import os
import sys
import time

import mujoco
import numpy as np

from spin_rl.config import ConfigError
from spin_rl.scenes.builder import native_model
from spin_rl.viewer import style
from spin_rl.viewer.rollout import Player
from spin_rl.viewer.snapshot import Snapshot
from spin_rl.viewer.video import play

_DOT_RADIUS_M = 0.025


def check_native() -> None:
    """Find out whether a window can be opened.

    Raises:
        ConfigError: There is no display.
    """
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ConfigError("viewer: native needs a display; use viewer=viser, or video=<file.mp4>")


def show(player: Player) -> None:
    """Play episodes in real time, each in a window of its own, until one is closed.

    Args:
        player: At the start of an episode.
    """
    import mujoco.viewer  # opens a connection to the display when imported on some systems

    period = player.env.cfg.sim.control_period
    while True:
        first = player.snapshots[0]
        model = native_model(first.scene, obj=None if first.target is None else first.target.what)
        data = mujoco.MjData(model)
        with mujoco.viewer.launch_passive(model, data) as window:
            for snapshot in next(play(player, 1)):
                due = time.monotonic() + period
                pose(model, data, snapshot)
                with window.lock():
                    if window.user_scn is not None:  # the window has been closed
                        draw_scandots(window.user_scn, snapshot)
                window.sync()
                if not window.is_running():
                    return
                time.sleep(max(0.0, due - time.monotonic()))
        print(f"  {snapshot.cause} after {snapshot.time:.1f} s", flush=True)


def pose(model: mujoco.MjModel, data: mujoco.MjData, snapshot: Snapshot) -> None:
    """Put robot, object, and obstacles that move, where they are in a snapshot of the model's scene."""
    data.qpos[:] = snapshot.qpos if snapshot.target is None else [*snapshot.qpos, *snapshot.target.pose]
    mujoco.mj_forward(model, data)
    scene = snapshot.scene
    names = scene.pool.geom_names()
    for slot in np.flatnonzero(scene.active & (scene.motion_speed > 0.0)):
        data.geom(names[slot]).xpos[:] = scene.pos[slot]


def draw_scandots(scene: mujoco.MjvScene, snapshot: Snapshot) -> None:
    """Replace a scene's added geoms with a sphere per scandot or object, and a disc at the goal if any."""
    dots = snapshot.marks
    colours = style.scandot_colours(dots.seen) / 255
    marks = [(point, colour, _DOT_RADIUS_M) for point, colour in zip(dots.points, colours, strict=True)]
    if snapshot.scandots is not None:
        marks.append((np.array([*snapshot.scene.goal, 0.0]), np.array(style.GOAL) / 255, 0.15))
    scene.ngeom = 0
    for point, colour, radius in marks[: scene.maxgeom]:
        mujoco.mjv_initGeom(
            scene.geoms[scene.ngeom],
            mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            np.array([radius, radius, min(radius, _DOT_RADIUS_M)]),
            point.astype(float),
            np.eye(3).ravel(),
            np.array([*colour, 1.0], dtype=np.float32),
        )
        scene.ngeom += 1
