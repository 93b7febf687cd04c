"""The tasks as gymnasium vector environments.

Importing this module registers them: `gymnasium.make_vec("spin_rl/Nav-v0", num_envs=64)`, and likewise Pick
and Fetch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from tensordict import TensorDict

from spin_rl.scenes.rooms.params import FamilyParams
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.registry import TASKS, find_task

IDS: Mapping[str, str] = MappingProxyType({name: f"spin_rl/{name.capitalize()}-v0" for name in TASKS})
"""Name of a task -> name of its environment."""


class TaskVectorEnv(VectorEnv):
    """Gymnasium's view of a task: NumPy arrays in and out.

    Observations are a dict of the task's groups (docs/tasks.md). `info["outcome"]` names how the episode of
    each world ended in this step, "running" where it goes on. With `AutoresetMode.SAME_STEP` the observation
    of a world that ended is the first of its next episode, and `info["final_obs"]` has the last one. With
    `NEXT_STEP`, which gymnasium's own wrappers such as `NormalizeObservation` want, it is the last one, and
    the next step starts the world anew whatever its action. With `DISABLED` whoever steps it resets worlds by
    a mask, see `reset`.

    A world that turned non-finite has no last observation: it shows the first one of a new episode.
    """

    def __init__(
        self,
        num_envs: int = 1,
        task: str = "nav",
        cfg: TaskConfig | None = None,
        device: str = "cpu",
        seed: int = 0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Create the worlds.

        Args:
            num_envs: Number of worlds.
            task: Name of the task.
            cfg: Its configuration, `spin_rl.training_config(task)` by default;
                `spin_rl.evaluation_config(task)` is that of `spin-eval`.
            device: Warp and Torch device.
            seed: Seed of scenes, start poses, dynamics and noise.
            autoreset_mode: When worlds that ended start anew.
            max_episode_steps: Time limit in steps of 0.1 s in place of the configuration's.
            render_mode: "rgb_array" lets `render` draw pictures; needs the extra `viewer`, slow with many
                worlds.

        Raises:
            ValueError: An argument is impossible; one line that names it.
        """
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode: expected 'rgb_array' or None, got {render_mode!r}")
        spec = find_task(task)
        if cfg is not None and not isinstance(cfg, spec.config):
            raise ValueError(f"cfg: expected a {spec.config.__name__}, got {type(cfg).__name__}")
        modes = [mode.value for mode in AutoresetMode]
        if autoreset_mode not in (*modes, *AutoresetMode):
            raise ValueError(f"autoreset_mode: expected one of {', '.join(modes)}, got {autoreset_mode!r}")
        cfg = _limited(spec.as_trained() if cfg is None else cfg, max_episode_steps)
        self.env = spec.make_env(cfg, num_envs, device, seed)
        self.env.keep_ends()
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {
            "autoreset_mode": self._mode,
            "render_modes": ["rgb_array"],
            "render_fps": round(1.0 / cfg.sim.control_period),
        }
        self._ended = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self._names = np.array(self.env.outcomes)
        self._pictures = None
        if render_mode is not None:
            from spin_rl.viewer.world_pictures import WorldPictures

            self._pictures = WorldPictures(self.env, title=task)
        self._set_spaces(self.env.get_observations())

    def _set_spaces(self, groups: TensorDict) -> None:
        boxes = {}
        for name, value in groups.items():
            if value.dtype == torch.uint8:
                boxes[name] = gym.spaces.Box(0, 255, (value.shape[1],), np.uint8)
            else:
                boxes[name] = gym.spaces.Box(-np.inf, np.inf, (value.shape[1],), np.float32)
        self.single_observation_space = gym.spaces.Dict(boxes)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (self.env.num_actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start new episodes.

        Args:
            seed: Restarts the random numbers of scenes, starts, dynamics and noise; for all worlds at once.
            options: `reset_mask`, shape (num_envs,), bool, resets these worlds only; the others go on.

        Raises:
            ValueError: A mask of another shape or type, one with a seed, or an option that there is not.
        """
        options = dict(options or {})
        given = options.pop("reset_mask", None)
        if options:
            raise ValueError(f"options: {min(options)} is unknown; there is reset_mask")
        super().reset(seed=seed)
        if given is not None:
            mask = self._mask(given, seed)
            self._ended &= ~mask
            return _numpy(self._reset_worlds(mask)), {}
        if seed is not None:
            self.env.reseed(seed)
        self._ended.zero_()
        obs = self.env.reset()
        if self._pictures is not None:
            self._pictures.restart()
        return _numpy(obs), {}

    def _mask(self, given: Any, seed: int | None) -> torch.Tensor:
        mask = np.asarray(given)
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"reset_mask: expected {self.num_envs} booleans, at least one of them true, got {given!r}"
            )
        if seed is not None:
            raise ValueError("seed: restarts the random numbers of all worlds, which reset_mask leaves alone")
        return torch.as_tensor(mask, device=self.env.device)

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply actions of shape (num_envs, 10) for one control period of 0.1 s.

        Raises:
            gymnasium.error.ResetNeeded: Autoreset is disabled and a world has ended.
            ValueError: Actions of another shape.
        """
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise gym.error.ResetNeeded("a world has ended: reset(options={'reset_mask': ...})")
        waiting, level = self._ended, self.env.level.clone()  # worlds whose step is to start anew
        tensor = torch.as_tensor(np.asarray(actions, np.float32), device=self.env.device)
        if tensor.shape != self.action_space.shape:
            raise ValueError(f"actions: expected shape {self.action_space.shape}, got {tuple(tensor.shape)}")
        obs, reward, done, extras = self.env.step(tensor)
        self._ended = done.bool() & ~waiting
        truncated = extras["time_outs"] & self._ended
        outcome = torch.where(waiting, 0, self.env.outcome)
        if self._pictures is not None:
            self._pictures.count_step()
        if waiting.any():  # only with NEXT_STEP
            self.env.level.copy_(torch.where(waiting, level, self.env.level))
            obs = self._reset_worlds(waiting)
            reward = reward.masked_fill(waiting, 0.0)
        info: dict[str, Any] = {"outcome": self._names[outcome.cpu().numpy()]}
        terminated = self._ended & ~truncated
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            info |= self._final(obs, info)
            obs = self._reset_worlds(self._ended)
            self._ended = torch.zeros_like(waiting)
        flags = (flag.cpu().numpy() for flag in (terminated, truncated))
        return _numpy(obs), reward.cpu().numpy(), *flags, info

    def _reset_worlds(self, mask: torch.Tensor) -> TensorDict:
        obs = self.env.reset_worlds(mask)
        if self._pictures is not None:
            self._pictures.begin(np.flatnonzero(mask.cpu().numpy()).tolist())
        return obs

    def _final(self, obs: TensorDict, info: dict[str, Any]) -> dict[str, Any]:
        """Say how worlds ended, in gymnasium's form."""
        last, ended = _numpy(obs), self._ended.cpu().numpy().copy()
        final = np.full(self.num_envs, None, dtype=object)
        for world in np.flatnonzero(ended):
            final[world] = {name: value[world].copy() for name, value in last.items()}
        infos = {name: values.copy() for name, values in info.items()}
        infos |= {f"_{name}": ended for name in info}
        return {"final_obs": final, "_final_obs": ended, "final_info": infos, "_final_info": ended}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return a picture of every world, (rows, columns, 3) each, uint8; None without `render_mode`."""
        return None if self._pictures is None else self._pictures.draw()


def _limited(cfg: TaskConfig, steps: int | None) -> TaskConfig:
    """Give a configuration a time limit in control steps, if there is one."""
    if steps is None:
        return cfg
    if type(steps) is not int or steps < 2:
        raise ValueError(f"max_episode_steps: expected a whole number from 2 on, got {steps!r}")
    if isinstance(getattr(cfg, "scene", None), FamilyParams):
        raise ValueError("max_episode_steps: in scene families the way sets the limit; see task.slack_s")
    return replace(cfg, episode_s=steps * cfg.sim.control_period)


def _numpy(obs: TensorDict) -> dict[str, np.ndarray]:
    return {str(name): obs.get(name).cpu().numpy() for name in obs.keys()}


def register() -> None:
    """Register the environments with gymnasium; importing `spin_rl.gym_env` does it."""
    for task, name in IDS.items():
        if name not in gym.registry:
            gym.register(name, vector_entry_point="spin_rl.gym_env:TaskVectorEnv", kwargs={"task": task})


register()
