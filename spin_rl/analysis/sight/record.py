"""Records, while somebody drives, from which head poses what would be seen, and what lies on the course."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp
from tensordict import TensorDict

from spin_rl import robot
from spin_rl.analysis.sight.heads import Poses, make_body, make_heads
from spin_rl.policy import Policy
from spin_rl.scenes.course import find_touched
from spin_rl.tasks.common.proprioception import joints
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.warp_kernels.sight import BITS, look
from spin_rl.warp_kernels.slots import slots_of


@dataclass(frozen=True)
class Record:
    """First episodes of worlds, one observation a row; what comes after an episode's end is not `running`.

    Attributes:
        running: Whether the episode was going on, shape (steps, worlds), bool.
        pos: Where slots were [m], shape (steps, worlds, slots, 3), float32.
        shown: Words of head poses that would have shown a slot, see `sight.look`, shape (steps, worlds,
            slots, words), uint32.
        on_course: Whether the base, going on at its speeds of that moment, would have come to touch the slot
            within the lead, shape (steps, worlds, slots), bool.
        too_late: Whether it would have come to touch the slot even if it had braked then and waited,
            likewise.
    """

    running: np.ndarray
    pos: np.ndarray
    shown: np.ndarray
    on_course: np.ndarray
    too_late: np.ndarray


REACTION_S = 0.35
"""From what the camera shows to a base that brakes [s]: a control step, the network, the drive's lag."""

WAIT_S = 3.0
"""How long a base that brakes is followed [s]."""


_SHAPES = ("pos", "yaw", "half_size", "active")


