"""The five objects to pick up, as one body whose geoms take the shape that each world needs.

Geom types are the same in all worlds of a batched model, so the body owns a cylinder, a box and two
capsules; those that an object does not use shrink to a point inside of it. Sizes and masses are those of the
YCB objects 011_banana, 025_mug, 005_tomato_soup_can, 061_foam_brick and 006_mustard_bottle; the mug has no
handle.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import mujoco
import numpy as np

from spin_rl import robot

Shape = Literal["cylinder", "box", "banana"]


@dataclass(frozen=True)
class ObjectKind:
    """An object at its nominal size.

    Attributes:
        shape: A cylinder, a box, or two capsules in a V that lies on its side.
        half_extents: Half sizes of the bounding box in the object's frame, z up as it stands [m], shape (3,).
        mass: Mass [kg].
    """

    shape: Shape
    half_extents: tuple[float, float, float]
    mass: float


KINDS: Mapping[str, ObjectKind] = MappingProxyType(
    {
        "banana": ObjectKind("banana", (0.0985, 0.037, 0.019), 0.066),
        "mug": ObjectKind("cylinder", (0.0465, 0.0465, 0.0405), 0.118),
        "can": ObjectKind("cylinder", (0.034, 0.034, 0.051), 0.349),
        "brick": ObjectKind("box", (0.0265, 0.039, 0.0255), 0.028),
        "bottle": ObjectKind("box", (0.0485, 0.0335, 0.0955), 0.603),
    }
)
OBJECTS = tuple(KINDS)
"""Names of the objects; a world's kind is an index into them."""

OBJECT_BODY = "object"
OBJECT_GEOMS = ("object_cylinder", "object_box", "object_left", "object_right")

# Less than the scene's 1.0, and MuJoCo takes the larger one of two geoms: contacts of object and scene have
# the scene's friction, those of object and pads what `object_model.write_objects` gives the pads.
_OBJECT_FRICTION = (0.3, 0.005, 0.0001)
_RGBA = (0.80, 0.62, 0.18, 1.0)
_GROUP = 1


def add_object(spec: mujoco.MjSpec) -> None:
    """Append the free object body with all of its geoms, for `object_model.write_objects` to shape."""
    body = _add_body(spec)
    body.mass = 0.1
    body.inertia = [1e-4, 1e-4, 1e-4]
    body.ipos, body.iquat = [0.0] * 3, [1.0, 0.0, 0.0, 0.0]
    body.explicitinertial = True
    types = (
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_BOX,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
    )
    for name, kind in zip(OBJECT_GEOMS, types, strict=True):
        _add_geom(body, name, kind, [0.02, 0.02, 0.02])


@dataclass(frozen=True)
class SceneObject:
    """The object of one world on the host.

    Attributes:
        kind: One of `OBJECTS`.
        half_extents: Half sizes of the bounding box in the object's frame [m], shape (3,).
        mass: Mass [kg].
        friction: Sliding friction of the fingertips' pads.
        start_pose: Position of the centre [m] and yaw [rad], shape (4,).
    """

    kind: str
    half_extents: np.ndarray
    mass: float
    friction: float
    start_pose: np.ndarray


def add_native_object(spec: mujoco.MjSpec, obj: SceneObject) -> None:
    """Append an object as an ordinary body with the geoms it uses, for oracles and viewers.

    MuJoCo computes its inertia; the object's start pose becomes the model's default.

    Args:
        spec: Specification with the grasping robot, whose pads get the friction.
        obj: The object.
    """
    body = _add_body(spec)
    body.pos = obj.start_pose[:3]
    body.quat = [math.cos(0.5 * obj.start_pose[3]), 0.0, 0.0, math.sin(0.5 * obj.start_pose[3])]
    x, y, z = (float(h) for h in obj.half_extents)
    shape = KINDS[obj.kind].shape
    if shape == "cylinder":
        _add_geom(body, OBJECT_GEOMS[0], mujoco.mjtGeom.mjGEOM_CYLINDER, [x, z, 0.0], obj.mass)
    elif shape == "box":
        _add_geom(body, OBJECT_GEOMS[1], mujoco.mjtGeom.mjGEOM_BOX, [x, y, z], obj.mass)
    else:
        for name, side in zip(OBJECT_GEOMS[2:], (-1.0, 1.0), strict=True):
            geom = _add_geom(body, name, mujoco.mjtGeom.mjGEOM_CAPSULE, [z, 0.0, 0.0], 0.5 * obj.mass)
            geom.fromto = [0.0, y - z, 0.0, side * (x - z), z - y, 0.0]
    for names in robot.PADS.values():
        for name in names:
            spec.geom(name).friction[0] = obj.friction


def _add_body(spec: mujoco.MjSpec) -> mujoco.MjsBody:
    body = spec.worldbody.add_body(name=OBJECT_BODY)
    body.add_freejoint(name=OBJECT_BODY)
    return body


def _add_geom(
    body: mujoco.MjsBody, name: str, kind: mujoco.mjtGeom, size: list[float], mass: float = math.nan
) -> mujoco.MjsGeom:
    return body.add_geom(
        name=name,
        type=kind,
        size=size,
        mass=mass,
        contype=robot.OBJECT_CONTYPE,
        conaffinity=3,
        condim=4,
        friction=list(_OBJECT_FRICTION),
        group=_GROUP,
        rgba=list(_RGBA),
    )
