import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.analysis.failures import (
    analysis as failures,
)
from spin_rl.analysis.failures import (
    report as failures_report,
)
from spin_rl.analysis.failures.failure import Failure, scene_of
from spin_rl.analysis.failures.names import OBSTACLES
from spin_rl.analysis.failures.watch import FailureWatch
from spin_rl.benchmark import registry, scenes
from spin_rl.benchmark.reach import Cell, run_cells
from spin_rl.benchmark.replay import benchmark_scene
from spin_rl.cli import evaluate
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.planning.solvability import scene_params
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.scenes.scene_file import load_scene
from spin_rl.tasks.common.config import CurriculumConfig
from spin_rl.tasks.nav.config import NavConfig

BLIND = (-3.14, 0.79)
AHEAD = (0.0, -0.6)
REACH, ROOMS, SCENES = (registry.find(name, "nav") for name in ("reach", "rooms", "scenes"))
BENCHMARK = NavConfig(episode_s=1.5, curriculum=CurriculumConfig(enabled=False, start=1.0))


class Driver:
    """Drives ahead with everything stowed but an arm that may stretch; looks where the camera is held."""

    def __init__(self, forward=1.0, turn=0.0):
        self.command = forward, turn

    def __call__(self, obs):
        action = torch.zeros(obs.batch_size[0], len(robot.ACTIONS), device=obs.device)
        action[:, 0], action[:, 1] = self.command
        return action

    def reset(self, dones=None):
        pass


def make_driver(obs, device):
    return Driver()


def scene_with_box(camera) -> Scene:
    """A low box whose face is 0.75 m ahead of the base's origin."""
    scene = Scene.empty(PoolSpec())
    scene.start_joints[:] = [robot.STOWED[joint] for joint in robot.JOINTS]
    scene.start_joints[-2:] = camera
    scene.goal[:] = (4.0, 0.0)
    slot = scene.pool.first_box
    scene.pos[slot], scene.half_size[slot], scene.active[slot] = (0.8, 0.0, 0.1), (0.05, 0.05, 0.1), True
    scene.num_obstacles = 1
    return scene


def watch_one(make_nav_env, driver, camera=AHEAD, **config):
    env = make_nav_env(NavConfig(camera_pose=camera, **config), num_envs=2, scene=scene_with_box(camera))
    watch = FailureWatch(driver, env, seed=9)
    (group,) = run_cells(env, watch, (Cell("scene", "scene"),), 2, report=lambda line: None)
    return env, group, watch.failures


@pytest.mark.parametrize(("camera", "seen"), [(AHEAD, ("in view", "before")), (BLIND, ("never",))])
def test_a_collision_is_described(make_nav_env, camera, seen):
    env, group, (failure, other) = watch_one(make_nav_env, Driver(), camera, episode_s=3.0)
    assert failure.outcome == "collision" and failure.parts == ["base"] and failure.hits == ["low"]
    assert failure.point_b[0] == pytest.approx(0.0595, abs=1e-3) and abs(failure.point_b[1]) < 0.06
    assert failure.slot == env.sim.layout.pool.first_box and not failure.moving and not failure.behind_corner
    assert (failure.seed, failure.world, other.world) == (9, 0, 1)
    assert failure.time_s == pytest.approx(group.steps[0] * env.cfg.sim.control_period)
    assert failure.forward_m_s > 0.6 and failure.motion == "forward"
    # The base's front is 0.0595 m ahead of its origin; the last observation is up to 0.08 m before the hit.
    assert 0.75 - 0.0595 - 0.1 < failure.travelled_m < 0.75 - 0.0595
    assert failure.to_go_m == pytest.approx(4.0 - failure.travelled_m, abs=2e-3)
    assert failure.seen in seen and (failure.unseen_s is None) == (failure.seen == "never")
    assert "front" in failures_report._by_side([failure, other])[1]
    # No wall has a way around it here: the way left is the straight line.
    assert (failure.way_m, failure.left_m) == pytest.approx((4.0, failure.to_go_m), abs=2e-3)
    assert failure.late_m == failure.travelled_m and failure.manner == "drove"
    rebuilt = scene_of(failure)
    np.testing.assert_allclose(rebuilt.pos[rebuilt.active], [[0.8, 0.0, 0.1]], atol=1e-4)


