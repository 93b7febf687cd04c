"""The training of phase 2: a student that sees depth learns from a teacher that does not."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

from tensordict import TensorDict

from spin_rl.config import from_mapping
from spin_rl.runners.config import check_class, check_learning, check_loop, check_teacher_name
from spin_rl.runners.distillation.algorithm import Distillation
from spin_rl.runners.loop import TrainingLoop
from spin_rl.runners.remote.ring import RingConfig


class DistillRunner(TrainingLoop):
    """Distils in one process: collects a rollout, learns from it, and so on.

    The sections of its configuration are `actor`, the student, and `algorithm`, with the `teacher`.
    """

    alg: Distillation
    loss = math.nan

    def _check(self, cfg: dict[str, Any], obs: TensorDict, num_envs: int) -> None:
        check_distillation(cfg, list(map(str, obs.keys())), num_envs)

    def _scalars(self, losses: dict[str, float]) -> dict[str, float]:
        self.loss = losses.get("actions", math.nan)
        return super()._scalars(losses)

    def _results(self) -> str:
        return f"loss {self.loss:.4f} | {super()._results()}"

    def _summary(self, *arguments: Any) -> dict[str, Any]:
        return super()._summary(*arguments) | {"loss": self.loss}


def check_distillation(cfg: dict[str, Any], observed: Collection[str], num_envs: int) -> None:
    """Check the configuration of `DistillRunner`; see `check_config`.

    Raises:
        ValueError: A key is unknown or missing, or a value is impossible; one line that names the key.
    """
    check_loop(cfg, observed, ("actor",), ("asynchronous",))
    algorithm = cfg["algorithm"]
    check_teacher_name(algorithm.get("teacher"))
    given = ("student", "sequences", "camera_actions", "device", "multi_gpu_cfg")
    check_class(algorithm, Distillation, "runner.algorithm", given)
    check_learning(algorithm, num_envs)
    from_mapping(RingConfig, cfg.get("asynchronous") or {}, "runner.asynchronous")
