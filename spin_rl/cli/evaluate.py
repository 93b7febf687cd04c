"""spin-eval: measure a policy in the paper's benchmark, beside the paper's figures."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from spin_rl.cli import common
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.build import env_config, plain

BENCHMARKS = ("reach",)


def main() -> None:
    """Entry point of the `spin-eval` command."""
    sys.argv[1:] = [_scene_file(argument) for argument in sys.argv[1:]]
    common.run("eval", evaluate)


def _scene_file(argument: str) -> str:
    """Turn `scene=<file>` into `scene_file=<file>`: `scene` is also a group, so Hydra would refuse a file."""
    key, _, value = argument.partition("=")
    if key != "scene" or (CONF_DIR / "scene" / f"{value}.yaml").is_file():
        return argument
    return f"scene_file={value}"


def evaluate(cfg: DictConfig) -> None:
    """Run the benchmark that `cfg` describes, print its table and write its JSON."""
    values = plain(cfg)
    out = _check(values)
    from spin_rl.benchmark import policies, reach, report, settings

    name = values["policy"]
    make_policy, trained = policies.open_policy(name)
    cfg = settings.for_policy(cfg, trained, HydraConfig.get().overrides.task)
    scene = _load_scene(values["scene_file"])
    result = reach.evaluate_reach(
        make_policy,
        env_config(cfg),
        values["episodes"],
        values["seeds"],
        common.resolve_device(values["device"]),
        policy_name=name,
        num_envs=values["num_envs"],
        scene=scene,
        scene_name=Path(values["scene_file"] or "").name,
        announce=common.announced,
    )
    print(report.table(result))
    if out is None:
        print(f"Wrote nothing, out=<file.json> keeps the numbers: {report.headline(result)}")
    else:
        report.write_json(result, out)
        print(f"Wrote {out}: {report.headline(result)}")


def _check(values: dict[str, Any]) -> Path | None:
    """Reject what needs no simulator to reject; return the file to write."""
    if values["benchmark"] not in BENCHMARKS:
        raise ConfigError(f"benchmark: unknown {values['benchmark']!r}; choose from {', '.join(BENCHMARKS)}")
    if not isinstance(values["policy"], str):
        raise ConfigError("policy: give a name, checkpoint, run directory, .safetensors file, zero or random")
    for key in ("episodes", "num_envs"):
        if type(values[key]) is not int and not (key == "num_envs" and values[key] is None):
            raise ConfigError(f"{key}: expected a whole number, got {values[key]!r}")
    seeds = values["seeds"]
    if not isinstance(seeds, list) or any(type(seed) is not int for seed in seeds):
        raise ConfigError(f"seeds: expected a list of whole numbers such as [0,1,2], got {seeds!r}")
    if values["out"] is None:
        return None
    out = Path(str(values["out"]))
    if out.is_dir():
        raise ConfigError(f"out: {out} is a folder; name a file such as {out / 'reach.json'}")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"out: cannot make the folder {out.parent}: {error.strerror}") from None
    return out


def _load_scene(path: str | None) -> Any:
    if path is None:
        return None
    from spin_rl.scenes.scene_file import load_scene

    if not Path(path).is_file():
        raise ConfigError(f"scene: there is no file {path}")
    return load_scene(Path(path))


if __name__ == "__main__":
    main()
