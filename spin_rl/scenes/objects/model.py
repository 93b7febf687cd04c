# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false, reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Shape, mass and friction of every world's object, written into a batched mujoco-warp model."""

from dataclasses import dataclass

import mujoco
import warp as wp

from spin_rl import robot
from spin_rl.scenes.objects.shapes import KINDS, OBJECT_BODY, OBJECT_GEOMS

_SHAPES = ("cylinder", "box", "banana")
CYLINDER = wp.constant(0)
_BOX = wp.constant(1)
SHAPE_OF_KIND = wp.constant(
    wp.types.vector(length=len(KINDS), dtype=wp.int32)(*(_SHAPES.index(k.shape) for k in KINDS.values()))
)
"""Index into `_SHAPES` of every kind."""

_UNUSED_M = wp.constant(1.0e-4)
"""Size of the geoms that an object does not use."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class ObjectStart:
    """The arrays of an `ObjectState` that the generator writes."""

    kind: wp.array[int]
    start_pose: wp.array[wp.vec4]
    half_extents: wp.array[wp.vec3]
    mass: wp.array[float]
    friction: wp.array[float]
    near: wp.array[wp.bool]


@wp.struct
class ObjectModel:
    """The arrays of a batched mujoco-warp model that make an object; leading axis nworld."""

    geom_size: wp.array2d[wp.vec3]
    geom_rbound: wp.array2d[float]
    geom_aabb: wp.array3d[wp.vec3]
    geom_pos: wp.array2d[wp.vec3]
    geom_quat: wp.array2d[wp.quat]
    geom_friction: wp.array2d[wp.vec3]
    body_mass: wp.array2d[float]
    body_subtreemass: wp.array2d[float]
    body_inertia: wp.array2d[wp.vec3]
    body_invweight0: wp.array2d[wp.vec2]
    dof_invweight0: wp.array2d[float]


MODEL_FIELDS = tuple(ObjectModel.vars)
"""Fields of mujoco-warp's Model that need one row per world."""


@wp.func
def _put_geom(
    world: int, geom: int, pos: wp.vec3, quat: wp.quat, size: wp.vec3, half: wp.vec3, out: ObjectModel
) -> None:
    """Write a geom of MuJoCo's size and of a bounding box with these half sizes, both in its own frame."""
    out.geom_pos[world, geom] = pos
    out.geom_quat[world, geom] = quat
    out.geom_size[world, geom] = size
    out.geom_aabb[world, geom, 0] = wp.vec3(0.0, 0.0, 0.0)
    out.geom_aabb[world, geom, 1] = half


@wp.func
def _put_cylinder(world: int, geom: int, half: wp.vec3, out: ObjectModel) -> None:
    upright = wp.quat(1.0, 0.0, 0.0, 0.0)
    _put_geom(world, geom, wp.vec3(0.0), upright, wp.vec3(half[0], half[2], 0.0), half, out)
    out.geom_rbound[world, geom] = wp.sqrt(half[0] * half[0] + half[2] * half[2])


@wp.func
def _put_box(world: int, geom: int, half: wp.vec3, out: ObjectModel) -> None:
    _put_geom(world, geom, wp.vec3(0.0), wp.quat(1.0, 0.0, 0.0, 0.0), half, half, out)
    out.geom_rbound[world, geom] = wp.length(half)


@wp.func
def _put_capsule(
    world: int, geom: int, middle: float, axis: wp.vec2, radius: float, out: ObjectModel
) -> None:
    """Write a horizontal capsule; `axis` is half of its straight part, along the object's x and y."""
    length = wp.length(axis)
    # The turn of z onto the axis, which is horizontal: by 90 degrees about (-y, x, 0). MuJoCo's order is w
    # first, in the memory of Warp's quaternion as well.
    s = wp.sqrt(0.5)
    unit = axis / length
    quat = wp.quat(s, -s * unit[1], s * unit[0], 0.0)
    size = wp.vec3(radius, length, 0.0)
    _put_geom(
        world, geom, wp.vec3(middle, 0.0, 0.0), quat, size, wp.vec3(radius, radius, radius + length), out
    )
    out.geom_rbound[world, geom] = radius + length


@wp.func
def _banana_inertia(half: wp.vec3, mass: float) -> wp.vec3:
    """Principal moments of two equal solid capsules in a V, about its centre [kg m^2]."""
    r = half[2]
    axis = 0.5 * wp.vec2(half[0] - r, 2.0 * (half[1] - r))
    length = wp.length(axis)
    unit = axis / length
    # Masses of straight part and ends, of both capsules together.
    straight = mass * 2.0 * length / (2.0 * length + 4.0 / 3.0 * r)
    ends = mass - straight
    along = (0.5 * straight + 0.4 * ends) * r * r
    across = straight * (0.25 * r * r + length * length / 3.0) + ends * (
        0.4 * r * r + length * length + 0.75 * length * r
    )
    offset = mass * axis[0] * axis[0]
    return wp.vec3(
        along * unit[0] * unit[0] + across * unit[1] * unit[1],
        along * unit[1] * unit[1] + across * unit[0] * unit[0] + offset,
        across + offset,
    )


