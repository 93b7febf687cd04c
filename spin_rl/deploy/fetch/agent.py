"""A whole fetch behind the interface of one policy: what the control loop drives."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from spin_rl.config import ConfigError, from_keys
from spin_rl.deploy import safety
from spin_rl.deploy.agent import Agent, Inputs
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch import script
from spin_rl.deploy.fetch.known import TOLD, Known, Now, read
from spin_rl.deploy.fetch.memory import Memory
from spin_rl.deploy.fetch.stages import Rules, advance, watch
from spin_rl.deploy.interface import Command, Connection, RobotState
from spin_rl.deploy.network import Network
from spin_rl.deploy.observations import out_of_base

BUNDLE = "fetch.json"
_POLICIES = (n.REACH, n.PICK, n.CARRY)
"""Stages in which a policy acts."""


class FetchAgent:
    """Two policies that take turns with scripts.

    Attributes:
        contract: That of the policy that drives, with the camera of one that reads images.
        rules: When stages end.
        memory: Where the fetch is.
    """

    def __init__(self, nav: Agent, pick: Agent, rules: Rules) -> None:
        """Keep the two policies.

        Args:
            nav: Drives, and follows what scripts want.
            pick: Picks.
            rules: When stages end.
        """
        self._nav, self._pick, self.rules = nav, pick, rules
        self._eyes = pick if pick.reads_images and not nav.reads_images else nav
        self.contract: Contract = replace(nav.contract, camera=self._eyes.contract.camera)
        actions = pick.contract.actions
        self._drive = script.Drive(
            nav.contract.speed_profile,
            rules.carry_moves,
            rules.carry_lift_m,
            (actions.forward[0], actions.turn),
        )

    @property
    def reads_images(self) -> bool:
        """Whether one of the policies reads depth images."""
        return self._eyes.reads_images

    def reduce(self, image: np.ndarray) -> np.ndarray:
        """Turn a camera's own image upright and reduce it."""
        return self._eyes.reduce(image)

    def check(self, connection: Connection, told: set[str]) -> None:
        """Reject a robot that cannot run one of the policies, or does not tell what a fetch must know.

        Raises:
            ConfigError: One line that says why.
        """
        for policy in (self._nav, self._pick):
            policy.check(connection, told)
        missing = [name for name in TOLD if name not in told]
        if missing:
            raise ConfigError(f"policy: a fetch must know {missing[0]!r}, which this back end cannot tell")

    def check_aims(self, goal: np.ndarray | None, object_b: np.ndarray | None) -> None:
        """Reject a fetch without a goal at the table; the object may be found by itself."""
        safety.check_aims(self.contract, goal, object_b)

    def reset(
        self, state: RobotState, goal: np.ndarray | None = None, object_start_b: np.ndarray | None = None
    ) -> None:
        """Start a fetch where the robot is now; see `Agent.reset`."""
        assert goal is not None
        for policy in (self._nav, self._pick):
            policy.reset(state, goal)
        self._active = self._nav
        self.memory = Memory(state.base[:2].copy(), goal.copy())
        if object_start_b is not None:
            self.memory.found, self.memory.is_found = out_of_base(object_start_b, state.base), True
        self._saw: bool | None = None

    def progress(self, inputs: Inputs) -> str | None:
        """Go on to the next stage if this one is over; return why the fetch ends, or None."""
        known, m = read(inputs.told), self.memory
        why = None
        if self._saw is not None:
            stage = m.stage
            # The object is seen as it was when the last action was chosen.
            why = advance(m, self.rules, self._now(inputs, replace(known, is_seen=self._saw)))
            if m.stage != stage:
                self._begin(inputs.state)
        self._saw = known.is_seen
        watch(m, known)
        return why

    def act(self, inputs: Inputs) -> tuple[np.ndarray, Command]:
        """Return the action of one step, shape (10,), and its command; see `Agent.act`."""
        action = np.zeros(len(self.contract.action_names))
        if self.memory.stage in _POLICIES:
            action = np.clip(self._active.decide(inputs), -1.0, 1.0)
        action = script.act(self._drive, self._now(inputs, read(inputs.told)), self.memory, action)
        return self._active.follow(action, inputs.state)

    def distance_m(self, state: RobotState) -> float:
        """Return the distance from the base to the goal of the stage [m]."""
        return float(np.hypot(*(self.memory.goal - state.base[:2])))

    def _now(self, inputs: Inputs, known: Known) -> Now:
        state = inputs.state
        turning = float(state.base_velocity[1])
        return Now(state.base, turning, state.joints, self._active.target, known, self.contract.period_s)

    def _begin(self, state: RobotState) -> None:
        """Hand over to the policy of a stage, its memory empty."""
        m = self.memory
        policy = self._pick if m.stage == n.PICK else self._nav
        policy.take_over(self._active)
        self._active = policy
        if m.stage == n.PICK:
            policy.hold(state)
            policy.aim(None, m.found)
        else:
            policy.aim(m.goal, None)


def open_agent(path: Path, speed_scale: float = 1.0, *, pilot: bool = True) -> Agent | FetchAgent:
    """Open an exported policy, or the folder of a fetch, in which no policy has a pilot; see `Agent`.

    Raises:
        ConfigError: It is neither.
    """
    bundle = path / BUNDLE if path.is_dir() else path
    if bundle.name != BUNDLE:
        return Agent(Network(path), speed_scale, pilot=pilot)
    try:
        values = json.loads(bundle.read_text(encoding="utf-8"))
        names, settings = values["policies"], values["settings"]
        files = [bundle.parent / names[name] for name in ("nav", "pick")]
    except (OSError, json.JSONDecodeError, KeyError, TypeError) as error:
        raise ConfigError(f"policy: {bundle} is no fetch of spin-export: {error}") from None
    try:
        rules = from_keys(Rules, settings)
    except ConfigError as error:
        raise ConfigError(f"policy: {bundle}: {error}") from None
    nav, pick = (Agent(Network(file), speed_scale, pilot=False) for file in files)
    for agent, task in ((nav, "nav"), (pick, "pick")):
        if agent.contract.task != task:
            raise ConfigError(f"policy: {bundle}: {task} is a policy of task={agent.contract.task}")
    return FetchAgent(nav, pick, rules)


def files_of(path: Path) -> list[Path]:
    """Return the files that a policy's or fetch's path stands for."""
    folder = path if path.is_dir() else path.parent if path.name == BUNDLE else None
    return [path] if folder is None else sorted(f for f in folder.iterdir() if f.suffix in (".json", ".onnx"))
