"""Draw docs/figures/scenes.png: the example scenes, the robot at its start, the goal green.

Run from the repository root: ``python docs/figures/scenes.py``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from spin_rl import robot
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.outline import outline
from spin_rl.scenes.scene_file import load_scene
from spin_rl.viewer import style
from spin_rl.viewer.renderer import Renderer
from spin_rl.viewer.snapshot import Scandots, Snapshot
from spin_rl.viewer.stage import Stage

NAMES = ("lab", "study", "apartment", "office", "workshop", "shop", "ward", "cafe", "library", "warehouse")
NAMES += ("playroom", "corridor")
COLUMNS = 3
SIZE = (360, 270)
SAMPLES = 3
SMALLEST_VIEW_M = 5.0
NOTHING_SEEN = Scandots(np.zeros((0, 3)), np.zeros(0, dtype=bool))


def example(name: str) -> Scene:
    """One of the example scenes."""
    return load_scene(CONF_DIR / "scenes_examples" / f"{name}.yaml")


def draw(name: str, scene: Scene) -> Image.Image:
    """One scene from above and from the south."""
    stage = Stage(scene.pool, "portrait")
    joints = dict(zip(robot.JOINTS, scene.start_joints.tolist(), strict=True))
    qpos = np.array(robot.qpos_from_joints(stage.model, joints))
    qpos[:3] = scene.start
    stage.pose(Snapshot(scene, 0, 0.0, qpos, NOTHING_SEEN))
    renderer = Renderer(stage, *SIZE, SAMPLES)
    stage.place_view(*view(scene))
    picture = Image.fromarray(renderer.render())
    ImageDraw.Draw(picture).text((8, 6), name, fill=style.INK, font=ImageFont.load_default(17))
    return picture


def view(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Where the camera stands and what it looks at [m], so that the whole scene is in the picture."""
    things = [outline(scene, slot) for slot in range(scene.pool.num_slots) if scene.active[slot]]
    points = np.concatenate([*things, scene.start[None, :2], scene.goal[None]])
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = 0.5 * (low + high)
    size = max((high - low)[0], 1.25 * (high - low)[1], SMALLEST_VIEW_M)
    return np.array([x - 0.2 * size, y - 0.92 * size, 0.92 * size]), np.array([x, y, 0.2])


def save_sheet(pictures: list[Image.Image], path: Path) -> None:
    """Write pictures beside and below each other, in few colours."""
    width, height = SIZE
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(pictures) // COLUMNS) * height))
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (i % COLUMNS * width, i // COLUMNS * height))
    few = sheet.quantize(128, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def main() -> None:
    """Write the picture beside this file."""
    save_sheet([draw(name, example(name)) for name in NAMES], Path(__file__).with_suffix(".png"))


if __name__ == "__main__":
    main()
