"""Replays the log of a run: the same inputs through the same policy must give the same actions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spin_rl.deploy.agent import Agent
from spin_rl.deploy.fetch.agent import FetchAgent
from spin_rl.deploy.log import LoggedRun, whole


@dataclass(frozen=True)
class Replay:
    """What a replay found.

    Attributes:
        steps: Steps replayed.
        action_error: Largest difference of an action.
        command_error: Largest difference of a base speed or joint target [m/s, rad/s, m, rad].
        first: Number of the first step with a difference above 1e-6, None without one.
    """

    steps: int
    action_error: float
    command_error: float
    first: int | None

    @property
    def agrees(self) -> bool:
        """Whether there was something to replay, and it gave the same."""
        return self.steps > 0 and self.first is None


TOLERANCE = 1e-6


def replay(run: LoggedRun, agent: Agent | FetchAgent) -> Replay:
    """Replay a run; the agent must have been made as the run's was.

    Raises:
        ConfigError: The log is damaged, or it is not of this policy.
    """
    agent.check_aims(run.goal, run.object_b)
    with whole(run.path):
        return _replay(run, agent)


def _replay(run: LoggedRun, agent: Agent | FetchAgent) -> Replay:
    agent.reset(run.state, run.goal, run.object_b)
    steps, worst_action, worst_command, first = 0, 0.0, 0.0, None
    for logged in run.steps():
        if agent.reads_images and logged.inputs.depth is None:
            raise ValueError(f"no image at tick {logged.tick}")
        agent.progress(logged.inputs)
        action, command = agent.act(logged.inputs)
        action_error = float(np.abs(action - logged.action).max())
        pairs = zip(
            (command.forward, command.turn, *command.joints),
            (logged.command.forward, logged.command.turn, *logged.command.joints),
            strict=True,
        )
        command_error = max(abs(ours - theirs) for ours, theirs in pairs)
        if first is None and max(action_error, command_error) > TOLERANCE:
            first = logged.tick
        worst_action, worst_command = max(worst_action, action_error), max(worst_command, command_error)
        steps += 1
    return Replay(steps, worst_action, worst_command, first)
