"""The dynamic benchmark: the paper's two real places with obstacles that lie there and one that steps in.

Success within 15 cm, and how often the robot hits something: an episode goes on after that (SPIN, Real-world
results). As in the paper there are obstacles on the floor only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch

from spin_rl import robot
from spin_rl.benchmark.drives import describe_drives, drive_figures
from spin_rl.benchmark.metrics import DriveEpisodes, mean_interval, summarize_drives
from spin_rl.benchmark.rounds import Announce, Report, WatchPolicy, check_counts, run_rounds, run_seeds
from spin_rl.benchmark.tables.paper import STATIC_DYNAMIC
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.planning.distance_field import CEILING_M
from spin_rl.planning.thrown import Throw, throw_into
from spin_rl.planning.trips import draw_trips
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.grounded import grounded
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.scene_file import load_scene
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv

SCENES = tuple(dict.fromkeys(scene for scene, _ in STATIC_DYNAMIC))
OBSTACLES = tuple(dict.fromkeys(obstacles for _, obstacles in STATIC_DYNAMIC))
_APART_STEPS = 5
"""So many control steps without touching anything lie between two collisions."""


@dataclass
class TrialEpisodes(DriveEpisodes):
    """How drives ended that go on after a collision.

    Attributes:
        collisions: How often the robot began to touch something, shape (n,), int.
    """

    collisions: np.ndarray


class CollisionCounter:
    """Counts in every world how often the robot began to touch something."""

    def __init__(self, num_envs: int, device: str) -> None:
        """Allocate."""
        self.count = torch.zeros(num_envs, dtype=torch.int64, device=device)
        self._apart = torch.full_like(self.count, _APART_STEPS)

    def restart(self) -> None:
        """Begin anew in all worlds."""
        self.count.zero_()
        self._apart.fill_(_APART_STEPS)

    def add(self, touches: torch.Tensor) -> torch.Tensor:
        """Take in which robots touch something, shape (num_envs,), bool; return new counts."""
        self.count += touches & (self._apart >= _APART_STEPS)
        self._apart = torch.where(touches, 0, self._apart + 1)
        return self.count.clone()


def evaluate_dynamic(
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    num_envs: int | None = None,
    announce: Announce | None = None,
    report: Report = print,
    watch: WatchPolicy | None = None,
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration; nothing of its scene is used, and episodes go on after a collision.
        episodes: Per row and seed; rows of one place are the same trips.
        seeds: Seeds of the trips and obstacles, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        num_envs: Most worlds at once; None takes all episodes of a seed at once as far as that is sensible.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.
        watch: Looks on, see `rounds.run_seeds`.

    Returns:
        `policy`, `benchmark`, `rows` (see `metrics.summarize_drives`, with `scene`, `obstacles`, the mean
        number of `collisions` and its `collisions_ci95`), and the settings under which they were measured.

    Raises:
        ConfigError: No episodes, no seeds, the same seed twice, or no worlds; SciPy is not installed.
    """
    check_counts(episodes, seeds, num_envs)
    cfg = replace(cfg, stop_on_collision=False)
    trips = {seed: _draw(episodes, seed, report) for seed in seeds}
    remaining = iter(trips.values())
    conditions = [(scene, obstacles) for scene in SCENES for obstacles in OBSTACLES]
    groups, facts = run_seeds(
        lambda nworld: NavEnv(
            cfg, nworld, device, scene=[trip for drawn in trips.values() for trip in drawn]
        ),
        make_policy,
        lambda env, policy, report: run_trials(env, policy, next(remaining), len(conditions), report=report),
        len(conditions) * episodes,
        seeds,
        device,
        num_envs=num_envs,
        announce=announce,
        report=report,
        watch=watch,
    )
    return {
        "policy": policy_name,
        "benchmark": "dynamic",
        "rows": [
            {"scene": scene, "obstacles": obstacles}
            | summarize_drives(group, cfg.sim.control_period)
            | summarize_collisions(group.collisions)
            for (scene, obstacles), group in zip(conditions, groups, strict=True)
        ],
        "episodes_per_seed": episodes,
        "throw": asdict(Throw()),
        "slack_s": cfg.slack_s,
        "slowness": cfg.slowness,
        **describe_drives(cfg),
        **facts,
    }


def summarize_collisions(collisions: np.ndarray) -> dict[str, Any]:
    """Mean number of collisions in an episode, and its interval (bootstrap)."""
    return {"collisions": float(collisions.mean()), "collisions_ci95": list(mean_interval(collisions))}


def run_trials(
    env: NavEnv, policy: Policy, trips: Sequence[Scene], conditions: int, *, report: Report = print
) -> list[TrialEpisodes]:
    """Drive every trip once, see `rounds.run_rounds`.

    Args:
        env: Environment that was made with scenes as large as these.
        policy: Policy for it.
        trips: A trip under every condition in turn.
        conditions: How many there are.
        report: Receives lines of progress.

    Returns:
        Episodes under every condition.
    """
    counter = CollisionCounter(env.num_envs, env.device)

    def prepare(chosen: np.ndarray) -> None:
        env.set_scenes([trips[trip] for trip in chosen])
        counter.restart()

    def measure() -> Mapping[str, torch.Tensor]:
        touches = env.sim.views.part_contacts.any(-1)
        return drive_figures(env) | {"collisions": counter.add(touches)}

    queue = np.arange(len(trips))
    driven = run_rounds(env, policy, queue, prepare, measure, TrialEpisodes, report=report)
    return [driven.select(queue % conditions == condition) for condition in range(conditions)]


def place(name: str) -> Scene:
    """One of the paper's places: with obstacles on the floor only, and nothing that moves."""
    scene = load_scene(CONF_DIR / "scenes_examples" / f"{name}.yaml")
    still = replace(scene, active=scene.active & (scene.motion_speed == 0.0))
    return grounded(still, CEILING_M)


def _draw(count: int, seed: int, report: Report) -> list[Scene]:
    """Draw trips, one under every condition in turn, so that every round has a mix of them."""
    stowed = np.array([robot.STOWED[joint] for joint in robot.JOINTS])
    rows: list[list[Scene]] = []
    for number, name in enumerate(SCENES):
        try:
            trips = draw_trips(place(name), count + max(count // 5, 2), NavConfig().scene, seed=seed)
            trips = [replace(trip, start_joints=stowed.copy()) for trip in trips]
            thrown = throw_into(trips, Throw(), count=count, seed=2 * seed + number)
        except ValueError as error:
            raise ConfigError(f"{error} ({name})") from None
        rows += [thrown.static, thrown.dynamic]
        report(f"  {name}: {count} trips with a way past what is thrown (seed {seed})")
    return [trip for turn in zip(*rows, strict=True) for trip in turn]
