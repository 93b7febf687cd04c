"""The rooms benchmark: every family has its row, and its worlds are of that family."""

import pytest

from spin_rl.benchmark import policies, rooms
from spin_rl.benchmark.registry import find
from spin_rl.benchmark.tables import rooms as tables
from spin_rl.config import ConfigError
from spin_rl.planning.solvability import scene_params
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.tasks.nav.config import NavConfig


def evaluate(scene, episodes, device, **changes):
    cfg = NavConfig(scene=scene_params(scene), slack_s=0.3, slowness=0.01, **changes)
    make = policies.open_policy("zero").make
    return rooms.evaluate_rooms(make, cfg, episodes, [0], device, report=lambda line: None)


def test_every_family_of_the_mixture_is_a_row(device):
    families = [name for name in FAMILIES if name != "shuttle"]  # it has a benchmark of its own scene
    result = evaluate("mixture", 2, device)
    assert [(row["family"], row["episodes"]) for row in result["rows"]] == [(name, 2) for name in families]
    assert all(row["success_rate"] == row["spl"] == 0.0 for row in result["rows"])
    # What moves in a crossing may run into a robot that stands still.
    assert all(row["timeout_rate"] == 1.0 for row in result["rows"] if row["family"] != "crossing")
    lines = tables.table(result).splitlines()
    assert lines[0].startswith("Rooms: policy, 2 episodes per family (seeds 0)")
    assert [line.split()[0] for line in lines[2:8]] == families
    assert "over 6 places, 12 episodes" in tables.headline(result)


def test_worlds_are_of_the_family_that_was_set(device):
    from spin_rl.tasks.nav.env import NavEnv

    env = NavEnv(NavConfig(scene=scene_params("mixture")), 12, device)
    env.set_families([0, 1, 2, 3, 4, 5] * 2)
    env.reset()
    assert env.sim.layout.family.numpy().tolist() == [0, 1, 2, 3, 4, 5] * 2
    env.set_families([-1] * 12)
    env.set_episode(0)
    env.reset()
    assert len(set(env.sim.layout.family.numpy().tolist())) > 1


def test_corridors_of_the_paper_are_refused():
    with pytest.raises(ConfigError, match=r"^scene: benchmark=rooms needs scene=mixture"):
        rooms.evaluate_rooms(policies.open_policy("zero").make, NavConfig(), 1, [0], "cpu")


def test_scenes_of_families_are_measured_by_families():
    assert find(None, "nav").name == "reach"
    assert find(None, "nav", families=True).name == "rooms"
    with pytest.raises(ConfigError, match="there is none of task=pick"):
        find(None, "pick", families=True)
