"""Options and fixtures that all tests share."""

import pytest
import warp as wp


def pytest_addoption(parser):
    parser.addoption("--device", default="cpu", help="device for kernels and environments: cpu or cuda:0")


@pytest.fixture(scope="session")
def device(request) -> str:
    """The Warp and Torch device under test."""
    name = request.config.getoption("--device")
    wp.init()
    wp.get_device(name)  # fails here, by name, where the machine lacks it
    return name
