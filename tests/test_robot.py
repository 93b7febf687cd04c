"""The robot against the official URDF's facts, and its servo law against itself at a fine time step."""

import json
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from spin_rl import robot

DATA = Path(__file__).parent / "data"
FK = json.loads((DATA / "re1_forward_kinematics.json").read_text())["samples"]
LINKS = json.loads((DATA / "re1_collision_extents.json").read_text())["links"]
COMMANDS = json.loads((DATA / "command_sequence.json").read_text())

# Capsules are round and the extents are boxes, so corners stand out: 21 mm for the pan bracket below the
# head's plate at extreme tilts, at most 16 mm for every other link.
UNDERCOVER_M = {"link_head_pan": 0.021}
UNDERCOVER_DEFAULT_M = 0.016
EXCESS_M = 0.03  # how far a collision geom may stand out of the links that it stands for


@pytest.fixture(scope="module")
def model():
    return robot.load_spec().compile()


def pose(model, joints):
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, joints)
    mujoco.mj_kinematics(model, data)
    return data


def collision_geoms(model, parts=robot.PARTS):
    return [g for g in range(model.ngeom) if model.geom_group[g] == 3 and part_of(model, g) in parts]


def part_of(model, geom):
    return model.geom(geom).name.split("_")[0]


# --- names, limits, contact bits -------------------------------------------------------------------


def test_joints_and_actuators_stand_in_dof_order(model):
    assert (model.nq, model.nv, model.nu) == (13, 13, 13)
    assert tuple(model.joint(i).name for i in range(model.njnt)) == robot.DOF_NAMES
    assert tuple(model.actuator(i).name for i in range(model.nu)) == robot.DOF_NAMES
    assert model.actuator_trnid[:, 0].tolist() == list(range(13))
    assert len(robot.ACTIONS) == 10


def test_joint_ranges_are_those_of_the_limits(model):
    assert not model.jnt_limited[:3].any()
    limits = dict(zip(robot.JOINTS, zip(robot.JOINT_LOWER, robot.JOINT_UPPER, strict=True), strict=True))
    for dof, (joint, share) in zip(robot.DOF_NAMES[3:], robot.DOF_SOURCE, strict=True):
        assert model.joint(dof).range == pytest.approx(share * np.array(limits[joint])), dof


def test_mass_and_options(model):
    assert model.body_mass.sum() == pytest.approx(24.754, abs=2e-3)
    assert (model.body_gravcomp[1:] == 1).all()
    assert (model.dof_damping == 0).all()
    inertia = np.sort(model.body_inertia[1:], axis=1)
    assert (inertia[:, 0] > 1e-6).all() and (inertia[:, 0] + inertia[:, 1] >= inertia[:, 2]).all()
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.opt.timestep == 0.02


def test_geoms_are_few_and_their_contact_bits_keep_the_contract(model):
    bits = {"base": (0, 5), "mast": (0, 1), "head": (0, 1), "arm": (0, 3), "wrist": (4, 3), "gripper": (4, 3)}
    geoms = collision_geoms(model)
    assert len(geoms) <= 13 and model.ngeom < 30
    assert {part_of(model, g) for g in geoms} == set(robot.PARTS)
    for g in range(model.ngeom):
        wanted = bits[part_of(model, g)] if g in geoms else (0, 0)
        assert (model.geom_contype[g], model.geom_conaffinity[g]) == wanted, model.geom(g).name


# --- qpos_from_joints, camera ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"lift": 1.2}, "lift"),
        ({"head_pan": -4.0}, "head_pan"),
        ({"wrist_roll": math.nan}, "wrist_roll"),
        ({"elbow": 0.0}, "elbow"),
        ({"arm_extension": None}, "arm_extension"),
    ],
)
def test_qpos_from_joints_names_the_bad_key(model, change, key):
    joints = {k: v for k, v in {**robot.STOWED, **change}.items() if v is not None}
    with pytest.raises(ValueError, match=key):
        robot.qpos_from_joints(model, joints)


def test_camera_tangents():
    assert robot.camera_tan_half_fov("portrait") == pytest.approx((0.948965, 0.554309), abs=1e-6)
    assert robot.camera_tan_half_fov("landscape") == pytest.approx((0.554309, 0.948965), abs=1e-6)
    with pytest.raises(ValueError, match="sideways"):
        robot.camera_tan_half_fov("sideways")