class SightWatch:
    """Passes a policy through and records the first episode of every world after each full reset."""

    def __init__(
        self, policy: Policy, env: NavEnv | FetchEnv, poses: Poses, *, lead_s: float, near_m: float
    ) -> None:
        """Watch a policy in an environment that only it acts in.

        Args:
            policy: Who drives.
            env: The environment.
            poses: Head poses to look from.
            lead_s: How long before a touch its obstacle lies on the course [s].
            near_m: Distance that counts as touching [m].
        """
        self._policy = policy
        self._env = env
        self._lead = round(lead_s / env.cfg.sim.control_period)
        self._near_m = near_m
        self._braking = robot.SPEED_PROFILES[env.cfg.robot_profile].base_acceleration
        layout, device = env.sim.layout, env.device
        self._slots, self._hiding = slots_of(layout), slots_of(layout)
        self._body = make_body(env.sim)
        self._heads = make_heads(poses, env.cfg.camera_mount, env.cfg.scandots.near_m, device)
        words = (len(poses) + BITS - 1) // BITS
        with wp.ScopedDevice(device):
            self._hiding.active = wp.zeros_like(layout.active)
            self._shown = wp.zeros((*layout.active.shape, words), dtype=wp.uint32)
            self._touched = wp.zeros_like(layout.active)
        # The first episodes' slots: a world that ended draws new ones.
        self._first = slots_of(layout)
        for name in _SHAPES:
            setattr(self._first, name, wp.clone(getattr(layout, name)))
        self._steps: list[dict[str, torch.Tensor]] = []
        self.records: list[Record] = []

    def __call__(self, obs: TensorDict) -> torch.Tensor:
        """Return the policy's actions, shape (num_envs, 10)."""
        self._observe()
        return self._policy(obs)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the policy's state; without a mask, keep what was recorded and begin anew."""
        self._policy.reset(dones)
        if dones is None:
            self.finish()
            for name in _SHAPES:
                wp.copy(getattr(self._first, name), getattr(self._env.sim.layout, name))
            self._running = torch.ones(self._env.num_envs, dtype=torch.bool, device=self._env.device)
        else:
            self._running &= dones == 0

    def _observe(self) -> None:
        env, sim = self._env, self._env.sim
        layout = sim.layout
        held = joints(sim.views.qpos)
        # What the robot stands in, because nothing stops it, hides nothing.
        touched = self._find_touched(self._slots, sim.views.qpos[:, :3], held, 0.0)
        wp.to_torch(self._hiding.active).copy_(wp.to_torch(layout.active) & ~touched)
        look(
            self._slots,
            self._hiding,
            layout.is_wall,
            layout.nearby,
            sim.data.qpos,
            self._body,
            self._heads,
            window=env.cfg.scandots.window_m,
            shown_out=self._shown,
        )
        pos = wp.to_torch(layout.pos)
        if self._steps:
            pos = torch.where(self._running[:, None, None], pos, self._steps[-1]["pos"])
        self._steps.append(
            {
                "running": self._running.clone(),
                "pos": pos.clone(),
                "shown": wp.to_torch(self._shown.view(wp.int32)).clone(),
                "pose": sim.views.qpos[:, :3].clone(),
                "velocity": sim.views.qvel[:, :3].clone(),
                "joints": held,
            }
        )

    def _find_touched(
        self, slots: Any, pose: torch.Tensor, held: torch.Tensor, margin: float
    ) -> torch.Tensor:
        find_touched(
            slots,
            self._env.sim.layout.is_wall,
            wp.from_torch(pose.contiguous(), dtype=wp.vec3),
            wp.from_torch(held.contiguous()),
            margin,
            touched_out=self._touched,
        )
        return wp.to_torch(self._touched)

    def finish(self) -> None:
        """Add what was recorded since the last full reset to `records`."""
        if not self._steps:
            return
        steps = {name: torch.stack([step[name] for step in self._steps]) for name in self._steps[0]}
        self._steps.clear()
        self.records.append(
            Record(
                steps["running"].cpu().numpy(),
                steps["pos"].cpu().numpy(),
                steps["shown"].cpu().numpy().view(np.uint32),
                *(found.cpu().numpy() for found in self._look_ahead(steps)),
            )
        )

    def _look_ahead(self, steps: dict[str, torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        """`on_course` and `too_late` of every step, given where the slots really went."""
        period = self._env.cfg.sim.control_period
        last = len(steps["pos"]) - 1
        pos = wp.to_torch(self._first.pos)
        shape = steps["pos"].shape[:3]
        on_course, too_late = (torch.zeros(shape, dtype=torch.bool, device=pos.device) for _ in range(2))
        for step in range(last + 1):
            pose, velocity, held = (steps[name][step] for name in ("pose", "velocity", "joints"))
            stop = braked_time(velocity, self._braking)
            for ahead in range(max(self._lead, round(WAIT_S / period)) + 1):
                pos.copy_(steps["pos"][min(step + ahead, last)])
                if ahead <= self._lead:
                    course = going_on(pose, velocity, ahead * period)
                    on_course[step] |= self._find_touched(self._first, course, held, self._near_m)
                course = going_on(pose, velocity, stop(ahead * period))
                too_late[step] |= self._find_touched(self._first, course, held, self._near_m)
        running = steps["running"][..., None]
        return on_course & running, too_late & running


def braked_time(velocity: torch.Tensor, braking: float) -> Callable[[float], torch.Tensor]:
    """Make what says in which time a base that does not brake comes as far as one that does.

    Args:
        velocity: Rates of change of x, y and yaw [m/s, rad/s], shape (n, 3).
        braking: Deceleration [m/s^2].

    Returns:
        A function of the time since the decision to brake [s], which takes effect after `REACTION_S`; to
        times [s], shape (n,).
    """
    lasts = (velocity[:, :2].norm(dim=-1) / braking).clamp_min(1e-6)

    def time(after: float) -> torch.Tensor:
        slowing = lasts.new_full(lasts.shape, max(after - REACTION_S, 0.0)).minimum(lasts)
        return min(after, REACTION_S) + slowing - 0.5 * slowing**2 / lasts

    return time


def going_on(pose: torch.Tensor, velocity: torch.Tensor, time_s: float | torch.Tensor) -> torch.Tensor:
    """Where bases are after a time at constant forward and turning speed.

    Args:
        pose: x, y [m] and yaw [rad], shape (n, 3).
        velocity: Their rates of change now [m/s, rad/s], shape (n, 3).
        time_s: The time [s], one for all or shape (n,).

    Returns:
        Shape (n, 3).
    """
    x, y, yaw = pose.unbind(-1)
    forward = velocity[:, 0] * yaw.cos() + velocity[:, 1] * yaw.sin()
    turned = velocity[:, 2] * time_s
    # The chord of an arc: torch.sinc(z) is sin(pi z) / (pi z).
    chord = forward * time_s * torch.sinc(0.5 * turned / torch.pi)
    along = yaw + 0.5 * turned
    return torch.stack((x + chord * along.cos(), y + chord * along.sin(), yaw + turned), -1)
