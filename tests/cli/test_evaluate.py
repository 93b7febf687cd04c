import json
import subprocess
import sys

import pytest

from spin_rl.cli import common, evaluate


def run_main(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["spin-eval", *arguments])
    evaluate.main()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["policy=no-such-policy"], "policy"),
        ([], "policy"),
        (
            ["policy=zero", "benchmark=dance"],
            "benchmark: unknown 'dance'; choose from reach, rooms, scenes, dynamic, pick, fetch, place",
        ),
        (["policy=zero", "episodes=0"], "episodes: at least 1"),
        (["policy=zero", "episodes=many"], "episodes: expected a whole number"),
        (["policy=zero", "seeds=3"], "seeds: expected a list"),
        (["policy=zero", "seeds=[]"], "seeds: at least one"),
        (["policy=zero", "seeds=[1,1]"], "seeds: every seed"),
        (["policy=zero", "num_envs=0"], "num_envs: at least 1"),
        (["policy=zero", "device=tpu"], "device: unknown device 'tpu'"),
        (["policy=zero", "scene=missing.yaml"], "scene: there is no file missing.yaml"),
        (["policy=zero", "out=."], "out: . is a folder"),
        (["policy=zero", "task.episode_s=-1"], "task.episode_s must exceed"),
        (["policy=zero", "robot.profile=jet"], "robot: unknown profile 'jet'"),
        (["policy=zero", "epsiodes=3"], "epsiodes"),
        (["policy=zero", "benchmark=rooms", "scene=lab.yaml"], "scene: lab.yaml needs benchmark=reach or"),
        (["policy=zero", "benchmark=rooms", "scene=nav"], "scene: benchmark=rooms needs scene=mixture or"),
        (["policy=zero", "benchmark=reach", "starts=3"], "starts: benchmark=reach draws its own"),
        (["policy=zero", "scene=lab.yaml", "starts=0"], "starts: at least 1"),
        (["policy=zero", "benchmark=scenes", "episodes=3"], "episodes: benchmark=scenes drives every trip"),
        (["policy=zero", "benchmark=scenes", "scene=room"], "scene: benchmark=scenes runs in scene files"),
        (
            ["policy=nav-cvo", "benchmark=pick"],
            "policy: nav-cvo was trained with task=nav, which is not task=pick",
        ),
        (
            ["policy=zero", "task=pick", "benchmark=reach"],
            "benchmark: reach measures task=nav, not task=pick",
        ),
        (["policy=zero", "benchmark=pick", "analysis=camera"], "analysis: camera needs benchmark=reach"),
        (["policy=zero", "benchmark=pick", "scene=lab.yaml"], "scene: lab.yaml needs benchmark=reach"),
        (["policy=zero", "benchmark=pick", "task.object=hat"], "task.object must be any or one of banana"),
        (["policy=nav-cvo", "depth=d435i"], "depth: depth=d435i changes nothing"),
        (
            ["policy=nav-cvo", "pick=pick-teacher"],
            "pick: pick-teacher needs benchmark=fetch or benchmark=place",
        ),
        (["policy=zero", "benchmark=fetch", "pick=3"], "pick: expected a name, checkpoint"),
        (["policy=zero", "benchmark=place", "pick=none-such"], "pick: There is no policy 'none-such'"),
        (
            ["policy=pick-teacher", "benchmark=fetch"],
            "policy: pick-teacher was trained with task=pick; a fetch needs one of task=nav",
        ),
        (
            ["policy=zero", "benchmark=fetch", "task.camera_pose=[0,2]"],
            "task.camera_pose: 2.0 is outside the limits of head_tilt",
        ),
        (["policy=zero", "backend=gazebo"], "backend: unknown 'gazebo'; choose from mujoco"),
        (["policy=zero", "backend=mujoco"], "policy: zero cannot be exported"),
        (["policy=zero", "processes=2"], "processes: needs backend=mujoco"),
        (["policy=zero", "backend=mujoco", "analysis=camera"], "backend: analysis=camera looks at"),
        (
            ["policy=zero", "benchmark=place", "backend=mujoco"],
            "backend: benchmark=place tells of",
        ),
        (["policy=zero", "benchmark=fetch", "scene=lab.yaml"], "scene: lab.yaml needs benchmark=reach"),
        (["policy=zero", "benchmark=dynamic", "scene=lab.yaml"], "scene: lab.yaml needs benchmark=reach"),
        (["policy=zero", "benchmark=dynamic", "analysis=failures"], "analysis: failures needs"),
        (
            ["policy=classical", "benchmark=pick"],
            "policy: classical acts in task=nav, which is not task=pick",
        ),
        (["policy=classical", "benchmark=fetch"], "policy: classical takes no turns with others"),
        (["policy=classical", "task.lidar.enabled=false"], "task.lidar.enabled: policy=classical"),
        (["policy=classical", "task.goal_range_m=3"], "task.goal_range_m: policy=classical"),
        (["policy=classical", "analysis=camera"], "analysis: camera needs a policy with one"),
        (["policy=classical", "backend=mujoco"], "policy: classical cannot be exported"),
        (["policy=zero", "task.lidar.far_m=0.1"], "task.lidar.far_m must exceed near_m"),
    ],
)
def test_bad_input_is_one_line_that_names_the_key(monkeypatch, capfd, tmp_path, arguments, expected):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        run_main(monkeypatch, *arguments)
    assert stopped.value.code == 2
    error = capfd.readouterr().err.strip()
    assert error.startswith("spin-eval: error: ") and expected in error
    assert "\n" not in error


