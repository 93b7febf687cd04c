"""spin-play: watch a policy, as a video, in the browser, in a window, or as plots."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from spin_rl.benchmark import policies, settings
from spin_rl.cli import common
from spin_rl.cli.task_choice import with_task
from spin_rl.config import Choice, ConfigError, Range, from_keys
from spin_rl.paths import POLICY_DIR
from spin_rl.policy import make_in
from spin_rl.scenes.kinds import DIFFICULTIES, FAMILIES, SCENARIOS, number_of
from spin_rl.scenes.rooms.params import FamilyParams, scene_class
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.registry import TASKS, TaskSpec, find_task

VIEWERS = ("viser", "native", "none")
# To find a world's corridor, all before it are drawn as well.
_MOST_WORLDS = 20_000


@dataclass(frozen=True)
class Options:
    """What to show, checked.

    Attributes:
        policy: Name or path; in a fetch of the one that drives.
        pick: The one that picks in a fetch; None takes the shipped one that sees what `policy` sees.
        scenario: 1 or 2.
        difficulty: One of `DIFFICULTIES`.
        episodes: Episodes of a video or of plots.
        seed: Of corridors, start poses and goals.
        world: Index in the batch of the seed in the benchmark of reach or rooms, whose scene is played; None
            for others.
        family: Of that world in the benchmark of rooms, or None.
        starts: Trips per scene and seed in the benchmark of scenes, or None.
        trip: Which of them is played, or None.
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

    policy: common.PolicyName
    pick: common.PolicyName | None
    scenario: Annotated[int, Choice(SCENARIOS)]
    difficulty: Annotated[str, Choice(DIFFICULTIES)]
    episodes: Annotated[int, Range(1, 1000)]
    seed: Annotated[int, Range(0, 2**31 - 1)]
    world: Annotated[int, Range(0, _MOST_WORLDS - 1)] | None
    family: Annotated[str, Choice(FAMILIES)] | None
    starts: Annotated[int, Range(1, _MOST_WORLDS)] | None
    trip: Annotated[int, Range(0, _MOST_WORLDS - 1)] | None
    viewer: Annotated[str, Choice(VIEWERS)]
    video: Path | None
    samples: Annotated[int, Range(1, 4)]
    plots: Path | None
    worlds: Annotated[int, Range(1, 16)]
    host: str
    port: Annotated[int, Range(1, 65535)]
    device: str
    scene_file: Path | None

    @property
    def level(self) -> int:
        """Index of `difficulty` in `DIFFICULTIES`."""
        return DIFFICULTIES.index(self.difficulty)


def main() -> None:
    """Entry point of the `spin-play` command."""
    common.run(
        "play",
        play,
        lambda given: with_task([common.scene_file_argument(a) for a in given]),
        common.keys_of(Options, common.TASK_GROUPS),
    )


def play(call: common.Call) -> None:
    """Show the policy that was asked for; write the video and the plots before any live view."""
    spec = find_task(call.values["task"].get("name"))
    options = read_options(call, spec)
    spec.check(call.values)
    players = Players(call, spec, options)
    if options.device == "cpu":
        import torch

        torch.set_num_threads(1)
    if options.video or options.plots or options.viewer == "none":
        _record(players, options)
    if options.viewer == "native":
        from spin_rl.viewer import native

        native.show(players.open(options.policy, worlds=1))
    elif options.viewer == "viser":
        from spin_rl.viewer.browser.view import Browser

        names = _shipped(spec.policies["policy"])
        with Browser(options.host, options.port) as browser:
            browser.run(
                lambda name: players.open(name, options.worlds),
                policies=list(dict.fromkeys([options.policy, *names, *policies.of_task(spec)])),
                scenario=options.scenario,
                difficulty=options.level,
            )


def _shipped(task: str) -> list[str]:
    """Names of the shipped policies of a task."""
    names = [file.stem for file in sorted(POLICY_DIR.glob("*.safetensors"))]
    return [name for name in names if policies.open_policy(name).task == task]


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
        what = ", ".join(filter(None, [progress_label(last), cell_label(last)]))
        print(f"  episode {i + 1}: {last.cause} after {last.time:.1f} s, {what}")
    result = summary([episode[-1] for episode in episodes])
    if options.video is not None:
        print(f"Wrote {options.video}: {result}")
    if options.plots is not None:
        files = plots.write_plots(options.plots, episodes, player.title)
        print(f"Wrote {files[0] if len(files) == 1 else options.plots}: {result}")
    if options.video is None and options.plots is None:
        print(f"{result} (video=<file.mp4> keeps pictures)")


