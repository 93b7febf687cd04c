"""Fixtures of the runner tests."""

import multiprocessing

import pytest


@pytest.fixture(scope="session")
def processes():
    """Start processes from a server that has imported the slow libraries once."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        [
            "torch.utils.tensorboard",
            "rsl_rl.runners",
            "safetensors.torch",
            "spin_rl.runners",
            "spin_rl.runners.remote.runner",
        ]
    )
    return context
