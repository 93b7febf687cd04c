"""Policies with few, random weights: what tests/data/tiny_*.onnx were exported from.

python tests/export/tiny_policies.py [name ...]    # writes them anew, after the metadata has changed
"""

import json
from dataclasses import asdict
from pathlib import Path

import torch

from spin_rl.export.write import Exported, export_policy
from spin_rl.runners.policy_file import build_model, read_policy, write_policy
from spin_rl.tasks.nav.config import GuardConfig, PlannerConfig

DATA = Path(__file__).parents[1] / "data"
LIKE = {"tiny_nav": "nav-cvo-depth", "tiny_pick": "pick-depth", "tiny_room": "nav-room"}
PILOT = {"guard": asdict(GuardConfig(enabled=True)), "planner": asdict(PlannerConfig(enabled=True))}
CHANGES = {"tiny_room": PILOT}
"""Of their tasks' configurations."""
FILTER = {"dilate_px": 1, "close_px": 4, "fill_px": 3, "median_support": 2, "blur": 0.5, "memory": 0.4}
FILTER |= {"hold_steps": 3}


def tiny_metadata(name: str, **changes) -> dict:
    """Metadata of a shipped policy with a small actor, and a depth filter with all steps."""
    metadata = json.loads(json.dumps(dict(read_policy(LIKE.get(name, name)).metadata)))
    actor = metadata["actor"]
    actor |= {"rnn_hidden_dim": 8, "scandot_latent": 4, "encoder_hidden": [8]}
    actor["hidden_dims"] = [8] if actor["hidden_dims"] else []
    if "depth_encoder" in actor:
        actor["depth_encoder"] |= {"channels": [2, 2], "kernels": [8, 4], "strides": [8, 4], "hidden": [8]}
        actor["depth_encoder"] |= {"hand_window": 8} if name == "tiny_pick" else {}
    if metadata["config"]["depth"] is not None:
        metadata["config"]["depth"]["filter"] |= FILTER
    metadata["facts"] = {"command": "none: random weights, for tests"}
    metadata["config"]["task"] |= CHANGES.get(name, {}) | changes
    return metadata


def make_tiny(name: str, folder: Path, seed: int = 1, **changes) -> Path:
    """Write a tiny policy file; `changes` are of its task's configuration."""
    metadata = tiny_metadata(name, **changes)
    dims = {group: metadata["obs_dims"][group] for group in metadata["obs_groups"]}
    torch.manual_seed(seed)
    model = build_model(metadata["actor"], "actor", dims, metadata["num_actions"])
    for parameter in model.parameters():  # actions that are neither constant nor at their limits
        torch.nn.init.normal_(parameter, std=0.2)
    weights = {key: value.contiguous() for key, value in model.state_dict().items()}
    path = folder / f"{name}.safetensors"
    write_policy(path, weights, metadata)
    return path


def export_tiny(name: str, folder: Path, out: Path, **changes) -> Exported:
    """Export a tiny policy."""
    return export_policy(read_policy(make_tiny(name, folder, **changes)), out)


if __name__ == "__main__":
    import sys
    import tempfile

    for tiny in sys.argv[1:] or LIKE:
        with tempfile.TemporaryDirectory() as place:
            print(export_tiny(tiny, Path(place), DATA / f"{tiny}.onnx").parity)
