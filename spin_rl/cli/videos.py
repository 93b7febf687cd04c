"""Short videos made by `spin-play`: of what a run has learned so far, and of what an analysis found."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from spin_rl.config import ConfigError

EPISODES = 1
LONGEST_S = 10.0
"""Time limit of the episode that is shown: a policy that stands still is told soon."""


@contextlib.contextmanager
def made_on_the_way(run_dir: Path, minutes: float | None, episode_s: float) -> Iterator[Callable[[], None]]:
    """Make a video of the latest checkpoint every few minutes, in `<run_dir>/videos`.

    It takes a core for about half a minute. What goes wrong with it is told and does not stop the training.

    Args:
        run_dir: Folder of the run.
        minutes: Time between videos [min]; None makes none.
        episode_s: Time limit of the task's episodes [s].

    Yields:
        Call it after the end for a video of the last checkpoint; one that is in the making then is given up.
    """
    if minutes is None:
        yield lambda: None
        return
    over = threading.Event()
    numbers = itertools.count(1 + max(map(int, _made(run_dir)), default=0))  # a resumed run counts on

    def make(over: threading.Event) -> None:
        if (run_dir / "checkpoints" / "last.pt").exists():
            video = run_dir / "videos" / f"{next(numbers):04d}.mp4"
            _make(_play(run_dir, min(LONGEST_S, episode_s), video), over)

    def make_every_time() -> None:
        while not over.wait(60.0 * minutes):
            make(over)

    def make_last() -> None:
        print("Making a video of the last checkpoint; Ctrl-C leaves it out", flush=True)
        make(threading.Event())

    thread = threading.Thread(target=make_every_time, daemon=True)
    thread.start()
    try:
        yield make_last
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
                said = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
                raise ConfigError(f"videos: {path}: {said[-1]}")
            yield path


def _made(run_dir: Path) -> list[str]:
    """Numbers of the videos of a run."""
    return [video.stem for video in (run_dir / "videos").glob("*.mp4") if video.stem.isdecimal()]


def _play(run_dir: Path, episode_s: float, video: Path) -> list[str]:
    command = [sys.executable, "-m", "spin_rl.cli.play", f"policy={run_dir}", f"episodes={EPISODES}"]
    return [*command, "samples=1", "device=cpu", f"task.episode_s={episode_s}", f"video={video}"]


def _make(command: list[str], over: threading.Event) -> None:
    """Run a command until it ends or is no longer wanted."""
    alone = {name: value for name, value in os.environ.items() if name not in _OF_TORCHRUN}
    process = subprocess.Popen(
        command,
        env=alone | {"OMP_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    error = None
    try:
        while error is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                error = process.communicate(timeout=0.2)[1].strip()
            if over.is_set():
                process.kill()
    finally:
        process.kill()
    if process.returncode and not over.is_set():
        last = error.splitlines()[-1] if error else f"exit status {process.returncode}"
        print(f"\nwarning: video_minutes: no video: {last}", file=sys.stderr, flush=True)


_OF_TORCHRUN = ("RANK", "LOCAL_RANK", "WORLD_SIZE", "LOCAL_WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
