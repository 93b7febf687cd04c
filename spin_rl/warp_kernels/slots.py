# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""The slots of all worlds, upright boxes and cylinders, as kernels read and write them."""

from typing import Protocol

import warp as wp

wp.set_module_options({"enable_backward": False})


class SlotArrays(Protocol):
    """What has the arrays of `Slots`, such as a ``Layout`` of ``spin_rl.scenes``."""

    pos: wp.array
    yaw: wp.array
    half_size: wp.array
    active: wp.array
    is_cylinder: wp.array


@wp.struct
class Slots:
    """Slots of all worlds; arrays of shape (nworld, nslot), ``is_cylinder`` (nslot,).

    ``pos`` is the centre in the world [m], ``yaw`` the turn about z [rad], ``half_size`` half extents [m],
    (radius, radius, half height) of a cylinder. What is not ``active`` does not exist.
    """

    pos: wp.array2d[wp.vec3]
    yaw: wp.array2d[float]
    half_size: wp.array2d[wp.vec3]
    active: wp.array2d[wp.bool]
    is_cylinder: wp.array[wp.bool]


def slots_of(arrays: SlotArrays) -> Slots:
    """Make the struct of arrays, which it shares."""
    slots = Slots()
    for name in Slots.vars:
        setattr(slots, name, getattr(arrays, name))
    return slots


@wp.func
def put_slot(world: int, slot: int, pos: wp.vec3, yaw: float, half: wp.vec3, slots: Slots) -> None:
    """Write one active slot."""
    slots.pos[world, slot] = pos
    slots.yaw[world, slot] = yaw
    slots.half_size[world, slot] = half
    slots.active[world, slot] = True
