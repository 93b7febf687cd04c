"""spin-eval: measure a policy in the paper's benchmark, beside the paper's figures."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

from spin_rl.analysis.sight.options import MAP, SightOptions
from spin_rl.baselines.registry import BASELINES
from spin_rl.benchmark import policies, settings
from spin_rl.benchmark import registry as benchmarks
from spin_rl.benchmark.tables import backend as backend_report
from spin_rl.cli import common, videos
from spin_rl.cli.task_choice import with_task
from spin_rl.config import Choice, ConfigError, Range, from_keys
from spin_rl.deploy.backends.renderers import RENDERERS
from spin_rl.extras import require
from spin_rl.files import write_json
from spin_rl.ranges import Seed
from spin_rl.reproduce.tables.registry import ALL, TABLES
from spin_rl.tasks.common.config import TaskConfig
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
_TASK_GROUPS = ("task", "robot", "scene", "sim", "depth", "camera")
"""Overrides that a replay by spin-play needs as well."""
_PLOTS = (".png", ".pdf", ".svg")
_VIDEOS = 2
"""Of each behaviour that was shown, and of each that failed."""

Angle = Annotated[float, Range()]

_SAME_FETCHES = "place"
"""The benchmark that tells of another's episodes."""


@dataclass(frozen=True)
class CameraOptions:
    """Where the analysis of the camera holds it.

    Attributes:
        tilts: At pan 0 [rad].
        blind: Pan and tilt of the control [rad], or None.
        cells: Names such as `1-hard`, or None for all.
    """

    tilts: tuple[Angle, ...]
    blind: tuple[Angle, Angle] | None
    cells: tuple[str, ...] | None


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


def main() -> None:
    """Entry point of the `spin-eval` command."""
    common.run(
        "eval",
        evaluate,
        lambda given: with_task([common.scene_file_argument(a) for a in given]),
        common.keys_of(Options, common.TASK_GROUPS),
    )


def evaluate(call: common.Call) -> bool:
    """Run the benchmark or analysis that was asked for, print its table and write its JSON.

    With `table`, print a table of stored results instead.
    """
    if call.values["table"] is not None:
        from spin_rl.cli import tables

        return tables.show(call)
    options = read_options(call)
    benchmark, spec = options.benchmark, find_task(options.benchmark.task)
    spec.check(call.values)
    named = "zero" if options.policy == MAP else options.policy
    source = policies.open_for(spec, {"policy": named, "pick": options.pick}, call.opened)
    task = spec.configure(settings.for_policy(call.values, source.trained, options.overrides))
    source.check(task)
    mistake = settings.unused_depth(task, options.overrides) or settings.unused_cell(options.overrides)
    if mistake is not None:
        raise ConfigError(mistake)
    runs = {
        None: _measure,
        "camera": _analyse_camera,
        "failures": _analyse_failures,
        "behaviour": _analyse_behaviour,
        "sight": _analyse_sight,
    }
    writer, result = runs[options.analysis](options, source, task)
    label = settings.scene_label(options.overrides, benchmark.scene)
    if label is not None and options.scene_file is None:
        result["scene"] = label
    headline = writer.headline(result)
    print(writer.table(result))
    if options.out is None:
        print(f"{headline[0].upper()}{headline[1:]} (out=<file.json> keeps the numbers)")
    else:
        write_json(options.out, result)
        print(f"Wrote {options.out}: {headline}")
    if options.plot is not None:
        writer.plot(result, options.plot)
        print(f"Wrote {options.plot}")
    if options.videos is not None:
        found = writer.examples(result, _VIDEOS)
        for path in videos.of_events(found, options.policy, options.device, options.videos):
            print(f"Wrote {path}")
    return bool(result.get("stopped"))


Measured = tuple[Any, dict[str, Any]]
"""What tells of a result, by its `table`, its `headline` and, of an analysis, its `plot`; and the result."""


