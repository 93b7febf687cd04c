"""What the commands know of the tasks, against the tasks themselves."""

import dataclasses
import pickle
from types import SimpleNamespace

import pytest

from spin_rl.benchmark.registry import BENCHMARKS
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.tasks import registry
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.registry import TASKS, find_task


def test_every_task_has_its_file_and_nothing_else_has_one():
    assert sorted(TASKS) == sorted(file.stem for file in (CONF_DIR / "task").glob("*.yaml"))
    assert {benchmark.task for benchmark in BENCHMARKS.values()} <= set(TASKS)


def test_an_unknown_task_is_an_error_that_lists_the_tasks():
    with pytest.raises(ConfigError, match=r"^task: unknown 'push'; choose from nav, pick, fetch$"):
        find_task("push")


@pytest.mark.parametrize("name", TASKS)
def test_the_groups_are_those_of_the_environment(name, device):
    spec = TASKS[name]
    optional = {"nav": ["map", "lidar"], "fetch": ["map"]}.get(name, [])
    enabled = [f"task.{sensor}.enabled=true" for sensor in ("depth", *optional)]
    enabled += ["task.teach_gaze=true"] if name == "nav" else []
    cfg = spec.configure(compose("eval", [f"task={name}", *enabled]))
    env = spec.make_env(cfg, 2, device, 0)
    assert sorted(env.get_observations().keys()) == sorted(spec.groups)


@pytest.mark.parametrize("name", TASKS)
def test_policies_that_take_turns_were_trained_in_tasks_that_can_be(name):
    spec = TASKS[name]
    assert next(iter(spec.policies)) == "policy"
    assert all(TASKS[task].untrainable is None for task in spec.policies.values())


@pytest.mark.parametrize("group", ["task_preset", "distill_task"])
def test_only_tasks_that_can_be_trained_change_a_training(group):
    changed = {file.stem for file in (CONF_DIR / group).glob("*.yaml")}
    assert changed <= {name for name, spec in TASKS.items() if spec.untrainable is None}


@pytest.mark.parametrize("name", TASKS)
def test_a_task_takes_no_configuration_of_another(name):
    cfg = compose("eval", [f"task={name}"])
    other = next(spec for spec in TASKS.values() if spec.name != name)
    with pytest.raises(ConfigError, match=f"^task: '{name}' is not a task of this command; use {other.name}"):
        other.configure(cfg)
    cfg["task"]["object_of_no_task"] = 1
    with pytest.raises(ConfigError, match=r"^task\.object_of_no_task: unknown key"):
        TASKS[name].configure(cfg)


@pytest.mark.parametrize("name", TASKS)
def test_another_process_can_be_told_the_task(name):  # in which it makes the environment
    assert pickle.loads(pickle.dumps(TASKS[name])) == TASKS[name]


def test_another_package_can_add_a_task(monkeypatch):
    mine = dataclasses.replace(TASKS["nav"], name="push")
    point = SimpleNamespace(value="my_package:PUSH", load=lambda: mine)
    monkeypatch.setattr(registry, "entry_points", lambda group, name: [point] if name == "push" else [])
    assert find_task("push") is mine
    mine = TASKS["nav"]
    with pytest.raises(ConfigError, match=r"^task: my_package:PUSH is no TaskSpec with the name 'push'"):
        find_task("push")
