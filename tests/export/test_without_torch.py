"""The runtime's tests pass where Torch, Warp, MuJoCo and Hydra cannot be imported."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAM = """
import sys
import pytest

FORBIDDEN = {"torch", "warp", "mujoco", "mujoco_warp", "hydra", "omegaconf", "tensordict", "rsl_rl", "yaml"}
FORBIDDEN |= {"gymnasium", "scipy", "onnx", "onnxscript", "safetensors", "tensorboard", "matplotlib"}


class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in FORBIDDEN:
            raise ModuleNotFoundError(f"{name} is blocked by a test", name=name)


sys.meta_path.insert(0, Blocker())
sys.exit(pytest.main(["tests/deploy", "-p", "no:cacheprovider"]))
"""


def test_the_runtimes_tests_pass_without_them(monkeypatch):
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # Hydra's plugin would import Hydra
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert " passed" in done.stdout
