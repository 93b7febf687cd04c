"""spin-list: names tasks, algorithms, scenes, policies, benchmarks, and the checkpoints of a run."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from spin_rl.baselines.registry import BASELINES
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR, POLICY_DIR
from spin_rl.policy import task_in_header

Row = tuple[str, str]


def main() -> None:
    """Entry point of the `spin-list` command."""
    arguments = sys.argv[1:]
    try:
        for title, rows in _asked_for(arguments):
            width = max((len(name) for name, _ in rows), default=0)
            print(f"{title}:")
            print("\n".join(f"  {name:<{width}}  {meaning}".rstrip() for name, meaning in rows) or "  none")
    except ConfigError as error:
        print(f"spin-list: error: {error}", file=sys.stderr)
        sys.exit(2)


def _asked_for(arguments: list[str]) -> Iterable[tuple[str, list[Row]]]:
    if not arguments:
        return [(kind, rows()) for kind, rows in KINDS.items()]
    return [_of(argument) for argument in arguments]


def _of(argument: str) -> tuple[str, list[Row]]:
    if argument in KINDS:
        return argument, KINDS[argument]()
    if Path(argument).is_dir():
        return f"checkpoints of {argument}", checkpoints(Path(argument))
    known = ", ".join(KINDS)
    raise ConfigError(f"{argument}: is neither the folder of a run nor one of {known}")


def tasks() -> list[Row]:
    """Tasks and what they are about."""
    return _files("task")


def algorithms() -> list[Row]:
    """Values of spin-train's `algo`."""
    return _files("algo")


def scenes() -> list[Row]:
    """Distributions of scenes, and scene files."""
    files = sorted((CONF_DIR / "scenes_examples").glob("*.yaml"))
    return _files("scene") + [(file.name, _meaning(file)) for file in files]


def policies() -> list[Row]:
    """Shipped policies, the task that each was trained in, and what its card says first."""
    rows = []
    for file in sorted(POLICY_DIR.glob("*.safetensors")):
        card = file.with_suffix(".md")
        text = card.read_text().split("\n\n")[1] if card.is_file() else ""
        about = text.partition(". ")[0].partition(": ")[0].partition(";")[0]
        rows.append((file.stem, f"task={task_in_header(file)}: {about}"))
    rows += [(name, f"task={known.task}: a baseline, docs/baselines.md") for name, known in BASELINES.items()]
    return [*rows, ("zero, random", "any task: what learned nothing")]


def benchmarks() -> list[Row]:
    """Values of spin-eval's `benchmark`."""
    from spin_rl.benchmark.registry import BENCHMARKS

    return [
        (name, f"task={benchmark.task} scene={benchmark.scene}") for name, benchmark in BENCHMARKS.items()
    ]


def checkpoints(run_dir: Path) -> list[Row]:
    """Checkpoints of a run, the newest first; `policy=` and `resume=` take the run, which is `last.pt`.

    Raises:
        ConfigError: The folder holds none.
    """
    folder = run_dir / "checkpoints" if (run_dir / "checkpoints").is_dir() else run_dir
    numbered = sorted(folder.glob("iteration_*.pt"), reverse=True)
    files = [file for file in (folder / "last.pt", *numbered) if file.is_file()]
    if not files:
        raise ConfigError(f"{run_dir}: holds no checkpoint")
    return [(str(file), f"{file.stat().st_size / 1e6:.1f} MB") for file in files]


def _files(group: str) -> list[Row]:
    return [(file.stem, _meaning(file)) for file in sorted((CONF_DIR / group).glob("*.yaml"))]


def _meaning(file: Path) -> str:
    lines = [line for line in file.read_text().splitlines() if not line.startswith("# @")]
    block = itertools.takewhile(lambda line: line.startswith("#"), lines)
    return " ".join(line[1:].strip() for line in block).partition(". ")[0].rstrip(".")


KINDS: dict[str, Callable[[], list[Row]]] = {
    "tasks": tasks,
    "algorithms": algorithms,
    "scenes": scenes,
    "policies": policies,
    "benchmarks": benchmarks,
}
