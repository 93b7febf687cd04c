# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Whether the camera sees the object: the masking function F of the pick policy (SPIN 2.1.1)."""

import warp as wp

from spin_rl.scenes.layout import Layout
from spin_rl.sensors.interface import Sensor
from spin_rl.warp_kernels.slots import Slots, slots_of
from spin_rl.warp_kernels.visibility import Box, Camera, Points, in_frustum, remove_hidden

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _see_objects(
    # In
    obstacles: Slots,
    nearby: wp.array2d(dtype=wp.int32),
    qpos: wp.array2d(dtype=float),
    first: int,
    site_xpos: wp.array2d(dtype=wp.vec3),
    site_xmat: wp.array2d(dtype=wp.mat33),
    camera_site: int,
    tan_half_fov: wp.vec2,
    near: float,
    far: float,
    occlusion: bool,
    # Out
    seen_out: wp.array(dtype=bool),
) -> None:
    w = wp.tid()
    camera = Camera()
    camera.pos = site_xpos[w, camera_site]
    camera.to_cam = wp.transpose(site_xmat[w, camera_site])
    camera.tan_half_fov = tan_half_fov
    camera.near = near
    point = wp.vec3(qpos[w, first], qpos[w, first + 1], qpos[w, first + 2])
    depth = (camera.to_cam * (point - camera.pos))[2]
    seen = int(0)
    if depth <= far and in_frustum(camera, point):
        seen = 1
        if occlusion:
            points = Points()
            for i in range(3):
                points[0, i] = point[i]
            target = Box()
            target.pos = point
            target.cos_yaw = 1.0
            seen = remove_hidden(points, 1, seen, camera, target, obstacles, nearby, w)
    seen_out[w] = seen != 0


class ObjectSight(Sensor):
    """Owns the flag of every world and refreshes it with one kernel launch.

    An object is seen if its centre is in the camera's frustum, within its range, and no obstacle slot (the
    table is one) is in between. The robot itself hides nothing here.

    Attributes:
        seen: Whether the camera sees the object, shape (nworld,), bool.
    """

    def __init__(
        self,
        layout: Layout,
        qpos: wp.array,
        site_xpos: wp.array,
        site_xmat: wp.array,
        *,
        object_column: int,
        camera_site: int,
        tan_half_fov: tuple[float, float],
        near: float,
        far: float,
        occlusion: bool = True,
    ) -> None:
        """Allocate the flags and keep references to the arrays that `update` reads.

        Args:
            layout: Obstacle slots.
            qpos: ``d.qpos``, shape (nworld, nq).
            site_xpos: ``d.site_xpos`` [m], shape (nworld, nsite), vec3.
            site_xmat: ``d.site_xmat``, shape (nworld, nsite), mat33.
            object_column: First of the three columns of `qpos` with the object's position.
            camera_site: Index of the camera's optical frame (x right, y down, z forward) among the sites.
            tan_half_fov: Tangent of half the field of view along the optical x and y axes.
            near: Smallest depth that the camera sees [m].
            far: Largest depth [m].
            occlusion: Whether obstacles hide the object.
        """
        self.seen = wp.zeros(layout.nworld, dtype=bool, device=layout.device)
        self._inputs = [
            slots_of(layout),
            layout.nearby,
            qpos,
            object_column,
            site_xpos,
            site_xmat,
            camera_site,
            wp.vec2(*tan_half_fov),
            near,
            far,
            occlusion,
        ]

    def update(self) -> None:
        """Recompute the flags from the current poses; graph-safe, and call it after the kinematics."""
        wp.launch(
            _see_objects,
            dim=self.seen.shape[0],
            inputs=self._inputs,
            outputs=[self.seen],
            device=self.seen.device,
        )
