"""The layers of docs/architecture.md, read from the imports."""

import ast
import functools
import graphlib
from collections import defaultdict
from pathlib import Path

import pytest

import spin_rl

ROOT = Path(spin_rl.__file__).parent


@functools.cache
def imports():
    """List (importing file, module, name) of every import of the project's own modules, deferred ones too."""
    found = []
    for file in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "spin_rl":
                for alias in node.names:
                    found.append((file.relative_to(ROOT), node.module, alias.name))
    return found


def packages():
    """Package or top-level module -> those that it imports."""
    graph = defaultdict(set)
    for file, module, name in imports():
        own = file.parts[0].removesuffix(".py")
        other = name if module == "spin_rl" else module.split(".")[1]
        if other != own:
            graph[own].add(other)
    return graph


def test_packages_do_not_import_each_other_in_a_circle():
    graph = packages()
    assert "viewer" in graph["analysis"]  # so that it is above it
    try:
        tuple(graphlib.TopologicalSorter(graph).static_order())
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(error.args[1][::-1]))


def test_runners_know_nothing_of_tasks():
    assert not packages()["runners"] & {"tasks", "sim", "sensors", "scenes"}


def test_private_names_stay_in_their_module():
    assert [f"{file}: {module}.{name}" for file, module, name in imports() if name.startswith("_")] == []
