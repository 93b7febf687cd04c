# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false
# (to a type checker, a Warp struct is an object, not a class, and wp.tid() has any number of values)
"""Scene geoms in MuJoCo: the fixed pool of the batched model, and ordinary models of one world."""

import math

import mujoco
import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.scenes.objects.shapes import SceneObject, add_native_object
from spin_rl.warp_kernels.slots import Slots, slots_of

PARKED_Z_M = -50.0
"""Height of the geoms of inactive slots, far below everything that could touch them."""

SCENE_CONTYPE = 1
FLOOR_CONTYPE = 2
SCENE_GROUP = 1

_WALL_RGBA = (0.82, 0.82, 0.80, 1.0)
_BOX_RGBA = (0.62, 0.56, 0.48, 1.0)
_CYLINDER_RGBA = (0.50, 0.56, 0.62, 1.0)
_FLOOR_RGBA = (0.45, 0.47, 0.50, 1.0)

wp.set_module_options({"enable_backward": False})


def add_pool(spec: mujoco.MjSpec, pool: PoolSpec) -> None:
    """Add the floor and one parked static geom for every slot to the world body.

    Contact bits: robot geoms collide with contype 1 (scene) and, for the arm, 2 (floor); see
    `robots/stretch_re1`.

    Args:
        spec: Specification to add to.
        pool: Slots of every world.
    """
    _add_floor(spec)
    parked = Scene.empty(pool)
    parked.pos[:, 2] = PARKED_Z_M
    for slot in range(pool.num_slots):
        _add_geom(spec, parked, slot)


def native_model(layout: Layout | Scene, world: int = 0, *, obj: SceneObject | None = None) -> mujoco.MjModel:
    """Compile an ordinary MuJoCo model of the robot in one world, for oracles and viewers.

    Args:
        layout: Scenes of all worlds, or a single scene.
        world: World index; ignored for a single scene.
        obj: An object to grasp; with one, the robot is the grasping one.

    Returns:
        The model. Inactive slots have no geom; the active ones have the names of `PoolSpec.geom_names`.
    """
    scene = layout.scene(world) if isinstance(layout, Layout) else layout
    spec = robot.load_spec() if obj is None else robot.load_grasp_spec()
    _add_floor(spec)
    for slot in np.flatnonzero(scene.active):
        _add_geom(spec, scene, int(slot))
    if obj is not None:
        add_native_object(spec, obj)
    return spec.compile()


def write_geoms(
    layout: Layout,
    geom_ids: wp.array,
    geom_xpos: wp.array,
    geom_xmat: wp.array,
    geom_size: wp.array,
    geom_rbound: wp.array,
    geom_aabb: wp.array,
    mask: wp.array,
) -> None:
    """Write the masked worlds' slots into the geoms of a batched mujoco-warp model; graph-safe.

    Static geoms have their world poses computed once, when Data is made, so that poses are written to Data
    and sizes to Model (allocated per world with `put_model(batch_sizes=...)`).

    Args:
        layout: Scenes to write.
        geom_ids: Geom of every slot, shape (nslot,), int32.
        geom_xpos: Output, `Data.geom_xpos` [m], shape (nworld, ngeom), vec3.
        geom_xmat: Output, `Data.geom_xmat`, shape (nworld, ngeom), mat33.
        geom_size: Output, `Model.geom_size` [m], shape (nworld, ngeom), vec3.
        geom_rbound: Output, `Model.geom_rbound` [m], shape (nworld, ngeom).
        geom_aabb: Output, `Model.geom_aabb` (centre, half size) [m], shape (nworld, ngeom, 2), vec3.
        mask: Worlds to write, shape (nworld,), bool.
    """
    for name, array in (("geom_size", geom_size), ("geom_rbound", geom_rbound), ("geom_aabb", geom_aabb)):
        if array.shape[0] != layout.nworld:
            raise ValueError(f"{name} needs one row per world ({layout.nworld}), it has {array.shape[0]}")
    wp.launch(
        _write_geoms,
        dim=(layout.nworld, layout.pool.num_slots),
        inputs=[
            slots_of(layout),
            geom_ids,
            mask,
        ],
        outputs=[geom_xpos, geom_xmat, geom_size, geom_rbound, geom_aabb],
        device=layout.device,
    )


@wp.kernel
def _write_geoms(
    # In
    slots: Slots,
    geom_ids: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    # Out
    geom_xpos_out: wp.array2d(dtype=wp.vec3),
    geom_xmat_out: wp.array2d(dtype=wp.mat33),
    geom_size_out: wp.array2d(dtype=wp.vec3),
    geom_rbound_out: wp.array2d(dtype=float),
    geom_aabb_out: wp.array3d(dtype=wp.vec3),
) -> None:
    world, slot = wp.tid()
    if not mask[world]:
        return
    geom = geom_ids[slot]
    if not slots.active[world, slot]:
        geom_xpos_out[world, geom] = wp.vec3(0.0, 0.0, float(wp.static(PARKED_Z_M)))
        return
    half = slots.half_size[world, slot]
    c = wp.cos(slots.yaw[world, slot])
    s = wp.sin(slots.yaw[world, slot])
    geom_xpos_out[world, geom] = slots.pos[world, slot]
    geom_xmat_out[world, geom] = wp.mat33(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    if slots.is_cylinder[slot]:
        # MuJoCo's cylinder size is (radius, half height).
        geom_size_out[world, geom] = wp.vec3(half[0], half[2], 0.0)
        geom_rbound_out[world, geom] = wp.sqrt(half[0] * half[0] + half[2] * half[2])
    else:
        geom_size_out[world, geom] = half
        geom_rbound_out[world, geom] = wp.length(half)
    geom_aabb_out[world, geom, 0] = wp.vec3(0.0, 0.0, 0.0)
    geom_aabb_out[world, geom, 1] = half


def _add_floor(spec: mujoco.MjSpec) -> None:
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        contype=FLOOR_CONTYPE,
        conaffinity=0,
        group=SCENE_GROUP,
        rgba=_FLOOR_RGBA,
    )


def _add_geom(spec: mujoco.MjSpec, scene: Scene, slot: int) -> None:
    """Add one slot of a scene as a static geom of the world body."""
    half = scene.half_size[slot]
    cylinder = bool(scene.is_cylinder[slot])
    rgba = _CYLINDER_RGBA if cylinder else _WALL_RGBA if scene.is_wall[slot] else _BOX_RGBA
    spec.worldbody.add_geom(
        name=scene.pool.geom_names()[slot],
        type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
        size=[half[0], half[2], 0.0] if cylinder else list(half),
        pos=list(scene.pos[slot]),
        quat=[math.cos(0.5 * scene.yaw[slot]), 0.0, 0.0, math.sin(0.5 * scene.yaw[slot])],
        contype=SCENE_CONTYPE,
        conaffinity=0,
        group=SCENE_GROUP,
        rgba=rgba,
    )
