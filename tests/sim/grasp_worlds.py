"""Scripted grasps, shared by the tests of manipulation: in the batched simulation and in C MuJoCo.

The native control law below is written in NumPy from docs/manipulation.md.
"""

import math

import mujoco
import numpy as np
import torch
import warp as wp
from omegaconf import OmegaConf

from spin_rl import robot
from spin_rl.config import from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.scenes.objects.shapes import KINDS, OBJECTS, SceneObject
from spin_rl.sim.config import SimConfig
from spin_rl.sim.simulation import Simulation
from spin_rl.sim.targets import ManipulationConfig

CONFIG = from_mapping(SimConfig, OmegaConf.to_container(OmegaConf.load(CONF_DIR / "sim" / "grasp.yaml")))
PROFILE = robot.SPEED_PROFILES["paper"]
POOL = PoolSpec()
TOP = 0.6
OBJECT_XY = (-0.0214, -0.72)
CLOSE, LIFT, HOLD = 10, 7, 6
GRASP_CENTER = robot.GRASP_CENTER_SITE


def grasp_scene(kind, *, yaw=0.0):
    """A table, and the open gripper around an object on it, pitched down at low ones."""
    half = np.array(KINDS[kind].half_extents)
    z = TOP + half[2]
    obj = SceneObject(kind, half, KINDS[kind].mass, 1.2, np.array([*OBJECT_XY, z, yaw]))
    scene = Scene.empty(POOL)
    slot = POOL.first_box
    scene.pos[slot], scene.half_size[slot] = (0.0, -0.85, 0.5 * TOP), (0.4, 0.25, 0.5 * TOP)
    scene.active[slot] = True
    joints = dict(robot.STOWED) | {"wrist_yaw": 0.0, "gripper_finger": 0.5}
    joints["wrist_pitch"] = 0.0 if kind == "bottle" else -0.3
    scene.start_joints = np.array([joints[name] for name in robot.JOINTS])
    # Lift and arm are slides: what the grasp centre lacks is what they must move.
    model = native_model(scene, obj=obj)
    data = mujoco.MjData(model)
    data.qpos[:13] = robot.qpos_from_joints(model, joints)[:13]
    mujoco.mj_kinematics(model, data)
    at = data.site(GRASP_CENTER).xpos
    height = max(z, TOP + 0.024)
    scene.start_joints[:2] += height - at[2], at[1] - OBJECT_XY[1]
    return scene, obj


SCENES = [grasp_scene(kind, yaw=math.pi / 2 if kind == "banana" else 0.0) for kind in OBJECTS]


def script():
    """Actions of closing, a lift of 0.25 m at 0.4 m/s, and holding, shape (steps, 10)."""
    actions = np.zeros((CLOSE + LIFT + HOLD, len(robot.ACTIONS)))
    actions[:, robot.ACTIONS.index("gripper_finger")] = -1.0
    lift = robot.ACTIONS.index("lift")
    actions[CLOSE : CLOSE + LIFT, lift] = 1.0
    actions[CLOSE + LIFT - 1, lift] = 0.25
    return actions


def make_sim(scenes, device):
    """A simulation with manipulation, one world per (scene, object), at their starts."""
    sim = Simulation(len(scenes), POOL, PROFILE, CONFIG, device, manipulation=ManipulationConfig())
    put(sim, scenes)
    restart(sim)
    return sim


def put(sim, scenes):
    views = sim.object.views
    for world, (scene, obj) in enumerate(scenes):
        sim.layout.load(scene, world)
        views.kind[world] = OBJECTS.index(obj.kind)
        views.mass[world], views.friction[world] = obj.mass, obj.friction
        views.half_extents[world] = torch.tensor(obj.half_extents)
        views.start_pose[world] = torch.tensor(obj.start_pose)


def restart(sim, mask=None):
    mask = np.ones(sim.nworld, dtype=bool) if mask is None else mask
    with wp.ScopedDevice(sim.device):
        sim.reset(wp.array(mask, dtype=bool))
        sim.forward()


def in_gripper(sim):
    """The object's position in the gripper's frame [m], shape (nworld, 3)."""
    with wp.ScopedDevice(sim.device):
        sim.forward()
    site = sim.mj_model.site(GRASP_CENTER).id
    turn = wp.to_torch(sim.data.site_xmat)[:, site].view(-1, 3, 3)
    offset = sim.object.views.pos - sim.views.site_pos[:, site]
    return torch.einsum("nij,ni->nj", turn, offset).cpu().numpy().copy()


class NativeGrasp:
    """One world of the same in C MuJoCo, under the same law."""

    SHARE = np.array([share for _, share in robot.DOF_SOURCE])
    SOURCE = np.array([robot.JOINTS.index(joint) for joint, _ in robot.DOF_SOURCE])
    STEP = np.array([0.04, 0.04, 0.2, 0.15, 0.2, 0.0, 0.3, 0.3])
    LEAD = np.array([0.08, 0.08, 0.4, 0.3, 0.4, 0.24, 0.6, 0.6])

    def __init__(self, scene, obj):
        self.model = native_model(scene, obj=obj)
        self.model.opt.timestep = CONFIG.timestep
        self.model.opt.iterations, self.model.opt.ls_iterations = CONFIG.iterations, CONFIG.ls_iterations
        self.data = mujoco.MjData(self.model)
        joints = dict(zip(robot.JOINTS, scene.start_joints, strict=True))
        self.data.qpos[:] = robot.qpos_from_joints(self.model, joints)
        self.target = scene.start_joints.copy()

    def joints(self):
        q = self.data.qpos
        return np.array([q[3], q[4] + q[5], *q[6:9], 0.5 * (q[9] + q[10]), q[11], q[12]])

    def step(self, action):
        h = CONFIG.timestep
        at = self.joints()
        self.target += action[2:] * self.STEP
        self.target[5] = 0.35 + 0.6 * action[7]
        self.target = np.clip(self.target, at - self.LEAD, at + self.LEAD)
        self.target = np.clip(self.target, robot.JOINT_LOWER, robot.JOINT_UPPER)
        limit = self.SHARE * np.array(PROFILE.joint_velocity_max)[self.SOURCE]
        gain = (1.0 - math.exp(-h / PROFILE.joint_time_constant)) / h
        goal = self.SHARE * self.target[self.SOURCE]
        for _ in range(CONFIG.substeps):
            self.data.ctrl[3:] = np.clip((goal - self.data.qpos[3:13]) * gain, -limit, limit)
            mujoco.mj_step(self.model, self.data)

    def finger_forces(self):
        """Normal forces of the left and right pads on the object in the last substep [N]."""
        sums = np.zeros(2)
        pads = [{self.model.geom(name).id for name in names} for names in robot.PADS.values()]
        for index, contact in enumerate(self.data.contact):
            if (self.model.geom_bodyid[contact.geom] == self.model.body("object").id).any():
                force = np.zeros(6)
                mujoco.mj_contactForce(self.model, self.data, index, force)
                for side in (0, 1):
                    sums[side] += force[0] if pads[side] & set(contact.geom.tolist()) else 0.0
        return sums
