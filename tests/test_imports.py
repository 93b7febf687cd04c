"""The layers of docs/architecture.md, read from the imports."""

import ast
import functools
from pathlib import Path

import pytest

import spin_rl

ROOT = Path(spin_rl.__file__).parent
LAYERS = (  # a package imports from those of the lines below its own
    {"cli"},
    {"analysis", "export", "gym_env", "reproduce", "speed"},
    {"benchmark", "viewer"},
    {"baselines"},
    {"tasks", "runners"},
    {"detection"},
    {"deploy"},
    {"sensors", "planning", "models"},
    {"sim"},
    {"scenes"},
    {"robot", "warp_kernels"},
    {"policy", "extras", "files", "machine", "ranges", "ranks", "stop_request"},
    {"config", "deferred", "groups", "paths"},
)
TASK_LAYERS = ({"registry"}, {"fetch"}, {"nav", "pick"}, {"common"})


@functools.cache
def trees():
    """The syntax tree of every file, by its path below the package."""
    return {file.relative_to(ROOT): ast.parse(file.read_text()) for file in sorted(ROOT.rglob("*.py"))}


@functools.cache
def imports():
    """List (file, module, name, local name) of every import of our own modules, deferred ones too."""
    found = []
    for file, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "spin_rl":
                found += [(file, node.module, alias.name, alias.asname or alias.name) for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level:
                found.append((file, "." * node.level, node.module or "", ""))
            elif isinstance(node, ast.Import):
                own = [alias for alias in node.names if alias.name.split(".")[0] == "spin_rl"]
                found += [(file, alias.name, "", alias.asname or alias.name) for alias in own]
    return found


def upward(layers, above):
    """List imports that do not point from a layer to a lower one, of the modules and packages in a package.

    Args:
        layers: Names, the highest first.
        above: Dotted name of the package.
    """
    level = {name: i for i, layer in enumerate(layers) for name in layer}
    depth = above.count(".") + 1
    wrong = []
    for file, module, name, _ in imports():
        path = (*module.split("."), name)
        if file.parts[: depth - 1] != tuple(above.split(".")[1:]) or path[:depth] != tuple(above.split(".")):
            continue
        own, other = file.parts[depth - 1].removesuffix(".py"), path[depth]
        if other.startswith("__"):  # the package's own version
            continue
        if own != "__init__" and own != other and level[own] >= level[other]:
            wrong.append(f"{file}: {module} {name}")
    return wrong


@pytest.mark.parametrize(("layers", "above"), [(LAYERS, "spin_rl"), (TASK_LAYERS, "spin_rl.tasks")])
def test_every_package_has_its_layer(layers, above):
    folder = ROOT.joinpath(*above.split(".")[1:])
    present = [path for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()]
    names = {path.stem for path in present} - {"__init__"}
    assert names == set().union(*layers)


@pytest.mark.parametrize(("layers", "above"), [(LAYERS, "spin_rl"), (TASK_LAYERS, "spin_rl.tasks")])
def test_imports_point_down(layers, above):
    assert upward(layers, above) == []


def test_an_import_that_points_up_is_found(monkeypatch):
    bad = [
        (Path("sim/drive.py"), "spin_rl.tasks.registry", "TASKS", "TASKS"),
        (Path("viewer/plots.py"), "spin_rl", "benchmark", "benchmark"),
        (Path("tasks/common/env.py"), "spin_rl.tasks.nav", "config", "config"),
    ]
    monkeypatch.setattr(f"{__name__}.imports", lambda: bad)
    assert [len(upward(LAYERS, "spin_rl")), len(upward(TASK_LAYERS, "spin_rl.tasks"))] == [2, 1]


def test_imports_are_absolute():
    assert [(file, name) for file, module, name, _ in imports() if module.startswith(".")] == []


def test_runners_know_nothing_of_what_they_train():
    known = {"runners", "config", "files", "groups", "models", "policy", "ranges", "ranks", "stop_request"}
    runners = [(module, name) for file, module, name, _ in imports() if file.parts[0] == "runners"]
    assert {(*module.split("."), name)[1] for module, name in runners} <= known


def private(name):
    return name.startswith("_") and not name.startswith("__")


def test_private_names_stay_in_their_module():
    taken = [f"{file}: {module}.{name}" for file, module, name, _ in imports() if private(name)]
    for file, tree in trees().items():
        modules = {local for other, _, _, local in imports() if other == file}
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and private(node.attr) and ast.unparse(node.value) in modules:
                taken.append(f"{file}: {ast.unparse(node)}")
    assert taken == []
