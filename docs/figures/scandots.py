"""Draw docs/figures/scandots.png: the obstacle corners that the robot knows, from above and in the image.

Run from the repository root: ``python docs/figures/scandots.py``.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle

from spin_rl.robot import camera_tan_half_fov
from spin_rl.sensors.scandots import Scandots

WINDOW_M = 2.0
CAMERA_POS = np.array([0.03, 0.0, 1.3])
CAMERA_TILT = -0.6
# kind, centre, yaw, half size (m, rad), in the base frame: a corridor that ends, with clutter.
SLOTS = [
    ("wall", (2.0, 1.05, 0.6), 0.0, (4.0, 0.05, 0.6)),
    ("wall", (2.0, -0.95, 0.6), 0.0, (4.0, 0.05, 0.6)),
    ("wall", (3.0, 0.0, 0.6), np.pi / 2, (1.0, 0.05, 0.6)),
    ("box", (1.15, 0.15, 0.28), 0.4, (0.16, 0.12, 0.28)),
    ("box", (1.72, 0.30, 0.12), 0.1, (0.12, 0.15, 0.12)),
    ("box", (1.35, -0.62, 0.2), -0.5, (0.14, 0.20, 0.2)),
    ("box", (0.35, 0.75, 0.3), 0.2, (0.15, 0.12, 0.3)),
    ("box", (-0.9, -0.45, 0.25), 0.7, (0.2, 0.15, 0.25)),
    ("cylinder", (1.85, -0.15, 0.3), 0.0, (0.13, 0.13, 0.3)),
]
COLORS = {"wall": "#9aa0a6", "box": "#c9a36b", "cylinder": "#7fa8c9"}
SEEN, UNSEEN = "#c1272d", "white"


def camera_matrix() -> np.ndarray:
    """Optical axes in the base frame as columns; in portrait, optical x points down in the image."""
    forward = np.array([np.cos(CAMERA_TILT), 0.0, np.sin(CAMERA_TILT)])
    left = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(left, forward), left, forward], axis=1)


def run_sensor(tan_half_fov: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Tokens (nslot, 32) of the scene: in the window, and seen."""
    kinds, pos, yaw, half = zip(*SLOTS, strict=True)
    scene = SimpleNamespace(
        pos=wp.array([pos], dtype=wp.vec3, device="cpu"),
        yaw=wp.array([yaw], dtype=float, device="cpu"),
        half_size=wp.array([half], dtype=wp.vec3, device="cpu"),
        active=wp.ones((1, len(SLOTS)), dtype=wp.bool, device="cpu"),
        is_cylinder=wp.array([k == "cylinder" for k in kinds], dtype=wp.bool, device="cpu"),
        is_wall=wp.array([k == "wall" for k in kinds], dtype=wp.bool, device="cpu"),
    )
    sensor = Scandots(
        scene,
        qpos=wp.zeros((1, 3), dtype=float, device="cpu"),
        site_xpos=wp.array(CAMERA_POS[None, None], dtype=wp.vec3, device="cpu"),
        site_xmat=wp.array(camera_matrix()[None, None], dtype=wp.mat33, device="cpu"),
        camera_site=0,
        tan_half_fov=tan_half_fov,
        window=WINDOW_M,
    )
    sensor.update()
    return sensor.all.numpy()[0], sensor.visible.numpy()[0]


def known_corners(token: np.ndarray) -> np.ndarray:
    """Corners of a token whose flag is set, shape (n, 3)."""
    return token[:24].reshape(8, 3)[token[24:] > 0]


