# pyright: reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What went wrong in physics: non-finite worlds with their recent states, and overflows by cause."""

import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

from spin_rl.files import reason
from spin_rl.sim.simulation import OVERFLOWS, Simulation
from spin_rl.tasks.common.episode import NON_FINITE, RUNNING

HISTORY_STEPS = 8
MAX_DUMPS = 8

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _record_history(
    # In
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    action: wp.array2d(dtype=float),
    outcome: wp.array(dtype=wp.int32),
    # In and out
    cursor: wp.array(dtype=wp.int32),
    history: wp.array3d(dtype=float),
    # Out
    dump_count_out: wp.array(dtype=wp.int32),
    dump_out: wp.array3d(dtype=float),
) -> None:
    w = wp.tid()
    nq = qpos.shape[1]
    nv = qvel.shape[1]
    row = cursor[w]
    for i in range(nq):
        history[w, row, i] = qpos[w, i]
    for i in range(nv):
        history[w, row, nq + i] = qvel[w, i]
    for i in range(action.shape[1]):
        history[w, row, nq + nv + i] = action[w, i]
    length = history.shape[1]
    cursor[w] = (row + 1) % length
    if outcome[w] == NON_FINITE:
        slot = wp.atomic_add(dump_count_out, 0, 1)
        if slot < dump_out.shape[0]:
            # Oldest first, the state that went wrong last.
            for k in range(length):
                for i in range(history.shape[2]):
                    dump_out[slot, k, i] = history[w, (row + 1 + k) % length, i]
    if outcome[w] != RUNNING:
        # States of one episode only: the next one starts with an empty record.
        for k in range(length):
            for i in range(history.shape[2]):
                history[w, k, i] = 0.0


@wp.kernel
def _count_overflow(
    # In
    bits: wp.array(dtype=wp.int32),
    # In and out
    overflow: wp.array(dtype=wp.int32),
    # Out
    count_out: wp.array(dtype=wp.int32),
) -> None:
    w = wp.tid()
    for i in range(bits.shape[0]):
        if (overflow[w] & bits[i]) != 0:
            wp.atomic_add(count_out, i, 1)
    # mujoco_warp clears the bits at a reset only: what is counted now must not count again in the next step.
    overflow[w] = 0


class HealthMonitor:
    """Counts on the device; nothing is read back until `read` or `dump`.

    A world whose positions, velocities or action turn non-finite is reset by the task like any other that
    ended, and training goes on; its last control steps are kept for a look. Overflow means that contacts or
    constraints of a world were dropped during a control step: by mujoco_warp, whose contact pool is shared by
    the worlds, so that its overflow is counted in all of them, or because more was within the robot's reach
    than `sim.nearby`.
    """

    def __init__(self, sim: Simulation, outcome: wp.array) -> None:
        """Allocate records for every world.

        Args:
            sim: The simulation to watch.
            outcome: Episode outcomes of the task, shape (nworld,).
        """
        self._sim = sim
        self._outcome = outcome
        width = sim.data.qpos.shape[1] + sim.data.qvel.shape[1] + sim.action.shape[1]
        with wp.ScopedDevice(sim.device):
            self._cursor = wp.zeros(sim.nworld, dtype=wp.int32)
            self._history = wp.zeros((sim.nworld, HISTORY_STEPS, width), dtype=float)
            self._dump_count = wp.zeros(1, dtype=wp.int32)
            self._dump = wp.zeros((MAX_DUMPS, HISTORY_STEPS, width), dtype=float)
            self._bits = wp.array([bit for bit, _ in OVERFLOWS.values()], dtype=wp.int32)
            self._overflow_count = wp.zeros(len(OVERFLOWS), dtype=wp.int32)

    def launch(self) -> None:
        """Record this control step; runs in the step graph after episodes ended and before the reset."""
        sim = self._sim
        wp.launch(
            _record_history,
            dim=sim.nworld,
            inputs=[sim.data.qpos, sim.data.qvel, sim.action, self._outcome, self._cursor, self._history],
            outputs=[self._dump_count, self._dump],
        )
        wp.launch(
            _count_overflow,
            dim=sim.nworld,
            inputs=[self._bits, sim.data.overflow],
            outputs=[self._overflow_count],
        )

    def clear(self) -> None:
        """Forget all that was counted and recorded."""
        self.restart()
        self._dump_count.zero_()
        self._overflow_count.zero_()
        if self._sim.nearby is not None:
            self._sim.nearby.missed.zero_()

    def restart(self) -> None:
        """Forget the states of the episodes that run: all worlds were reset from outside."""
        self._history.zero_()

    def read(self) -> dict[str, float]:
        """Return and clear the number of control steps with overflow, over all worlds, as `overflow/<cause>`.

        Raises:
            RuntimeError: There were some and `sim.overflow` is "raise"; the message names the key to
                increase.
        """
        # A copy before it is cleared: on the CPU, numpy() is a view.
        counts = dict(zip(OVERFLOWS, self._overflow_count.numpy().tolist(), strict=True))
        self._overflow_count.zero_()
        config, keys = self._sim.config, {cause: key for cause, (_, key) in OVERFLOWS.items()}
        if self._sim.nearby is not None:
            counts["nearby"], keys["nearby"] = int(self._sim.nearby.missed.numpy()[0]), "nearby"
            self._sim.nearby.missed.zero_()
        for cause, key in keys.items():
            if config.overflow == "raise" and counts[cause] and key is not None:
                raise RuntimeError(
                    f"overflow/{cause}: contacts or constraints were dropped in {counts[cause]} "
                    f"control steps of a world; increase sim.{key}, now {getattr(config, key)}"
                )
        return {f"overflow/{cause}": float(count) for cause, count in counts.items()}

    def dump(self, folder: Path) -> list[Path]:
        """Write one .npz per non-finite world since the last call (at most MAX_DUMPS) and clear the record.

        Where they cannot be written, that is said, and they are lost.

        Each file has `qpos`, `qvel` and `action` of the last control steps, oldest first, shape (8, ...).
        """
        count = min(int(self._dump_count.numpy()[0]), MAX_DUMPS)
        if count == 0:
            return []
        records = self._dump.numpy()
        self._dump_count.zero_()
        try:
            return self._write(folder, records[:count])
        except OSError as error:  # a look at them is worth less than the training
            print(f"\nwarning: states of non-finite worlds: {reason(error)}", file=sys.stderr, flush=True)
            return []

    def _write(self, folder: Path, records: np.ndarray) -> list[Path]:
        folder.mkdir(parents=True, exist_ok=True)
        nq, nv = self._sim.data.qpos.shape[1], self._sim.data.qvel.shape[1]
        files = []
        for i in range(len(records)):
            path = folder / f"non_finite_{time.time_ns()}_{i}.npz"
            qpos, qvel, action = np.split(records[i], [nq, nq + nv], axis=1)
            np.savez_compressed(path, qpos=qpos, qvel=qvel, action=action)
            files.append(path)
        return files
