"""The runtime stays small: what it imports, and how long that takes."""

import subprocess
import sys

FORBIDDEN = ("torch", "warp", "mujoco", "mujoco_warp", "hydra", "omegaconf", "tensordict", "rsl_rl", "yaml")
PROGRAM = """
import sys, time
start = time.process_time()
import spin_rl.cli.deploy, spin_rl.deploy.text, onnxruntime
seconds = time.process_time() - start
print(seconds, *sorted(set(sys.modules) & set({forbidden!r})))
"""


def test_importing_the_runtime_takes_less_than_a_second_and_nothing_large():
    command = [sys.executable, "-c", PROGRAM.format(forbidden=FORBIDDEN)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, *large = done.stdout.split()
    assert float(seconds) < 1.0 and large == []