def unseen_corners(every: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Corners in the window that the camera does not see, shape (n, 3)."""
    return every[:24].reshape(8, 3)[(every[24:] > 0) & (visible[24:] == 0)]


def outline(kind: str, pos: tuple, yaw: float, half: tuple) -> np.ndarray:
    """Counter-clockwise footprint of a slot, shape (n, 2)."""
    if kind == "cylinder":
        angle = np.linspace(0.0, 2 * np.pi, 33)[:-1]
        return np.array(pos[:2]) + half[0] * np.column_stack([np.cos(angle), np.sin(angle)])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.array(pos[:2]) + np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half[:2] @ turn.T


def faces(kind: str, pos: tuple, yaw: float, half: tuple) -> list[np.ndarray]:
    """Side and top polygons of a slot, each (n, 3); long sides are cut in short strips for depth sorting."""
    foot = outline(kind, pos, yaw, half)
    low, high = pos[2] - half[2], pos[2] + half[2]
    polygons = [np.column_stack([foot, np.full(len(foot), high)])] if kind != "wall" else []
    for a, b in zip(foot, np.roll(foot, -1, axis=0), strict=True):
        strips = max(1, round(np.linalg.norm(b - a) / 0.25))
        for i in range(strips):
            p, q = a + (b - a) * i / strips, a + (b - a) * (i + 1) / strips
            polygons.append(np.array([[*p, low], [*q, low], [*q, high], [*p, high]]))
    return polygons


def to_image(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image coordinates (right, up), shape (n, 2), as tangents, and depths [m]."""
    down, left, depth = ((points - CAMERA_POS) @ camera_matrix()).T
    return np.column_stack([-left, -down]) / np.maximum(depth, 1e-6)[:, None], depth


def floor_footprint(tan_half_fov: tuple[float, float]) -> np.ndarray:
    """Where the edges of the image meet the floor (far edges cut at 6 m), shape (4, 2)."""
    corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * tan_half_fov
    rays = np.column_stack([corners, np.ones(4)]) @ camera_matrix().T
    reach = np.where(rays[:, 2] < -1e-3, -CAMERA_POS[2] / np.minimum(rays[:, 2], -1e-3), np.inf)
    reach = np.minimum(reach, 6.0 / np.linalg.norm(rays[:, :2], axis=1))
    return CAMERA_POS[:2] + reach[:, None] * rays[:, :2]


def draw_dots(axes: plt.Axes, points: np.ndarray, color: str, **options: float) -> None:
    """Round markers with a red edge; ``color`` fills them."""
    axes.scatter(*points.T, s=34, facecolor=color, edgecolor=SEEN, linewidth=1.3, **options)


def draw_top_view(axes: plt.Axes, every: np.ndarray, visible: np.ndarray, tan: tuple[float, float]) -> None:
    """Footprints, window, frustum, and corners, x forward up the page."""

    def turn(points: np.ndarray) -> np.ndarray:
        return np.column_stack([-points[:, 1], points[:, 0]])

    axes.add_patch(Polygon(turn(floor_footprint(tan)), facecolor="#ffe9a8", edgecolor="#d9a400", zorder=0))
    axes.add_patch(Rectangle((-2, -2), 4, 4, fill=False, linestyle="--", edgecolor="0.35"))
    for slot in SLOTS:
        axes.add_patch(Polygon(turn(outline(*slot)), facecolor=COLORS[slot[0]], alpha=0.75, zorder=1))
    for slot, token, seen in zip(SLOTS, every, visible, strict=True):
        if slot[0] == "wall" and seen[24:].any():
            piece = known_corners(seen)[:4]
            axes.add_patch(Polygon(turn(piece[:, :2]), facecolor=SEEN, alpha=0.6, zorder=2))
        hollow = token if slot[0] == "wall" else None
        unseen = known_corners(hollow) if hollow is not None else unseen_corners(token, seen)
        draw_dots(axes, turn(unseen), UNSEEN, zorder=3)
        draw_dots(axes, turn(known_corners(seen)), SEEN, zorder=4)
    axes.add_patch(Rectangle((-0.17, -0.25), 0.34, 0.4, facecolor="0.2", zorder=5))
    axes.annotate("", (0, 0.5), (0, 0.1), arrowprops={"arrowstyle": "->", "color": "0.2", "lw": 2}, zorder=6)
    axes.set(xlim=(-2.2, 2.2), ylim=(-2.3, 3.3), aspect="equal")
    axes.set(xlabel="right of the base [m]", ylabel="ahead of the base [m]", title="From above")


def draw_image(axes: plt.Axes, every: np.ndarray, visible: np.ndarray, tan: tuple[float, float]) -> None:
    """The scene through the camera, far faces first, with the corners over it."""
    polygons = [(np.linalg.norm(f.mean(0) - CAMERA_POS), f, slot[0]) for slot in SLOTS for f in faces(*slot)]
    for _, face, kind in sorted(polygons, key=lambda item: -item[0]):
        image, depth = to_image(face)
        if depth.min() > 0.05:
            color = to_rgb(COLORS[kind])
            if np.ptp(face[:, 2]) == 0.0:  # tops are lighter
                color = tuple(0.5 + 0.5 * c for c in color)
            axes.add_patch(Polygon(image, facecolor=color, edgecolor="0.35", linewidth=0.4))
    for slot, token, seen in zip(SLOTS, every, visible, strict=True):
        if slot[0] == "wall":
            continue
        unseen = unseen_corners(token, seen)
        image, depth = to_image(unseen)
        draw_dots(axes, image[depth > 0.1], UNSEEN, zorder=5)
        draw_dots(axes, to_image(known_corners(seen))[0], SEEN, zorder=6)
    for seen in (v for slot, v in zip(SLOTS, visible, strict=True) if slot[0] == "wall" and v[24:].any()):
        corners = known_corners(seen)
        across = np.argsort(np.linalg.norm(corners[:4, :2], axis=1))[:1].item()
        near = corners[[across, (across + 1) % 4, (across + 1) % 4 + 4, across + 4]]
        other = corners[[across, (across - 1) % 4, (across - 1) % 4 + 4, across + 4]]
        face = max(near, other, key=lambda f: np.linalg.norm(f[1] - f[0]))
        axes.add_patch(Polygon(to_image(face)[0], fill=False, edgecolor=SEEN, linewidth=2, zorder=4))
    axes.add_patch(
        Rectangle((-tan[1], -tan[0]), 2 * tan[1], 2 * tan[0], fill=False, edgecolor="#d9a400", lw=3)
    )
    axes.set(xlim=(-1.25 * tan[1], 1.25 * tan[1]), ylim=(-1.12 * tan[0], 1.12 * tan[0]), aspect="equal")
    axes.set(xticks=[], yticks=[], title="Camera image (portrait mount)")


def main() -> None:
    """Write the figure beside this script."""
    tan = camera_tan_half_fov("portrait")
    every, visible = run_sensor(tan)
    figure, (top, image) = plt.subplots(1, 2, figsize=(11, 7.4), width_ratios=(1.05, 1))
    draw_top_view(top, every, visible, tan)
    draw_image(image, every, visible, tan)
    dot = {"marker": "o", "color": "none", "markeredgecolor": SEEN, "markersize": 7}
    figure.legend(
        handles=[
            Line2D([], [], markerfacecolor=SEEN, label="corner in view", **dot),
            Line2D([], [], markerfacecolor=UNSEEN, label="corner in the window, not in view", **dot),
            Line2D([], [], color=SEEN, linewidth=3, label="piece of a wall in view"),
            Line2D([], [], color="0.35", linestyle="--", label="local window"),
            Line2D([], [], color="#d9a400", linewidth=3, label="camera frustum (on the floor)"),
        ],
        loc="lower center",
        ncols=3,
        frameon=False,
    )
    figure.tight_layout(rect=(0, 0.1, 1, 1))
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=110)


if __name__ == "__main__":
    main()
