"""One picture of a video: the scene, the plan, the depth image, and a strip of figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from spin_rl.viewer import style
from spin_rl.viewer.camera import DRIVE_VIEW, GRASP_VIEW, TABLE_VIEW, FollowCamera, View
from spin_rl.viewer.labels import cell_label, progress_label
from spin_rl.viewer.overlay import draw_overlays
from spin_rl.viewer.plan import Plan
from spin_rl.viewer.renderer import Renderer
from spin_rl.viewer.snapshot import Snapshot
from spin_rl.viewer.stage import Stage

SIZE = (720, 448)
"""Columns and rows of a picture."""

_VIEW = (480, 384)
_SIDE = SIZE[0] - _VIEW[0]
_PLAN = (_SIDE, 224)
_DEPTH_HEIGHT = _VIEW[1] - _PLAN[1] - 24
_DEPTH_RANGE_M = 4.0
_LEVEL_LABELS = {
    "low": "low obstacle",
    "arm": "at arm height",
    "head": "at head height",
    "tall": "tall",
}


class PictureMaker:
    """Turns the snapshots of one world, in their order, into pictures."""

    def __init__(self, stage: Stage, title: str, control_period: float, samples: int = 2) -> None:
        """Allocate the renderer.

        Args:
            stage: Stage of the snapshots' pool.
            title: What plays, such as the policy's name.
            control_period: Time between snapshots [s].
            samples: Rays per pixel along each axis.
        """
        self._stage = stage
        self._title = title
        self._period = control_period
        self._renderer = Renderer(stage, *_VIEW, samples)
        self._follow = FollowCamera()
        self._plan: Plan | None = None
        self._path: list[np.ndarray] = []
        self._episode: int | None = None

    def draw(self, snapshot: Snapshot) -> Image.Image:
        """Return the picture of a snapshot, of `SIZE`."""
        stage = self._stage
        if snapshot.episode != self._episode or self._plan is None:
            self._episode = snapshot.episode
            self._plan = Plan(snapshot.scene, *_PLAN, whole=snapshot.scandots is not None)
            self._path = []
            self._follow = FollowCamera()
        self._path.append(snapshot.qpos[:2])
        stage.pose(snapshot)
        stage.place_view(*self._follow.place(*_view(snapshot), self._period))
        view = draw_overlays(
            self._renderer.render(), self._renderer.camera(), stage.depth_camera(), snapshot.marks
        )
        picture = Image.new("RGB", SIZE, style.PAPER)
        picture.paste(view, (0, 0))
        picture.paste(self._plan.draw(stage, snapshot, np.array(self._path)), (_VIEW[0], 0))
        depth = camera_picture(stage, snapshot, _DEPTH_HEIGHT)
        picture.paste(depth, (_VIEW[0] + 10, _PLAN[1] + 18))
        draw = ImageDraw.Draw(picture)
        if snapshot.stage is not None:
            _draw_stages(draw, snapshot.stages, snapshot.stage)
        draw.text((_VIEW[0] + 10, _PLAN[1] + 2), camera_label(snapshot), fill=style.INK, font=_font(12))
        _draw_legend(draw, (_VIEW[0] + depth.width + 18, _PLAN[1] + 18), snapshot)
        self._draw_strip(draw, snapshot)
        return picture

    def _draw_strip(self, draw: ImageDraw.ImageDraw, snapshot: Snapshot) -> None:
        top = _VIEW[1]
        draw.text((10, top + 4), self._title, fill=style.INK, font=_font(15))
        draw.text((10, top + 25), cell_label(snapshot), fill=style.UNSEEN, font=_font(13))
        episode = f"episode {snapshot.episode + 1}"
        draw.text((10, top + 43), episode, fill=style.UNSEEN, font=_font(13))
        draw.text((204, top + 8), f"{snapshot.time:4.1f} s", fill=style.INK, font=_font(20))
        outcome = snapshot.outcome.replace("_", "-")
        draw.text((278, top + 8), outcome, fill=style.OUTCOME[snapshot.outcome], font=_font(20))
        draw.text((204, top + 36), progress_label(snapshot), fill=style.UNSEEN, font=_font(13))
        model = self._stage.model
        for row, joint in enumerate(("head_pan", "head_tilt", "lift")):
            low, high = model.joint(joint).range
            value = snapshot.joint(joint)
            y = top + 5 + 19 * row
            text = f"{value:.2f} m" if joint == "lift" else f"{np.degrees(value):.0f}°"
            label = {"head_pan": "camera pan", "head_tilt": "camera tilt", "lift": "arm lift"}[joint]
            draw.text((418, y), label, fill=style.INK, font=_font(13))
            draw.text((706, y), text, fill=style.INK, font=_font(13), anchor="ra")
            left, right = 492, 654
            draw.rounded_rectangle((left, y + 4, right, y + 11), 3, fill=(222, 226, 230))
            zero = left + (right - left) * (max(low, 0.0) - low) / (high - low)
            x = left + (right - left) * (value - low) / (high - low)
            draw.rectangle((min(zero, x), y + 4, max(zero, x), y + 11), fill=style.FRUSTUM)
            draw.line((zero, y + 2, zero, y + 13), fill=style.UNSEEN)


def _view(snapshot: Snapshot) -> tuple[np.ndarray, View]:
    """From where the robot is shown well in what it does, as `FollowCamera.place` takes it."""
    views = {None: GRASP_VIEW, "align": TABLE_VIEW, "pick": GRASP_VIEW, "retract": TABLE_VIEW}
    if snapshot.target is None or snapshot.stage not in views:
        return snapshot.qpos[:3], DRIVE_VIEW
    # Whichever way the robot turns, the object's place is to the right.
    x, y = snapshot.target.what.start_pose[:2] - snapshot.qpos[:2]
    return np.array([*snapshot.qpos[:2], np.arctan2(y, x) + 0.5 * np.pi]), views[snapshot.stage]


def _draw_stages(draw: ImageDraw.ImageDraw, stages: Sequence[str], present: str) -> None:
    """Name all stages along the top of the view, the present one in a box."""
    draw.rectangle((0, 0, _VIEW[0] - 1, 29), fill=style.PAPER)
    width = _VIEW[0] / len(stages)
    for i, stage in enumerate(stages):
        middle = (i + 0.5) * width, 15
        if stage == present:
            box = (i * width + 8, 4, (i + 1) * width - 8, 26)
            draw.rounded_rectangle(box, 5, fill=style.INK)
        draw.text(
            middle,
            stage,
            fill=style.PAPER if stage == present else style.UNSEEN,
            font=_font(15),
            anchor="mm",
        )


def camera_picture(stage: Stage, snapshot: Snapshot, height: int) -> Image.Image:
    """The depth image: the policy's own, pixel by pixel, or else an ideal one of the scene.

    Args:
        stage: Posed as in the snapshot.
        snapshot: What to show.
        height: Rows of the picture.
    """
    if snapshot.depth is None:
        return depth_picture(stage.depth_image(height))
    rows, columns = snapshot.depth.shape
    size = (round(height * columns / rows), height)
    return depth_picture(snapshot.depth).resize(size, Image.Resampling.NEAREST)


def camera_label(snapshot: Snapshot) -> str:
    """What `camera_picture` shows."""
    return "depth camera" if snapshot.depth is None else "depth, as the policy gets it"


def depth_picture(depth: np.ndarray) -> Image.Image:
    """A depth image [m], near bright, far and nothing dark."""
    share = np.clip(1.0 - depth / _DEPTH_RANGE_M, 0.0, 1.0)
    anchors = np.array([(16, 12, 48), (94, 24, 110), (200, 60, 84), (250, 150, 60), (252, 244, 190)])
    places = np.linspace(0, 1, len(anchors))
    channels = [np.interp(share, places, anchors[:, i]) for i in range(3)]
    return Image.fromarray(np.stack(channels, -1).astype(np.uint8))


def _draw_legend(draw: ImageDraw.ImageDraw, corner: tuple[int, int], snapshot: Snapshot) -> None:
    x, y = corner
    corners = "" if snapshot.scandots is None else "corner"
    objects = "" if snapshot.target is None else "object"
    point = "/".join(filter(None, (corners, objects)))
    rows = [(f"seen {point}", style.SEEN, True), (f"unseen {point}", style.UNSEEN, True)]
    rows += [("camera's view", style.FRUSTUM, False)]
    if snapshot.scandots is not None:  # obstacles on the way
        rows += [(_LEVEL_LABELS[level], style.LEVEL[level], False) for level in _LEVEL_LABELS]
    for i, (label, colour, dot) in enumerate(rows):
        middle = y + 8 + 19 * i
        if dot:
            draw.ellipse((x + 1, middle - 4, x + 9, middle + 4), fill=colour)
        else:
            draw.rectangle((x, middle - 5, x + 10, middle + 5), fill=colour)
        draw.text((x + 17, middle), label, fill=style.INK, font=_font(12), anchor="lm")


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
