"""The collecting process of asynchronous distillation: the student acts, the teacher's actions are noted."""

from __future__ import annotations

import pickle
import signal
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, cast

import torch
from tensordict import TensorDict

from spin_rl.models import ScandotModel
from spin_rl.runners.checkpoint import to_cpu
from spin_rl.runners.distillation.sequences import Recorder, Sequences
from spin_rl.runners.distillation.student import build_student
from spin_rl.runners.interface import TrainingEnv

_POLL_S = 0.5


class SharedWeights:
    """A model's weights, its normalizer's statistics among them, in memory that two processes share.

    There are two copies of them: one is read while the other is written, so that nobody waits, and a process
    that dies in between blocks none.
    """

    def __init__(self, model: ScandotModel) -> None:
        """Allocate, and publish as version 0.

        Args:
            model: The learner's.
        """
        self._copies = [
            [value.to("cpu", copy=True).share_memory_() for value in model.state_dict().values()]
            for _ in range(2)
        ]
        self._versions = torch.zeros(2, dtype=torch.int64).share_memory_()
        self._count = torch.zeros(1, dtype=torch.int64).share_memory_()

    def publish(self, model: ScandotModel, version: int) -> None:
        """Write the learner's weights; one process only may do so."""
        count = int(self._count) + 1
        for own, value in zip(self._copies[count % 2], model.state_dict().values(), strict=True):
            own.copy_(value)
        self._versions[count % 2] = version
        self._count.fill_(count)

    def load_into(self, model: ScandotModel) -> int:
        """Copy the newest weights into a model; return their version."""
        while True:
            count = int(self._count)
            for own, value in zip(self._copies[count % 2], model.state_dict().values(), strict=True):
                value.copy_(own)
            version = int(self._versions[count % 2])
            if int(self._count) == count:  # else the copy that was read may have been overwritten
                return version


@dataclass
class Order:
    """What the collector needs to begin.

    Attributes:
        cfg: Configuration of the runner.
        blocks: Shared memory, all of it the collector's at first.
        weights: The student's.
        teacher: Sent as the learner has it: its file may hold others by now.
        env_state: Of a resumed run.
        run_dir: Folder for the states of worlds that turn non-finite.
    """

    cfg: dict[str, Any]
    blocks: list[Sequences]
    weights: SharedWeights
    teacher: ScandotModel
    env_state: dict[str, Any] | None
    run_dir: Path | None


@dataclass
class Rollout:
    """What the collector tells about a block that it hands over.

    Attributes:
        slot: Place of the block.
        version: Learner's iteration whose weights acted.
        seconds: Time that it took [s], waiting not included.
        statistics: Of the episodes that ended.
        env_state: For the learner's next checkpoint.
        dumps: Files with the states of worlds that turned non-finite.
    """

    slot: int
    version: int
    seconds: float
    statistics: dict[str, float]
    env_state: dict[str, Any]
    dumps: list[Path] = field(default_factory=list)


@dataclass
class Introduction:
    """What the learner has to know of an environment that is in another process."""

    example: dict[str, torch.Tensor]
    num_actions: int
    camera: tuple[tuple[int, ...], dict[str, tuple[int, ...]]]
    env_state: dict[str, Any]


def collect_for_ever(connection: Connection, make_env: Callable[[], TrainingEnv], device: str) -> None:
    """Serve a learner until it says so, or is no more.

    Args:
        connection: To the learner: an `Introduction`, then `Rollout`s; from it an `Order`, then free places,
            and None for the end. An error is sent as its text.
        make_env: Makes the environment, in this process.
        device: Torch device.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the learner decides, and says so
    if device == "cpu":
        torch.set_num_threads(1)
    try:
        env = make_env()
        camera = getattr(env, "camera_actions", ()), dict(getattr(env, "camera_columns", {}))
        groups = cast(dict[str, torch.Tensor], env.get_observations())
        example = {name: value.cpu() for name, value in groups.items()}
        send(connection, Introduction(example, env.num_actions, camera, to_cpu(env.state_dict())))
        order = connection.recv()
        if order is not None:
            _Collector(connection, env, order, device).run()
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass  # the learner is gone
    except Exception as error:
        traceback.print_exc(file=sys.stderr)
        send(connection, f"{type(error).__name__}: {error}")


class _Collector:
    """Student, teacher and environment of the collecting process."""

    def __init__(self, connection: Connection, env: TrainingEnv, order: Order, device: str) -> None:
        self._connection = connection
        self._env = env
        self._order = order
        obs = env.get_observations()
        torch.manual_seed(order.cfg.get("seed", 0))
        self._student = build_student(obs, order.cfg, env.num_actions).to(device).requires_grad_(False)
        self._free = deque(range(len(order.blocks)))
        # From a GPU, whole rollouts are copied to the shared memory of the host.
        steps = order.cfg["num_steps_per_env"]
        on_host = torch.device(device).type == "cpu"
        self._local = (
            None if on_host else Sequences.allocate(obs, self._student, steps, env.num_actions, device)
        )
        self._recorder = Recorder(self._student, order.teacher.to(device), order.blocks[0])
        self._ends = False

    @torch.no_grad()
    def run(self) -> None:
        """Make rollouts until the learner wants no more."""
        signal.signal(signal.SIGTERM, self._end)  # a scheduler's: the rollout under way is still handed over
        if self._order.env_state is not None:
            self._env.load_state_dict(self._order.env_state)
        obs = self._env.get_observations()
        while (slot := self._next_free()) is not None:
            start = time.monotonic()
            version = self._order.weights.load_into(self._student)
            block = self._order.blocks[slot]
            record = block if self._local is None else self._local
            obs = self._roll_out(obs, record)
            if record is not block:
                block.copy_(record)
            folder = self._order.run_dir
            rollout = Rollout(
                slot,
                version,
                time.monotonic() - start,
                self._env.episode_stats(),
                to_cpu(self._env.state_dict()),
                [] if folder is None else self._env.dump_non_finite(folder / "non_finite"),
            )
            send(self._connection, rollout)

    def _roll_out(self, obs: TensorDict, record: Sequences) -> TensorDict:
        self._recorder.begin(record)
        for _ in range(record.num_steps):
            obs, _, dones, _ = self._env.step(self._recorder.act(obs))
            self._recorder.note_ends(dones)
        return obs

    def _next_free(self) -> int | None:
        """Wait for a block to write into; None for the end."""
        while not self._ends:
            while self._connection.poll(0.0 if self._free else _POLL_S):
                slot = self._connection.recv()
                if slot is None:
                    return None
                self._free.append(slot)
            if self._free:
                return self._free.popleft()
        return None

    def _end(self, *_: Any) -> None:
        self._ends = True


def send(connection: Connection, message: Any) -> None:
    """Send by value: tensors that a connection sends itself are lost with the process that made them."""
    connection.send_bytes(pickle.dumps(message))


def receive(connection: Connection) -> Any:
    """Receive what `send` sent."""
    return pickle.loads(connection.recv_bytes())
