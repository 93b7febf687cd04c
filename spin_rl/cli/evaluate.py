"""spin-eval: measure a policy in the paper's benchmark, beside the paper's figures."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from spin_rl.analysis.sight.options import MAP
from spin_rl.benchmark import policies, settings
from spin_rl.benchmark.tables import backend as backend_report
from spin_rl.cli import common, videos
from spin_rl.cli.measurement import Options, read_options
from spin_rl.cli.task_choice import with_task
from spin_rl.config import ConfigError
from spin_rl.files import write_json
from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.registry import find_task

_TASK_GROUPS = ("task", "robot", "scene", "sim", "depth", "camera")
"""Overrides that a replay by spin-play needs as well."""
_VIDEOS = 2
"""Of each behaviour that was shown, and of each that failed."""


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
    further = variants.held_variants(options.camera_analysis.tilts, options.camera_analysis.blind)
    if options.camera_analysis.sampled:
        further.append(variants.sampled_variant())
    result = analysis.analyse_camera(
        source.make,
        task,
        options.episodes,
        options.seeds,
        options.device,
        further=further,
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


if __name__ == "__main__":
    main()