def test_a_box_that_leaves_the_image_was_seen_before(make_nav_env):
    # The camera sees the box until it is nearer than the low edge of its image.
    _, _, (failure, _) = watch_one(make_nav_env, Driver(), (0.0, -0.3), episode_s=3.0)
    assert failure.seen == "before" and 0.1 <= failure.unseen_s <= failure.time_s


def test_a_timeout_has_no_hit(make_nav_env):
    _, _, (failure, _) = watch_one(make_nav_env, Driver(0.0, 0.4), episode_s=1.0)
    assert failure.outcome == "timeout" and failure.time_s == pytest.approx(1.0)
    assert failure.parts == [] and failure.slot is None and failure.seen is None
    assert failure.motion == "turning" and failure.turn_rad_s == pytest.approx(0.6, abs=0.05)
    assert failure.late_m < 0.05 and 0.4 < failure.late_turn_rad < 0.6 and failure.manner == "stood"


def quick(**changes) -> NavConfig:
    """Episodes of three seconds."""
    return NavConfig(slack_s=3.0, slowness=0.01, curriculum=BENCHMARK.curriculum, **changes)


def assert_same_places(scene, failure):
    """What stands still is where it was in a failure, and so is the goal."""
    seen, still = scene_of(failure), scene.active & (scene.motion_speed == 0.0)
    for name in ("pos", "yaw", "half_size"):
        np.testing.assert_allclose(getattr(seen, name)[still], getattr(scene, name)[still], atol=1e-4)
    assert seen.active.tolist() == scene.active.tolist()
    np.testing.assert_allclose(scene.goal, failure.goal, atol=1e-4)


def test_families_of_places(device):
    cfg = quick(scene=scene_params("mixture"))
    result = failures.analyse_failures(
        ROOMS, make_driver, cfg, 2, [4], device, overrides=["scene=mixture"], report=lambda line: None
    )
    found = failures.failures_of(json.loads(json.dumps(result, allow_nan=False)))
    assert len(result["durations_s"]) == result["num_envs"] == 12
    kinds = {hit for failure in found for hit in failure.hits}
    assert kinds and kinds <= {*OBSTACLES, "wall", "floor", "distractor"}
    for failure in found:
        assert failure.condition == FAMILIES[failure.world % 6] == result["rows"][failure.world % 6]["family"]
        assert failure.place is None or failure.condition == "corridor"
        # A way counts more than its length near obstacles.
        assert 0.0 < failure.left_m <= failure.way_m + 3.0 * failure.travelled_m + 0.5
    last = max((f for f in found if f.condition in ("room", "doorway", "crossing")), key=lambda f: f.world)
    entry = result["failures"][found.index(last)]
    assert entry["play"] == f"family={last.condition} seed=4 world={last.world} scene=mixture"
    assert_same_places(benchmark_scene(cfg, last.condition, 4, last.world, device), last)
    text = failures_report.table(result)
    assert text.startswith("Failures: policy, 2 episodes per family (seeds 4)")
    assert any(line.startswith("crossing ") for line in text.splitlines()) and "free width" in text