def test_scene_is_a_file_or_the_group():
    assert common.scene_file_argument("scene=rooms/kitchen.yaml") == "scene_file=rooms/kitchen.yaml"
    assert common.scene_file_argument("scene=nav") == "scene=nav"
    assert common.scene_file_argument("scene.width=1.2") == "scene.width=1.2"
    assert common.scene_file_argument("policy=zero") == "policy=zero"


def test_other_scenes_and_images_are_named_in_table_and_file(monkeypatch, capsys, device, tmp_path):
    out = tmp_path / "reach.json"
    run_main(monkeypatch, "policy=zero", "episodes=1", "seeds=[0]", f"device={device}", f"out={out}",
             "scene=moving", "depth=d435i", "task.depth.enabled=true", "task.episode_s=0.2")  # fmt: skip
    assert ", depth noise d435i, scene moving\n" in capsys.readouterr().out
    result = json.loads(out.read_text())
    assert result["scene"] == "moving" and result["depth"]["noise"]["latency_steps"] == [0, 1]


@pytest.mark.slow
def test_zero_policy_end_to_end(device, tmp_path):
    # The episodes are cut short: no robot that stands still reaches anything.
    out = tmp_path / "new" / "reach.json"
    command = [sys.executable, "-m", "spin_rl.cli.evaluate", "policy=zero", "episodes=1", "seeds=[0,1]",
               f"device={device}", f"out={out}", "num_envs=4", "task.episode_s=0.5"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.strip().splitlines()
    assert lines[-1].startswith(f"Wrote {out}")
    assert any("SPIN (CVO)" in line for line in lines)
    result = json.loads(out.read_text())
    assert result["policy"] == "zero" and result["benchmark"] == "reach"
    assert result["seeds"] == [0, 1] and result["num_envs"] == 3 and "scene" not in result
    assert [(row["scenario"], row["difficulty"]) for row in result["rows"]] == [
        (1, "easy"), (1, "medium"), (1, "hard"), (2, "easy"), (2, "medium"), (2, "hard")
    ]  # fmt: skip
    for row in result["rows"]:
        assert row["episodes"] == 2
        assert row["success_rate"] == 0.0 and row["duration_s"] is None
        assert row["timeout_rate"] == 1.0 and row["causes"]["timeout"] == 1.0
        assert row["duration_all_s"] == pytest.approx(0.5)
        assert row["final_distance_m"] > 2.0


def test_picks_end_to_end(monkeypatch, capsys, device, tmp_path):
    """The benchmark names the task; a robot that stands still lifts nothing."""
    out = tmp_path / "pick.json"
    run_main(monkeypatch, "policy=zero", "benchmark=pick", "episodes=7", "seeds=[0,1]", f"device={device}",
             f"out={out}", "num_envs=4", "task.episode_s=0.4", "camera=fixcam_IV")  # fmt: skip
    printed = capsys.readouterr().out
    assert "Pick: zero, 14 episodes (seeds 0, 1), " in printed and "frozen at pan 0.0, tilt -0.2" in printed
    all_line = next(line for line in printed.splitlines() if line.startswith("all "))
    assert "0.97  5.7 s" in all_line and "0.86 11.0 s" in all_line
    result = json.loads(out.read_text())
    assert result["benchmark"] == "pick" and result["camera_pose"] == [0.0, -0.2]
    assert [(row["object"], row["episodes"]) for row in result["rows"]] == [
        ("banana", 4), ("mug", 4), ("can", 2), ("brick", 2), ("bottle", 2)
    ]  # fmt: skip
    assert result["overall"]["episodes"] == 14 and result["overall"]["causes"]["timeout"] == 1.0
    assert result["overall"]["duration_all_s"] == pytest.approx(0.4)
    assert result["overflows"] == {} and set(result["noise"].values()) == {0.0}


def test_fetches_end_to_end(monkeypatch, capsys, device, tmp_path):
    """The benchmark names the task; a robot that stands still reaches no table."""
    out = tmp_path / "fetch.json"
    run_main(monkeypatch, "policy=zero", "pick=random", "benchmark=fetch", "episodes=1", "seeds=[0,1]",
             f"device={device}", f"out={out}", "num_envs=4", "task.limits.reach=0.3")  # fmt: skip
    printed = capsys.readouterr().out
    assert "Fetch: zero + random, 2 episodes per cell (seeds 0, 1), robot paper, camera portrait" in printed
    assert "fetched 0.00 (0.00-0.24) of 12; reach 0/12, pick 0/0, place 0/0" in printed
    result = json.loads(out.read_text())
    assert (result["policy"], result["pick"], result["benchmark"]) == ("zero", "random", "fetch")
    assert result["num_envs"] == 3 and result["overflows"] == {} and result["limits"]["reach"] == 0.3
    assert [row["episodes"] for row in result["rows"]] == [2] * 6
    assert all(row["causes"] == {"reach timeout": 1.0} for row in result["rows"])
    assert {row["object"]: row["episodes"] for row in result["objects"]} == {
        "banana": 4, "mug": 2, "can": 2, "brick": 2, "bottle": 2
    }  # fmt: skip
    assert result["overall"]["duration_all_s"] == pytest.approx(0.3)


def test_flags_of_hydra_find_the_task_of_the_policy(monkeypatch, capfd):
    run_main(monkeypatch, "policy=pick-teacher", "--cfg", "job")
    assert "\n  name: pick\n" in capfd.readouterr().out
    with pytest.raises(SystemExit) as stopped:
        run_main(monkeypatch, "-m", "policy=zero,random", "seeds=3")
    assert stopped.value.code == 2 and "spin-eval: error: seeds: expected a list" in capfd.readouterr().err
