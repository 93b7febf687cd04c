"""spin-export: write a policy as an ONNX file for robots, or show what such a file says of itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from spin_rl.benchmark.policies import UNTRAINED, check_name
from spin_rl.cli import common
from spin_rl.config import ConfigError, from_keys

if TYPE_CHECKING:
    from spin_rl.export.write import Exported


@dataclass(frozen=True)
class Options:
    """What to export, checked; see conf/export.yaml."""

    policy: common.PolicyName | None
    pick: common.PolicyName | None
    fetch: bool
    out: Path | None
    show: Path | None


def main() -> None:
    """Entry point of the `spin-export` command."""
    common.run("export", export, lambda given: (given, None), common.keys_of(Options, ()))


def export(call: common.Call) -> None:
    """Write the file or the bundle, and say how well it agrees with the policy; or show a file."""
    options = from_keys(Options, call.values)
    if options.show is not None:
        if options.policy is not None:
            raise ConfigError("show: exports nothing, leave policy= out")
        _show(options.show)
        return
    if options.policy is None:
        raise ConfigError("policy: a name or path is needed, or show=<file.onnx>")
    if options.pick is not None and not options.fetch:
        raise ConfigError("pick: is of a fetch, say fetch=true")
    for key, name in (("policy", options.policy), ("pick", options.pick)):
        if name is not None:
            check_name(name, key)
            if name in UNTRAINED:
                raise ConfigError(f"{key}: {name} learned nothing that could be exported")
    name = Path(options.policy).stem
    path = options.out or Path("fetch" if options.fetch else f"{name}.onnx")
    if not options.fetch:
        common.make_folder_of(path, f"{name}.onnx")
    elif path.exists() and not path.is_dir():
        raise ConfigError(f"out: {path} is a file; a fetch is a folder")
    written = _write(options.policy, options.pick, path, options.fetch)
    for done in written:
        parity = done.parity
        size = done.path.stat().st_size / 1e6
        print(
            f"Wrote {done.path} ({size:.1f} MB): {parity.steps} steps, {parity.resets} resets within "
            f"{parity.action_error:.1e} (actions) and {parity.state_error:.1e} (memory) of the policy"
        )
        if done.contract.simulation_only is not None:
            print(f"  For simulation only: {done.contract.simulation_only}")
    if options.fetch:
        print(f"Wrote {written[0].path.parent / 'fetch.json'}, the settings of the stages")


def _write(policy: str, pick: str | None, path: Path, fetch: bool) -> list[Exported]:
    """Write the file, or the two of a fetch; Torch is imported now."""
    import torch

    from spin_rl.export.write import export_fetch, export_policy
    from spin_rl.runners.policy_file import read_policy

    torch.set_num_threads(1)
    if fetch:
        return export_fetch(policy, pick, path)
    try:
        source = read_policy(policy)
    except ValueError as error:
        raise ConfigError(f"policy: {error}") from None
    return [export_policy(source, path)]


def _show(path: Path) -> None:
    """Print what a file says of itself, or all files of a fetch."""
    from spin_rl.deploy.fetch.agent import files_of
    from spin_rl.deploy.network import Network
    from spin_rl.deploy.text import full_text

    files = files_of(path)
    if not files:
        raise ConfigError(f"show: {path} holds no exported policy")
    for file in files:
        print(
            file.read_text(encoding="utf-8") if file.suffix == ".json" else full_text(Network(file).contract)
        )


if __name__ == "__main__":
    main()
