# pyright: reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Forces between fingertips, object and scene, read from the solver's contact list."""

import warp as wp

LEFT_PAD = wp.constant(1)
RIGHT_PAD = wp.constant(2)
FINGER = wp.constant(3)
HARD_PART = wp.constant(4)
SCENE = wp.constant(5)
OBJECT = wp.constant(6)
"""Roles of geoms in `sum_grasp_forces`; 0 is none."""

_COLLISION_BIT = wp.constant(1)
"""Bit of ``contact.type`` that marks a contact of the constraint solver (others serve distance sensors)."""

# Columns of the sums of one substep.
_LEFT = wp.constant(0)
_RIGHT = wp.constant(1)
_TABLE = wp.constant(2)
_HARD = wp.constant(3)
_SUPPORT = wp.constant(4)
NUM_SUMS = 5

wp.set_module_options({"enable_backward": False})


@wp.func
def _column(first: int, second: int) -> int:
    """Sum that a contact between two roles belongs to, -1 for none."""
    low = wp.min(first, second)
    high = wp.max(first, second)
    if high == OBJECT:
        if low == LEFT_PAD:
            return _LEFT
        if low == RIGHT_PAD:
            return _RIGHT
        if low == SCENE:
            return _SUPPORT
    if high == SCENE:
        if low == HARD_PART:
            return _HARD
        if low == LEFT_PAD or low == RIGHT_PAD or low == FINGER:
            return _TABLE
    return -1


@wp.kernel
def _sum_forces(
    contact_geom: wp.array[wp.vec2i],
    contact_world: wp.array[int],
    contact_type: wp.array[int],
    contact_efc: wp.array2d[int],
    num_contacts: wp.array[int],
    efc_force: wp.array2d[float],
    geom_role: wp.array[int],
    sums_out: wp.array2d[float],
):
    contact = wp.tid()
    if contact >= num_contacts[0]:
        return
    # A contact without a row applies no force: it does not touch yet, or there was no room for it.
    row = contact_efc[contact, 0]
    if row < 0 or row >= efc_force.shape[1] or (contact_type[contact] & _COLLISION_BIT) == 0:
        return
    geoms = contact_geom[contact]
    column = _column(geom_role[geoms[0]], geom_role[geoms[1]])
    if column >= 0:
        world = contact_world[contact]
        wp.atomic_add(sums_out, world, column, efc_force[world, row])


@wp.kernel
def _keep_forces(
    sums: wp.array2d[float],
    finger_out: wp.array2d[float],
    table_out: wp.array[float],
    hard_out: wp.array[float],
    support_out: wp.array[wp.bool],
):
    world = wp.tid()
    finger_out[world, 0] = sums[world, _LEFT]
    finger_out[world, 1] = sums[world, _RIGHT]
    table_out[world] = wp.max(table_out[world], sums[world, _TABLE])
    hard_out[world] = wp.max(hard_out[world], sums[world, _HARD])
    support_out[world] = sums[world, _SUPPORT] > 0.0
    for column in range(sums.shape[1]):
        sums[world, column] = 0.0


def grasp_forces(
    contact_geom: wp.array,
    contact_world: wp.array,
    contact_type: wp.array,
    contact_efc: wp.array,
    num_contacts: wp.array,
    efc_force: wp.array,
    geom_role: wp.array,
    sums: wp.array,
    *,
    finger_out: wp.array,
    table_out: wp.array,
    hard_out: wp.array,
    support_out: wp.array,
) -> None:
    """Read the normal forces of one physics step; graph-safe.

    Call it after stepping and before ``mujoco_warp.reset_data``. The cone must be elliptic: there the first
    row of a contact holds its normal force.

    Args:
        contact_geom: ``d.contact.geom``, shape (naconmax,), vec2i: the two geoms of a contact.
        contact_world: ``d.contact.worldid``, shape (naconmax,), int32.
        contact_type: ``d.contact.type``, shape (naconmax,), int32 bit field.
        contact_efc: ``d.contact.efc_address``, shape (naconmax, rows), int32.
        num_contacts: ``d.nacon``, shape (1,), int32: how many entries are in use, over all worlds.
        efc_force: ``d.efc.force`` [N], shape (nworld, njmax).
        geom_role: Role of each geom, shape (ngeom,), int32.
        sums: Scratch, zero before the first call, shape (nworld, NUM_SUMS).
        finger_out: Output, sum of the normal forces of the left and the right pads on the object [N], shape
            (nworld, 2).
        table_out: Output, sum of those of pads and fingers on the scene [N], shape (nworld,); only ever
            raised, so that the largest of several physics steps remains.
        hard_out: Likewise of every other part of the robot on the scene.
        support_out: Output, whether the scene or the floor pushes on the object, shape (nworld,), bool.
    """
    device = sums.device
    wp.launch(
        _sum_forces,
        dim=contact_geom.shape[0],
        inputs=[
            contact_geom,
            contact_world,
            contact_type,
            contact_efc,
            num_contacts,
            efc_force,
            geom_role,
        ],
        outputs=[sums],
        device=device,
    )
    wp.launch(
        _keep_forces,
        dim=sums.shape[0],
        inputs=[sums],
        outputs=[finger_out, table_out, hard_out, support_out],
        device=device,
    )
