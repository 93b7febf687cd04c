# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What the scripts of a fetch know of robot and surroundings, here read from the simulator."""

import warp as wp

from spin_rl import robot
from spin_rl.deploy.fetch.numbers import HOLDS_N
from spin_rl.scenes.footprint import Disc, disc_touches
from spin_rl.sim.simulation import Simulation
from spin_rl.tasks.pick.episode import Forces
from spin_rl.warp_kernels.slots import Slots, slots_of

_LEFT = wp.constant(robot.DOF_NAMES.index("finger_left"))
_RIGHT = wp.constant(robot.DOF_NAMES.index("finger_right"))
_NEAR_M = wp.constant(1.0)
"""Radius around the base's origin in which walls and obstacles are known; its corners are at 0.34 m."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class Known:
    """All that scripts read beside their own memory in `FetchState`, leading axis nworld.

    The comments say what a robot would have to estimate it from. The frame is that in which the corridor
    begins along +x with its middle at y = 0, z up from the floor.
    """

    base: wp.array[wp.vec3]  # x, y [m], yaw [rad]: odometry, or localization in a map
    turning: wp.array[float]  # [rad/s]: gyroscope
    target: wp.array2d[float]  # of the joints, as last commanded, in `robot.JOINTS` order [m or rad]
    finger: wp.array[float]  # angle of the fingers [rad]: the gripper's encoder
    holds: wp.array[wp.bool]  # something hangs in the hand: effort of the gripper, and of the lift
    supported: wp.array[wp.bool]  # what is held, or the hand, stands on something: effort of the lift
    table_yaw: wp.array[float]  # direction across the table, away from the robot [rad]: its edge in images
    near: Slots  # walls and obstacles near the base: a map of laser scans or images, cells as boxes


@wp.kernel
def _know(
    # In
    slots: Slots,
    table_slot: int,
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    forces: Forces,
    # Out
    known: Known,
) -> None:
    w = wp.tid()
    known.base[w] = wp.vec3(qpos[w, 0], qpos[w, 1], qpos[w, 2])
    known.turning[w] = qvel[w, 2]
    known.finger[w] = 0.5 * (qpos[w, _LEFT] + qpos[w, _RIGHT])
    pressed = forces.finger[w, 0] + forces.finger[w, 1] > HOLDS_N
    known.holds[w] = pressed and not forces.support[w]
    known.supported[w] = forces.support[w] or forces.table[w] > HOLDS_N
    known.table_yaw[w] = slots.yaw[w, table_slot]
    around = Disc()
    around.radius = _NEAR_M
    around.low = -1.0e3
    around.high = 1.0e3
    for slot in range(slots.active.shape[1]):
        pos = slots.pos[w, slot]
        yaw = slots.yaw[w, slot]
        half = slots.half_size[w, slot]
        known.near.pos[w, slot] = pos
        known.near.yaw[w, slot] = yaw
        known.near.half_size[w, slot] = half
        is_near = disc_touches(around, qpos[w, 0], qpos[w, 1], 0.0, pos, yaw, half, slots.is_cylinder[slot])
        known.near.active[w, slot] = slots.active[w, slot] and is_near


class Knowledge:
    """Fills `known` from the simulator's memory.

    Attributes:
        known: What scripts read.
    """

    def __init__(self, sim: Simulation, forces: Forces, table_slot: int) -> None:
        """Allocate the arrays.

        Args:
            sim: The simulation, with manipulation.
            forces: Forces of the last control step.
            table_slot: The slot that is the table.
        """
        layout, n = sim.layout, sim.nworld
        near = Slots()
        known = Known()
        with wp.ScopedDevice(sim.device):
            for name in ("pos", "yaw", "half_size", "active"):
                setattr(near, name, wp.zeros_like(getattr(layout, name)))
            near.is_cylinder = layout.is_cylinder
            for name in ("base", "turning", "finger", "holds", "supported", "table_yaw"):
                setattr(known, name, wp.zeros(n, dtype=Known.vars[name].type.dtype))
        known.target = sim.target
        known.near = near
        self.known = known
        self._device = sim.device
        self._inputs = [slots_of(layout), table_slot, sim.data.qpos, sim.data.qvel, forces]

    def update(self) -> None:
        """Read the present state of all worlds; graph-safe."""
        n = self.known.base.shape[0]
        wp.launch(_know, dim=n, inputs=self._inputs, outputs=[self.known], device=self._device)
