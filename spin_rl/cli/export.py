"""spin-export: write a policy as an ONNX file for robots, or show what such a file says of itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from spin_rl.cli import common
from spin_rl.config import ConfigError, from_keys
from spin_rl.runners.policy_file import read_policy


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
    from spin_rl.export.write import export_fetch, export_policy

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
    torch.set_num_threads(1)
    if options.fetch:
        folder = options.out or Path("fetch")
        if folder.is_file():
            raise ConfigError(f"out: {folder} is a file; a fetch is a folder")
        written = export_fetch(options.policy, options.pick, folder)
    else:
        policy = read_policy(options.policy)
        name = Path(options.policy).stem
        path = options.out or Path(f"{name}.onnx")
        common.make_folder_of(path, f"{name}.onnx")
        written = [export_policy(policy, path)]
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
