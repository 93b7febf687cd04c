"""spin-play: watch a policy, as a video, in the browser, in a window, or as plots."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from spin_rl.cli import common
from spin_rl.cli.task_choice import check_task, trained_task, with_task
from spin_rl.config import ConfigError
from spin_rl.paths import POLICY_DIR
from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.registry import any_config, make_env, plain

VIEWERS = ("viser", "native", "none")
# To find a world's corridor, all before it are drawn as well.
_MOST_WORLDS = 20_000


def main() -> None:
    """Entry point of the `spin-play` command."""
    sys.argv[1:] = with_task([common.scene_file_argument(argument) for argument in sys.argv[1:]])
    common.run("play", play)


@dataclass(frozen=True)
class Options:
    """What to show, checked.

    Attributes:
        policy: Name or path; in a fetch of the one that drives.
        pick: The one that picks in a fetch; None takes the shipped one that sees what `policy` sees.
        scenario: 1 or 2.
        difficulty: Index into `DIFFICULTIES`.
        episodes: Episodes of a video or of plots.
        seed: Of corridors, start poses and goals.
        world: Index in the reach benchmark's batch of the seed, whose corridor is played; None for others.
        viewer: One of `VIEWERS`.
        video: File to write, or None.
        samples: Rays per pixel of a video along each axis.
        plots: Folder to write to, or None.
        worlds: Worlds in the browser.
        host: Address that the browser view listens on.
        port: Port of the browser view.
        device: "cpu" or "cuda:N".
        scene_file: A fixed scene, or None.
    """

    policy: str
    pick: str | None
    scenario: int
    difficulty: int
    episodes: int
    seed: int
    world: int | None
    viewer: str
    video: Path | None
    samples: int
    plots: Path | None
    worlds: int
    host: str
    port: int
    device: str
    scene_file: str | None


def play(cfg: DictConfig) -> None:
    """Show the policy that `cfg` names; write the video and the plots before any live view."""
    values = plain(cfg)
    options = check(values)
    players = Players(cfg, options, HydraConfig.get().overrides.task)
    if options.device == "cpu":
        torch.set_num_threads(1)
    if options.video or options.plots or options.viewer == "none":
        _record(players, options)
    if options.viewer == "native":
        from spin_rl.viewer import native

        native.show(players.open(options.policy, worlds=1))
    elif options.viewer == "viser":
        from spin_rl.viewer.browser.view import Browser

        task = values["task"]["name"]
        names = _shipped("nav" if task == "fetch" else task)
        with Browser(options.host, options.port) as browser:
            browser.run(
                lambda name: players.open(name, options.worlds),
                policies=list(dict.fromkeys([options.policy, *names, "zero", "random"])),
                scenario=options.scenario,
                difficulty=options.difficulty,
            )


def _shipped(task: str) -> list[str]:
    """Names of the shipped policies of a task."""
    from spin_rl.benchmark.policies import open_policy

    names = [file.stem for file in sorted(POLICY_DIR.glob("*.safetensors"))]
    return [name for name in names if trained_task(open_policy(name)[1]) == task]


def _record(players: Players, options: Options) -> None:
    """Play the episodes once, for the video and the plots alike."""
    from spin_rl.viewer import plots
    from spin_rl.viewer.labels import cell_label, progress_label, summary
    from spin_rl.viewer.video import open_video, record
    from spin_rl.viewer.video import play as play_episodes

    player = players.open(options.policy, worlds=1)
    if options.video is None:
        episodes = [list(episode) for episode in play_episodes(player, options.episodes)]
    else:
        from spin_rl.viewer.picture import PictureMaker
        from spin_rl.viewer.stage import stage_of

        period = player.env.cfg.sim.control_period
        maker = PictureMaker(stage_of(player), player.title, period, options.samples)
        with common.announced(f"Preparing pictures for {options.video}"):
            maker.draw(player.snapshots[0])
        with open_video(options.video, fps=1.0 / period) as append:
            episodes = record(player, options.episodes, maker.draw, append)
    for i, episode in enumerate(episodes):
        last = episode[-1]
        what = f"{progress_label(last)}, {cell_label(last)}"
        print(f"  episode {i + 1}: {last.cause} after {last.time:.1f} s, {what}")
    result = summary([episode[-1] for episode in episodes])
    if options.video is not None:
        print(f"Wrote {options.video}: {result}")
    if options.plots is not None:
        files = plots.write_plots(options.plots, episodes, player.title)
        print(f"Wrote {files[0] if len(files) == 1 else options.plots}: {result}")
    if options.video is None and options.plots is None:
        print(f"Wrote nothing, video=<file.mp4> keeps pictures: {result}")


class Players:
    """Opens policies, each in an environment as it was trained for."""

    def __init__(self, cfg: DictConfig, options: Options, overrides: list[str]) -> None:
        """Remember the configuration.

        Args:
            cfg: Composed conf/play.yaml.
            options: The same, checked.
            overrides: Overrides of the command line, which win over a policy's own settings.
        """
        self._cfg = cfg
        self._options = options
        self._overrides = overrides
        self._envs: dict[str, Any] = {}

    def open(self, policy: str, worlds: int) -> Any:
        """Return a `Player` at the start of the first episodes of the seed.

        Raises:
            ConfigError: There is no such policy, or the scene does not fit it.
        """
        from spin_rl.benchmark import settings
        from spin_rl.viewer.rollout import Player

        options = self._options
        make_policy, trained, title = self._find(policy)
        task = any_config(settings.for_policy(self._cfg, trained, self._overrides))
        idle = settings.unused_depth(task, self._overrides)
        if idle is not None:  # no error: the browser's menu has other policies
            print(f"warning: {idle}", file=sys.stderr)
        key = f"{worlds} {task}"
        if key not in self._envs:
            self._envs.clear()  # one environment at a time is enough
            with common.announced(f"Starting {worlds} world{'s' if worlds > 1 else ''} on {options.device}"):
                self._envs[key] = self._start(task, worlds)
        env = self._envs[key]
        player = Player(env, make_policy(env.get_observations(), options.device), title)
        player.start(options.scenario, options.difficulty, seed=options.seed)
        return player

    def _find(self, policy: str) -> tuple[Any, dict[str, Any], str]:
        """Find a policy or the two of a fetch: what makes it, what it was trained with, and its title."""
        from spin_rl.benchmark import policies

        if self._cfg.task.name == "fetch":
            make_policy, trained, pick = policies.open_fetch_policy(policy, self._options.pick)
            return make_policy, trained, f"{Path(policy).stem}, {Path(pick).stem}"
        make_policy, trained = policies.open_policy(policy)
        check_task(policy, trained, self._cfg.task.name)
        return make_policy, trained, Path(policy).stem

    def _start(self, task: Any, worlds: int) -> Any:
        """Start the worlds of a task; corridors may be a scene file's, or one of the benchmark's."""
        from spin_rl.benchmark.reach import Cell, in_usual_pool
        from spin_rl.benchmark.replay import benchmark_scene
        from spin_rl.tasks.nav.env import NavEnv

        options = self._options
        if not isinstance(task, NavConfig):
            return make_env(task, worlds, options.device, options.seed)
        scene = common.load_scene_file(options.scene_file)
        if options.world is not None:
            cell = Cell(options.scenario, DIFFICULTIES[options.difficulty])
            scene = benchmark_scene(task, cell, options.seed, options.world, options.device)
        fixed = None if scene is None else in_usual_pool(scene)
        return NavEnv(task, worlds, options.device, options.seed, scene=fixed)


def check(values: dict[str, Any]) -> Options:
    """Reject what needs no simulator to reject.

    Raises:
        ConfigError: One line that names the key.
    """
    if not isinstance(values["policy"], str):
        raise ConfigError("policy: give a name, checkpoint, run directory, .safetensors file, zero or random")
    if values["scenario"] not in SCENARIOS:
        raise ConfigError(f"scenario: expected 1 or 2, got {values['scenario']!r}")
    if values["difficulty"] not in DIFFICULTIES:
        choices = ", ".join(DIFFICULTIES)
        raise ConfigError(f"difficulty: unknown {values['difficulty']!r}; choose from {choices}")
    for key, low, high in (
        ("episodes", 1, 1000),
        ("seed", 0, 2**31 - 1),
        ("samples", 1, 4),
        ("worlds", 1, 16),
        ("port", 1, 65535),
    ):
        if type(values[key]) is not int or not low <= values[key] <= high:
            raise ConfigError(f"{key}: expected a whole number from {low} to {high}, got {values[key]!r}")
    world = values["world"]
    if world is not None and (type(world) is not int or not 0 <= world < _MOST_WORLDS):
        raise ConfigError(f"world: expected a whole number from 0 to {_MOST_WORLDS - 1}, got {world!r}")
    if world is not None and values["scene_file"] is not None:
        raise ConfigError("world: a scene file is the same in every world")
    for key in ("pick", "video", "plots", "scene_file", "viewer"):
        if values[key] is not None and not isinstance(values[key], str):
            raise ConfigError(f"{key}: expected a name, got {values[key]!r}")
    for key in ("world", "scene_file"):
        if values["task"]["name"] != "nav" and values[key] is not None:
            raise ConfigError(f"{key.removesuffix('_file')}: {values[key]} needs a policy of task=nav")
    if values["pick"] is not None and values["task"]["name"] != "fetch":
        raise ConfigError(f"pick: {values['pick']} needs task=fetch")
    video = None if values["video"] is None else Path(values["video"])
    plots = None if values["plots"] is None else Path(values["plots"])
    viewer = values["viewer"] or ("none" if video or plots else "viser")
    if viewer not in VIEWERS:
        raise ConfigError(f"viewer: unknown {viewer!r}; choose from {', '.join(VIEWERS)}")
    options = Options(
        **{key: values[key] for key in ("policy", "pick", "scenario", "episodes", "seed", "samples")},
        **{key: values[key] for key in ("worlds", "port", "scene_file", "world")},
        difficulty=DIFFICULTIES.index(values["difficulty"]),
        viewer=viewer,
        video=video,
        plots=plots,
        host=str(values["host"]),
        device=common.resolve_device(values["device"]),
    )
    _check_views(options)
    return options


def _check_views(options: Options) -> None:
    """Find out about missing packages, displays and folders before anything is compiled."""
    if options.video is not None:
        from spin_rl.extras import require
        from spin_rl.viewer.video import check_video

        require("PIL", "pillow", "viewer", "video")
        check_video(options.video)
    if options.plots is not None:
        from spin_rl.viewer.plots import check_plots

        if options.plots.exists() and not options.plots.is_dir():
            raise ConfigError(f"plots: {options.plots} is no folder")
        check_plots()
    if options.viewer == "native":
        from spin_rl.viewer.native import check_native

        check_native()
    if options.viewer == "viser":
        from spin_rl.extras import require

        require("viser", "viser", "viewer", "viewer")


if __name__ == "__main__":
    main()
