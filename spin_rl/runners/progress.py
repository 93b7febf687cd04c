"""What a run shows: lines on the terminal and scalars for TensorBoard."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO

from rsl_rl.utils.log_writer import LogWriter

MAIN_TAGS = ("Train/mean_reward", "Episode/success_rate")
OVER_STEPS = "/env_steps"
"""Tags that are also written over the environment steps, and what is then added to them."""

LINE_INTERVAL_S = 10.0
"""Time between lines where the output is not a terminal."""


def join_statistics(parts: Sequence[dict[str, float]]) -> dict[str, float]:
    """Join episode statistics of processes, rollouts or iterations.

    Args:
        parts: Statistics with the same names, "episodes" among them; may be empty.

    Returns:
        Sums of the counts, which are "episodes" and what is named "overflow/..."; of all else the mean,
        weighted by the episodes. Parts without episodes count only where no part has one.
    """
    episodes = sum(part["episodes"] for part in parts)
    joined = {"episodes": episodes}
    for name in parts[0].keys() - {"episodes"} if parts else ():
        if name.startswith("overflow/"):
            joined[name] = sum(part[name] for part in parts)
        elif episodes > 0:
            counted = (part for part in parts if part["episodes"] > 0)
            joined[name] = sum(part["episodes"] / episodes * part[name] for part in counted)
        else:
            joined[name] = sum(part[name] for part in parts) / len(parts)
    return joined


class RecentEpisodes:
    """Statistics over the last few iterations, weighted by their episodes."""

    def __init__(self, iterations: int = 10) -> None:
        self._window: deque[dict[str, float]] = deque(maxlen=iterations)

    def add(self, statistics: dict[str, float]) -> None:
        """Add the statistics of one iteration; those without an ended episode say nothing."""
        if statistics["episodes"] > 0:
            self._window.append(statistics)

    def mean(self, name: str) -> float:
        """Return a statistic's mean, NaN before the first episode has ended."""
        return join_statistics(self._window)[name] if self._window else math.nan


class ProgressLine:
    """One line of state: rewritten in place on a terminal, printed every few seconds elsewhere."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._in_place = self._stream.isatty()
        self._next_time = 0.0
        self._width = 0

    def show(self, text: str, force: bool = False) -> None:
        """Show the line; off a terminal only when it is due, or if forced."""
        if self._in_place:
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        elif force or time.monotonic() >= self._next_time:
            self._next_time = time.monotonic() + LINE_INTERVAL_S
            self._stream.write(text + "\n")
        self._stream.flush()

    def end(self, text: str) -> None:
        """Finish the line that is rewritten, and print one that stays."""
        self._stream.write(("\n" if self._in_place and self._width else "") + text + "\n")
        self._stream.flush()
        self._width = 0


class ScalarWriter:
    """TensorBoard events of a run; does nothing without a folder, nor after a failure that it told of."""

    def __init__(
        self,
        folder: Path | None,
        first_iteration: int,
        wandb_project: str | None = None,
        config: dict[str, Any] | None = None,
    ) -> None:
        """Open an event file; events of a resumed run after its checkpoint are dropped.

        Args:
            folder: Where to; None for nowhere.
            first_iteration: Iterations of the checkpoint.
            wandb_project: Project at Weights & Biases that gets the scalars as well.
            config: Configuration of the run, for the project.
        """
        self._folder = folder
        self._writer = None
        self._axes = ("", OVER_STEPS)
        if folder is None:
            return
        with self._giving_up():
            if wandb_project is None:
                from torch.utils.tensorboard import SummaryWriter  # slow to import

                step = first_iteration + 1
                self._writer = SummaryWriter(str(folder), purge_step=step, flush_secs=10)
            else:
                self._writer = _wandb_writer(folder, wandb_project, config or {})
                self._axes = ("",)  # there, whoever looks chooses the axis, and steps may only grow

    def write(self, iteration: int, scalars: dict[str, float]) -> None:
        """Write the scalars that are finite, over the iteration and some also over the environment steps."""
        if self._writer is None:
            return
        with self._giving_up():
            for axis in self._axes:
                step = round(scalars["Perf/env_steps"]) if axis else iteration
                for tag in MAIN_TAGS if axis else scalars:
                    if math.isfinite(scalars.get(tag, math.nan)):
                        self._writer.add_scalar(tag + axis, scalars[tag], step)

    def close(self) -> None:
        """Write what is buffered."""
        if self._writer is not None:
            with self._giving_up():
                self._writer.close()
                if isinstance(self._writer, LogWriter):
                    self._writer.stop()

    @contextlib.contextmanager
    def _giving_up(self) -> Iterator[None]:
        """Go on without events where they cannot be written: a run is worth more than its curves."""
        try:
            yield
        except OSError as error:
            self._writer = None
            what = f"{self._folder}: no more events are written: {error.strerror or error}"
            print(f"\nwarning: {what}", file=sys.stderr, flush=True)


def _wandb_writer(folder: Path, project: str, config: dict[str, Any]) -> Any:
    import wandb  # pyright: ignore[reportMissingImports]  # an optional package
    from rsl_rl.utils.wandb_log_writer import WandbLogWriter

    writer = WandbLogWriter(str(folder), project)
    wandb.config.update(config)
    return writer


def episode_tag(name: str) -> str:
    """TensorBoard tag of an episode statistic: rsl_rl's, or in the group before its slash, else Episode."""
    if name == "mean_return":
        return "Train/mean_reward"
    return name[0].upper() + name[1:] if "/" in name else f"Episode/{name}"


def format_duration(seconds: float) -> str:
    """Format a duration as h:mm:ss."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}"