def test_mujoco_camera_looks_along_the_optical_frame_and_is_upright(model):
    data = pose(model, {**robot.STOWED, "head_tilt": 0.0})
    mujoco.mj_camlight(model, data)
    optical = data.site("camera_depth_optical_frame")
    x, _, z = optical.xmat.reshape(3, 3).T
    camera = data.camera("depth_camera")
    _, up, back = camera.xmat.reshape(3, 3).T
    assert camera.xpos == pytest.approx(optical.xpos)
    assert np.allclose(-back, z, atol=1e-5) and np.allclose(up, -x, atol=1e-5)
    assert np.allclose(up, [0, 0, 1], atol=1e-5) and np.allclose(z, [1, 0, 0], atol=1e-5)
    assert model.camera("depth_camera").fovy[0] == robot.CAMERA_FOV_DEG[0]


# --- forward kinematics and shape ------------------------------------------------------------------


@pytest.mark.parametrize("sample", FK, ids=range(len(FK)))
def test_forward_kinematics_equals_the_urdf(model, sample):
    data = pose(model, sample["joints"])
    for name, matrix in sample["frames"].items():
        matrix = np.array(matrix)
        site = data.site(name)
        assert np.linalg.norm(site.xpos - matrix[:3, 3]) < 1e-3, name
        turn = matrix[:3, :3].T @ site.xmat.reshape(3, 3)
        # The sine keeps its precision at small angles, where the trace does not.
        sine = np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        assert math.degrees(math.atan2(sine, (np.trace(turn) - 1) / 2)) < 0.1, name


def box_distance(points, centre, rotation, half):
    q = np.abs((points - centre) @ rotation) - half
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)


def geom_distance(model, data, geom, points):
    """Signed distance of points to a box or capsule geom, shape (n,)."""
    centre, rotation = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    size = model.geom_size[geom]
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        return box_distance(points, centre, rotation, size)
    assert model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
    local = (points - centre) @ rotation
    local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
    return np.linalg.norm(local, axis=-1) - size[0]


def link_boxes(model, data, joints):
    """Each URDF link's extents at a pose: its entry, box centre, rotation and half extents."""
    rest = mujoco.MjData(model)
    mujoco.mj_kinematics(model, rest)
    for link in LINKS:
        low, high = np.array(link["aabb_m"])
        body = model.body(link["body"]).id
        rotation = data.xmat[body].reshape(3, 3)
        local = (low + high) / 2 - rest.xpos[body]
        local[1] -= link["extension_share"] * joints["arm_extension"]
        yield link, data.xpos[body] + rotation @ local, rotation, (high - low) / 2


GRID = np.array([p for p in np.ndindex(3, 3, 3) if p != (1, 1, 1)]) - 1.0  # corners, edge and face middles


@pytest.mark.parametrize("sample", FK[:12], ids=range(12))
def test_collision_geoms_cover_every_link(model, sample):
    data = pose(model, sample["joints"])
    for link, centre, rotation, half in link_boxes(model, data, sample["joints"]):
        points = centre + (GRID * half) @ rotation.T
        distance = np.min(
            [geom_distance(model, data, g, points) for g in collision_geoms(model, link["parts"])], axis=0
        )
        assert distance.max() < UNDERCOVER_M.get(link["link"], UNDERCOVER_DEFAULT_M), link["link"]


@pytest.mark.parametrize("sample", FK[:12], ids=range(12))
def test_collision_geoms_are_not_grossly_larger_than_the_links(model, sample):
    data = pose(model, sample["joints"])
    boxes = [box[1:] for box in link_boxes(model, data, sample["joints"])]
    for g in collision_geoms(model):
        centre, rotation = data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3)
        size = model.geom_size[g]
        if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX:
            points = centre + (GRID * size) @ rotation.T
        else:
            sphere = GRID / np.linalg.norm(GRID, axis=1, keepdims=True) * size[0]
            points = np.concatenate(
                [centre + rotation[:, 2] * size[1] * end + sphere for end in (-1.0, 0.0, 1.0)]
            )
        distance = np.min([box_distance(points, *box) for box in boxes], axis=0)
        assert distance.max() < EXCESS_M, model.geom(g).name


@pytest.mark.parametrize("extension", np.linspace(0, 0.52, 14).round(3))
def test_arm_has_no_hole_from_lift_to_wrist(model, extension):
    data = pose(model, {**robot.STOWED, "arm_extension": extension})
    shoulder, end = data.site("link_lift").xpos, data.site("link_arm_l0").xpos
    axis = shoulder + np.linspace(0, 1, 400)[:, None] * (end - shoulder)
    arm = collision_geoms(model, ("arm",))
    # Points 2 cm off the axis too: the tubes must not merely touch at their round ends.
    for offset in ([0, 0, 0], [0.02, 0, 0], [-0.02, 0, 0], [0, 0, 0.02], [0, 0, -0.02]):
        distance = np.min([geom_distance(model, data, g, axis + offset) for g in arm], axis=0)
        assert distance.max() < 0, offset


