# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportAssignmentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""The guard's part for the arm: it stands where its action would move it into what was seen."""

import mujoco
import numpy as np
import warp as wp

from spin_rl import robot
from spin_rl.sim.simulation import Simulation
from spin_rl.sim.targets import action_for, joint_position, joint_target
from spin_rl.warp_kernels.guard.hulls import (
    FIRST_ARM_HULL,
    NUM_HULLS,
    Hulls,
    Shapes,
    half_of,
    hulls_of,
    in_base,
    middle_of,
    reach_of,
)
from spin_rl.warp_kernels.guard.trial import Things, gap_between, is_level, thing_of

_FIRST_HEAD = wp.constant(robot.JOINTS.index(robot.CAMERA_JOINTS[0]))
_AHEAD_S = wp.constant(0.2)
"""Time that the arm's actions are foreseen: the next step, and one for the arm to stand [s]."""
_NEAR_M = wp.constant(0.01)
"""Distance that counts as a hit [m]."""
_DEEPER_M = wp.constant(0.002)
"""What a hull overlaps already it goes deeper into when it does by so much [m]."""

wp.set_module_options({"enable_backward": False, "max_unroll": 1})


@wp.struct
class Joints:
    """The joints as an action moves them: arrays (njoint,) in `robot.JOINTS` order, or (ndof,).

    ``low``, ``stowed`` and ``high`` are set-points [m, rad], ``speed`` limits [m/s, rad/s]; ``joint`` and
    ``share`` say how degrees of freedom follow joints, ``slides`` which are slides. ``moves`` (nshape, ndof)
    says which move a shape.
    """

    low: wp.array[float]
    stowed: wp.array[float]
    high: wp.array[float]
    speed: wp.array[float]
    joint: wp.array[int]
    share: wp.array[float]
    slides: wp.array[wp.bool]
    moves: wp.array2d[wp.bool]


@wp.struct
class Bodies:
    """Where geoms and joints are in the world, as MuJoCo has them, (nworld, ngeom) or (nworld, njoint)."""

    geom_pos: wp.array2d[wp.vec3]
    geom_frame: wp.array2d[wp.mat33]
    anchor: wp.array2d[wp.vec3]
    axis: wp.array2d[wp.vec3]


def make_joints(sim: Simulation, shapes: Shapes) -> Joints:
    """Collect limits and find out which degrees of freedom move which shapes."""
    model, limits = sim.mj_model, sim.limits
    geoms, ndof = shapes.geom.numpy(), len(robot.DOF_NAMES)
    moves = np.zeros((len(geoms), ndof), dtype=bool)
    for i, geom in enumerate(geoms):
        body = model.geom_bodyid[geom]
        while body > 0:
            first = model.body_dofadr[body]
            moves[i, first : first + model.body_dofnum[body]] = model.body_dofnum[body] > 0
            body = model.body_parentid[body]
    joints = Joints()
    joints.low, joints.stowed, joints.high = limits.joint_low, limits.joint_default, limits.joint_high
    joints.speed, joints.joint, joints.share = limits.joint_speed, limits.dof_joint, limits.dof_share
    slides = model.jnt_type[model.dof_jntid[:ndof]] == mujoco.mjtJoint.mjJNT_SLIDE
    joints.slides = wp.array(slides, dtype=bool, device=sim.device)
    joints.moves = wp.array(moves, dtype=bool, device=sim.device)
    return joints


@wp.func
def _move(world: int, dof: int, joints: Joints, action: wp.array2d[float], qpos: wp.array2d[float]) -> float:
    """How far a degree of freedom gets towards where its action leads it [m, rad]."""
    joint = joints.joint[dof]
    share = joints.share[dof]
    a = wp.clamp(action[world, 2 + joint], -1.0, 1.0)
    to = share * joint_target(a, joints.low[joint], joints.stowed[joint], joints.high[joint])
    most = share * joints.speed[joint] * _AHEAD_S
    return wp.clamp(to - qpos[world, dof], -most, most)


