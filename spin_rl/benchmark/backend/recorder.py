"""How the episodes of a batched benchmark began and ended, for those who run them again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from tensordict import TensorDict

from spin_rl.benchmark.metrics import Episodes
from spin_rl.policy import Policy
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.objects.shapes import SceneObject
from spin_rl.tasks.common.env import TaskEnv
from spin_rl.tasks.nav.env import NavEnv


@dataclass(frozen=True)
class Start:
    """An episode before its first step.

    Attributes:
        scene: The world, with start and goal.
        most_steps: Control steps until its time is over.
        way: Length of the way to the goal, if there is one [m].
        thing: The object to pick, if there is one.
    """

    scene: Scene
    most_steps: int
    way: float = 0.0
    thing: SceneObject | None = None


class Recorder:
    """Keeps how the episodes of a batched benchmark began and ended; its `watch` argument.

    Attributes:
        starts: In the order of worlds, seed after seed.
        ends: Likewise, a group of every seed.
    """

    def __init__(self) -> None:
        self.starts: list[Start] = []
        self.ends: list[Episodes] = []

    def __call__(self, env: TaskEnv, policy: Policy, seed: int) -> Policy:
        """Look on at the episodes of a seed."""
        return _Recorded(self, env, policy)


class _Recorded:
    """Passes a policy through; every world is one episode."""

    def __init__(self, recorder: Recorder, env: TaskEnv, policy: Policy) -> None:
        self._recorder, self._env, self._policy = recorder, env, policy

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        return self._policy(obs)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        self._policy.reset(dones)
        env = self._env
        if dones is None:
            self._recorder.starts += _starts(env)
            self._running = np.ones(env.num_envs, dtype=bool)
            self._end = Episodes(*np.zeros((2, env.num_envs), dtype=int))
            self._recorder.ends.append(self._end)
            return
        self._end.steps[self._running] += 1
        ended = self._running & (dones > 0).numpy(force=True)
        self._end.outcome[ended] = env.outcome.numpy(force=True)[ended]
        self._running &= ~ended


def _starts(env: TaskEnv) -> list[Start]:
    scenes = env.sim.layout.scenes()
    if isinstance(env, NavEnv):
        steps, ways = env.most_steps.tolist(), env.way_left.tolist()
        return [Start(*start) for start in zip(scenes, steps, ways, strict=True)]
    objects = [env.sim.object.scene_object(world) for world in range(env.num_envs)]
    steps = env.max_episode_length
    return [Start(scene, steps, thing=thing) for scene, thing in zip(scenes, objects, strict=True)]
