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
NOTHING_SEEN = Scandots(np.zeros((0, 3)), np.zeros(0, dtype=bool))


def draw(name: str) -> Image.Image:
    """One scene from above and from the south."""
    scene = load_scene(CONF_DIR / "scenes_examples" / f"{name}.yaml")
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
    points = np.concatenate([outline(scene, slot) for slot in range(scene.pool.num_slots)])
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = 0.5 * (low + high)
    size = max((high - low)[0], 1.25 * (high - low)[1])
    return np.array([x - 0.2 * size, y - 0.92 * size, 0.92 * size]), np.array([x, y, 0.2])


def main() -> None:
    """Write the picture beside this file."""
    width, height = SIZE
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(NAMES) // COLUMNS) * height))
    for i, name in enumerate(NAMES):
        sheet.paste(draw(name), (i % COLUMNS * width, i // COLUMNS * height))
    few = sheet.quantize(128, dither=Image.Dither.NONE)
    few.save(Path(__file__).with_suffix(".png"), optimize=True)


if __name__ == "__main__":
    main()
