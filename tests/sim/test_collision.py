"""Which parts touch what, in unequal worlds, with C MuJoCo as the judge."""

import mujoco
import numpy as np
import pytest
from sim_worlds import STOWED, advance, restart, scene_with, simulate

from spin_rl import robot
from spin_rl.scenes.builder import native_model
from spin_rl.sim.config import SimConfig
from spin_rl.sim.graph import StepGraph


def pose(**changes):
    return tuple((dict(robot.STOWED) | changes)[joint] for joint in robot.JOINTS)


REACHING = pose(lift=0.7, arm_extension=0.4, wrist_yaw=0.0, wrist_pitch=0.0)
START = (0.3, -0.2, 0.4)
# Part, pose, collision geom at which a small box is put, and where on its long axis [m].
CASES = {
    "base": (STOWED, "base", 0.08),
    "mast": (STOWED, "mast", 0.0),
    "head": (STOWED, "head", 0.03),
    "camera": (STOWED, "head_1", -0.03),
    "lift": (REACHING, "arm", 0.05),
    "arm": (REACHING, "arm_2", 0.0),
    "wrist": (REACHING, "wrist", -0.05),
    "gripper": (REACHING, "gripper", -0.02),
    "finger": (REACHING, "gripper_1", -0.08),
}
PART = {"camera": "head", "lift": "arm", "finger": "gripper"}


def box_at(joints, geom, along):
    """World position on a geom's axis."""
    scene = scene_with(start=START, joints=joints)
    model = native_model(scene)
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, dict(zip(robot.JOINTS, joints, strict=True)))
    data.qpos[:3] = START
    mujoco.mj_kinematics(model, data)
    found = data.geom(geom)
    return found.xpos + found.xmat.reshape(3, 3)[:, 2] * along


def native_parts(scene):
    """Parts that C MuJoCo finds in contact with the scene."""
    model = native_model(scene)
    data = mujoco.MjData(model)
    joints = dict(zip(robot.JOINTS, scene.start_joints, strict=True))
    data.qpos[:] = robot.qpos_from_joints(model, joints)
    data.qpos[:3] = scene.start
    mujoco.mj_forward(model, data)
    parts = set()
    for contact in data.contact:
        bodies = model.geom_bodyid[contact.geom]
        if contact.dist < 0 and (bodies == 0).any():
            parts.add(model.geom(contact.geom[np.argmax(bodies)]).name.split("_")[0])
    return parts


def flagged(sim):
    return [
        {part for part, touched in zip(robot.PARTS, row, strict=True) if touched}
        for row in sim.views.part_contacts.cpu().numpy()
    ]


def test_each_part_is_flagged_in_its_own_world(device):
    # One substep: the flags are those of its start, before the servos are pushed away.
    scenes = [
        scene_with(box_at(joints, geom, along), 0.01, START, joints) for joints, geom, along in CASES.values()
    ]
    scenes.append(scene_with(start=START))
    sim = simulate(scenes, device, SimConfig(substeps=1))
    advance(sim)
    assert flagged(sim) == [{PART.get(name, name)} for name in CASES] + [set()]
    assert flagged(sim) == [native_parts(scene) for scene in scenes]
    assert not sim.views.self_contact.any()


def test_floor_counts_for_the_arm_and_the_base_for_itself(device):
    on_floor = pose(lift=0.0, arm_extension=0.3, wrist_yaw=0.0, wrist_pitch=-1.57)
    on_base = pose(lift=0.3, wrist_pitch=-1.0)
    scenes = [scene_with(joints=joints) for joints in (on_floor, on_base, STOWED)]
    sim = simulate(scenes, device, SimConfig(substeps=1))
    advance(sim)
    assert flagged(sim) == [{"gripper"}, set(), set()]
    assert sim.views.self_contact.tolist() == [False, True, False]


def test_robot_that_drives_into_a_box_is_flagged_when_it_arrives(device):
    # The base's front is 59.5 mm before its origin; the box begins at x = 0.4 m and only world 0 has it.
    sim = simulate([scene_with((0.5, 0.0, 0.06), (0.1, 0.4, 0.06)), scene_with()], device)
    graph = StepGraph(sim.advance, device)
    base = robot.PARTS.index("base")
    touched = []
    for _ in range(12):
        sim.views.action[:, 0] = 1.0
        before = sim.views.qpos[:, 0].clone()
        graph.replay()
        flags = sim.views.part_contacts.cpu().numpy()
        assert not flags[1].any() and not np.delete(flags[0], base).any()
        touched.append(bool(flags[0, base]))
        arrived = 0.0595 + sim.views.qpos[0, 0] > 0.4
        if not arrived:
            assert not touched[-1]
        if 0.0595 + before[0] > 0.4:
            assert touched[-1]
    first = touched.index(True)
    assert first > 2 and all(touched[first:])
    x = sim.views.qpos[:, 0].tolist()
    assert 0.34 < x[0] < 0.36  # it stays outside, up to 2 cm
    assert x[1] > 0.7


def test_moved_box_is_met_where_it_is_now(device):
    # Static geoms' poses and bounds are written by the reset: a box that grew and moved must be felt.
    sim = simulate([scene_with((3.0, 0.0, 0.05), 0.01)] * 2, device, SimConfig(substeps=1))
    advance(sim)
    assert flagged(sim) == [set(), set()]
    sim.layout.load(scene_with((0.3, 0.0, 0.05), (0.28, 0.1, 0.05)), 1)
    restart(sim)
    advance(sim)
    assert flagged(sim) == [set(), {"base"}]


@pytest.mark.parametrize("field", ["timestep", "substeps", "iterations", "contacts_per_world"])
def test_impossible_options_are_named(field):
    with pytest.raises(ValueError, match=rf"sim\.{field}"):
        SimConfig(**{field: 0})