@wp.func
def hulls_soon(
    world: int,
    soon: Hulls,
    shapes: Shapes,
    joints: Joints,
    bodies: Bodies,
    action: wp.array2d[float],
    qpos: wp.array2d[float],
) -> Hulls:
    """Make hulls hold what the arm's geoms will be in, too, moved by the joints' velocities."""
    base = wp.vec3(qpos[world, 0], qpos[world, 1], 0.0)
    yaw = qpos[world, 2]
    for i in range(shapes.geom.shape[0]):
        hull = shapes.hull[i]
        if hull >= FIRST_ARM_HULL:
            geom = shapes.geom[i]
            centre = bodies.geom_pos[world, geom]
            moved = wp.vec3(0.0, 0.0, 0.0)
            for dof in range(3, joints.joint.shape[0]):
                if joints.moves[i, dof]:
                    along = bodies.axis[world, dof]
                    if not joints.slides[dof]:
                        along = wp.cross(along, centre - bodies.anchor[world, dof])
                    moved += _move(world, dof, joints, action, qpos) * along
            at = in_base(centre + moved - base, yaw)
            reach = reach_of(shapes, i, bodies.geom_frame[world, geom], yaw)
            for axis in range(3):
                soon.low[hull, axis] = wp.min(soon.low[hull, axis], at[axis] - reach[axis])
                soon.high[hull, axis] = wp.max(soon.high[hull, axis], at[axis] + reach[axis])
    return soon


@wp.func
def _goes_in(world: int, now: Hulls, soon: Hulls, things: Things) -> bool:
    """Whether the arm will touch what it does not now, or go deeper into it."""
    for k in range(things.count[world]):
        for hull in range(FIRST_ARM_HULL, NUM_HULLS):
            if is_level(world, k, things, soon, hull):
                allowed = float(_NEAR_M)
                if is_level(world, k, things, now, hull):
                    allowed = wp.min(allowed, things.gap[world, k][hull] - _DEEPER_M)
                if (
                    gap_between(middle_of(soon, hull), half_of(soon, hull), thing_of(world, k, things))
                    < allowed
                ):
                    return True
    return False


@wp.kernel
def _hold_arm(
    shapes: Shapes,
    joints: Joints,
    bodies: Bodies,
    qpos: wp.array2d[float],
    hull_low: wp.array2d[wp.vec3],
    hull_high: wp.array2d[wp.vec3],
    things: Things,
    recovery_left: wp.array[int],
    action: wp.array2d[float],
) -> None:
    """Keep the arm where it is, also where the guard drives by itself: the policy has no plan for that."""
    world = wp.tid()
    if recovery_left[world] == 0:
        if things.count[world] == 0:
            return
        now = hulls_of(world, hull_low, hull_high)
        soon = hulls_soon(world, hulls_of(world, hull_low, hull_high), shapes, joints, bodies, action, qpos)
        if not _goes_in(world, now, soon, things):
            return
    for joint in range(_FIRST_HEAD):
        at = joint_position(world, joint, joints.joint, joints.share, qpos)
        hold = action_for(at, joints.low[joint], joints.stowed[joint], joints.high[joint])
        action[world, 2 + joint] = wp.clamp(hold, -1.0, 1.0)  # a hair beyond a limit may be far beyond it


def hold_arm(
    sim: Simulation,
    shapes: Shapes,
    joints: Joints,
    hull_low: wp.array,
    hull_high: wp.array,
    things: Things,
    recovery_left: wp.array,
) -> None:
    """Let arms stand that would move into what is remembered, or whose base is on a way out; graph-safe.

    Args:
        sim: The simulation, whose actions are changed.
        shapes: The robot's collision geoms.
        joints: What moves them.
        hull_low: Boxes around the robot, see `hulls.measure_hulls`.
        hull_high: Their highest corners.
        things: What is near, as the guard has gathered it.
        recovery_left: Steps of a way out that are left, shape (num_envs,), int32.
    """
    data = sim.data
    bodies = Bodies()
    bodies.geom_pos, bodies.geom_frame = data.geom_xpos, data.geom_xmat
    bodies.anchor, bodies.axis = data.xanchor, data.xaxis
    wp.launch(
        _hold_arm,
        dim=recovery_left.shape[0],
        inputs=[shapes, joints, bodies, data.qpos, hull_low, hull_high, things, recovery_left, sim.action],
        device=sim.device,
    )
