"""Fetches put into any state, for tests."""

import torch
import warp as wp

from spin_rl import robot
from spin_rl.sim.targets import ABSOLUTE, INCREMENTAL
from spin_rl.tasks.fetch.config import STAGES

REACH, ALIGN, PICK, RETRACT, CARRY, PLACE = range(len(STAGES))
NUM_WORLDS = 4


def state(env, name):
    """A Torch view of one of the fetch's arrays."""
    return wp.to_torch(getattr(env._state, name))


def idle(env):
    return torch.zeros(env.num_envs, 10, device=env.device)


def stand_at(env, point, world, yaw=None):
    """Put a robot down somewhere at rest, arm stowed."""
    qpos, qvel = env.sim.views.qpos, env.sim.views.qvel
    qpos[world, :2] = torch.as_tensor(point, dtype=torch.float32)
    if yaw is not None:
        qpos[world, 2] = yaw
    stowed = robot.qpos_from_joints(env.sim.mj_model, robot.STOWED)[3:13]
    qpos[world, 3:13] = torch.as_tensor(stowed, dtype=torch.float32)
    qvel[world, :13] = 0.0
    env.sim.views.base_velocity[world] = 0.0


def put_object(env, position, world):
    qpos, qvel = env.sim.views.qpos, env.sim.views.qvel
    qpos[world, 13:16] = torch.as_tensor(position, dtype=torch.float32)
    qpos[world, 16:20] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    qvel[world, 13:] = 0.0


def enter(env, stage, world, phase=0):
    state(env, "stage")[world] = stage
    state(env, "time")[world] = 0
    state(env, "phase")[world] = phase
    state(env, "phase_time")[world] = 0
    env.sim.views.mode[world] = INCREMENTAL if stage == PICK else ABSOLUTE


def table_yaw(env, world):
    return float(env.sim.layout.yaw.numpy()[world, env.cfg.scene.table_slot])
