"""What figures are measured on: the machine, and the commit of the code."""

from __future__ import annotations

import os
import platform
import subprocess
from pathlib import Path

from spin_rl.paths import CONF_DIR

_DRIVERS = ("/dev/nvidiactl", "/dev/dxg", "/dev/kfd")
"""What the drivers of NVIDIA, of Windows' subsystem for Linux and of AMD put there."""


def hardware(device: str) -> str:
    """Describe the machine, such as "AMD EPYC, 2 cores, no GPU used"."""
    gpu = "no GPU used"
    if device != "cpu":
        import torch

        gpu = torch.cuda.get_device_name(device)
    return f"{_cpu_model()}, {num_cores()} cores, {gpu}"


def num_cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def has_gpu_driver() -> bool:
    """Whether the system has a driver for GPUs; there may be none that works all the same."""
    return any(Path(driver).exists() for driver in _DRIVERS)


def num_gpus() -> int:
    """GPUs that Torch can use; it is not imported where there is no driver for any."""
    if not has_gpu_driver():
        return 0
    import torch

    return torch.cuda.device_count() if torch.cuda.is_available() else 0


def commit(root: Path = CONF_DIR.parent) -> str | None:
    """Commit of a checkout, with "-dirty" if files differ; None outside of one.

    Args:
        root: The checkout; without one, that which holds the package.
    """
    if not (root / ".git").exists():
        return None
    try:
        name = _git(root, "rev-parse", "--short=12", "HEAD")
        # Results and their page are what is being made: they are no code.
        changed = _git(root, "diff", "--name-only", "HEAD", "--", ".", ":!results", ":!docs/results.md")
    except (OSError, subprocess.SubprocessError):
        return None
    return f"{name}-dirty" if changed else name


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "--no-optional-locks", "-C", str(root), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=10.0, check=True).stdout.strip()


def _cpu_model() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
