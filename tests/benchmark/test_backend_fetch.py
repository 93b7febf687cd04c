"""Whole fetches again in C MuJoCo: what is counted, what ends them, and that they begin alike."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spin_rl import robot
from spin_rl.benchmark import policies
from spin_rl.benchmark.backend import again
from spin_rl.benchmark.backend.conditions import check
from spin_rl.benchmark.backend.recorder import Recorder, Start
from spin_rl.benchmark.backend.umpires import FetchUmpire
from spin_rl.benchmark.fetch import Fetches, summarize_fetches
from spin_rl.benchmark.metrics import Episodes
from spin_rl.config import ConfigError
from spin_rl.deploy.backends.mujoco import MujocoRobot
from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch.agent import open_agent
from spin_rl.deploy.fetch.memory import Memory
from spin_rl.export.write import fetch_settings
from spin_rl.scenes.objects.shapes import KINDS, OBJECTS, SceneObject
from spin_rl.scenes.scene_file import parse_scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.fetch.config import FetchConfig, StageLimits
from spin_rl.tasks.fetch.env import FetchEnv

DATA = Path(__file__).parents[1] / "data"
CFG = FetchConfig(limits=StageLimits(reach=0.5))


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """Two policies that learned nothing, as a fetch."""
    folder = tmp_path_factory.mktemp("fetch")
    for name in ("tiny_nav", "tiny_pick"):
        shutil.copy(DATA / f"{name}.onnx", folder)
    settings = fetch_settings(CFG, "tiny_nav.onnx", "tiny_pick.onnx")
    (folder / "fetch.json").write_text(json.dumps(settings))
    return folder


@pytest.fixture
def touching():
    """A robot whose base is in a wall, its umpire, and a stand-in for the agent and for the hand."""
    wall = {"position": [0.1, 0.0], "size": [0.1, 2.0, 0.15]}
    scene = parse_scene({"start": {"position": [0, 0]}, "goal": [1, 0], "walls": [wall]})
    thing = SceneObject("mug", np.array(KINDS["mug"].half_extents), 0.1, 1.0, np.array([2.0, 1.0, 0.5, 0.0]))
    one = MujocoRobot(scene, again._agent(DATA / "tiny_nav.onnx").contract, thing=(thing, 0))
    hand: Any = SimpleNamespace(grip=SimpleNamespace(is_supported=True))
    agent: Any = SimpleNamespace(memory=Memory(np.array([0.0, 0.0]), np.array([1.0, 0.0])))
    return one, FetchUmpire(one.model, hand, agent, OBJECTS.index("mug")), agent.memory


def make_step(one, umpire, memory, stage):
    memory.stage = stage
    for _ in range(2):
        umpire.add_substep(one.data)
    umpire.judge(one.data)


@pytest.mark.parametrize("stage", range(len(n.STAGES)))
def test_a_touch_ends_a_fetch_while_a_policy_drives(touching, stage):
    one, umpire, memory = touching
    make_step(one, umpire, memory, stage)
    assert umpire.is_over == (n.STAGES[stage] in ("reach", "carry")) and umpire.outcome == episode.COLLISION
    parts = umpire.figures(one.data)["parts"]
    assert [part for part, touched in zip(robot.PARTS, parts, strict=True) if touched] == ["base"]


def test_parts_that_touched_are_those_of_the_last_step(touching):
    one, umpire, memory = touching
    make_step(one, umpire, memory, n.ALIGN)
    one.data.contact.dist[:] = 1.0
    make_step(one, umpire, memory, n.ALIGN)
    assert not umpire.figures(one.data)["parts"].any()


def test_stages_drops_and_scrapes_are_counted(touching):
    one, umpire, memory = touching
    one.data.contact.dist[:] = 1.0
    first = (n.REACH, n.REACH, n.ALIGN, n.PICK, n.RETRACT)
    for stage in (*first, n.ALIGN, n.PICK, n.ALIGN, n.PICK, n.RETRACT, n.CARRY, n.CARRY, n.CARRY):
        make_step(one, umpire, memory, stage)
    figures = umpire.figures(one.data)
    assert figures["stage_steps"].tolist() == [2, 3, 3, 2, 3, 0] and figures["scrapes"] == 3
    assert figures["drops"] == 1  # from `retract` back to `align`; from `pick` nothing had been picked
    assert figures["reached"] and figures["picked"] and figures["stage"] == n.CARRY
    assert figures["distance"] == pytest.approx(np.hypot(2.0, 1.0)) and OBJECTS[figures["kind"]] == "mug"
    memory.loose = n.LOOSE_STEPS
    assert umpire.figures(one.data)["drops"] == 2


def test_fetches_are_paired_by_cell_and_by_object():
    cells, count = 6, 12
    fetched = np.arange(count) % 2 == 0
    rows = [
        {"outcome": episode.SUCCESS if done else episode.TIMEOUT, "steps": 10, "stage": n.PLACE,
         "kind": i % 5, "stage_steps": np.ones(6, dtype=int), "reached": True, "picked": True, "retries": 0,
         "drops": 0, "scrapes": 0, "distance": 0.1, "parts": np.zeros(6, dtype=bool)}
        for i, done in enumerate(fetched)
    ]  # fmt: skip
    ours = Fetches(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
    told = summarize_fetches(replace(ours, outcome=np.full(count, episode.TIMEOUT)), 0.1)
    scene: Any = None
    things = [SceneObject(OBJECTS[i % 5], np.ones(3), 1.0, 1.0, np.zeros(4)) for i in range(count)]
    starts = [Start(scene, 10, thing=thing) for thing in things]
    ends = [Episodes(np.full(count, episode.TIMEOUT), np.full(count, 10))]
    batched = {
        "rows": [{"scenario": 1 + cell // 3, **told} for cell in range(cells)],
        "objects": [{"object": name, **told} for name in OBJECTS],
    }
    paired = again._pair(rows, starts, ends, CFG, batched)
    assert [row["success_rate"] for row in paired["rows"]] == [1.0, 0.0] * 3
    assert [row["difference"]["won"] for row in paired["rows"]] == [2, 0] * 3
    assert sum(row["difference"]["won"] for row in paired["objects"]) == 6
    assert [row["episodes"] for row in paired["objects"]] == [3, 3, 2, 2, 2]
    assert paired["overall"]["place"]["succeeded"] == 6 and paired["overall"]["difference"]["won"] == 6


def test_rules_that_were_not_exported_are_refused(bundle):
    agent = open_agent(bundle)
    check(agent, CFG)
    for changed, message in [
        (replace(CFG, retries=3), r"task\.retries: is 3, and 1 in the exported"),
        (replace(CFG, limits=StageLimits()), r"task\.limits: is "),
        (replace(CFG, detector="segmentation"), r"task\.detector: "),
    ]:
        with pytest.raises(ConfigError, match=message):
            check(agent, changed)


def test_a_fetch_begins_as_in_the_batched_simulation_and_is_run_to_its_end(device, bundle):
    env = FetchEnv(CFG, 3, device, 5)
    recorder = Recorder()
    recorder(env, policies.open_policy("zero").make(env.reset(), device), 0).reset()
    agent = open_agent(bundle)
    for world, start in enumerate(recorder.starts):
        assert start.thing is not None and start.most_steps == 3000
        table = CFG.scene.table_slot
        one = MujocoRobot(start.scene, agent.contract, thing=(start.thing, table))
        np.testing.assert_allclose(one.data.qpos, env.sim.views.qpos[world].cpu(), atol=1e-5)
        edge = start.scene.pos[table, 2] + start.scene.half_size[table, 2] + start.thing.half_extents[2]
        assert start.thing.start_pose[2] == pytest.approx(edge, abs=1e-5)
        row = again.run_episode(start, path=bundle, cfg=CFG)
        assert row["outcome"] in (episode.TIMEOUT, episode.COLLISION) and row["stage"] == n.REACH
        assert row["steps"] == row["stage_steps"].sum() <= 5 and not row["reached"]


def test_scripts_get_what_a_robot_could_know_alone(bundle):
    """Of the truth about the object a script reads nothing: neither its place nor its speed nor its size."""
    from spin_rl.deploy.fetch import script
    from spin_rl.deploy.fetch.known import Grip, Known, Now, Slots

    rng = np.random.default_rng(0)
    agent = open_agent(bundle)
    far = Slots(np.array([[9.0, 9.0, 0.5]]), np.zeros(1), np.full((1, 3), 0.3), np.array([False]))
    for _ in range(300):
        stage = rng.choice([n.ALIGN, n.RETRACT, n.PLACE])
        phase = rng.integers(0, 5)
        grip = Grip(tuple(rng.choice([0.0, 4.0], 2)), rng.choice([0.0, 5.0]), 0.0, bool(rng.random() < 0.5))
        joints, base, found = rng.uniform(-0.5, 0.5, 8), rng.uniform(-1.0, 1.0, 3), rng.normal(size=3)
        actions = []
        truths = (rng.normal(size=3), 0.0, True, 0.1), (np.full(3, np.nan), 9.0, False, 9.0)
        for at, speed, seen, length in truths:
            memory = Memory(np.zeros(2), np.ones(2), stage=stage, phase=phase, is_found=True, found=found)
            known = Known(grip, at, speed, seen, length, far, far)
            now = Now(base, 0.0, joints, joints, known, 0.1)
            actions.append(script.act(agent._drive, now, memory, np.zeros(10)))
        np.testing.assert_array_equal(*actions)
