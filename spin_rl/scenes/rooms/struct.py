# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Parameters of the scene families as kernels read them."""

import dataclasses
from functools import lru_cache

import warp as wp

from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.rooms.params import GROUPS, FamilyParams

vec_shares = wp.types.vector(length=len(FAMILIES), dtype=float)


@wp.struct
class FamilyStruct:
    """What `FamilyParams` adds to `GeneratorParams`, as the kernels read it; `shares` are cumulative."""

    shares: vec_shares
    way: wp.vec2
    gap: float
    close_share: float
    furniture_density: wp.vec2
    furniture_empty_share: float
    furniture_hanging_share: float
    corridor_paper_share: float
    corridor_corners: wp.vec2i
    corridor_leg: wp.vec2
    corridor_obstacles_per_m: wp.vec2
    corridor_dead_end_share: float
    corridor_dead_end: wp.vec2
    room_size: wp.vec2
    room_wing_share: float
    doorway_length: wp.vec2
    doorway_width: wp.vec2
    doorway_door_width: wp.vec2
    doorway_three_share: float
    field_things: wp.vec2i
    field_size: wp.vec2
    field_floating_share: float
    crossing_length: wp.vec2
    crossing_width: wp.vec2
    crossing_lane: wp.vec2
    crossing_stations: wp.vec2i
    crossing_opening: wp.vec2
    crossing_mover_share: float
    crossing_patrolling_share: float
    crossing_floating_share: float
    crossing_half_size: wp.vec2
    crossing_trigger: wp.vec2
    crossing_speed: wp.vec2
    walker_share: float
    walker_half_size: wp.vec2
    walker_way: wp.vec2
    walker_speed: wp.vec2
    shuttle_width: wp.vec2
    shuttle_passage: float
    shuttle_ahead: wp.vec2
    shuttle_back: wp.vec2
    shuttle_floating_share: float
    shuttle_floating: wp.vec2
    shuttle_trigger: wp.vec2
    shuttle_speed: wp.vec2


@lru_cache(maxsize=8)
def family_struct(params: FamilyParams) -> FamilyStruct:
    """The kernels' copy of the parameters."""
    struct = FamilyStruct()
    shares = [getattr(params.shares, name) for name in FAMILIES]
    struct.shares = vec_shares(*(sum(shares[: i + 1]) / sum(shares) for i in range(len(shares))))
    struct.way = wp.vec2(*params.way)
    struct.gap = params.gap
    struct.close_share = params.close_share
    for group in GROUPS:
        values = getattr(params, group)
        for entry in dataclasses.fields(values):
            value = getattr(values, entry.name)
            if isinstance(value, tuple):
                value = wp.vec2i(*value) if isinstance(value[0], int) else wp.vec2(*value)
            setattr(struct, f"{group}_{entry.name}", value)
    return struct
