# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Scene geoms in MuJoCo: the fixed pool of the batched model, and ordinary models of one world."""

import math

import mujoco
import mujoco_warp as mjw
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
NEAR_GROUP = 3
"""Of geoms that are touched and not seen, as the robot's collision shape."""

_WALL_RGBA = (0.82, 0.82, 0.80, 1.0)
_BOX_RGBA = (0.62, 0.56, 0.48, 1.0)
_CYLINDER_RGBA = (0.50, 0.56, 0.62, 1.0)
_FLOOR_RGBA = (0.45, 0.47, 0.50, 1.0)

wp.set_module_options({"enable_backward": False})


def add_pool(spec: mujoco.MjSpec, pool: PoolSpec, nearby: int | None = None) -> None:
    """Add the floor and one parked static geom for every slot to the world body.

    Contact bits: robot geoms collide with contype 1 (scene) and, for the arm, 2 (floor); see
    `robots/stretch_re1`.

    Args:
        spec: Specification to add to.
        pool: Slots of every world.
        nearby: Where the pool has more slots than this, these are only seen, and as many boxes and cylinders
            are added that follow the robot (`near_geom_names`), for it to touch. None: all are touched.
    """
    _add_floor(spec)
    follows = nearby is not None and nearby < pool.num_slots
    parked = Scene.empty(pool)
    parked.pos[:, 2] = PARKED_Z_M
    for slot in range(pool.num_slots):
        _add_geom(spec, parked, slot, touched=not follows)
    if follows:
        for cylinder, names in enumerate(near_geom_names(pool, nearby)):
            for name in names:
                spec.worldbody.add_geom(
                    name=name,
                    type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
                    size=[0.05, 0.05, 0.0 if cylinder else 0.05],
                    pos=[0.0, 0.0, PARKED_Z_M],
                    contype=SCENE_CONTYPE,
                    conaffinity=0,
                    group=NEAR_GROUP,
                )


def near_geom_names(pool: PoolSpec, nearby: int) -> tuple[list[str], list[str]]:
    """Names of the boxes and of the cylinders that follow the robot in a larger pool than `nearby`."""
    boxes = min(nearby, pool.first_cylinder)
    cylinders = min(nearby, pool.num_cylinders)
    return [f"near_box_{i}" for i in range(boxes)], [f"near_cylinder_{i}" for i in range(cylinders)]


def native_model(
    layout: Layout | Scene, world: int = 0, *, obj: SceneObject | None = None, movable: bool = False
) -> mujoco.MjModel:
    """Compile an ordinary MuJoCo model of the robot in one world, for oracles and viewers.

    Args:
        layout: Scenes of all worlds, or a single scene.
        world: World index; ignored for a single scene.
        obj: An object to grasp; with one, the robot is the grasping one.
        movable: Make slots that move mocap bodies with the names of their geoms.

    Returns:
        The model. Inactive slots have no geom; the active ones have the names of `PoolSpec.geom_names`.
    """
    scene = layout.scene(world) if isinstance(layout, Layout) else layout
    spec = robot.load_spec() if obj is None else robot.load_grasp_spec()
    _add_floor(spec)
    for slot in np.flatnonzero(scene.active):
        _add_geom(spec, scene, int(slot), movable=movable)
    if obj is not None:
        add_native_object(spec, obj)
    return spec.compile()


@wp.struct
class Geoms:
    """The arrays of a batched mujoco-warp model that say where its geoms are, and how large.

    Static geoms have their world poses computed once, when Data is made, so that poses are written to Data
    and sizes to Model (allocated per world with `put_model(batch_sizes=...)`). Shapes: (nworld, ngeom), of
    `aabb` (centre, half size) (nworld, ngeom, 2); lengths in metres.
    """

    xpos: wp.array2d[wp.vec3]
    xmat: wp.array2d[wp.mat33]
    size: wp.array2d[wp.vec3]
    rbound: wp.array2d[float]
    aabb: wp.array3d[wp.vec3]


def geoms_of(model: mjw.Model, data: mjw.Data) -> Geoms:
    """Collect the arrays of a model and its data.

    Raises:
        ValueError: A field of the model was not allocated for every world; the message names it.
    """
    geoms = Geoms()
    geoms.xpos, geoms.xmat = data.geom_xpos, data.geom_xmat
    nworld = data.geom_xpos.shape[0]
    for name in ("size", "rbound", "aabb"):
        array = getattr(model, f"geom_{name}")
        if array.shape[0] != nworld:
            raise ValueError(f"geom_{name} needs one row per world ({nworld}), it has {array.shape[0]}")
        setattr(geoms, name, array)
    return geoms


def write_geoms(layout: Layout, geom_ids: wp.array, geoms: Geoms, mask: wp.array) -> None:
    """Write the masked worlds' slots into the geoms of a batched mujoco-warp model; graph-safe.

    Args:
        layout: Scenes to write.
        geom_ids: Geom of every slot, shape (nslot,), int32.
        geoms: Output.
        mask: Worlds to write, shape (nworld,), bool.
    """
    wp.launch(
        _write_geoms,
        dim=(layout.nworld, layout.pool.num_slots),
        inputs=[
            slots_of(layout),
            geom_ids,
            mask,
        ],
        outputs=[geoms],
        device=layout.device,
    )


