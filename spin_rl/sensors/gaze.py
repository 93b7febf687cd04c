# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# pyright: reportCallIssue=false, reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Where to look, as camera actions for a policy to imitate: the target of `runners.ppo.gaze`."""

import math

import warp as wp

from spin_rl import robot
from spin_rl.scenes.tabletops.start_pose import head_towards, within_reach
from spin_rl.sensors.interface import Sensor
from spin_rl.sensors.memory import SeenThings
from spin_rl.sensors.scandots import Obstacles
from spin_rl.sim.targets import action_for
from spin_rl.warp_kernels.gaze import find_next
from spin_rl.warp_kernels.slots import Slots, slots_of

LEAD_S = 0.8
"""What is nearest to where the base will be after this time comes first [s], as in `analysis/sight`."""
FRESH_S = 0.1
"""What moves is known for so long after it was seen [s]: it is looked at until it stands."""

_PAN, _TILT = (robot.JOINTS.index(joint) for joint in robot.CAMERA_JOINTS)
_LOW = wp.constant(wp.vec2(robot.JOINT_LOWER[_PAN], robot.JOINT_LOWER[_TILT]))
_HIGH = wp.constant(wp.vec2(robot.JOINT_UPPER[_PAN], robot.JOINT_UPPER[_TILT]))
_AHEAD = wp.constant(1.0)
"""How far from the base the camera looks along its way [m] ..."""
_HEIGHT = wp.constant(0.3)
"""... and how high [m]: floor and walls from the base on are in the image."""
_OF_IMAGE = 0.6
"""Part of the half image above its middle that a thing is in at most."""
_STOWED = wp.constant(wp.vec2(*(robot.STOWED[joint] for joint in robot.CAMERA_JOINTS)))

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _aim(
    # In
    slots: Slots,
    slot: wp.array(dtype=wp.int32),
    qpos: wp.array2d(dtype=float),
    ahead: wp.array(dtype=wp.vec2),
    most_above: float,
    # Out
    gaze_out: wp.array2d(dtype=float),
) -> None:
    world = wp.tid()
    base = wp.vec3(qpos[world, 0], qpos[world, 1], qpos[world, 2])
    way = ahead[world] - wp.vec2(base[0], base[1])
    aim = wp.vec2()
    if slot[world] >= 0:
        # Between it and the floor below it, if the image is high enough for both.
        thing = slots.pos[world, slot[world]]
        aim = head_towards(base, wp.cw_mul(thing, wp.vec3(1.0, 1.0, 0.5)))
        aim[1] = wp.max(aim[1], head_towards(base, thing)[1] - most_above)
    elif wp.length(way) > 0.0:
        way = _AHEAD * wp.normalize(way)
        aim = head_towards(base, wp.vec3(base[0] + way[0], base[1] + way[1], _HEIGHT))
    else:
        for i in range(3):
            gaze_out[world, i] = 0.0
        return
    aim[0] = within_reach(aim[0])
    for i in range(2):
        angle = wp.clamp(aim[i], _LOW[i], _HIGH[i])
        gaze_out[world, i] = action_for(angle, _LOW[i], _STOWED[i], _HIGH[i])
    gaze_out[world, 2] = 1.0


class Gaze(Sensor):
    """Looks towards the unknown thing that the base will be nearest to soon (``spin_rl.warp_kernels.gaze``).

    It knows things that no camera has shown yet, also those that are still hidden. Where everything that will
    be near is known it looks along the way, and it says nothing at its end.

    Attributes:
        gaze: Camera actions that point the head there, and 1; or zeros, shape (nworld, 3).
    """

    def __init__(
        self,
        obstacles: Obstacles,
        qpos: wp.array,
        qvel: wp.array,
        ahead: wp.array,
        seen: SeenThings,
        *,
        near_m: float,
        mount: robot.CameraMount,
        period: float,
    ) -> None:
        """Allocate the buffers.

        Args:
            obstacles: Obstacle slots, shape (nworld, nslot).
            qpos: ``d.qpos``, shape (nworld, nq).
            qvel: ``d.qvel``, shape (nworld, nv).
            ahead: Where the way goes, the goal or the planner's next point of it [m], shape (nworld,), vec2.
            seen: What the camera has shown; updated before this one is.
            near_m: Only what is nearer to the base then counts: until then a camera along the way shows what
                appears on it [m].
            mount: How the camera is mounted: how high its image is.
            period: Time between two steps [s].
        """
        self._slots, self._is_wall = slots_of(obstacles), obstacles.is_wall
        self._qpos, self._qvel, self._memory = qpos, qvel, seen.memory
        self._ahead = ahead
        self._most_above = _OF_IMAGE * math.atan(robot.camera_tan_half_fov(mount)[0])
        self._near, self._fresh = near_m, round(FRESH_S / period)
        nworld, device = obstacles.pos.shape[0], obstacles.pos.device
        self._next = wp.zeros(nworld, dtype=wp.int32, device=device)
        self.gaze = wp.zeros((nworld, 3), dtype=float, device=device)

    def update(self) -> None:
        """Aim anew; graph-safe."""
        find_next(
            self._slots,
            self._is_wall,
            self._qpos,
            self._qvel,
            self._memory,
            fresh=self._fresh,
            lead=LEAD_S,
            near=self._near,
            slot_out=self._next,
        )
        wp.launch(
            _aim,
            dim=self.gaze.shape[0],
            inputs=[self._slots, self._next, self._qpos, self._ahead, self._most_above],
            outputs=[self.gaze],
            device=self.gaze.device,
        )
