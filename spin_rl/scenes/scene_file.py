"""Scenes written by hand: a YAML file with walls, boxes, cylinders, a start and a goal.

All lengths in metres, angles in radians, in the world frame (z up, floor at 0)::

    start: {position: [0, 0], yaw: 0}
    goal: [5, 0]
    joints: {lift: 0.4}                      # optional; missing joints are stowed
    walls:                                   # optional, as are boxes and cylinders
      - {position: [2.5, 0.55], size: [6, 0.1, 1.5], yaw: 0}
    boxes:
      - {position: [2, 0.3, 1.3], size: [0.3, 0.4, 0.2]}
    cylinders:
      - {position: [3, -0.3], radius: 0.1, height: 0.2, motion: {to: [3, 0.3], speed: 1, trigger: 1.5}}

A position is the centre; without a z the thing stands on the floor. A size is the full extent along the
thing's own x, y and z. Walls are boxes that the robot perceives piece by piece: use them for what is longer
than about 2 m.

A box or cylinder with a motion starts at its position. With a trigger it goes straight to ``to``, and stays
there, as soon as the base is nearer to that place than the trigger; without one it goes to and fro all the
time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import Layout, PoolSpec, Scene

MAX_SLOTS = 300
"""Most walls, boxes and cylinders together."""

MAX_EXTENT_M = 1000.0
"""Largest coordinate or size."""

_KEYS = ("start", "goal", "joints", "walls", "boxes", "cylinders")


def load_scene(path: str | Path) -> Scene:
    """Read and check a scene file.

    Args:
        path: YAML file.

    Returns:
        The scene, in a pool of just the slots that it needs (at least one).

    Raises:
        ConfigError: The file cannot be read, has unknown, missing or impossible entries, or the robot touches
            something at the start. One line that names the file and the key.
    """
    path = Path(path)
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the file: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}: not valid YAML{where}") from None
    try:
        scene = parse_scene(content)
        _check_free(scene)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return scene


def parse_scene(content: Any) -> Scene:
    """Build a scene from a scene file's parsed content, without looking for collisions.

    Raises:
        ConfigError: An unknown, missing or impossible entry, named in the message.
    """
    top = _mapping(content, "the scene", _KEYS, required=("start", "goal"))
    items = {kind: _list(top.get(kind), kind) for kind in ("walls", "boxes", "cylinders")}
    total = sum(len(entries) for entries in items.values())
    if total > MAX_SLOTS:
        raise ConfigError(f"walls, boxes and cylinders: at most {MAX_SLOTS} together, got {total}")
    scene = Scene.empty(
        PoolSpec(
            num_walls=len(items["walls"]),
            # A pool has at least one slot, even for an empty floor.
            num_boxes=max(len(items["boxes"]), 1 - len(items["walls"]) - len(items["cylinders"])),
            num_cylinders=len(items["cylinders"]),
        )
    )
    pool = scene.pool
    for kind, first in (("walls", 0), ("boxes", pool.first_box), ("cylinders", pool.first_cylinder)):
        for i, entry in enumerate(items[kind]):
            _read_slot(scene, first + i, entry, f"{kind}[{i}]")
    start = _mapping(top["start"], "start", ("position", "yaw"), required=("position",))
    scene.start[:2] = _numbers(start["position"], "start.position", (2,))
    scene.start[2] = _number(start.get("yaw", 0.0), "start.yaw")
    scene.goal[:] = _numbers(top["goal"], "goal", (2,))
    scene.start_joints[:] = _joints(top.get("joints"))
    scene.num_obstacles = len(items["boxes"]) + len(items["cylinders"])
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


def _read_slot(scene: Scene, slot: int, entry: Any, where: str) -> None:
    """Read one wall, box or cylinder into a slot."""
    if where.startswith("cylinders"):
        keys = ("position", "radius", "height")
        values = _mapping(entry, where, (*keys, "motion"), required=keys)
        radius = _positive(values["radius"], f"{where}.radius")
        half = np.array([radius, radius, 0.5 * _positive(values["height"], f"{where}.height")])
    else:
        keys = ("position", "size", "yaw")
        may_move = () if where.startswith("walls") else ("motion",)
        values = _mapping(entry, where, (*keys, *may_move), required=keys[:2])
        size = _numbers(values["size"], f"{where}.size", (3,))
        if min(size) <= 0.0:
            raise ConfigError(f"{where}.size: must be positive, got {values['size']!r}")
        half = 0.5 * np.array(size)
        scene.yaw[slot] = _number(values.get("yaw", 0.0), f"{where}.yaw")
    position = _numbers(values["position"], f"{where}.position", (2, 3))
    scene.pos[slot] = (*position, half[2])[:3]
    scene.half_size[slot] = half
    scene.active[slot] = True
    if values.get("motion") is not None:
        _read_motion(scene, slot, values["motion"], f"{where}.motion")


def _read_motion(scene: Scene, slot: int, entry: Any, where: str) -> None:
    """Read how a slot moves; its position, where it starts, is in the scene already."""
    values = _mapping(entry, where, ("to", "speed", "trigger"), required=("to", "speed"))
    scene.home[slot] = (*_numbers(values["to"], f"{where}.to", (2,)), scene.pos[slot, 2])
    scene.retreat[slot] = (scene.pos[slot] - scene.home[slot])[:2]
    if not scene.retreat[slot].any():
        raise ConfigError(f"{where}.to: must differ from the position, got {values['to']!r}")
    scene.motion_speed[slot] = _positive(values["speed"], f"{where}.speed")
    if "trigger" in values:
        scene.motion_trigger[slot] = _positive(values["trigger"], f"{where}.trigger")


def _joints(content: Any) -> list[float]:
    """Start joints in `robot.JOINTS` order; missing ones are stowed."""
    given = {} if content is None else _mapping(content, "joints", robot.JOINTS)
    joints = []
    for name, low, high in zip(robot.JOINTS, robot.JOINT_LOWER, robot.JOINT_UPPER, strict=True):
        value = _number(given.get(name, robot.STOWED[name]), f"joints.{name}")
        if not low <= value <= high:
            raise ConfigError(f"joints.{name}: must be in [{low}, {high}], got {value}")
        joints.append(value)
    return joints


def _check_free(scene: Scene) -> None:
    """Reject a start at which the robot touches something, and a goal inside something that stands there."""
    model = native_model(scene)
    data = mujoco.MjData(model)
    joints = dict(zip(robot.JOINTS, scene.start_joints.tolist(), strict=True))
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


def _mapping(
    value: Any, where: str, allowed: tuple[str, ...], required: tuple[str, ...] = ()
) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{where}: expected keys {', '.join(allowed)}, got {_short(value)}")
    for key in value:
        if key not in allowed:
            raise ConfigError(f"{where}: unknown key {_short(key)}; choose from {', '.join(allowed)}")
    for key in required:
        if key not in value:
            raise ConfigError(f"{where}: {key} is missing")
    return value


def _list(value: Any, where: str) -> list[Any]:
    if value is None:
        return []
    if not isinstance(value, list):
        raise ConfigError(f"{where}: expected a list, got {_short(value)}")
    return value


def _numbers(value: Any, where: str, lengths: tuple[int, ...]) -> list[float]:
    if not isinstance(value, list) or len(value) not in lengths:
        wanted = " or ".join(str(length) for length in lengths)
        raise ConfigError(f"{where}: expected a list of {wanted} numbers, got {_short(value)}")
    return [_number(item, where) for item in value]


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= MAX_EXTENT_M:
        raise ConfigError(
            f"{where}: expected a number of at most {MAX_EXTENT_M:g} either way, got {_short(value)}"
        )
    return float(value)


def _positive(value: Any, where: str) -> float:
    number = _number(value, where)
    if number <= 0.0:
        raise ConfigError(f"{where}: must be positive, got {value!r}")
    return number


def _short(value: Any) -> str:
    """One line about any value."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
