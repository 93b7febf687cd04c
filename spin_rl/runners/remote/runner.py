"""Asynchronous distillation: one process collects, this one learns (SPIN supplement, asynchronous DAgger)."""

from __future__ import annotations

import copy
import multiprocessing
import shutil
import time
from collections.abc import Callable
from multiprocessing.connection import wait
from multiprocessing.context import ForkServerContext, SpawnContext
from pathlib import Path
from typing import Any, cast

from tensordict import TensorDict

from spin_rl.config import from_mapping
from spin_rl.models import ScandotModel
from spin_rl.runners.distillation.runner import DistillRunner
from spin_rl.runners.distillation.sequences import Sequences
from spin_rl.runners.interface import TrainingEnv
from spin_rl.runners.progress import join_statistics
from spin_rl.runners.remote.collector import (
    Introduction,
    Order,
    Rollout,
    SharedWeights,
    collect_for_ever,
    receive,
)
from spin_rl.runners.remote.ring import Ring, RingConfig

_SHARED_MEMORY = Path("/dev/shm")
_PATIENCE_S = 10.0
_SLICE_S = 0.5
_REPORT_S = 15.0


class CollectorError(RuntimeError):
    """The collecting process failed or is gone; one line says how."""


class RemoteEnv:
    """Stands for the environment of a collecting process that it starts."""

    is_remote = True
    cfg: dict[str, Any] = {}  # noqa: RUF012 - rsl_rl asks for one, and only logs it

    def __init__(
        self,
        make_env: Callable[[], TrainingEnv],
        device: str,
        context: ForkServerContext | SpawnContext | None = None,
    ) -> None:
        """Start the process and wait for its environment.

        Args:
            make_env: Makes the environment there; it is sent to the process, so that it must be picklable.
            device: Torch device of the collector.
            context: How to start processes; a forked one could not use a GPU, so that by default they are
                spawned.

        Raises:
            CollectorError: It could not make the environment.
        """
        context = context or multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(
            target=collect_for_ever, args=(other, make_env, device), name="collector", daemon=True
        )
        self._process.start()
        other.close()  # so that the end of the process is the end of the connection
        introduction: Introduction = self.receive()
        self._example = introduction.example
        self.num_actions = introduction.num_actions
        self.camera_actions, self.camera_columns = introduction.camera
        self.num_envs = next(iter(self._example.values())).shape[0]
        self._state = introduction.env_state
        self._resumed: dict[str, Any] | None = None

    @property
    def pid(self) -> int | None:
        """Number of the collecting process."""
        return self._process.pid

    def get_observations(self) -> TensorDict:
        """Return observations of the right sizes, those that the environment began with."""
        return TensorDict(self._example, batch_size=[self.num_envs])

    def state_dict(self) -> dict[str, Any]:
        """Return the environment's state after the newest rollout."""
        return self._state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Let the collector begin with a state."""
        self._state = self._resumed = state

    def dump_non_finite(self, folder: Path) -> list[Path]:
        """Return nothing: the collector writes such files itself, and tells in `Rollout.dumps`."""
        return []

    def begin(
        self,
        cfg: dict[str, Any],
        blocks: list[Sequences],
        weights: SharedWeights,
        teacher: ScandotModel,
        run_dir: Path | None,
    ) -> None:
        """Let the collector begin; arguments as of `Order`.

        Raises:
            CollectorError: It is gone.
        """
        try:
            self._connection.send(Order(cfg, blocks, weights, teacher, self._resumed, run_dir))
        except (BrokenPipeError, ConnectionResetError):
            raise self._end() from None

    def poll(self) -> bool:
        """Whether a message is there."""
        return self._connection.poll()

    def receive(self, check: Callable[[], None] | None = None) -> Any:
        """Wait for the next message.

        Args:
            check: Called now and then while there is none; what it raises ends the waiting. With it, what
                takes long is told.

        Raises:
            CollectorError: It tells of an error, or there will be none.
        """
        start = reported = time.monotonic()
        while not wait([self._connection, self._process.sentinel], _SLICE_S):
            now = time.monotonic()
            if check is not None:
                check()
            if check is not None and now - reported >= _REPORT_S:
                reported = now
                print(f"\nStill waiting for the collecting process, {now - start:.0f} s", flush=True)
        try:
            message = receive(self._connection) if self._connection.poll() else None
        except (EOFError, ConnectionResetError):
            message = None
        if message is None:
            raise self._end()
        if isinstance(message, str):
            raise CollectorError(f"The collecting process failed: {message}")
        if isinstance(message, Rollout):
            self._state = message.env_state
        return message

    def give(self, slot: int) -> None:
        """Let the collector write into a block; one that is no more is noticed at the next `receive`."""
        try:
            self._connection.send(slot)
        except (BrokenPipeError, ConnectionResetError):
            pass

    def close(self) -> None:
        """End the process, by force if it takes long: nothing is lost with it."""
        if self._connection.closed:
            return
        try:
            self._connection.send(None)
        except (BrokenPipeError, ConnectionResetError):
            pass
        self._process.join(_PATIENCE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._connection.close()

    def _end(self) -> CollectorError:
        """Tell how the process ended that has closed its connection."""
        self._process.join(_PATIENCE_S)
        return CollectorError(f"The collecting process ended, exit code {self._process.exitcode}.")


class AsyncDistillRunner(DistillRunner):
    """Distils while another process collects; an iteration learns from one of the newest rollouts.

    The section `asynchronous` of its configuration is a `RingConfig`.
    """

    env: RemoteEnv

    def __init__(
        self,
        env: RemoteEnv,
        cfg: dict[str, Any],
        run_dir: Path | None = None,
        device: str = "cpu",
        snapshot: dict[str, Any] | None = None,
    ) -> None:
        """Build models and algorithm; arguments as of `DistillRunner`."""
        # It has no `step`: rollouts come from the other process.
        super().__init__(cast(TrainingEnv, env), cfg, run_dir, device, snapshot)
        ring = from_mapping(RingConfig, self.cfg.get("asynchronous") or {}, "runner.asynchronous")
        self._ring = Ring(ring)
        self._blocks = _allocate_shared(self.alg.sequences, ring.blocks)
        self._weights = SharedWeights(self.alg.student)
        self._slot = 0
        self._asynchronous: dict[str, float] = {}

    def train(self, max_iterations: int, max_minutes: float | None = None) -> dict[str, Any]:
        """Train as `DistillRunner.train` does, and end the collecting process.

        Raises:
            CollectorError: It failed; a checkpoint is saved.
        """
        try:
            return super().train(max_iterations, max_minutes)
        finally:
            self.env.close()

    def _begin(self) -> None:
        self._weights.publish(self.alg.student, self.alg.num_updates)
        teacher = copy.deepcopy(self.alg.teacher).cpu()
        teacher.reset()  # the collector's episodes are its own
        self.env.begin(self.cfg, self._blocks, self._weights, teacher, self.run_dir)

    def close(self) -> None:
        """End the collecting process."""
        self.env.close()
        super().close()

    def _collect(self, obs: TensorDict) -> tuple[TensorDict, dict[str, float], int]:
        """Take over what has arrived, and wait until there is something to learn from."""
        arrived: list[Rollout] = []
        now = self.alg.num_updates
        for slot in self._ring.release(now):
            self.env.give(slot)
        while (slot := self._ring.choose(now)) is None or self.env.poll():
            arrived.append(self._take_over(self.env.receive(self._check_stop), now))
        self._slot = slot
        staleness, uses = self._ring.use(slot, now)
        self._asynchronous = {"Async/staleness": staleness, "Async/uses": uses, "Async/arrived": len(arrived)}
        if arrived:
            mean_s = sum(rollout.seconds for rollout in arrived) / len(arrived)
            self._asynchronous["Async/rollout_s"] = mean_s
        return (
            obs,
            join_statistics([rollout.statistics for rollout in arrived]),
            len(arrived) * self.steps_per_iteration,
        )

    def _take_over(self, rollout: Rollout, now: int) -> Rollout:
        """Note a block that the collector has filled; one that is too old already goes back."""
        self._ring.add(rollout.slot, rollout.version)
        for slot in self._ring.release(now):
            self.env.give(slot)
        for path in rollout.dumps:
            print(f"\nA world turned non-finite and was reset; its last states: {path}", flush=True)
        return rollout

    def _learn(self) -> dict[str, float]:
        losses = self.alg.learn(self._blocks[self._slot])
        self._weights.publish(self.alg.student, self.alg.num_updates)
        return losses

    def _scalars(self, losses: dict[str, float]) -> dict[str, float]:
        return super()._scalars(losses) | self._asynchronous


def _allocate_shared(example: Sequences, number: int) -> list[Sequences]:
    """Make blocks like an example in memory that processes share.

    Raises:
        ValueError: There is not enough of it; one line that names the setting.
    """
    size = number * sum(tensor.numel() * tensor.element_size() for tensor in example.tensors())
    if _SHARED_MEMORY.is_dir() and size > 0.9 * shutil.disk_usage(_SHARED_MEMORY).free:
        free = shutil.disk_usage(_SHARED_MEMORY).free / 1e6
        raise ValueError(
            f"asynchronous.blocks: {number} rollouts take {size / 1e6:.0f} MB of shared memory; "
            f"{_SHARED_MEMORY} has {free:.0f} MB free."
        )
    blocks = [example.empty_like("cpu") for _ in range(number)]
    for block in blocks:
        for tensor in block.tensors():
            tensor.share_memory_()
    return blocks
