"""Training: PPO, checkpoints, progress and policy files."""

import os

# rsl_rl's logger imports GitPython, which fails where git is not installed unless told not to look.
os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")

from spin_rl.runners.checkpoint import find_checkpoint, load_checkpoint, resolve_checkpoint, save_checkpoint
from spin_rl.runners.interface import TrainingEnv
from spin_rl.runners.policy_file import load_policy, read_policy, save_policy
from spin_rl.runners.ppo.algorithm import PPO
from spin_rl.runners.ppo.runner import PPORunner

__all__ = [
    "PPO",
    "PPORunner",
    "TrainingEnv",
    "find_checkpoint",
    "load_checkpoint",
    "load_policy",
    "read_policy",
    "resolve_checkpoint",
    "save_checkpoint",
    "save_policy",
]