def write_near_geoms(
    layout: Layout, distance: wp.array, within: float, box_ids: wp.array, cylinder_ids: wp.array, geoms: Geoms
) -> None:
    """Write the slots `layout.nearby` of all worlds into the geoms that follow the robot; graph-safe.

    Args:
        layout: Scenes to write.
        distance: Of these slots from the robot [m], shape (nworld, k).
        within: Slots that are farther are left out [m].
        box_ids: Geoms of the boxes, as many as there may be nearby, shape (n,), int32.
        cylinder_ids: Geoms of the cylinders, likewise.
        geoms: Output; those that no slot takes are parked.
    """
    wp.launch(
        _write_near_geoms,
        dim=layout.nworld,
        inputs=[slots_of(layout), layout.nearby, distance, within, box_ids, cylinder_ids],
        outputs=[geoms],
        device=layout.device,
    )


@wp.func
def _write_geom(world: int, slot: int, geom: int, slots: Slots, geoms: Geoms) -> None:
    half = slots.half_size[world, slot]
    c = wp.cos(slots.yaw[world, slot])
    s = wp.sin(slots.yaw[world, slot])
    geoms.xpos[world, geom] = slots.pos[world, slot]
    geoms.xmat[world, geom] = wp.mat33(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    if slots.is_cylinder[slot]:
        # MuJoCo's cylinder size is (radius, half height).
        geoms.size[world, geom] = wp.vec3(half[0], half[2], 0.0)
        geoms.rbound[world, geom] = wp.sqrt(half[0] * half[0] + half[2] * half[2])
    else:
        geoms.size[world, geom] = half
        geoms.rbound[world, geom] = wp.length(half)
    geoms.aabb[world, geom, 0] = wp.vec3(0.0, 0.0, 0.0)
    geoms.aabb[world, geom, 1] = half


@wp.kernel
def _write_geoms(
    # In
    slots: Slots,
    geom_ids: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=bool),
    # Out
    geoms: Geoms,
) -> None:
    world, slot = wp.tid()
    if not mask[world]:
        return
    geom = geom_ids[slot]
    if not slots.active[world, slot]:
        geoms.xpos[world, geom] = wp.vec3(0.0, 0.0, float(wp.static(PARKED_Z_M)))
        return
    _write_geom(world, slot, geom, slots, geoms)


@wp.kernel
def _write_near_geoms(
    # In
    slots: Slots,
    nearby: wp.array2d(dtype=wp.int32),
    distance: wp.array2d(dtype=float),
    within: float,
    box_ids: wp.array(dtype=wp.int32),
    cylinder_ids: wp.array(dtype=wp.int32),
    # Out
    geoms: Geoms,
) -> None:
    world = wp.tid()
    boxes = int(0)
    cylinders = int(0)
    for k in range(nearby.shape[1]):
        slot = nearby[world, k]
        if slot >= 0 and distance[world, k] <= within:
            geom = int(0)
            if slots.is_cylinder[slot]:
                geom = cylinder_ids[cylinders]
                cylinders += 1
            else:
                geom = box_ids[boxes]
                boxes += 1
            _write_geom(world, slot, geom, slots, geoms)
    parked = wp.vec3(0.0, 0.0, float(wp.static(PARKED_Z_M)))
    for i in range(boxes, box_ids.shape[0]):
        geoms.xpos[world, box_ids[i]] = parked
    for i in range(cylinders, cylinder_ids.shape[0]):
        geoms.xpos[world, cylinder_ids[i]] = parked


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


def _add_geom(
    spec: mujoco.MjSpec, scene: Scene, slot: int, *, touched: bool = True, movable: bool = False
) -> None:
    """Add one slot of a scene as a static geom of the world body; if it moves, and may, of a mocap body."""
    half = scene.half_size[slot]
    cylinder = bool(scene.is_cylinder[slot])
    rgba = _CYLINDER_RGBA if cylinder else _WALL_RGBA if scene.is_wall[slot] else _BOX_RGBA
    name, body, pos = scene.pool.geom_names()[slot], spec.worldbody, list(scene.pos[slot])
    if movable and scene.motion_speed[slot] > 0.0:
        body, pos = body.add_body(name=name, pos=pos, mocap=True), [0.0, 0.0, 0.0]
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
        size=[half[0], half[2], 0.0] if cylinder else list(half),
        pos=pos,
        quat=[math.cos(0.5 * scene.yaw[slot]), 0.0, 0.0, math.sin(0.5 * scene.yaw[slot])],
        contype=SCENE_CONTYPE if touched else 0,
        conaffinity=0,
        group=SCENE_GROUP,
        rgba=rgba,
    )