def test_trips_and_a_scene_file(monkeypatch, device):
    names = ("corridor", "playroom")
    files = {name: load_scene(CONF_DIR / "scenes_examples" / f"{name}.yaml") for name in names}
    monkeypatch.setattr(scenes, "example_scenes", lambda: files)
    silent = {"report": lambda line: None}
    result = failures.analyse_failures(SCENES, make_driver, quick(), 2, [1], device, **silent)
    found = failures.failures_of(result)
    assert len(result["durations_s"]) == 4
    for failure, entry in zip(found, result["failures"], strict=True):
        name, trip = names[failure.world % 2], failure.world // 2
        assert failure.condition == name and failure.place is None and "distractor" not in failure.hits
        assert entry["play"] == f"scene={name}.yaml starts=2 trip={trip} seed=1"
    scene = scenes.trips_through(files[found[-1].condition], 2, quick(), 1)[found[-1].world // 2]
    np.testing.assert_allclose(scene.goal, found[-1].goal, atol=1e-4)

    alone = {"scene": files["corridor"], "scene_file": Path("mine/corridor.yaml")} | silent
    result = failures.analyse_failures(REACH, make_driver, BENCHMARK, 1, [0], device, **alone)
    (entry,) = result["failures"]
    assert (entry["condition"], entry["play"]) == ("corridor.yaml", "scene=mine/corridor.yaml")
    assert "per cell" in failures_report.table(result)


@pytest.fixture(scope="module")
def analysis(device):
    lines = []
    result = failures.analyse_failures(
        REACH, make_driver, BENCHMARK, episodes=2, seeds=[3, 5], device=device,
        policy_name="driver", overrides=["robot=re1"], report=lines.append,
    )  # fmt: skip
    return json.loads(json.dumps(result, allow_nan=False)), lines


def test_every_failure_is_listed_once(analysis):
    result, lines = analysis
    entries = failures.failures_of(result)
    assert sum(row["episodes"] for row in result["rows"]) == len(result["durations_s"]) == 24
    assert len({(f.seed, f.world) for f in entries}) == len(entries) == 24  # nothing reaches a goal in 1.5 s
    for row in result["rows"]:
        mine = [f for f in entries if f.condition == f"{row['scenario']} {row['difficulty']}"]
        assert len(mine) == row["episodes"] == 4
        collisions = [f for f in mine if f.outcome == "collision"]
        assert len(collisions) / 4 == row["collision_rate"] and all(f.parts for f in collisions)
    assert sorted(f.time_s for f in entries) == sorted(result["durations_s"])
    assert len(lines) == 2 and result["num_envs"] == 12


def test_a_replay_has_the_same_corridor(analysis, device):
    failure = failures.failures_of(analysis[0])[-1]
    assert failure.seed == 5 and failure.world < 11
    entry = analysis[0]["failures"][-1]
    scenario, difficulty = failure.condition.split()
    assert entry["play"].startswith(f"scenario={scenario} difficulty={difficulty} seed=5 world=")
    assert entry["play"].endswith(" robot=re1")
    cell = Cell(int(scenario), difficulty)
    scene = benchmark_scene(BENCHMARK, cell, failure.seed, failure.world, device)
    assert_same_places(scene, failure)


def test_report(analysis, tmp_path):
    result, _ = analysis
    text = failures_report.table(result)
    collisions = sum(entry["outcome"] == "collision" for entry in result["failures"])
    assert text.startswith("Failures: driver, 4 episodes per cell (seeds 3, 5)")
    headline = failures_report.headline(result)
    assert headline.startswith("24 of 24 episodes failed, ")
    assert f", {collisions} by collision" in headline and f", {24 - collisions} by timeout" in headline
    assert "and 12 more" in text
    listed = [line for line in text.splitlines() if "scenario=" in line]
    assert len(listed) == 12 and all(line.endswith("robot=re1") for line in listed)
    pytest.importorskip("matplotlib")
    failures_report.plot(result, tmp_path / "new" / "failures.png")
    assert (tmp_path / "new" / "failures.png").stat().st_size > 10_000


def test_rates_are_of_those_who_were_at_risk():
    def entry(**values):
        quiet = {name: None for name in Failure.__dataclass_fields__}
        known = {"outcome": "collision", "parts": ["base"], "hits": ["low"], "time_s": 0.5, "unseen_s": 0.0}
        return Failure(**quiet | known | values)

    some = [
        entry(),
        entry(time_s=3.0, unseen_s=0.9),
        entry(time_s=4.0, unseen_s=1.5, parts=["gripper", "base"], hits=["tall", "wall"]),
        entry(time_s=20.0, unseen_s=None),
        entry(time_s=60.0, outcome="timeout", parts=[], hits=[]),
        entry(time_s=5.0, hits=["wall"]),
    ]  # fmt: skip
    durations = [0.5, 3.0, 4.0, 20.0, 60.0, 5.0, 7.0, 1.0]

    def rows(lines):
        cells = [[cell for cell in line.split("  ") if cell] for line in lines[1:]]
        return {row[0].strip(): (row[1].strip(), row[2].strip()) for row in cells if len(row) > 2}

    by_time = rows(failures_report._by_time(some, durations))
    assert by_time["0 to 1 s"] == ("1", "12.5%") and by_time["2 to 4 s"] == ("2", "33.3%")
    assert by_time["over 16 s"] == ("1", "50.0%")
    by_sight = rows(failures_report._by_sight(some))
    assert by_sight["seen longer ago"] == ("0", "0.0%")  # of the walls, which come last
    assert by_sight["in view"] == ("1", "100.0%")
    obstacles = rows(failures_report._by_sight([f for f in some if f.hits != ["wall"]]))
    shares = ["in view", "seen up to 1 s ago", "seen longer ago", "never seen"]
    assert [obstacles[name] for name in shares] == [("1", "25.0%")] * 4
    contacts = failures_report._by_contact(some, 50)
    assert sum(line.startswith("base     low") and " 3 " in line for line in contacts) == 1
    assert failures_report._by_contact([], 50) == [] and failures_report._by_motion([]) == []

    narrow = [entry(width_m=width) for width in (0.3, 0.36, 0.37, 2.0, None)]
    by_width = rows(failures_report._by_width([*narrow, entry(width_m=0.9, outcome="timeout", parts=[])]))
    assert by_width["0 to 0.36 m"] == ("2", "33.3%") and by_width["0.36 to 0.55 m"] == ("1", "16.7%")
    assert by_width["0.55 to 1 m"] == ("1", "16.7%") and by_width["over 1 m"] == ("2", "33.3%")
    ends = {"to_go_m": 1.0, "late_m": 2.0, "late_turn_rad": -6.3, "way_m": 8.0, "outcome": "timeout"}
    late = [entry(manner="circled", left_m=left, **ends) for left in (2.0, 4.0, 5.0)]
    (line,) = [line for line in failures_report._timeouts([*some[:2], *late]) if line.startswith("circled")]
    assert [cell.strip() for cell in line.split("  ") if cell][1:3] == ["3", "100.0%"]
    assert [cell.strip() for cell in line.split("  ") if cell][4:] == ["50%", "1.0 m", "2.0 m", "1.0"]
    assert failures_report._timeouts(some[:2]) == [] and failures_report._by_place(some) == []


@pytest.mark.parametrize(
    ("episodes", "seeds", "num_envs", "key"),
    [(0, [0], None, "episodes"), (1, [1, 1], None, "seeds"), (2, [0], 11, "num_envs")],
)
def test_impossible_settings_name_the_key(episodes, seeds, num_envs, key):
    with pytest.raises(ConfigError, match=f"^{key}"):
        failures.analyse_failures(REACH, make_driver, BENCHMARK, episodes, seeds, "cpu", num_envs=num_envs)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ["benchmark=pick"],
            "analysis: failures needs benchmark=reach or benchmark=rooms or benchmark=scenes",
        ),
        (["plot=a.txt"], "plot: expected a .png"),
        (["num_envs=4"], "num_envs: all 600 episodes"),
    ],
)
def test_bad_input_is_one_line(monkeypatch, capfd, tmp_path, arguments, expected):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        sys, "argv", ["spin-eval", "policy=zero", "analysis=failures", "episodes=100", *arguments]
    )
    with pytest.raises(SystemExit) as stopped:
        evaluate.main()
    error = capfd.readouterr().err.strip()
    assert stopped.value.code == 2 and error.startswith("spin-eval: error: ")
    assert expected in error and "\n" not in error


def test_command_writes_tables_and_numbers(monkeypatch, capfd, device, tmp_path):
    out = tmp_path / "failures.json"
    monkeypatch.chdir(tmp_path)
    arguments = ["policy=zero", "analysis=failures", "episodes=1", "seeds=[4]", f"device={device}"]
    arguments += [f"out={out}", "task.episode_s=0.3", "scene=hidden"]
    monkeypatch.setattr(sys, "argv", ["spin-eval", *arguments])
    evaluate.main()
    printed = capfd.readouterr().out
    assert (
        "Failures: zero, 1 episodes per cell (seeds 4), robot paper, camera portrait, scene hidden" in printed
    )
    assert "6 of 6 episodes failed, 6 by timeout" in printed
    plays = [entry["play"] for entry in json.loads(out.read_text())["failures"]]
    assert len(plays) == 6 and all(play.endswith(" task.episode_s=0.3 scene=hidden") for play in plays)
