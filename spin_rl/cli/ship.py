"""Turn a trained run into a shipped policy and its model card: python -m spin_rl.cli.ship RUN NAME REPORT."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from spin_rl.benchmark.registry import BENCHMARKS
from spin_rl.files import write_text
from spin_rl.machine import hardware
from spin_rl.paths import POLICY_DIR
from spin_rl.runners.policy_file import save_policy


def main() -> None:
    """Write `policies/<name>.safetensors` and `policies/<name>.md` from a run and its benchmark report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="run folder, with summary.json")
    parser.add_argument("name", help="name of the policy, as in spin-eval policy=<name>")
    parser.add_argument("report", type=Path, help="JSON written by spin-eval out=")
    parser.add_argument("--command", required=True, help="the command that trained it")
    parser.add_argument("--note", default="", help="what else a reader should know")
    arguments = parser.parse_args()
    try:
        summary = json.loads((arguments.run / "summary.json").read_text())
        report = json.loads(arguments.report.read_text())
    except (OSError, ValueError) as error:
        parser.error(str(error))
    machine = hardware(summary["device"])
    facts = {"command": arguments.command, "hardware": machine, "seed": summary["seed"]}
    path = POLICY_DIR / f"{arguments.name}.safetensors"
    save_policy(path, arguments.run, facts)
    card = _card(arguments.name, arguments.note, facts, summary, report)
    write_text(path.with_suffix(".md"), card)
    print(f"Wrote {path} ({path.stat().st_size / 1e6:.1f} MB) and {path.with_suffix('.md')}")


def _card(
    name: str, note: str, facts: dict[str, Any], summary: dict[str, Any], report: dict[str, Any]
) -> str:
    """Compose the model card."""
    seeds = ",".join(str(seed) for seed in report["seeds"])
    table = BENCHMARKS[report["benchmark"]].table(report | {"policy": name})
    return f"""# {name}

{note}

| | |
|---|---|
| Trained with | `{facts["command"]}` |
| Hardware | {facts["hardware"]} |
| Processes | {summary["processes"]} |
| Samples | {summary["env_steps"]:,} env steps in {summary["minutes"]:.0f} min |
| Seed | {facts["seed"]} |
| Success in training at the end | {summary["success_rate"]:.2f} |

Measured with `spin-eval policy={name} benchmark={report["benchmark"]} \
episodes={report["episodes_per_seed"]} seeds=[{seeds}]` (deterministic actions):

```
{table}
```
"""


if __name__ == "__main__":
    main()
