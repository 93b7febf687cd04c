# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false, reportIndexIssue=false
# pyright: reportCallIssue=false, reportOperatorIssue=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""A camera that goes to poses in turn, as camera actions for a policy to imitate."""

from collections.abc import Sequence

import warp as wp

from spin_rl import robot
from spin_rl.sensors.interface import Sensor

ARRIVED_RAD = 0.12
"""A head that is so near to a pose, in pan and in tilt, has arrived [rad]."""
MEANT = 0.25
"""Actions that are so near to those of a pose, in both together, mean that pose; of several, the nearest."""

_PAN, _TILT = (wp.constant(robot.DOF_NAMES.index(joint)) for joint in robot.CAMERA_JOINTS)
_PAN_ACTION, _TILT_ACTION = (wp.constant(robot.ACTIONS.index(joint)) for joint in robot.CAMERA_JOINTS)

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _go_on(
    # In
    poses: wp.array[wp.vec2],
    actions: wp.array[wp.vec2],
    arrived: float,
    meant: float,
    qpos: wp.array2d[float],
    action: wp.array2d[float],
    # Out
    gaze_out: wp.array2d[float],
) -> None:
    world = wp.tid()
    sent = wp.vec2(action[world, _PAN_ACTION], action[world, _TILT_ACTION])
    now = int(0)
    nearest = meant
    for i in range(poses.shape[0]):
        away = wp.length(actions[i] - sent)
        if away < nearest:
            nearest = away
            now = i
    away_pan = wp.abs(qpos[world, _PAN] - poses[now][0])
    away_tilt = wp.abs(qpos[world, _TILT] - poses[now][1])
    if wp.max(away_pan, away_tilt) < arrived:
        now = (now + 1) % poses.shape[0]
    gaze_out[world, 0] = actions[now][0]
    gaze_out[world, 1] = actions[now][1]
    gaze_out[world, 2] = 1.0


class Patrol(Sensor):
    """Sends the head to each of a few poses in turn.

    It is sent on to the pose that it was sent to, or, once it has arrived there, to the next one. Unlike
    `Gaze` this goes by nothing but what `proprio` tells: where the head is, and where it was sent. What was
    sent to no pose goes to the first one, so that there is no place between poses where a policy that does
    it by half would be told to stay.

    Attributes:
        gaze: Camera actions that send the head to its next pose, and 1, shape (nworld, 3).
    """

    def __init__(self, poses: Sequence[Sequence[float]], qpos: wp.array, action: wp.array) -> None:
        """Allocate the buffers.

        Args:
            poses: Head pan and tilt [rad] of each pose, all different, within the joints' limits.
            qpos: ``d.qpos``, shape (nworld, nq).
            action: What was executed last, in the order of `robot.ACTIONS`, shape (nworld, num_actions).
        """
        self._qpos, self._action = qpos, action
        actions = [list(map(robot.action_of, robot.CAMERA_JOINTS, pose)) for pose in poses]
        nworld, device = qpos.shape[0], qpos.device
        self._poses = wp.array(poses, dtype=wp.vec2, device=device)
        self._actions = wp.array(actions, dtype=wp.vec2, device=device)
        self.gaze = wp.zeros((nworld, 3), dtype=float, device=device)

    def update(self) -> None:
        """Send the head on where it has arrived; graph-safe."""
        wp.launch(
            _go_on,
            dim=self.gaze.shape[0],
            inputs=[self._poses, self._actions, ARRIVED_RAD, MEANT, self._qpos, self._action],
            outputs=[self.gaze],
            device=self.gaze.device,
        )