@wp.func
def _inertia(shape: int, half: wp.vec3, mass: float) -> wp.vec3:
    """Principal moments of a solid object [kg m^2]."""
    x = half[0] * half[0]
    y = half[1] * half[1]
    z = half[2] * half[2]
    if shape == CYLINDER:
        return mass * wp.vec3(0.25 * x + z / 3.0, 0.25 * x + z / 3.0, 0.5 * x)
    if shape == _BOX:
        return mass / 3.0 * wp.vec3(y + z, x + z, x + y)
    return _banana_inertia(half, mass)


@wp.kernel
def _write_objects(
    # Ids
    geoms: wp.array(dtype=wp.int32),
    pads: wp.array(dtype=wp.int32),
    body: int,
    first_dof: int,
    # In
    mask: wp.array(dtype=bool),
    kind: wp.array(dtype=wp.int32),
    half_extents: wp.array(dtype=wp.vec3),
    mass: wp.array(dtype=float),
    friction: wp.array(dtype=float),
    # Out
    out: ObjectModel,
) -> None:
    world = wp.tid()
    if not mask[world]:
        return
    shape = SHAPE_OF_KIND[kind[world]]
    half = half_extents[world]
    point = wp.vec3(_UNUSED_M, _UNUSED_M, _UNUSED_M)
    _put_cylinder(world, geoms[0], wp.where(shape == CYLINDER, half, point), out)
    _put_box(world, geoms[1], wp.where(shape == _BOX, half, point), out)
    radius = _UNUSED_M
    axis = wp.vec2(_UNUSED_M, 0.0)
    if shape != CYLINDER and shape != _BOX:
        radius = half[2]
        axis = wp.vec2(0.5 * (half[0] - radius), radius - half[1])
    _put_capsule(world, geoms[2], -axis[0], wp.vec2(-axis[0], axis[1]), radius, out)
    _put_capsule(world, geoms[3], axis[0], axis, radius, out)
    for i in range(pads.shape[0]):
        sliding = out.geom_friction[world, pads[i]]
        out.geom_friction[world, pads[i]] = wp.vec3(friction[world], sliding[1], sliding[2])

    m = mass[world]
    inertia = _inertia(shape, half, m)
    out.body_mass[world, body] = m
    out.body_subtreemass[world, body] = m
    out.body_inertia[world, body] = inertia
    # What MuJoCo's compiler computes of them for a free body.
    turning = (1.0 / inertia[0] + 1.0 / inertia[1] + 1.0 / inertia[2]) / 3.0
    out.body_invweight0[world, body] = wp.vec2(1.0 / m, turning)
    for i in range(3):
        out.dof_invweight0[world, first_dof + i] = 1.0 / m
        out.dof_invweight0[world, first_dof + 3 + i] = turning


@dataclass(frozen=True)
class ObjectIds:
    """Where the object is in a model: arrays of geom ids on the device, body and first degree of freedom."""

    geoms: wp.array
    pads: wp.array
    body: int
    first_dof: int

    @staticmethod
    def of(model: mujoco.MjModel, device: str) -> "ObjectIds":
        """Find the object and the grasping robot's pads in a model."""
        pads = [name for names in robot.PADS.values() for name in names]

        def ids(names: tuple[str, ...] | list[str]) -> wp.array:
            return wp.array([model.geom(name).id for name in names], dtype=wp.int32, device=device)

        return ObjectIds(
            geoms=ids(OBJECT_GEOMS),
            pads=ids(pads),
            body=model.body(OBJECT_BODY).id,
            first_dof=int(model.joint(OBJECT_BODY).dofadr[0]),
        )


def write_objects(
    ids: ObjectIds,
    mask: wp.array,
    *,
    kind: wp.array,
    half_extents: wp.array,
    mass: wp.array,
    friction: wp.array,
    out: ObjectModel,
) -> None:
    """Give the masked worlds' objects their shape, mass and friction; graph-safe.

    Args:
        ids: Where the object is in the model.
        mask: Worlds to write, shape (nworld,), bool.
        kind: Index into `OBJECTS`, shape (nworld,), int32.
        half_extents: Half sizes of the bounding box [m], shape (nworld,), vec3.
        mass: Mass [kg], shape (nworld,).
        friction: Sliding friction of the fingertips' pads, shape (nworld,).
        out: Output, the model's arrays.
    """
    wp.launch(
        _write_objects,
        dim=mask.shape[0],
        inputs=[
            ids.geoms,
            ids.pads,
            ids.body,
            ids.first_dof,
            mask,
            kind,
            half_extents,
            mass,
            friction,
        ],
        outputs=[out],
        device=mask.device,
    )
