# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where the robot sees the object (the paper's F(o_t)): by the simulator, or by a detector in images."""

import warp as wp

from spin_rl import robot
from spin_rl.detection.segmentation import CENTRE_OFFSET_M, SegmentationDetector
from spin_rl.scenes.objects.shapes import OBJECT_GEOMS, OBJECTS
from spin_rl.sensors.depth.camera import DepthCamera
from spin_rl.sensors.depth.size import image_shape
from spin_rl.sensors.interface import Sensor
from spin_rl.sensors.object_sight import ObjectSight
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.common.depth import DepthImages
from spin_rl.tasks.common.objects.config import SightConfig

_FINER = 4
"""Rows and columns of the detector's image for each of the policy's."""
_MIN_PIXELS = 20
_OBJECT = wp.constant(len(robot.DOF_NAMES))
_OFFSETS = wp.constant(
    wp.types.vector(length=len(OBJECTS), dtype=float)(*(CENTRE_OFFSET_M[kind] for kind in OBJECTS))
)

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _read_positions(
    # In
    qpos: wp.array2d(dtype=float),
    # Out
    at_out: wp.array(dtype=wp.vec3),
) -> None:
    w = wp.tid()
    at_out[w] = wp.vec3(qpos[w, _OBJECT], qpos[w, _OBJECT + 1], qpos[w, _OBJECT + 2])


@wp.kernel
def _choose_offsets(
    # In
    kind: wp.array(dtype=wp.int32),
    # Out
    offset_out: wp.array(dtype=float),
) -> None:
    w = wp.tid()
    offset_out[w] = _OFFSETS[kind[w]]


@wp.kernel
def _to_world(
    # In
    qpos: wp.array2d(dtype=float),
    point_b: wp.array(dtype=wp.vec3),
    visible: wp.array(dtype=bool),
    # Out
    at_out: wp.array(dtype=wp.vec3),
) -> None:
    w = wp.tid()
    if visible[w]:
        c = wp.cos(qpos[w, 2])
        s = wp.sin(qpos[w, 2])
        p = point_b[w]
        at_out[w] = wp.vec3(qpos[w, 0] + c * p[0] - s * p[1], qpos[w, 1] + s * p[0] + c * p[1], p[2])


class Sight(Sensor):
    """Owns what is seen of the object in every world, and refreshes it inside the captured step.

    Without a detector an object is seen where it is, and the robot itself hides nothing; see `ObjectSight`.
    With one, what the arm or the hand hides is not seen. Objects are then found in exact depth images of
    their own, finer than the policy's, and the camera's mounting error of a policy with noisy images applies
    to them as well. Their position in the world is that in the base frame moved by the true pose of the
    base, as by perfect odometry.

    Attributes:
        seen: Whether the object is seen now, shape (num_envs,), bool.
        at: Where it is seen, world [m], shape (num_envs,), vec3; has no meaning while it is not.
    """

    def __init__(
        self,
        sim: Simulation,
        detector: str,
        cfg: SightConfig,
        *,
        camera_mount: robot.CameraMount,
        images: DepthImages | None,
    ) -> None:
        """Allocate the flags and the detector's camera.

        Args:
            sim: The simulation.
            detector: One of `DETECTORS`.
            cfg: When the camera sees the object, without a detector.
            camera_mount: "portrait" or "landscape".
            images: The policy's depth images, if it reads any.
        """
        self._sim = sim
        camera_site = sim.mj_model.site(robot.CAMERA_SITE).id
        tan_half_fov = robot.camera_tan_half_fov(camera_mount)
        self._detector: SegmentationDetector | None = None
        with wp.ScopedDevice(sim.device):
            self.at = wp.zeros(sim.nworld, dtype=wp.vec3)
        if detector == "none":
            self._sight = ObjectSight(
                sim.layout,
                qpos=sim.data.qpos,
                site_xpos=sim.data.site_xpos,
                site_xmat=sim.data.site_xmat,
                object_column=len(robot.DOF_NAMES),
                camera_site=camera_site,
                tan_half_fov=tan_half_fov,
                near=cfg.near_m,
                far=cfg.far_m,
                occlusion=cfg.occlusion,
            )
            self.seen = self._sight.seen
            return
        rows, columns = image_shape(camera_mount)
        self._camera = DepthCamera(
            sim.mj_model,
            sim.model,
            sim.data,
            camera_site=camera_site,
            tan_half_fov=tan_half_fov,
            shape=(_FINER * rows, _FINER * columns),
        )
        if images is not None:
            self._camera.mount_pos, self._camera.mount_rot = images.camera.mount_pos, images.camera.mount_rot
        model = sim.mj_model
        self._detector = SegmentationDetector(
            self._camera,
            sim.data,
            base_body=model.body("base").id,
            geoms=[model.geom(name).id for name in OBJECT_GEOMS],
            min_pixels=_MIN_PIXELS,
        )
        self.seen = self._detector.visible

    def update(self) -> None:
        """Look for the objects at the current poses; graph-safe, and call it after the kinematics."""
        sim, n = self._sim, self._sim.nworld
        if self._detector is None:
            self._sight.update()
            wp.launch(_read_positions, dim=n, inputs=[sim.data.qpos], outputs=[self.at], device=sim.device)
            return
        detector = self._detector
        wp.launch(
            _choose_offsets,
            dim=n,
            inputs=[sim.object.kind],
            outputs=[detector.centre_offset],
            device=sim.device,
        )
        self._camera.update()
        detector.update()
        wp.launch(
            _to_world,
            dim=n,
            inputs=[sim.data.qpos, detector.point_b, detector.visible],
            outputs=[self.at],
            device=sim.device,
        )
