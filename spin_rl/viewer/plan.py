"""The scene from above, as a plan: walls, obstacles by height, the robot's path, and what it sees."""

from __future__ import annotations

import numpy as np
from PIL import Image

from spin_rl.scenes.layout import Scene
from spin_rl.scenes.outline import UNIT_CIRCLE, outline
from spin_rl.viewer import style
from spin_rl.viewer.overlay import FRUSTUM_LENGTH_M, FRUSTUM_SIDES, Canvas
from spin_rl.viewer.snapshot import Snapshot
from spin_rl.viewer.stage import Stage

_MARGIN_M = 0.35
_NEAR_M = 0.8
_GOAL_RADIUS_M = 0.15


class Plan:
    """Draws the plan of one scene."""

    def __init__(self, scene: Scene, width: int, height: int, *, whole: bool = True) -> None:
        """Choose the scale that shows start and goal, and all of the walls or what is near.

        Args:
            scene: The scene.
            width: Columns of the picture.
            height: Rows.
            whole: Whether to show all of the walls.
        """
        self._scene = scene
        self._size = (width, height)
        self._slots = [
            (slot, colour) for slot, colour in enumerate(style.slot_colours(scene)) if scene.active[slot]
        ]
        walls = [outline(scene, slot) for slot, _ in self._slots if whole and scene.is_wall[slot]]
        points = np.concatenate([*walls, scene.start[None, :2], scene.goal[None]])
        margin = _MARGIN_M if whole else _NEAR_M
        low, high = points.min(0) - margin, points.max(0) + margin
        self._scale = float(min(np.array(self._size) / (high - low)))
        self._centre = 0.5 * (low + high)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixels (column, row) of world positions [m], shape (n, 2 or more) -> (n, 2); y points up."""
        return (points[:, :2] - self._centre) * (self._scale, -self._scale) + np.array(self._size) / 2

    def draw(self, stage: Stage, snapshot: Snapshot, path: np.ndarray) -> Image.Image:
        """Draw one time.

        Args:
            stage: At the snapshot's pose.
            snapshot: What to draw.
            path: Positions of the base so far [m], shape (n, 2).
        """
        canvas = Canvas(*self._size)
        scale = self._scale
        if snapshot.stage is not None:  # a start to come back to
            ring = self._scene.start[:2] + _GOAL_RADIUS_M * np.concatenate((UNIT_CIRCLE, UNIT_CIRCLE[:1]))
            canvas.line(self.pixels(ring), style.GOAL)
        if snapshot.scandots is not None:  # a goal to drive to
            canvas.polygon(self.pixels(snapshot.scene.goal + _GOAL_RADIUS_M * UNIT_CIRCLE), style.GOAL)
        for slot, colour in self._slots:
            shape = outline(snapshot.scene, slot)  # where it is now
            canvas.polygon(self.pixels(shape), colour, alpha=255 if self._scene.is_wall[slot] else 210)
        frustum = stage.depth_camera().frustum(FRUSTUM_LENGTH_M)
        canvas.polygons(self.pixels(frustum)[FRUSTUM_SIDES], style.FRUSTUM, alpha=110)
        if len(path) > 1:
            canvas.line(self.pixels(path), style.ROBOT, width=1.0, alpha=150)
        self._draw_robot(canvas, stage)
        dots = snapshot.marks
        for point, seen in zip(self.pixels(dots.points), dots.seen, strict=True):
            if seen:
                canvas.dot(point, max(1.8, 0.03 * scale), style.SEEN)
            else:
                canvas.dot(point, max(1.2, 0.02 * scale), style.UNSEEN)
        return canvas.on(Image.new("RGB", self._size, (255, 255, 255)))

    def _draw_robot(self, canvas: Canvas, stage: Stage) -> None:
        geom = stage.data.geom("base")
        half = stage.model.geom("base").size
        corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * half
        canvas.polygon(self.pixels(geom.xpos + corners @ geom.xmat.reshape(3, 3).T), style.ROBOT)
        arm = [stage.data.body(name).xpos for name in ("lift", "arm_inner", "wrist_yaw")]
        arm.append(stage.data.site("link_grasp_center").xpos)
        canvas.line(self.pixels(np.array(arm)), (120, 124, 132), width=max(1.5, 0.05 * self._scale))
