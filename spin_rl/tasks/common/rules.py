"""A task's rules as its kernels read them, from its configuration."""

from __future__ import annotations

from typing import Any

from spin_rl.tasks.common.config import TaskConfig
from spin_rl.warp_kernels.structs import struct_of


def rules_of(kind: Any, cfg: TaskConfig, **others: Any) -> Any:
    """Make the Warp struct of a task's rules, whose fields have the names of the configuration's.

    Times become control steps: a field `hold_steps` is `cfg.hold_s`, rounded and at least one step.

    Args:
        kind: The struct.
        cfg: The task's configuration.
        **others: Values of fields that it does not have.
    """
    period = cfg.sim.control_period
    steps = {
        name: max(round(getattr(cfg, name.removesuffix("teps")) / period), 1)
        for name in kind.vars
        if name.endswith("_steps")
    }
    return struct_of(kind, cfg, **steps, **others)
