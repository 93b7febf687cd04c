"""Kills a process that saves again and again, hundreds of times: does a run ever lose what it had saved?

    python -m spin_rl.speed.kills --kills 500

Prints what was found and exits with 1 if anything was lost. POSIX only: the process is a fork.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import torch

from spin_rl.files import remove_temporary, write_json
from spin_rl.runners.checkpoint import (
    KEEP_NUMBERED,
    find_checkpoint,
    load_checkpoint,
    save_numbered,
    set_aside,
)

LONGEST_S = 0.1
"""Time until the kill; shorter ones are as likely."""
_WEIGHTS = 200_000
_BRANCH = 50
"""Every so many kills the run goes on from an older checkpoint."""


@dataclass
class Findings:
    """What the kills found.

    Attributes:
        kills: How many there were.
        torn: Kills that left a temporary file, and so hit a write.
        lost: One line for each loss.
    """

    kills: int = 0
    torn: int = 0
    lost: list[str] = field(default_factory=list)


def kill_often(folder: Path, kills: int, seed: int = 0) -> Findings:
    """Let a process save checkpoints and a summary in a folder, kill it, and look at what is left.

    Args:
        folder: Empty folder.
        kills: How often.
        seed: Of the times until the kill.
    """
    rng = random.Random(seed)
    found, told = Findings(), 0
    checkpoints = folder / "checkpoints"
    for kill in range(kills):
        reads, writes = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reads)
            _save_for_ever(folder, told, writes)
        os.close(writes)
        time.sleep(rng.uniform(0.0, LONGEST_S))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        told = max([told, *_numbers(reads)])
        found.kills += 1
        found.torn += bool([*folder.glob(".*.tmp"), *checkpoints.glob(".*.tmp")])
        found.lost += [f"kill {kill}: {problem}" for problem in _problems(folder, told)]
        if kill % _BRANCH == _BRANCH - 1 and told > KEEP_NUMBERED:
            told = _go_back(checkpoints)
    return found


def _save_for_ever(folder: Path, iteration: int, tell: int) -> None:
    """Be the process: go on where the last one stopped, and tell every number when its files are written."""
    try:
        remove_temporary(folder / "checkpoints")
        generator = torch.Generator().manual_seed(iteration)
        while True:
            iteration += 1
            weights = torch.rand(_WEIGHTS, generator=generator)
            save_numbered(folder / "checkpoints", iteration, {"iteration": iteration, "weights": weights})
            write_json(folder / "summary.json", {"iterations": iteration})
            os.write(tell, iteration.to_bytes(4, "little"))
    finally:
        os._exit(1)


def _numbers(reads: int) -> list[int]:
    with os.fdopen(reads, "rb") as pipe:
        content = pipe.read()
    return [int.from_bytes(content[i : i + 4], "little") for i in range(0, len(content), 4)]


def _problems(folder: Path, told: int) -> list[str]:
    """Say what of the checkpoints that were told of cannot be had any more."""
    checkpoints = folder / "checkpoints"
    if told == 0 and not (checkpoints / "last.pt").exists():
        return []
    problems = []
    for path in sorted(checkpoints.glob("*.pt")):
        try:
            load_checkpoint(path)
        except ValueError as error:
            problems.append(str(error))
    try:
        newest = find_checkpoint(folder)[1]["iteration"]
    except (FileNotFoundError, ValueError):
        newest = 0
    if newest < told:
        problems.append(f"{told} had been saved, {newest} is left")
    return problems


def _go_back(checkpoints: Path) -> int:
    """Begin another branch at the oldest checkpoint; return its number."""
    oldest = min(checkpoints.glob("iteration_*.pt"))
    set_aside(oldest)
    return load_checkpoint(oldest)["iteration"]


def main() -> None:
    """Kill as often as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        found = kill_often(Path(folder), arguments.kills, arguments.seed)
    print(*found.lost, sep="\n", end="\n" if found.lost else "")
    print(f"{found.kills} kills, {found.torn} of them inside a write: {len(found.lost)} losses")
    sys.exit(1 if found.lost else 0)


if __name__ == "__main__":
    main()
