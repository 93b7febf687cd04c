"""Fixtures of the runner tests."""

import multiprocessing

import pytest


@pytest.fixture(scope="session")
def processes():
    """Start processes from a server that has imported the slow libraries once."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["training_jobs", "torch.utils.tensorboard"])
    return context
