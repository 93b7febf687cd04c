"""Training: PPO, checkpoints, progress and policy files."""

import os

# rsl_rl's logger imports GitPython, which fails where git is not installed unless told not to look.
os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
