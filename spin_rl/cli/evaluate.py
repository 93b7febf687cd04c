"""spin-eval: measure a policy in the paper's benchmark, beside the paper's figures."""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from spin_rl.benchmark import registry as benchmarks
from spin_rl.cli import common
from spin_rl.cli.task_choice import check_task, with_task
from spin_rl.config import ConfigError
from spin_rl.files import write_json
from spin_rl.tasks.registry import any_config, plain

ANALYSES = ("camera", "failures")
# The analysis of the camera runs the benchmark a dozen times.
_ANALYSIS_COUNTS = {"episodes": 50, "seeds": [0]}
# Overrides that a replay by spin-play needs as well.
_TASK_GROUPS = ("task", "robot", "scene", "sim", "depth", "baseline")


def main() -> None:
    """Entry point of the `spin-eval` command."""
    sys.argv[1:] = with_task([common.scene_file_argument(argument) for argument in sys.argv[1:]])
    common.run("eval", evaluate)


def evaluate(cfg: DictConfig) -> None:
    """Run the benchmark or analysis that `cfg` describes, print its table and write its JSON."""
    values = plain(cfg)
    overridden = HydraConfig.get().overrides.task
    out = _check(values)
    from spin_rl.analysis.camera import report as camera_report
    from spin_rl.analysis.failures import report as failures_report
    from spin_rl.benchmark import policies, settings

    benchmark = benchmarks.BENCHMARKS[values["benchmark"]]
    if benchmark.task == "fetch":
        make_policy, trained, values["pick"] = policies.open_fetch_policy(values["policy"], values["pick"])
    else:
        make_policy, trained = policies.open_policy(values["policy"])
        check_task(values["policy"], trained, benchmark.task)
    task = any_config(settings.for_policy(cfg, trained, overridden))
    mistake = settings.unused_depth(task, overridden)
    if mistake is not None:
        raise ConfigError(mistake)
    if values["analysis"] == "camera":
        writer, result = camera_report, _analyse_camera(values, make_policy, task, overridden)
    elif values["analysis"] == "failures":
        writer, result = failures_report, _analyse_failures(values, make_policy, task, overridden)
    else:
        writer, result = benchmark, _measure(benchmark, values, make_policy, task)
    label = settings.scene_label(overridden, benchmark.scene)
    if label is not None and values["scene_file"] is None:
        result["scene"] = label
    headline = writer.headline(result)
    print(writer.table(result))
    if out is None:
        print(f"Wrote nothing, out=<file.json> keeps the numbers: {headline}")
    else:
        write_json(out, result)
        print(f"Wrote {out}: {headline}")
    if values["plot"] is not None:
        assert not isinstance(writer, benchmarks.Benchmark)  # checked: only an analysis draws
        writer.plot(result, Path(values["plot"]))
        print(f"Wrote {values['plot']}")


def _measure(
    benchmark: benchmarks.Benchmark, values: dict[str, Any], make_policy: Any, task: Any
) -> dict[str, Any]:
    scene = common.load_scene_file(values["scene_file"])
    return benchmark.evaluate(
        make_policy,
        task,
        values["episodes"],
        values["seeds"],
        common.resolve_device(values["device"]),
        policy_name=values["policy"],
        num_envs=values["num_envs"],
        announce=common.announced,
        **({} if scene is None else {"scene": scene, "scene_name": Path(values["scene_file"]).name}),
        **({} if values["pick"] is None else {"pick_name": values["pick"]}),
    )


def _analyse_camera(
    values: dict[str, Any], make_policy: Any, task: Any, overridden: Sequence[str]
) -> dict[str, Any]:
    from spin_rl.analysis.camera import analysis as camera
    from spin_rl.analysis.camera import variants as camera_variants
    from spin_rl.benchmark import reach

    given = {override.partition("=")[0] for override in overridden}
    values = values | {key: value for key, value in _ANALYSIS_COUNTS.items() if key not in given}
    options = values["camera"]
    cells = options["cells"]
    return camera.analyse_camera(
        make_policy,
        task,
        values["episodes"],
        values["seeds"],
        common.resolve_device(values["device"]),
        held=camera_variants.held_variants(options["tilts"], options["blind"]),
        cells=reach.REACH_CELLS if cells is None else camera_variants.parse_cells(cells),
        policy_name=values["policy"],
        num_envs=values["num_envs"],
        announce=common.announced,
    )


