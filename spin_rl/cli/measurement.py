"""What spin-eval is to measure: its options, read and checked before anything is simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from spin_rl.analysis.sight.options import MAP, SightOptions
from spin_rl.baselines.registry import BASELINES
from spin_rl.benchmark import policies
from spin_rl.benchmark import registry as benchmarks
from spin_rl.benchmark.tables import backend as backend_report
from spin_rl.cli import common
from spin_rl.config import Choice, ConfigError, Range, from_keys
from spin_rl.deploy.backends.renderers import RENDERERS
from spin_rl.extras import require
from spin_rl.ranges import Seed
from spin_rl.reproduce.tables.registry import ALL, TABLES
from spin_rl.tasks.registry import TaskSpec, find_task

ANALYSES = ("camera", "failures", "behaviour", "sight")
_ANALYSED = {
    "camera": ("reach", "rooms"),
    "failures": ("reach", "rooms", "scenes"),
    "behaviour": ("reach", "rooms", "scenes"),
    "sight": ("reach", "rooms", "fetch"),
}
"""The benchmarks that each analysis looks into."""
_ANALYSIS_COUNTS = {"episodes": 50, "seeds": [0]}
"""The analysis of the camera runs the benchmark a dozen times, those of behaviour and sight keep episodes."""
_TRIPS = "scenes"
"""The benchmark that draws starts and goals in scene files."""
_TRIP_COUNTS = {"starts": 50, "seeds": [0]}
_PLOTS = (".png", ".pdf", ".svg")
_SAME_FETCHES = "place"
"""The benchmark that tells of another's episodes."""


Angle = Annotated[float, Range()]


@dataclass(frozen=True)
class CameraOptions:
    """Where the analysis of the camera holds it.

    Attributes:
        tilts: At pan 0 [rad].
        blind: Pan and tilt of the control [rad], or None.
        cells: Names such as `1-hard`, or None for all.
        sampled: Whether it also moves as in training.
    """

    tilts: tuple[Angle, ...]
    blind: tuple[Angle, Angle] | None
    cells: tuple[str, ...] | None
    sampled: bool


@dataclass(frozen=True)
class Options:
    """What to measure, checked.

    Attributes:
        policy: Name or path; in a fetch of the one that drives.
        pick: The one that picks in a fetch; None takes the shipped one that sees what `policy` sees.
        benchmark: The benchmark.
        episodes: Per seed, in corridors also per cell.
        starts: Trips per scene and seed in place of `episodes`, or None.
        seeds: Of scenes, start poses and goals.
        num_envs: Most worlds at once, or None.
        device: "cpu" or "cuda:N".
        scene_file: A fixed scene, or None.
        backend: Another simulator to run the same episodes in, or None.
        renderer: What makes depth images there.
        processes: How many run episodes there at the same time.
        table: A table of stored results in place of all else, or None; see `cli.tables`.
        fresh: Whether it is measured again.
        analysis: One of `ANALYSES`, or None.
        plot: Drawing to write, or None.
        videos: Folder for short videos of what an analysis found, or None.
        out: JSON to write, or None.
        camera_analysis: Of `analysis=camera`.
        sight: Of `analysis=sight`.
        overrides: Those of the command line.
    """

    policy: common.PolicyName
    pick: common.PolicyName | None
    benchmark: benchmarks.Benchmark
    episodes: Annotated[int, Range(high=1_000_000)]
    starts: Annotated[int, Range(high=1_000_000)] | None
    seeds: tuple[Seed, ...]
    num_envs: Annotated[int, Range(high=2**18)] | None
    device: str
    scene_file: Path | None
    backend: Annotated[str, Choice(tuple(backend_report.BACKENDS))] | None
    renderer: Annotated[str, Choice(RENDERERS)]
    processes: Annotated[int, Range(1)]
    table: Annotated[str, Choice((*TABLES, ALL))] | None
    fresh: bool
    analysis: Annotated[str, Choice(ANALYSES)] | None
    plot: Path | None
    videos: Path | None
    out: Path | None
    camera_analysis: CameraOptions
    sight: SightOptions
    overrides: tuple[str, ...]


def read_options(call: common.Call) -> Options:
    """Reject what needs no simulator to reject, and make the folder of `out`.

    Raises:
        ConfigError: One line that names the key.
    """
    values = call.values
    asked = _TRIPS if values["benchmark"] is None and values["starts"] is not None else values["benchmark"]
    if values["benchmark"] is None and asked == _TRIPS and values["task"].get("name") != "nav":
        raise ConfigError(f"starts: benchmark={_TRIPS} draws them, which measures task=nav")
    benchmark = benchmarks.find(asked, values["task"].get("name"), families="shares" in values["scene"])
    counts = _TRIP_COUNTS if benchmark.name == _TRIPS else {}
    if values["analysis"] in ("camera", "behaviour", "sight"):
        counts = _ANALYSIS_COUNTS
    given = {override.partition("=")[0] for override in call.overrides}
    values = values | {key: value for key, value in counts.items() if key not in given}
    device = common.resolve_device(values["device"])
    found = {"benchmark": benchmark, "device": device, "overrides": tuple(call.overrides)}
    options = from_keys(Options, values | found)
    if options.starts is not None:
        _check_trips(options)
        options = replace(options, episodes=options.starts)
    _check(options, find_task(benchmark.task))
    common.make_folder_of(options.out, f"{benchmark.name}.json")
    return options


