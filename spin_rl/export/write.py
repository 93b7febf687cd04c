"""Writes exported policies: one file, or the two of a fetch with the settings of its stages."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from spin_rl.benchmark import settings
from spin_rl.benchmark.policies import open_for
from spin_rl.config import ConfigError
from spin_rl.deploy.contract import Contract, Parity
from spin_rl.deploy.fetch.numbers import STAGES
from spin_rl.deploy.metadata import write_metadata
from spin_rl.deploy.network import Network
from spin_rl.deploy.text import summary
from spin_rl.export.describe import describe
from spin_rl.export.graph import make_graph, recurrent
from spin_rl.export.parity import agrees, compare
from spin_rl.files import write_atomically, write_json
from spin_rl.runners.policy_file import TrainedPolicy, read_policy
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.spec import FETCH

# Settings of the state machine, of all that defines the task; the rest is the simulator's.
_FETCH_SETTINGS = (
    "limits",
    "retries",
    "goal_tolerance_m",
    "home_tolerance_m",
    "place_m",
    "lift_m",
    "hold_s",
    "grasp_force_n",
    "finger_force_n",
    "hard_force_n",
    "fall_m",
    "carry_moves",
    "carry_lift_m",
    "pick_range_m",
)
_DRIVES = ("reach", "carry")


@dataclass(frozen=True)
class Exported:
    """A file that was written.

    Attributes:
        path: Where.
        contract: What it says of itself.
        parity: The check against the trained policy.
    """

    path: Path
    contract: Contract
    parity: Parity


def export_policy(policy: TrainedPolicy, path: Path, pilot: Mapping[str, Any] | None = None) -> Exported:
    """Export a policy; the file appears only if it does what the policy does.

    Args:
        policy: A recurrent one.
        path: File to write, `<name>.onnx`.
        pilot: See `describe`.

    Raises:
        ConfigError: It cannot be exported, a package is missing, or the exported one acts differently.
    """
    if path.suffix != ".onnx":
        raise ConfigError(f"out: a policy's file is named <name>.onnx, not {path.name}")
    actor = recurrent(policy.build(), policy.name)
    contract = describe(policy, actor.rnn_hidden_dim, pilot)
    dims = {group.name: group.size for group in contract.observations}
    model = make_graph(actor, dims)
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / path.name
        draft.write_bytes(_with_metadata(model, contract))
        parity = compare(Network(draft), actor)
    if not agrees(parity):
        raise ConfigError(
            f"policy: {policy.name} acts differently once exported: actions by {parity.action_error:.1e}, "
            f"memory by {parity.state_error:.1e}"
        )
    contract = replace(contract, parity=parity)
    data = _with_metadata(model, contract)
    write_atomically(path, lambda file: file.write(data))
    return Exported(path, contract, parity)


def export_fetch(
    nav: str, pick: str | None, folder: Path, config: FetchConfig | None = None
) -> list[Exported]:
    """Export the two policies of a fetch and `fetch.json`, the settings of its stages.

    Args:
        nav: Name or path of the policy that drives.
        pick: Of the one that picks; None takes the shipped one that sees what `nav` sees.
        folder: To write to.
        config: Settings of the stages; None takes those of the benchmark.

    Raises:
        ConfigError: They do not fit each other, or one cannot be exported.
    """
    source = open_for(FETCH, {"policy": nav, "pick": pick})
    if config is None:
        config = FETCH.configure(settings.for_policy(compose("eval", ["task=fetch"]), source.trained, ()))
    if config.camera_pose is not None:
        raise ConfigError("task.camera_pose: the stages of an exported fetch turn the head")
    if not config.head_sweeps:
        raise ConfigError("task.head_sweeps: the stages of an exported fetch sweep the head")
    stems = [Path(name).stem for name in source.names.values()]
    if stems[0] == stems[1]:  # such as checkpoints of two runs
        stems = ["nav", "pick"]
    exported = [
        export_policy(read_policy(name), folder / f"{stem}.onnx")
        for name, stem in zip(source.names.values(), stems, strict=True)
    ]
    files = [done.path.name for done in exported]
    write_json(folder / "fetch.json", fetch_settings(config, *files))
    return exported


def fetch_settings(config: FetchConfig, nav: str, pick: str) -> dict[str, Any]:
    """Return the settings of a fetch's state machine, as JSON can hold them; `nav` and `pick` name files."""
    files = dict.fromkeys(_DRIVES, nav) | {"pick": pick}
    values = asdict(config)
    return {
        "policies": {"nav": nav, "pick": pick},
        "stages": [{"name": stage, "policy": files.get(stage)} for stage in STAGES],
        "scripted": "stages without a policy; spin_rl/deploy/fetch",
        "reset": "a policy's memory is reset when its stage begins",
        "settings": {name: values[name] for name in _FETCH_SETTINGS},
    }


def _with_metadata(model: Any, contract: Contract) -> bytes:
    """Serialize a graph with its contract as metadata, and as text for those who open it in a viewer."""
    import onnx

    del model.metadata_props[:]
    onnx.helper.set_model_props(model, write_metadata(contract))
    model.doc_string = summary(contract)
    return model.SerializeToString()
