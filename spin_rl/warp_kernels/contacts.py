# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportAttributeAccessIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Which parts of the robot touch the scene, read from the solver's contact list."""

import warp as wp

_COLLISION_BIT = wp.constant(1)
"""Bit of ``contact.type`` that marks a contact of the constraint solver (others serve distance sensors)."""

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _clear_flags(part_out: wp.array2d[wp.bool], self_out: wp.array[wp.bool]):
    world = wp.tid()
    for part in range(part_out.shape[1]):
        part_out[world, part] = False
    self_out[world] = False


@wp.kernel
def _scan_contacts(
    contact_geom: wp.array[wp.vec2i],
    contact_world: wp.array[int],
    contact_dist: wp.array[float],
    contact_type: wp.array[int],
    num_contacts: wp.array[int],
    geom_part: wp.array[int],
    geom_is_scene: wp.array[wp.bool],
    part_out: wp.array2d[wp.bool],
    self_out: wp.array[wp.bool],
):
    contact = wp.tid()
    if contact >= num_contacts[0] or contact_dist[contact] >= 0.0:
        return
    if (contact_type[contact] & _COLLISION_BIT) == 0:
        return
    world = contact_world[contact]
    geoms = contact_geom[contact]
    first = geom_part[geoms[0]]
    second = geom_part[geoms[1]]
    # Several threads may set one flag; all of them write True.
    if first >= 0 and second >= 0:
        self_out[world] = True
    elif first >= 0 and geom_is_scene[geoms[1]]:
        part_out[world, first] = True
    elif second >= 0 and geom_is_scene[geoms[0]]:
        part_out[world, second] = True


def clear_part_contacts(part_out: wp.array, self_out: wp.array) -> None:
    """Clear the flags of `part_contacts`; same arrays."""
    wp.launch(_clear_flags, dim=part_out.shape[0], outputs=[part_out, self_out], device=part_out.device)


def part_contacts(
    contact_geom: wp.array,
    contact_world: wp.array,
    contact_dist: wp.array,
    contact_type: wp.array,
    num_contacts: wp.array,
    geom_part: wp.array,
    geom_is_scene: wp.array,
    *,
    part_out: wp.array,
    self_out: wp.array,
) -> None:
    """Flag the robot parts that penetrate a scene geom or the floor, and the worlds with a self-contact.

    Flags are only ever set here, so that several physics steps add up; `clear_part_contacts` starts over.

    Call it after stepping and before ``mujoco_warp.reset_data``, which leaves stale entries in the list.
    Graph-safe.

    Args:
        contact_geom: ``d.contact.geom``, shape (naconmax,), vec2i: the two geoms of a contact.
        contact_world: ``d.contact.worldid``, shape (naconmax,), int32.
        contact_dist: ``d.contact.dist`` [m], shape (naconmax,), float; only penetration (< 0) counts.
        contact_type: ``d.contact.type``, shape (naconmax,), int32 bit field.
        num_contacts: ``d.nacon``, shape (1,), int32: how many entries are in use, over all worlds.
        geom_part: Part index of each robot geom and -1 for every other geom, shape (ngeom,), int32.
        geom_is_scene: Whether a geom is an obstacle, wall, or the floor, shape (ngeom,), bool.
        part_out: Output, shape (nworld, nparts), bool: the part touches a scene geom.
        self_out: Output, shape (nworld,), bool: two robot geoms touch each other.
    """
    device = part_out.device
    wp.launch(
        _scan_contacts,
        dim=contact_geom.shape[0],
        inputs=[
            contact_geom,
            contact_world,
            contact_dist,
            contact_type,
            num_contacts,
            geom_part,
            geom_is_scene,
        ],
        outputs=[part_out, self_out],
        device=device,
    )
