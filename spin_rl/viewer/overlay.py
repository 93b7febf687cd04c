"""Drawing over a rendered picture: what the depth camera covers, and which scandots the policy gets."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from PIL import Image, ImageDraw

from spin_rl.viewer import style
from spin_rl.viewer.camera import PinholeCamera
from spin_rl.viewer.snapshot import Scandots
from spin_rl.viewer.stage import DepthCamera

FRUSTUM_LENGTH_M = 1.0
FRUSTUM_SIDES = np.array([(0, 1 + i, 1 + (i + 1) % 4) for i in range(4)])
"""Triangles of apex and corners; from wherever one looks, they cover all of the pyramid."""
_SCALE = 2  # drawn larger and shrunk: Pillow's lines have no smooth edges


class Canvas:
    """A transparent layer with smooth edges, in the coordinates of the picture below it."""

    def __init__(self, width: int, height: int) -> None:
        """Start empty, in pixels of the picture."""
        self._size = (width, height)
        self._image = Image.new("RGBA", (width * _SCALE, height * _SCALE), (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._image)

    def polygon(self, points: np.ndarray, colour: style.Rgb, alpha: int = 255) -> None:
        """Fill a polygon with corners of shape (n, 2); overlapping ones add up."""
        if alpha == 255:
            self._draw.polygon([tuple(p) for p in points * _SCALE], fill=(*colour, alpha))
            return
        self.polygons([points], colour, alpha)

    def polygons(self, shapes: Iterable[np.ndarray], colour: style.Rgb, alpha: int) -> None:
        """Fill what polygons cover together, each with corners of shape (n, 2)."""
        layer = Image.new("RGBA", self._image.size, (0, 0, 0, 0))
        draw = ImageDraw.Draw(layer)
        for points in shapes:
            draw.polygon([tuple(p) for p in points * _SCALE], fill=(*colour, alpha))
        self._image.alpha_composite(layer)

    def line(self, points: np.ndarray, colour: style.Rgb, width: float = 1.5, alpha: int = 255) -> None:
        """Draw a path through points of shape (n, 2)."""
        path = [tuple(p) for p in points * _SCALE]
        self._draw.line(path, fill=(*colour, alpha), width=round(width * _SCALE), joint="curve")

    def dot(
        self,
        point: np.ndarray,
        radius: float,
        colour: style.Rgb,
        rim: style.Rgb | None = None,
        alpha: int = 255,
    ) -> None:
        """Draw a disc, with a rim of another colour or none."""
        (x, y), r = point * _SCALE, radius * _SCALE
        outline = None if rim is None else (*rim, alpha)
        box = (x - r, y - r, x + r, y + r)
        self._draw.ellipse(box, fill=(*colour, alpha), outline=outline, width=_SCALE)

    def on(self, picture: Image.Image) -> Image.Image:
        """Return the picture with this layer over it."""
        layer = self._image.resize(self._size, Image.Resampling.BOX)
        return Image.alpha_composite(picture.convert("RGBA"), layer).convert("RGB")


def draw_overlays(
    picture: np.ndarray, view: PinholeCamera, depth_camera: DepthCamera, scandots: Scandots
) -> Image.Image:
    """Draw the depth camera's frustum and the scandots over a picture; nothing hides them.

    Args:
        picture: Shape (height, width, 3), uint8.
        view: The camera that took it.
        depth_camera: The robot's.
        scandots: Those of the same time.
    """
    canvas = Canvas(view.width, view.height)
    _draw_frustum(canvas, view, depth_camera.frustum(FRUSTUM_LENGTH_M))
    pixels, _ = view.project(scandots.points)
    drawn = np.isfinite(pixels).all(-1)
    margin = 8
    drawn &= (pixels > -margin).all(-1) & (pixels < (view.width + margin, view.height + margin)).all(-1)
    for seen in (False, True):  # what is seen comes on top
        for point in pixels[drawn & (scandots.seen == seen)]:
            if seen:
                canvas.dot(point, 3.6, style.SEEN, rim=(255, 255, 255))
            else:
                canvas.dot(point, 2.2, style.UNSEEN, alpha=170)
    return canvas.on(Image.fromarray(picture))


def _draw_frustum(canvas: Canvas, view: PinholeCamera, frustum: np.ndarray) -> None:
    apex, corners = frustum[0], frustum[1:]
    pixels, depth = view.project(frustum)
    if (depth > 0.0).all():
        for side in FRUSTUM_SIDES:
            canvas.polygon(pixels[side], style.FRUSTUM, alpha=22)
    for i in range(4):
        for start, end in ((apex, corners[i]), (corners[i], corners[(i + 1) % 4])):
            segment = view.project_segment(start, end)
            if segment is not None:
                canvas.line(segment, style.FRUSTUM, width=1.4, alpha=230)
