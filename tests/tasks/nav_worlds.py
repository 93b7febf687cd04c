"""Snapshots and actions that the tests of the navigation task share."""

import numpy as np
import torch

from spin_rl.scenes.layout import Layout


def actions(steps, num_envs, seed=0, forward=0.3):
    """Random actions, shape (steps, num_envs, 10), with some bias towards driving forward."""
    generator = torch.Generator().manual_seed(seed)
    result = 2 * torch.rand(steps, num_envs, 10, generator=generator) - 1
    result[..., 0] += forward
    return result


def snapshot(env) -> dict[str, np.ndarray]:
    """Everything that belongs to a world, one row per world, copied to the host."""
    sim = env.sim
    arrays = {name: getattr(sim.data, name) for name in ("qpos", "qvel", "geom_xpos", "geom_xmat", "time")}
    arrays |= {name: getattr(sim.model, name) for name in ("geom_size", "geom_rbound", "geom_aabb")}
    arrays |= {f"layout_{name}": getattr(sim.layout, name) for name in Layout._PER_WORLD}
    arrays |= {"lag": sim.dynamics.lag, "speed_scale": sim.dynamics.speed_scale}
    arrays |= {"base_velocity": sim.base_velocity, "action": sim.action}
    values = {name: array.numpy().copy() for name, array in arrays.items()}
    values["episode_length"] = env.episode_length_buf.cpu().numpy().copy()
    values["level"] = env.level.cpu().numpy().copy()
    return values


def run(env, sequence) -> list[dict[str, np.ndarray]]:
    """Positions, rewards, dones and observations of every step."""
    record = []
    for action in sequence:
        obs, reward, done, _ = env.step(action.to(env.device))
        step = {"qpos": env.sim.views.qpos, "reward": reward, "done": done, **obs}
        record.append({name: value.cpu().numpy().copy() for name, value in step.items()})
    return record


def assert_same(first, second, worlds=slice(None)):
    """Two records of `run` are the same bits."""
    assert len(first) == len(second)
    for i, (a, b) in enumerate(zip(first, second, strict=True)):
        for name in a:
            np.testing.assert_array_equal(a[name][worlds], b[name][worlds], err_msg=f"{name} at step {i}")
