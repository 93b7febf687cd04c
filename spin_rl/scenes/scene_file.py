"""Scenes written by hand: a YAML file with walls, boxes, cylinders, furniture, a start and a goal.

All lengths in metres, angles in radians, in the world frame (z up, floor at 0)::

    start: {position: [0, 0], yaw: 0}
    goal: [5, 0]
    joints: {lift: 0.4}                      # optional; missing joints are stowed
    walls:                                   # optional, as is all that follows
      - {position: [2.5, 0.55], size: [6, 0.1, 1.5], yaw: 0}
    boxes:
      - {position: [2, 0.3, 1.3], size: [0.3, 0.4, 0.2]}
    cylinders:
      - {position: [3, -0.3], radius: 0.1, height: 0.2, motion: {to: [3, 0.3], speed: 1, trigger: 1.5}}
    furniture:
      - {piece: chair, position: [4, 1], yaw: 1.57}
    pieces:                                  # in addition to those of conf/furniture.yaml
      sign: {boxes: [{position: [0, 0, 0.8], size: [0.05, 0.4, 0.3]}], cylinders: [{...}]}

A position is the centre; without a z the thing stands on the floor. A size is the full extent along the
thing's own x, y and z. Walls are boxes that the robot perceives piece by piece: use them for what is longer
than about 2 m.

A piece of furniture is made of walls, boxes and cylinders in a frame of its own, which stands at `position`
(with a third number: raised by it) and is turned by `yaw`. The front of the pieces in conf/furniture.yaml
faces +x, and their origin is the middle of their footprint.

A box or cylinder with a motion starts at its position. With a trigger it goes straight to ``to``, and stays
there, as soon as the base is nearer to that place than the trigger; without one it goes to and fro all the
time. Furniture does not move.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.furniture import KINDS, Part, read_parts
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.scenes.yaml_values import mapping, number, numbers, positive, read_yaml

MAX_SLOTS = 300
"""Most walls, boxes and cylinders together, those of the furniture included."""
SHORTEST_M = 0.2
"""Least distance from start to goal; nearer, a robot has arrived before it has moved."""

_KEYS = ("start", "goal", "joints", *KINDS, "furniture", "pieces")


def load_scene(path: str | Path) -> Scene:
    """Read and check a scene file.

    Args:
        path: YAML file.

    Returns:
        The scene, in a pool of just the slots that it needs (at least one).

    Raises:
        ConfigError: The file cannot be read, has unknown, missing or impossible entries, the robot touches
            something at the start, or is there already. One line that names the file and the key.
    """
    path = Path(path)
    content = read_yaml(path)
    try:
        scene = parse_scene(content)
        _check_free(scene)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return scene


def find_scene(name: Path) -> Path:
    """Return the path of a scene file: as it is, or one of conf/scenes_examples by its name.

    Raises:
        ConfigError: There is neither.
    """
    for path in (name, CONF_DIR / "scenes_examples" / name):
        if path.is_file():
            return path
    examples = sorted(path.name for path in (CONF_DIR / "scenes_examples").glob("*.yaml"))
    raise ConfigError(f"scene: there is no file {name}; of those shipped, there are {', '.join(examples)}")


def parse_scene(content: Any) -> Scene:
    """Build a scene from a scene file's parsed content, without looking for collisions.

    Raises:
        ConfigError: An unknown, missing or impossible entry, named in the message.
    """
    top = mapping(content, "the scene", _KEYS, required=("start", "goal"))
    parts = read_parts(top)
    if len(parts) > MAX_SLOTS:
        raise ConfigError(f"walls, boxes and cylinders: at most {MAX_SLOTS} together, got {len(parts)}")
    walls, boxes, cylinders = (sum(part.kind == kind for part in parts) for kind in KINDS)
    # A pool has at least one slot, even for an empty floor.
    scene = Scene.empty(PoolSpec(walls, boxes if parts else 1, cylinders))
    for slot, part in enumerate(parts):
        _read_slot(scene, slot, part)
    start = mapping(top["start"], "start", ("position", "yaw"), required=("position",))
    scene.start[:2] = numbers(start["position"], "start.position", (2,))
    scene.start[2] = number(start.get("yaw", 0.0), "start.yaw")
    scene.goal[:] = numbers(top["goal"], "goal", (2,))
    scene.start_joints[:] = _joints(top.get("joints"))
    scene.num_obstacles = boxes + cylinders
    scene.scenario = 0
    return scene


def scene_pool(scene: Scene) -> PoolSpec:
    """The slots that a scene needs."""
    return scene.pool


def layout_from_scene(scene: Scene, nworld: int, device: str) -> Layout:
    """A layout with the same scene in every world.

    Args:
        scene: What to put there.
        nworld: Number of worlds.
        device: Warp device.
    """
    layout = Layout(nworld, scene_pool(scene), device)
    layout.load(scene)
    return layout


def _read_slot(scene: Scene, slot: int, part: Part) -> None:
    """Read one wall, box or cylinder into a slot."""
    where = part.where
    may_move = () if part.kind == "walls" or part.frame else ("motion",)
    if part.kind == "cylinders":
        keys = ("position", "radius", "height")
        values = mapping(part.entry, where, (*keys, *may_move), required=keys)
        radius = positive(values["radius"], f"{where}.radius")
        half = np.array([radius, radius, 0.5 * positive(values["height"], f"{where}.height")])
    else:
        keys = ("position", "size", "yaw")
        values = mapping(part.entry, where, (*keys, *may_move), required=keys[:2])
        size = numbers(values["size"], f"{where}.size", (3,))
        if min(size) <= 0.0:
            raise ConfigError(f"{where}.size: must be positive, got {values['size']!r}")
        half = 0.5 * np.array(size)
        scene.yaw[slot] = number(values.get("yaw", 0.0), f"{where}.yaw")
    position = numbers(values["position"], f"{where}.position", (2, 3))
    scene.pos[slot] = (*position, half[2])[:3]
    scene.half_size[slot] = half
    scene.active[slot] = True
    if part.frame:
        _place(scene, slot, part.frame)
    if values.get("motion") is not None:
        _read_motion(scene, slot, values["motion"], f"{where}.motion")


def _place(scene: Scene, slot: int, frame: tuple[float, float, float, float]) -> None:
    """Take a slot from the frame of its piece of furniture to the world."""
    x, y, z, yaw = frame
    c, s = math.cos(yaw), math.sin(yaw)
    px, py, pz = scene.pos[slot]
    scene.pos[slot] = (x + c * px - s * py, y + s * px + c * py, z + pz)
    if not scene.is_cylinder[slot]:
        scene.yaw[slot] += yaw


def _read_motion(scene: Scene, slot: int, entry: Any, where: str) -> None:
    """Read how a slot moves; its position, where it starts, is in the scene already."""
    values = mapping(entry, where, ("to", "speed", "trigger"), required=("to", "speed"))
    scene.home[slot] = (*numbers(values["to"], f"{where}.to", (2,)), scene.pos[slot, 2])
    scene.retreat[slot] = (scene.pos[slot] - scene.home[slot])[:2]
    if not scene.retreat[slot].any():
        raise ConfigError(f"{where}.to: must differ from the position, got {values['to']!r}")
    scene.motion_speed[slot] = positive(values["speed"], f"{where}.speed")
    if "trigger" in values:
        scene.motion_trigger[slot] = positive(values["trigger"], f"{where}.trigger")


def _joints(content: Any) -> list[float]:
    """Start joints in `robot.JOINTS` order; missing ones are stowed."""
    given = {} if content is None else mapping(content, "joints", robot.JOINTS)
    joints = []
    for name, low, high in zip(robot.JOINTS, robot.JOINT_LOWER, robot.JOINT_UPPER, strict=True):
        value = number(given.get(name, robot.STOWED[name]), f"joints.{name}")
        if not low <= value <= high:
            raise ConfigError(f"joints.{name}: must be in [{low}, {high}], got {value}")
        joints.append(value)
    return joints


def _check_free(scene: Scene) -> None:
    """Reject a start at which the robot touches something, and a goal at the start or inside of something."""
    if math.dist(scene.start[:2], scene.goal) < SHORTEST_M:
        raise ConfigError(f"goal: must be at least {SHORTEST_M} m from the start")
    model = native_model(scene)
    data = mujoco.MjData(model)
    joints: dict[str, float] = dict(zip(robot.JOINTS, scene.start_joints.tolist(), strict=True))
    data.qpos[:] = robot.qpos_from_joints(model, joints)
    data.qpos[:3] = scene.start
    mujoco.mj_forward(model, data)
    for contact in data.contact:
        first, second = (model.geom(int(geom)).name for geom in contact.geom)
        if contact.dist < 0.0:
            raise ConfigError(f"start: the robot is in collision ({first} touches {second})")
    stays = np.where(scene.motion_trigger[:, None] > 0.0, scene.home, scene.pos)
    leaves = (scene.motion_speed > 0.0) & (scene.motion_trigger == 0.0)
    on_floor = scene.pos[:, 2] - scene.half_size[:, 2] < 0.2
    for slot in np.flatnonzero(scene.active & on_floor & ~leaves):
        dx, dy = scene.goal - stays[slot, :2]
        c, s = math.cos(scene.yaw[slot]), math.sin(scene.yaw[slot])
        local = np.abs((c * dx + s * dy, c * dy - s * dx))
        half = scene.half_size[slot]
        inside = math.hypot(dx, dy) < half[0] if scene.is_cylinder[slot] else bool((local < half[:2]).all())
        if inside:
            raise ConfigError(f"goal: lies inside {scene.pool.geom_names()[slot]}")