class Players:
    """Opens policies, each in an environment as it was trained for."""

    def __init__(self, call: common.Call, spec: TaskSpec, options: Options) -> None:
        """Remember what was asked for."""
        self._call = call
        self._spec = spec
        self._options = options
        self._opened = call.opened
        self._envs: dict[str, Any] = {}

    def open(self, policy: str, worlds: int) -> Any:
        """Return a `Player` at the start of the first episodes of the seed.

        Raises:
            ConfigError: There is no such policy, or the scene does not fit it.
        """
        from spin_rl.viewer.rollout import Player

        options, overrides = self._options, self._call.overrides
        # Only once: a training that goes on may have replaced the file when it is chosen again.
        opened, self._opened = self._opened, None
        source = policies.open_for(self._spec, {"policy": policy, "pick": options.pick}, opened)
        task = self._spec.configure(settings.for_policy(self._call.values, source.trained, overrides))
        source.check(task)
        idle = settings.unused_depth(task, overrides)
        if idle is not None:  # no error: the browser's menu has other policies
            print(f"warning: {idle}", file=sys.stderr)
        key = f"{worlds} {task}"
        if key not in self._envs:
            self._envs.clear()  # one environment at a time is enough
            with common.announced(f"Starting {worlds} world{'s' if worlds > 1 else ''} on {options.device}"):
                self._envs[key] = self._start(task, worlds)
        env = self._envs[key]
        title = ", ".join(Path(name).stem for name in source.names.values())
        player = Player(env, make_in(env, source.make), title)
        player.start(options.scenario, options.level, seed=options.seed)
        return player

    def _start(self, task: TaskConfig, worlds: int) -> Any:
        """Start the worlds of a task; the scene may be a file's, or one of a benchmark's."""
        from spin_rl.benchmark.reach import Cell, in_usual_pool
        from spin_rl.benchmark.replay import benchmark_scene
        from spin_rl.benchmark.scenes import trips_through

        options = self._options
        scene = common.load_scene_file(options.scene_file)
        if options.world is not None:
            condition = options.family or Cell(options.scenario, options.difficulty)
            assert isinstance(task, NavConfig)  # `read_options` has seen to it
            scene = benchmark_scene(task, condition, options.seed, options.world, options.device)
        elif scene is not None and options.starts is not None and options.trip is not None:
            assert isinstance(task, NavConfig)
            scene = trips_through(scene, options.starts, task, options.seed)[options.trip]
        if scene is None:
            return self._spec.make_env(task, worlds, options.device, options.seed)
        scene = in_usual_pool(scene)
        # With several scenes, ways and time limits are those of families and trips.
        by_field = options.family is not None or options.trip is not None
        fixed = [scene] if by_field else scene
        return self._spec.make_env(task, worlds, options.device, options.seed, scene=fixed)


def read_options(call: common.Call, spec: TaskSpec) -> Options:
    """Reject what needs no simulator to reject.

    Raises:
        ConfigError: One line that names the key.
    """
    values = call.values
    default = "none" if values["video"] or values["plots"] else "viser"
    numbers = {key: number_of(key, values[key], key) for key in ("scenario", "difficulty")}
    level = numbers["difficulty"]
    named = {"difficulty": DIFFICULTIES[level]} if level in range(len(DIFFICULTIES)) else {}
    viewer = default if values["viewer"] is None else values["viewer"]
    found = {"viewer": viewer, "device": common.resolve_device(values["device"])}
    options = from_keys(Options, values | {"scenario": numbers["scenario"]} | named | found)
    policies.check_name(options.policy)
    if options.world is not None and options.scene_file is not None:
        raise ConfigError("world: a scene file is the same in every world")
    _check_replay(options, families=scene_class(values["scene"]) is FamilyParams)
    for key, value in (("world", options.world), ("scene", options.scene_file)):
        if value is not None and not spec.scene_files:
            raise ConfigError(f"{key}: {value} needs a policy of {_those(lambda spec: spec.scene_files)}")
    if options.pick is not None and "pick" not in spec.policies:
        raise ConfigError(f"pick: {options.pick} needs {_those(lambda spec: 'pick' in spec.policies)}")
    _check_views(options)
    return options


def _check_replay(options: Options, families: bool) -> None:
    """Reject incomplete names of an episode of the benchmarks of rooms and scenes."""
    if options.world is not None and families and options.family is None:
        raise ConfigError(f"world: {options.world} of scene families needs family=, the world's own")
    if options.family is not None and (options.world is None or not families):
        raise ConfigError(f"family: {options.family} needs world= and scene=mixture")
    if (options.starts is None) != (options.trip is None):
        raise ConfigError(
            "trip: needs starts=, the number of trips that it is one of, and starts= needs trip="
        )
    if options.trip is not None and options.starts is not None:
        if options.scene_file is None:
            raise ConfigError(f"trip: {options.trip} needs a scene file, such as scene=lab.yaml")
        if options.trip >= options.starts:
            raise ConfigError(f"trip: {options.trip} is none of {options.starts}, which are counted from 0")


def _those(fits: Callable[[TaskSpec], bool]) -> str:
    """Name the tasks that fit."""
    return " or ".join(f"task={name}" for name, spec in TASKS.items() if fits(spec))


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