def _check_trips(options: Options) -> None:
    """Reject what does not go with random starts in scene files."""
    if options.benchmark.name != _TRIPS:
        raise ConfigError(f"starts: benchmark={options.benchmark.name} draws its own; see benchmark={_TRIPS}")
    if options.starts is not None and options.starts < 1:
        raise ConfigError(f"starts: at least 1 is needed, got {options.starts}")
    for override in options.overrides:
        if override.startswith("episodes="):
            raise ConfigError(f"episodes: benchmark={_TRIPS} drives every trip once, starts= is their number")
        if override.startswith("scene="):
            raise ConfigError(f"scene: benchmark={_TRIPS} runs in scene files, not in {override}")


def _check(options: Options, spec: TaskSpec) -> None:
    """Reject options that do not go with the benchmark or with each other."""
    if options.scene_file is not None and not options.benchmark.scene_files:
        raise ConfigError(f"scene: {options.scene_file} needs {_those(lambda known: known.scene_files)}")
    if options.pick is not None and "pick" not in spec.policies:
        takes_turns = _those(lambda known: "pick" in find_task(known.task).policies)
        raise ConfigError(f"pick: {options.pick} needs {takes_turns}")
    _check_backend(options)
    if options.fresh:
        raise ConfigError(f"fresh: needs table=<name>, of {', '.join(TABLES)}")
    if options.videos is not None:
        _check_videos(options)
    if options.policy == MAP and options.analysis != "sight":
        raise ConfigError(f"policy: {MAP} drives for analysis=sight alone")
    if options.analysis is None:
        if options.plot is not None:
            raise ConfigError("plot: only an analysis draws one, such as analysis=camera")
        return
    analysed = _ANALYSED[options.analysis]
    if options.benchmark.name not in analysed:
        raise ConfigError(
            f"analysis: {options.analysis} needs {_those(lambda known: known.name in analysed)}"
        )
    if options.policy in BASELINES and options.analysis == "camera":
        raise ConfigError(f"analysis: camera needs a policy with one, which {options.policy} has not")
    if options.scene_file is not None and options.analysis in ("camera", "sight"):
        raise ConfigError(f"scene: analysis={options.analysis} runs in generated places, not in a scene file")
    if options.plot is not None:
        if options.plot.suffix not in _PLOTS:
            raise ConfigError(f"plot: expected a .png, .pdf or .svg file, got {str(options.plot)!r}")
        if find_spec("matplotlib") is None:
            raise ConfigError("plot: needs matplotlib: pip install 'spin-rl[plots]'")


def _check_videos(options: Options) -> None:
    """Reject videos of what shows none, and where they cannot be made."""
    if options.analysis != "behaviour":
        raise ConfigError("videos: only analysis=behaviour makes them; see spin-play video=")
    if options.videos is not None and options.videos.is_file():
        raise ConfigError(f"videos: {options.videos} is a file; name a folder")
    for module, package in (("imageio_ffmpeg", "imageio[ffmpeg]"), ("PIL", "pillow")):
        require(module, package, "viewer", "videos")


def _check_backend(options: Options) -> None:
    """Reject what cannot be run in another simulator."""
    if options.backend is None:
        for override in options.overrides:
            if override.startswith(("renderer=", "processes=")):
                raise ConfigError(f"{override.partition('=')[0]}: needs backend={backend_report.MUJOCO}")
        return
    if options.analysis is not None:
        raise ConfigError(f"backend: analysis={options.analysis} looks at the batched simulation alone")
    if options.benchmark.name == _SAME_FETCHES:
        raise ConfigError(f"backend: benchmark={_SAME_FETCHES} tells of a part alone, say benchmark=fetch")
    for key, name in (("policy", options.policy), ("pick", options.pick)):
        if name in policies.UNSAVED:
            raise ConfigError(f"{key}: {name} cannot be exported, as backend={options.backend} needs")


def _those(fits: Callable[[benchmarks.Benchmark], bool]) -> str:
    """Name the benchmarks that fit."""
    names = [name for name, benchmark in benchmarks.BENCHMARKS.items() if fits(benchmark)]
    return " or ".join(f"benchmark={name}" for name in names)
