"""Short videos made by `spin-play`: of what a run has learned so far, and of what an analysis found."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from spin_rl.config import ConfigError

EPISODES = 1
LONGEST_S = 10.0
"""Time limit of the episode that is shown: a policy that stands still is told soon."""


@contextlib.contextmanager
def made_on_the_way(run_dir: Path, minutes: float | None, episode_s: float) -> Iterator[None]:
    """Make a video of the latest checkpoint every few minutes, in `<run_dir>/videos`.

    It takes a core for about half a minute. What goes wrong with it is told and does not stop the training.

    Args:
        run_dir: Folder of the run.
        minutes: Time between videos [min]; None makes none.
        episode_s: Time limit of the task's episodes [s].
    """
    if minutes is None:
        yield
        return
    over = threading.Event()
    command = [sys.executable, "-m", "spin_rl.cli.play", f"policy={run_dir}", f"episodes={EPISODES}"]
    command += ["samples=1", "device=cpu", f"task.episode_s={min(LONGEST_S, episode_s)}"]
    thread = threading.Thread(target=_make, args=(command, run_dir, 60.0 * minutes, over), daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def of_events(
    events: Mapping[str, Sequence[Mapping[str, Any]]], policy: str, device: str, folder: Path
) -> Iterator[Path]:
    """Make a video of the episode of each event; yield the files as they are made.

    Args:
        events: Of each kind, with `play`, the overrides that show the episode again.
        policy: Who acted.
        device: "cpu" or "cuda:N".
        folder: Made if needed.

    Raises:
        ConfigError: A video could not be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for kind, found in events.items():
        for number, event in enumerate(found, start=1):
            path = folder / f"{kind.replace(', ', '_').replace(' ', '_')}_{number}.mp4"
            command = [sys.executable, "-m", "spin_rl.cli.play", f"policy={policy}", *event["play"].split()]
            command += ["episodes=1", "samples=1", f"device={device}", f"video={path}"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise ConfigError(f"videos: {path}: {done.stderr.strip().splitlines()[-1:]}")
            yield path


def _make(command: list[str], run_dir: Path, seconds: float, over: threading.Event) -> None:
    number = 0
    while not over.wait(seconds):
        if not (run_dir / "checkpoints" / "last.pt").exists():
            continue
        number += 1
        video = run_dir / "videos" / f"{number:04d}.mp4"
        alone = {name: value for name, value in os.environ.items() if name not in _OF_TORCHRUN}
        process = subprocess.Popen(
            [*command, f"video={video}"],
            env=alone | {"OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        while process.poll() is None:
            if over.wait(1.0):
                process.kill()
        error = process.communicate()[1].strip()
        if process.returncode and not over.is_set():
            last = error.splitlines()[-1] if error else f"exit status {process.returncode}"
            print(f"\nwarning: video_minutes: no video: {last}", file=sys.stderr, flush=True)


_OF_TORCHRUN = ("RANK", "LOCAL_RANK", "WORLD_SIZE", "LOCAL_WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
