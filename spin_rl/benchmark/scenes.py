"""The scenes benchmark: random trips through hand-made scenes, where the planner finds a way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from spin_rl.benchmark.drives import describe_drives, run_drives
from spin_rl.benchmark.metrics import DriveEpisodes, Episodes, summarize_drives
from spin_rl.benchmark.rounds import Announce, Report, WatchPolicy, check_counts, run_seeds
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.planning.trips import draw_trips
from spin_rl.policy import Policy, PolicyFactory
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.scene_file import load_scene
from spin_rl.tasks.common.env import with_camera_at
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv


def evaluate_scenes(
    make_policy: PolicyFactory,
    cfg: NavConfig,
    episodes: int,
    seeds: Sequence[int],
    device: str,
    *,
    policy_name: str = "policy",
    num_envs: int | None = None,
    scene: Scene | None = None,
    scene_name: str = "scene",
    announce: Announce | None = None,
    report: Report = print,
    watch: WatchPolicy | None = None,
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        make_policy: Makes the policy once observations exist.
        cfg: Task configuration; of its scene only the start ranges of the joints are used.
        episodes: Trips per scene and seed, see `planning.trips.draw_trips`; each is driven once.
        seeds: Seeds of the trips, all different.
        device: "cpu" or "cuda:N".
        policy_name: For the result.
        num_envs: Most worlds at once; None takes all trips of a seed at once as far as that is sensible.
        scene: The one scene to measure in; None takes all of conf/scenes_examples.
        scene_name: Its name in the result.
        announce: Context manager factory around work that may compile kernels.
        report: Receives lines of progress.
        watch: Looks on, see `rounds.run_seeds`.

    Returns:
        `policy`, `benchmark`, `rows` (see `metrics.summarize_drives`, with `scene`), and the settings under
        which the rows were measured.

    Raises:
        ConfigError: A scene has no room for trips; no trips, no seeds, the same seed twice, or no worlds;
            SciPy is not installed.
    """
    check_counts(episodes, seeds, num_envs)
    scenes = example_scenes() if scene is None else {scene_name: scene}
    trips = {seed: _draw_all(scenes, episodes, cfg, seed, report) for seed in seeds}
    remaining = iter(trips.values())
    groups, facts = run_seeds(
        lambda nworld: NavEnv(cfg, nworld, device, scene=[trip for seed in seeds for trip in trips[seed]]),
        make_policy,
        lambda env, policy, report: run_trips(env, policy, next(remaining), len(scenes), report=report),
        len(scenes) * episodes,
        seeds,
        device,
        num_envs=num_envs,
        announce=announce,
        report=report,
        watch=watch,
    )
    return {
        "policy": policy_name,
        "benchmark": "scenes",
        "rows": [
            {"scene": name} | summarize_drives(group, cfg.sim.control_period)
            for name, group in zip(scenes, groups, strict=True)
        ],
        "episodes_per_seed": episodes,
        "slack_s": cfg.slack_s,
        "slowness": cfg.slowness,
        **describe_drives(cfg),
        **facts,
    }


def example_scenes() -> dict[str, Scene]:
    """Scenes of conf/scenes_examples by name."""
    files = sorted((CONF_DIR / "scenes_examples").glob("*.yaml"))
    return {file.stem: load_scene(file) for file in files}


def run_trips(
    env: NavEnv, policy: Policy, trips: Sequence[Scene], scenes: int, *, report: Report = print
) -> list[DriveEpisodes]:
    """Drive every trip once, see `rounds.run_rounds`.

    Args:
        env: Environment that was made with scenes as large as these.
        policy: Policy for it.
        trips: A trip through every scene in turn.
        scenes: How many scenes there are.
        report: Receives lines of progress.

    Returns:
        Episodes of every scene.
    """
    driven = run_drives(
        env,
        policy,
        len(trips),
        1,
        lambda chosen: env.set_scenes([trips[trip] for trip in chosen]),
        report=report,
    )
    return [Episodes.concatenate(driven[first::scenes]) for first in range(scenes)]


def trips_through(scene: Scene, count: int, cfg: NavConfig, seed: int) -> list[Scene]:
    """Draw the trips of a seed through a scene, see `planning.trips.draw_trips`."""
    return draw_trips(scene, count, with_camera_at(cfg.scene, cfg.camera_pose), seed=seed)


def _draw_all(
    scenes: Mapping[str, Scene], count: int, cfg: NavConfig, seed: int, report: Report
) -> list[Scene]:
    """Draw trips, one through every scene in turn, so that every round has a mix of them."""
    drawn = []
    for name, scene in scenes.items():
        try:
            drawn.append(trips_through(scene, count, cfg, seed))
        except ValueError as error:
            raise ConfigError(f"{error} ({name})") from None
        report(f"  {name}: {count} trips with a way (seed {seed})")
    return [trip for turn in zip(*drawn, strict=True) for trip in turn]