def _measure(options: Options, source: policies.PolicySource, task: TaskConfig) -> Measured:
    from spin_rl.planning.trips import has_way

    scene = common.load_scene_file(options.scene_file)
    if scene is not None and options.starts is None and find_spec("scipy") and not has_way(scene):
        print(f"scene: {options.scene_file}: the planner finds no way from the start to the goal")
    fixed = {} if options.scene_file is None else {"scene": scene, "scene_name": options.scene_file.name}
    batched = partial(
        options.benchmark.evaluate,
        source.make,
        task,
        options.episodes,
        options.seeds,
        options.device,
        num_envs=options.num_envs,
        announce=common.announced,
        **{f"{key}_name": name for key, name in source.names.items()},
        **fixed,
    )
    if options.backend is None:
        return options.benchmark, batched()
    return backend_report, _measure_again(options, batched, task)


def _measure_again(options: Options, batched: Callable[..., dict[str, Any]], task: Any) -> dict[str, Any]:
    from spin_rl.benchmark.backend import again
    from spin_rl.benchmark.backend.conditions import pilot_of
    from spin_rl.export.write import export_fetch, export_policy
    from spin_rl.runners.policy_file import read_policy

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        if options.benchmark.task == "fetch":
            export_fetch(options.policy, options.pick, path, task)
        else:
            path /= "policy.onnx"
            export_policy(read_policy(options.policy), path, pilot_of(task))
        return again.evaluate_again(
            batched,
            task,
            path,
            backend=str(options.backend),
            renderer=options.renderer,
            processes=options.processes,
        )


def _analyse_camera(options: Options, source: policies.PolicySource, task: Any) -> Measured:
    from spin_rl.analysis.camera import analysis, report, variants
    from spin_rl.benchmark import reach

    cells = options.camera_analysis.cells
    if options.benchmark.name == "rooms":
        if cells is not None:
            raise ConfigError("camera_analysis.cells: are those of benchmark=reach")
        conditions = analysis.places(task)
    else:
        conditions = analysis.corridors(reach.REACH_CELLS if cells is None else variants.parse_cells(cells))
    result = analysis.analyse_camera(
        source.make,
        task,
        options.episodes,
        options.seeds,
        options.device,
        held=variants.held_variants(options.camera_analysis.tilts, options.camera_analysis.blind),
        conditions=conditions,
        policy_name=options.policy,
        num_envs=options.num_envs,
        announce=common.announced,
    )
    return report, result


def _analyse_failures(options: Options, source: policies.PolicySource, task: Any) -> Measured:
    from spin_rl.analysis.failures import analysis, report

    return report, _watched(analysis.analyse_failures, options, source, task)


def _watched(
    analyse: Callable[..., dict[str, Any]], options: Options, source: policies.PolicySource, task: Any
) -> dict[str, Any]:
    """Run an analysis that looks at every episode."""
    return analyse(
        options.benchmark,
        source.make,
        task,
        options.episodes,
        options.seeds,
        options.device,
        policy_name=options.policy,
        overrides=[given for given in options.overrides if settings.group_of(given) in _TASK_GROUPS],
        num_envs=options.num_envs,
        scene=common.load_scene_file(options.scene_file),
        scene_file=options.scene_file,
        announce=common.announced,
    )


def _analyse_behaviour(options: Options, source: policies.PolicySource, task: Any) -> Measured:
    from spin_rl.analysis.behaviour import analysis, report

    return report, _watched(analysis.analyse_behaviour, options, source, task)


def _analyse_sight(options: Options, source: policies.PolicySource, task: Any) -> Measured:
    from spin_rl.analysis.sight import analysis, report

    if policies.reads_images(source):
        raise ConfigError(f"policy: {options.policy} reads images; analysis=sight needs one that can be told")
    if options.policy == MAP and options.benchmark.task == "fetch":
        raise ConfigError(f"policy: {MAP} drives and picks nothing; a fetch needs a policy of task=nav")
    result = analysis.analyse_sight(
        options.benchmark,
        source.make,
        task,
        options.sight,
        options.episodes,
        options.seeds,
        options.device,
        policy_name=options.policy,
        pick_name=source.names.get("pick"),
        num_envs=options.num_envs,
        announce=common.announced,
    )
    if options.out is not None:
        report.write_csv(result, options.out.with_suffix(".csv"))
    return report, result


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


if __name__ == "__main__":
    main()
