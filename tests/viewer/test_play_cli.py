import subprocess
import sys

import mujoco
import numpy as np
import pytest
from viewer_worlds import SCENE, pick_snapshot, snapshot

from spin_rl.cli import play
from spin_rl.scenes.builder import native_model
from spin_rl.viewer.native import draw_scandots, pose


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "policy: expected a name, checkpoint"),
        (["policy=no-such-policy", "viewer=none"], "policy: There is no policy"),
        (["policy=zero", "scenario=3"], "scenario: unknown 3; choose from 1, 2"),
        (
            ["policy=zero", "difficulty=brutal"],
            "difficulty: unknown 'brutal'; choose from any, easy, medium, hard",
        ),
        (["policy=zero", "difficulty=any"], "difficulty: unknown 'any'; choose from easy, medium, hard"),
        (["policy=zero", "episodes=0"], "episodes: expected a whole number"),
        (["policy=zero", "viewer=holo"], "viewer: unknown 'holo'; choose from viser, native, none"),
        (["policy=zero", "viewer=native"], "viewer: native needs a display"),
        (["policy=zero", "video=a.avi"], "video: a.avi should end in .mp4 or .gif"),
        (["policy=zero", "video=."], "video: "),
        (["policy=zero", "plots=a-file"], "plots: a-file is no folder"),
        (["policy=zero", "port=http"], "port: expected a whole number"),
        (["policy=zero", "world=-1"], "world: expected a whole number from 0 to 19999 or null, got -1"),
        (["policy=zero", "world=3", "scene=lab.yaml"], "world: a scene file is the same in every world"),
        (["policy=zero", "task=pick", "world=3"], "world: 3 needs a policy of task=nav"),
        (["policy=zero", "scene=room", "world=3"], "world: 3 of scene families needs family="),
        (["policy=zero", "family=room", "world=3"], "family: room needs world= and scene=mixture"),
        (["policy=zero", "family=lawn"], "family: unknown 'lawn'; choose from corridor, room"),
        (["policy=zero", "scene=lab.yaml", "starts=3"], "trip: needs starts="),
        (["policy=zero", "starts=3", "trip=1"], "trip: 1 needs a scene file"),
        (["policy=zero", "scene=lab.yaml", "starts=3", "trip=3"], "trip: 3 is none of 3"),
        (["policy=nav-cvo", "task=pick", "viewer=none"], "policy: nav-cvo was trained with task=nav"),
        (["policy=zero", "pick=pick-teacher", "viewer=none"], "pick: pick-teacher needs task=fetch"),
        (["policy=zero", "task=fetch", "pick=7"], "pick: expected a name, checkpoint"),
        (["policy=zero", "task=fetch", "scene=lab.yaml"], "scene: lab.yaml needs a policy of task=nav"),
        (
            ["policy=pick-teacher", "task=fetch", "viewer=none"],
            "policy: pick-teacher was trained with task=pick",
        ),
        (
            ["policy=zero", "task=fetch", "pick=nav-cvo", "viewer=none"],
            "pick: nav-cvo was trained with task=nav",
        ),
        (["policy=zero", "device=tpu"], "device: unknown device 'tpu'"),
        (["policy=zero", "viewer=none", "scene=missing.yaml"], "scene: there is no file missing.yaml"),
        (["policy=zero", "viwer=none"], "viwer"),
    ],
)
def test_bad_input_is_one_line_that_names_the_key(monkeypatch, capfd, tmp_path, arguments, expected):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    (tmp_path / "a-file").touch()
    monkeypatch.setattr(sys, "argv", ["spin-play", *arguments])
    with pytest.raises(SystemExit) as stopped:
        play.main()
    assert stopped.value.code == 2
    error = capfd.readouterr().err.strip()
    assert error.startswith("spin-play: error: ") and expected in error
    assert "\n" not in error


@pytest.mark.slow
def test_plots_end_to_end(device, tmp_path):
    pytest.importorskip("matplotlib")
    folder = tmp_path / "plots"
    command = [sys.executable, "-m", "spin_rl.cli.play", "policy=zero", "episodes=2", "difficulty=easy",
               f"plots={folder}", f"device={device}", "depth=d435i", "task.episode_s=0.5"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"Wrote {folder}: 0 of 2 episodes reached the goal"
    assert "episode 2: timeout after 0.5 s" in done.stdout
    assert "warning: depth: depth=d435i changes nothing, since this policy reads no images\n" in done.stderr
    assert sorted(file.name for file in folder.iterdir()) == ["episode_001.png", "episode_002.png"]


@pytest.mark.parametrize(
    "again",
    [["scene=mixture", "family=open", "world=1"], ["scene=corridor.yaml", "starts=2", "trip=1"]],
    ids=["a world of a family", "a trip"],
)
def test_an_episode_of_a_benchmark_has_its_own_time_limit(monkeypatch, capfd, device, again):
    quick = ["policy=zero", "viewer=none", "task.slack_s=0.3", "task.slowness=0.01", f"device={device}"]
    monkeypatch.setattr(sys, "argv", ["spin-play", *quick, *again])
    play.main()
    lines = capfd.readouterr().out.splitlines()
    (line,) = [line for line in lines if "episode 1: timeout after 0." in line]
    assert "scenario" not in line and not line.endswith(", ")
    assert lines[-1].startswith("0 of 1 episodes reached the goal")


def test_native_window_gets_a_mark_per_scandot_and_the_goal():
    model = native_model(SCENE)
    scene = mujoco.MjvScene(model, maxgeom=50)
    state = snapshot()
    for _ in range(2):  # replaced, not added
        draw_scandots(scene, state)
    assert scene.ngeom == 3
    np.testing.assert_allclose(scene.geoms[0].pos, state.scandots.points[0], atol=1e-6)
    np.testing.assert_allclose(scene.geoms[2].pos[:2], SCENE.goal)
    assert scene.geoms[0].rgba[0] > 0.8 > scene.geoms[1].rgba[0]


def test_native_window_marks_the_object_and_no_goal():
    state = pick_snapshot()
    model = native_model(SCENE, obj=state.target.what)
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, maxgeom=50)
    pose(model, data, state)
    np.testing.assert_allclose(data.body("object").xpos, state.target.pose[:3])
    draw_scandots(scene, state)
    assert scene.ngeom == 1
    np.testing.assert_allclose(scene.geoms[0].pos, state.target.pose[:3], atol=1e-6)


def test_a_fetch_end_to_end(monkeypatch, capfd, device):
    arguments = ["task=fetch", "policy=zero", "pick=random", "viewer=none", "scenario=1", "difficulty=easy",
                 "task.object=can", "task.limits.reach=0.2", "episodes=2", f"device={device}"]  # fmt: skip
    monkeypatch.setattr(sys, "argv", ["spin-play", *arguments])
    play.main()
    lines = capfd.readouterr().out.splitlines()
    assert lines[-1].endswith("0 of 2 fetches done (2 reach timeout)")
    assert any(
        "episode 2: reach timeout after 0.2 s" in line and "scenario 1, easy, can" in line for line in lines
    )