def test_stowed_pose_is_compact_and_touches_nothing(model):
    data = pose(model, robot.STOWED)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    hand = collision_geoms(model, ("wrist", "gripper"))
    # Of the arm only the lift: the wrist hangs on the arm's other pieces.
    others = collision_geoms(model, ("base", "mast", "head")) + [model.geom("arm").id]
    assert min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in hand for b in others) > 0.02

    base = model.geom("base").id
    low, high = model.geom_pos[base] - model.geom_size[base], model.geom_pos[base] + model.geom_size[base]
    for g in collision_geoms(model):
        size, ends = model.geom_size[g], np.zeros((1, 2))
        if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            ends = np.outer([-size[1], size[1]], data.geom_xmat[g].reshape(3, 3)[:2, 2])
            size = np.full(3, size[0])
        centres = data.geom_xpos[g][:2] + ends
        overhang = max((low[:2] - centres + size[:2]).max(), (centres + size[:2] - high[:2]).max())
        assert overhang < 0.011, model.geom(g).name


def contact_pairs(model, data):
    return {frozenset(part_of(model, g) for g in contact.geom) for contact in data.contact}


def test_gripper_meets_base_and_floor(model):
    down = {**robot.STOWED, "lift": 0.1, "wrist_pitch": -1.0}
    data = pose(model, down)
    mujoco.mj_forward(model, data)
    assert contact_pairs(model, data) == {frozenset({"gripper", "base"})}

    spec = robot.load_spec()
    floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
    floor.contype, floor.conaffinity = 2, 0
    on_floor = spec.compile()
    reach = {**down, "lift": 0.0, "wrist_yaw": 0.0, "arm_extension": 0.3, "wrist_pitch": -1.57}
    data = pose(on_floor, reach)
    mujoco.mj_forward(on_floor, data)
    assert contact_pairs(on_floor, data) == {frozenset({"gripper", "floor"})}


# --- servo law --------------------------------------------------------------------------------------


def roll_out(timestep, profile):
    """States after each control step, shape (20, 13), under the first-order servo law at one time step."""
    model = robot.load_spec().compile()
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos_from_joints(model, COMMANDS["start_joints"])
    share = np.array([s for _, s in robot.DOF_SOURCE])
    source = [robot.JOINTS.index(j) for j, _ in robot.DOF_SOURCE]
    lower, upper = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
    speed_max = share * np.array(profile.joint_velocity_max)[source]
    gain = (1 - math.exp(-timestep / profile.joint_time_constant)) / timestep
    states = []
    for action in np.array(COMMANDS["actions"]):
        target = share * (lower + (action[2:] + 1) / 2 * (upper - lower))[source]
        forward = action[0] * (profile.forward_max if action[0] > 0 else profile.reverse_max)
        turn = action[1] * profile.turn_max
        for _ in range(round(COMMANDS["control_period_s"] / timestep)):
            yaw = data.qpos[2] + 0.5 * timestep * turn
            data.ctrl[:3] = forward * math.cos(yaw), forward * math.sin(yaw), turn
            data.ctrl[3:] = np.clip((target - data.qpos[3:]) * gain, -speed_max, speed_max)
            mujoco.mj_step(model, data)
        states.append(data.qpos.copy())
    return np.array(states)


def test_command_sequence_excites_every_action():
    actions = np.array(COMMANDS["actions"])
    assert actions.shape == (20, 10) and np.abs(actions).max() <= 1
    assert (np.ptp(actions, axis=0) > 1).all()


@pytest.mark.parametrize("name", robot.SPEED_PROFILES)
def test_servo_law_at_20_ms_agrees_with_1_ms(name):
    profile = robot.SPEED_PROFILES[name]
    coarse, fine = roll_out(0.02, profile), roll_out(0.001, profile)
    span = np.array(robot.JOINT_UPPER) - np.array(robot.JOINT_LOWER)
    for i, (joint, share) in enumerate(robot.DOF_SOURCE):
        error = np.abs(coarse - fine)[:, 3 + i].max() / (share * span[robot.JOINTS.index(joint)])
        assert error < 0.01, joint
    steps = np.diff(fine[:, :3], axis=0, prepend=np.zeros((1, 3)))
    travel, turned = np.linalg.norm(steps[:, :2], axis=1).sum(), np.abs(steps[:, 2]).sum()
    assert np.linalg.norm(coarse[:, :2] - fine[:, :2], axis=1).max() < 0.01 * travel
    assert np.abs(coarse - fine)[:, 2].max() < 0.01 * turned