def _analyse_failures(
    values: dict[str, Any], make_policy: Any, task: Any, overridden: Sequence[str]
) -> dict[str, Any]:
    from spin_rl.analysis.failures import analysis as failures

    return failures.analyse_failures(
        make_policy,
        task,
        values["episodes"],
        values["seeds"],
        common.resolve_device(values["device"]),
        policy_name=values["policy"],
        overrides=[given for given in overridden if given.lstrip("+~").startswith(_TASK_GROUPS)],
        num_envs=values["num_envs"],
        announce=common.announced,
    )


def _check(values: dict[str, Any]) -> Path | None:
    """Reject what needs no simulator to reject, choose the benchmark, and return the file to write."""
    values["benchmark"] = benchmarks.find(values["benchmark"], values["task"]["name"])
    if values["benchmark"] != "reach":
        for key in ("scene_file", "analysis"):
            if values[key] is not None:
                raise ConfigError(f"{key.removesuffix('_file')}: {values[key]} needs benchmark=reach")
    pick = values["pick"]
    if pick is not None and benchmarks.BENCHMARKS[values["benchmark"]].task != "fetch":
        raise ConfigError(f"pick: {pick} needs benchmark=fetch or benchmark=place")
    for key in ("policy",) if pick is None else ("policy", "pick"):
        if not isinstance(values[key], str):
            raise ConfigError(
                f"{key}: give a name, checkpoint, run directory, .safetensors file, zero or random"
            )
    for key in ("episodes", "num_envs"):
        if type(values[key]) is not int and not (key == "num_envs" and values[key] is None):
            raise ConfigError(f"{key}: expected a whole number, got {values[key]!r}")
    seeds = values["seeds"]
    if not isinstance(seeds, list) or any(type(seed) is not int for seed in seeds):
        raise ConfigError(f"seeds: expected a list of whole numbers such as [0,1,2], got {seeds!r}")
    _check_analysis(values)
    return common.output_file(values["out"], f"{values['benchmark']}.json")


def _check_analysis(values: dict[str, Any]) -> None:
    analysis, plot, options = values["analysis"], values["plot"], values["camera"]
    if analysis not in (None, *ANALYSES):
        raise ConfigError(f"analysis: unknown {analysis!r}; choose from {', '.join(ANALYSES)}")
    if analysis is None:
        if plot is not None:
            raise ConfigError("plot: only an analysis draws one, such as analysis=camera")
        return
    if values["scene_file"] is not None:
        raise ConfigError("scene: an analysis runs in the benchmark's corridors, not in a scene file")
    if not _are_angles(options["tilts"]):
        raise ConfigError(f"camera.tilts: expected a list of angles [rad], got {options['tilts']!r}")
    blind = options["blind"]
    if blind is not None and not (_are_angles(blind) and len(blind) == 2):
        raise ConfigError(f"camera.blind: expected [pan, tilt] [rad] or null, got {blind!r}")
    if not isinstance(options["cells"], list | None):
        raise ConfigError(f"camera.cells: expected a list such as [1-hard,2-hard], got {options['cells']!r}")
    if plot is not None:
        _check_plot(plot)


def _check_plot(plot: Any) -> None:
    if not isinstance(plot, str) or Path(plot).suffix not in (".png", ".pdf", ".svg"):
        raise ConfigError(f"plot: expected a .png, .pdf or .svg file, got {plot!r}")
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError("plot: needs matplotlib: pip install 'spin-rl[plots]'")


def _are_angles(values: Any) -> bool:
    return isinstance(values, list) and all(type(v) in (int, float) and math.isfinite(v) for v in values)


if __name__ == "__main__":
    main()
