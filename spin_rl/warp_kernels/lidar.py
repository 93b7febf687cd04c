# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A lidar whose rays turn in one horizontal plane, among the slots of all worlds.

Ray i points i full turns / rays counter-clockwise from the base's +x. Every slot shortens the rays within the
angle that it can cover, so that a world costs about as many tests as rays are hit.
"""

import warp as wp

from spin_rl.warp_kernels.geometry import ray_box, ray_cylinder, rotate_yaw, rotate_yaw_inverse
from spin_rl.warp_kernels.slots import Slots

NO_RETURN = wp.constant(0.0)
"""Range of a ray that came back from nothing, as the RPLidar reports it."""

NOT_SWEPT = wp.constant(-1.0)
"""Range of a ray that the mirror has not passed in this control step."""

_TURN = wp.constant(6.283185307179586)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Mount:
    """Where the lidar is in the base frame [m], and the rays that the robot itself hides, shape (rays,)."""

    x: float
    y: float
    z: float
    hidden: wp.array[wp.bool]


@wp.struct
class Beam:
    """What a ray measures: between ``near`` and ``far`` [m], with normal noise of a share of the range."""

    near: float
    far: float
    noise: float


@wp.func
def _laser(mount: Mount, pose: wp.vec3) -> wp.vec3:
    """Where the lidar is in the world."""
    offset = rotate_yaw(wp.vec3(mount.x, mount.y, mount.z), wp.cos(pose[2]), wp.sin(pose[2]))
    return wp.vec3(pose[0] + offset[0], pose[1] + offset[1], offset[2])


@wp.kernel
def _clear(value: float, ranges_out: wp.array2d[float]):
    world, ray = wp.tid()
    ranges_out[world, ray] = value


@wp.kernel
def _cast(
    obstacles: Slots,
    active: wp.array2d[wp.bool],
    qpos: wp.array2d[float],
    mount: Mount,
    ranges_out: wp.array2d[float],
):
    """Shorten the rays that may hit a slot, one thread per world and slot."""
    world, slot = wp.tid()
    if not active[world, slot]:
        return
    centre = obstacles.pos[world, slot]
    half = obstacles.half_size[world, slot]
    pose = wp.vec3(qpos[world, 0], qpos[world, 1], qpos[world, 2])
    laser = _laser(mount, pose)
    if wp.abs(laser[2] - centre[2]) > half[2]:
        return
    rays = ranges_out.shape[1]
    step = _TURN / float(rays)
    yaw = obstacles.yaw[world, slot]
    cos_yaw = wp.cos(yaw)
    sin_yaw = wp.sin(yaw)
    origin = rotate_yaw_inverse(laser - centre, cos_yaw, sin_yaw)
    distance = wp.sqrt(origin[0] * origin[0] + origin[1] * origin[1])
    reach = half[0]
    if not obstacles.is_cylinder[slot]:
        reach = wp.sqrt(half[0] * half[0] + half[1] * half[1])
    first = int(0)
    count = rays
    if distance > reach:
        middle = wp.atan2(centre[1] - laser[1], centre[0] - laser[0]) - pose[2]
        wide = wp.asin(reach / distance)
        first = int(wp.floor((middle - wide) / step))
        count = wp.min(int(wp.ceil(2.0 * wide / step)) + 2, rays)
    for k in range(count):
        ray = (first + k) % rays
        if ray < 0:
            ray = ray + rays
        angle = pose[2] + step * float(ray)
        direction = rotate_yaw_inverse(wp.vec3(wp.cos(angle), wp.sin(angle), 0.0), cos_yaw, sin_yaw)
        hit = float(0.0)
        if obstacles.is_cylinder[slot]:
            hit = ray_cylinder(origin, direction, half[0], half[2])
        else:
            hit = ray_box(origin, direction, half)
        wp.atomic_min(ranges_out, world, ray, hit)


@wp.kernel
def _measure(
    seed: wp.array[int],
    episode: wp.array[int],
    step: wp.array[int],
    swept: int,
    mount: Mount,
    beam: Beam,
    ranges_out: wp.array2d[float],
):
    """Turn exact ranges into what the lidar reports, one thread per world and ray."""
    world, ray = wp.tid()
    rays = ranges_out.shape[1]
    since = (ray - step[world] * swept) % rays
    if since < 0:
        since = since + rays
    if since >= swept:
        ranges_out[world, ray] = NOT_SWEPT
        return
    exact = ranges_out[world, ray]
    drawn = world * 1000003 + episode[world] * 10007 + step[world] * 101
    rng = wp.rand_init(seed[0] + 15485863, drawn * rays + ray)
    measured = exact * (1.0 + beam.noise * wp.randn(rng))
    if mount.hidden[ray] or exact > beam.far or measured < beam.near:
        measured = NO_RETURN
    ranges_out[world, ray] = measured


@wp.kernel
def _restart(mask: wp.array[wp.bool], step_out: wp.array[int]):
    world = wp.tid()
    if mask[world]:
        step_out[world] = -1


@wp.kernel
def _count(step_out: wp.array[int]):
    world = wp.tid()
    step_out[world] = step_out[world] + 1


def restart_turns(mask: wp.array, *, step_out: wp.array) -> None:
    """Let the next count be step 0 in the masked worlds, shape (nworld,), bool and int32; graph-safe."""
    wp.launch(_restart, dim=mask.shape, inputs=[mask], outputs=[step_out], device=mask.device)


def count_steps(*, step_out: wp.array) -> None:
    """Count a control step in all worlds, shape (nworld,), int32; graph-safe."""
    wp.launch(_count, dim=step_out.shape, outputs=[step_out], device=step_out.device)


def cast_rays(
    obstacles: Slots,
    active: wp.array,
    qpos: wp.array,
    mount: Mount,
    *,
    farthest: float,
    ranges_out: wp.array,
) -> None:
    """Compute the exact ranges of all rays; graph-safe.

    Args:
        obstacles: Obstacle slots, shape (nworld, nslot).
        active: Which of them exist, in place of the struct's own, shape (nworld, nslot), bool.
        qpos: Base x, y [m] and yaw [rad] in columns 0 to 2, shape (nworld, 3 or more).
        mount: Where the lidar is.
        farthest: Range of a ray that hits nothing [m].
        ranges_out: Ranges [m], 0 from inside of a slot, shape (nworld, rays).
    """
    device = qpos.device
    wp.launch(_clear, dim=ranges_out.shape, inputs=[farthest], outputs=[ranges_out], device=device)
    wp.launch(
        _cast,
        dim=obstacles.pos.shape,
        inputs=[obstacles, active, qpos, mount],
        outputs=[ranges_out],
        device=device,
    )


def measure_ranges(
    seed: wp.array,
    episode: wp.array,
    step: wp.array,
    mount: Mount,
    beam: Beam,
    *,
    swept: int,
    ranges_out: wp.array,
) -> None:
    """Turn exact ranges into measured ones, in place; graph-safe.

    Args:
        seed: Random seed, shape (1,), int32.
        episode: Number of the episode, which noise depends on, shape (nworld,), int32.
        step: Number of the control step in it, which says where the mirror is, shape (nworld,), int32.
        mount: Says which rays are hidden.
        beam: What a ray measures.
        swept: Rays that the mirror passes in a control step; at least as many as there are take all.
        ranges_out: Exact ranges in; measured ones, `NO_RETURN` or `NOT_SWEPT` out [m], shape (nworld, rays).
    """
    wp.launch(
        _measure,
        dim=ranges_out.shape,
        inputs=[seed, episode, step, swept, mount, beam],
        outputs=[ranges_out],
        device=ranges_out.device,
    )
