"""The runtime stays small: what it imports, how long that takes, and what its own package holds."""

import subprocess
import sys
import tomllib
from pathlib import Path

import spin_rl

ROOT = Path(__file__).parents[2]
FORBIDDEN = ("torch", "warp", "mujoco", "mujoco_warp", "hydra", "omegaconf", "tensordict", "rsl_rl", "yaml")
PROGRAM = """
import sys, time
start = time.process_time()
import spin_rl.cli.deploy, spin_rl.deploy.text, onnxruntime
print(time.process_time() - start)
print(*sys.modules)
"""


def imported():
    """CPU time of importing the runtime [s], and all that is imported then."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    seconds, modules = done.stdout.splitlines()
    return float(seconds), set(modules.split())


def test_importing_the_runtime_takes_less_than_a_second_and_nothing_large():
    seconds, modules = imported()
    assert seconds < 1.0 and modules.isdisjoint(FORBIDDEN)


def test_the_light_package_holds_all_that_the_runtime_imports():
    project = tomllib.loads((ROOT / "packaging" / "spin-rl-deploy" / "pyproject.toml").read_text())
    included = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    for source in included:
        assert (ROOT / "packaging" / "spin-rl-deploy" / source).exists(), source
    package = Path(spin_rl.__file__).parent
    for name in imported()[1]:
        if name.split(".")[0] == "spin_rl":
            path = package.parent.joinpath(*name.split("."))
            file = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).relative_to(
                package.parent
            )
            assert any(str(file) == place or str(file).startswith(f"{place}/") for place in included.values())
