import json
import sys

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.analysis.camera import analysis as camera
from spin_rl.analysis.camera import drawing as camera_drawing
from spin_rl.analysis.camera import examples as camera_examples
from spin_rl.analysis.camera import motion as camera_motion
from spin_rl.analysis.camera import report as camera_report
from spin_rl.analysis.camera import variants as camera_variants
from spin_rl.analysis.camera.variants import Variant
from spin_rl.analysis.camera.watch import WatchedPolicy
from spin_rl.analysis.hits import FLOOR, Hit, NearestObstacle, summarize_hits
from spin_rl.benchmark import policies
from spin_rl.benchmark.metrics import ReachEpisodes
from spin_rl.benchmark.reach import Cell, run_cells
from spin_rl.cli import evaluate
from spin_rl.config import ConfigError
from spin_rl.planning.solvability import scene_params
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common import episode
from spin_rl.tasks.nav.config import NavConfig

BLIND = (-3.14, 0.79)
AHEAD = (0.0, -0.6)


def episodes_of(success) -> ReachEpisodes:
    outcome = np.where(success, episode.SUCCESS, episode.TIMEOUT)
    n = len(outcome)
    return ReachEpisodes(outcome, np.full(n, 10), np.zeros(n), np.zeros((n, len(robot.PARTS)), dtype=bool))


def test_difference_counts_corridors_that_changed():
    own = [episodes_of([1, 1, 1, 0]), episodes_of([1, 1, 0, 0])]
    other = [episodes_of([0, 1, 1, 0]), episodes_of([0, 0, 1, 0])]
    difference = camera.paired_difference(own, other)
    assert (difference["won"], difference["lost"]) == (1, 3)
    assert difference["mean"] == pytest.approx(-2 / 8)
    # By hand: p12 = 2/10, p21 = 4/10, variance (0.6 - 0.04) / 10.
    half = 1.959964 * np.sqrt(0.056)
    assert difference["ci95"] == pytest.approx([-0.2 - half, -0.2 + half], abs=1e-6)


def test_order_of_corridors_matters_to_the_interval_only():
    success = np.arange(100) % 2 == 0
    same = camera.paired_difference([episodes_of(success)], [episodes_of(success)])
    opposite = camera.paired_difference([episodes_of(success)], [episodes_of(~success)])
    assert same["mean"] == opposite["mean"] == 0.0
    width = [d["ci95"][1] - d["ci95"][0] for d in (same, opposite)]
    assert 0.0 < width[0] < 0.3 * width[1]


@pytest.mark.parametrize(("lost", "won"), [(0.02, 0.02), (0.3, 0.05), (0.0, 0.1)])
def test_interval_covers_the_true_difference(lost, won):
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(400):
        draw = rng.random(120)
        before, after = draw < lost, (draw >= lost) & (draw < lost + won)
        low, high = camera.paired_difference([episodes_of(before)], [episodes_of(after)])["ci95"]
        covered += low <= won - lost <= high
    assert 0.92 < covered / 400 <= 1.0


def test_different_numbers_of_corridors_cannot_be_paired():
    with pytest.raises(ValueError, match="paired"):
        camera.paired_difference([episodes_of([1, 0])], [episodes_of([1])])


def test_a_constant_pose_is_told_apart_from_looking_around():
    valid = np.ones((100, 2), dtype=bool)
    constant = np.tile([0.0, 1.0], (100, 1))
    moving = np.tile(0.5 + 0.5 * np.sin(0.2 * np.arange(100))[:, None], (1, 2))
    held = camera_motion.camera_motion(constant, valid, 0.1)
    looking = camera_motion.camera_motion(moving, valid, 0.1)
    assert held.std == pytest.approx(0.5) and held.std_within == 0.0 and held.rate == 0.0
    assert looking.std_within == pytest.approx(0.5 / np.sqrt(2), rel=0.05)
    assert looking.rate == pytest.approx(0.1 * 2 / np.pi / 0.1, rel=0.05)  # mean |cos|


def test_only_valid_steps_count():
    poses = np.array([[9.0, 9.0], [1.0, 9.0], [2.0, 9.0], [5.0, 9.0]])
    valid = np.array([[False, False], [True, False], [True, False], [False, False]])
    motion = camera_motion.camera_motion(poses, valid, 0.5)
    assert (motion.mean, motion.rate, motion.std_within) == (1.5, 2.0, 0.5)
    assert camera_motion.camera_motion(poses, np.zeros_like(valid), 0.5) is None


def test_poses_are_counted_where_they_are():
    poses = np.array([[0.02, -0.5]] * 3 + [[-3.13, -1.2], [-3.9001, -1.5301]])  # the last: a hair too far
    share = camera_motion.share_of_time(poses)
    pans, tilts = (np.array(share[name]) for name in ("pan_edges", "tilt_edges"))
    values = np.array(share["share"])
    assert values.shape == (len(pans) - 1, len(tilts) - 1) and values.sum() == pytest.approx(1.0)
    for (pan, tilt), expected in (((0.02, -0.5), 0.6), ((-3.13, -1.2), 0.2), ((-3.8999, -1.5299), 0.2)):
        cell = values[np.searchsorted(pans, pan) - 1, np.searchsorted(tilts, tilt) - 1]
        assert cell == pytest.approx(expected)


def test_examples_are_the_first_that_succeed_with_what_came_out():
    steps, worlds = 6, 4
    yaw = np.full((steps, worlds), np.pi / 2)
    y = np.repeat([[0.0], [0.1], [0.2], [0.1], [0.0], [9.0]], worlds, axis=1)
    fastest = np.zeros((steps, worlds))
    fastest[[1, 2, 4], 2] = 1.0
    recording = camera_examples.Recording(
        poses=np.stack([np.full((steps, worlds), -3.0), np.full((steps, worlds), -1.0)], -1),
        base=np.stack([np.zeros_like(y), y, yaw], -1),
        fastest=fastest,
        ends=np.array([5, 0, 5, 5]),
        outcomes=np.array([episode.COLLISION, episode.SUCCESS, episode.SUCCESS, episode.SUCCESS]),
        period=0.5,
    )
    found = camera_examples.examples(recording)
    assert [each["world"] for each in found] == [2, 3, 0]  # world 1 did not end
    assert [each["outcome"] for each in found] == ["success", "success", "collision"]
    assert found[0]["comes_out_s"] == [0.5, 2.0] and found[1]["comes_out_s"] == []
    assert found[0]["speed_m_s"] == pytest.approx([0.2, 0.2, -0.2, -0.2, -0.2])
    assert found[0]["pan_rad"] == [-3.0] * 5 and found[0]["time_s"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert len(camera_examples.examples(recording, most=1)) == 1


def test_sweep_has_every_pose_once_and_names_fixcam():
    variants = camera_variants.held_variants([-0.2, -0.5, 0], BLIND)
    assert [variant.pose[1] for variant in variants] == [0.0, -0.2, -0.5, -1.05, -1.3, 0.79]
    assert [variant.name for variant in variants] == [
        "tilt 0.00 (FixCam I)", "tilt -0.20 (FixCam IV)", "tilt -0.50", "tilt -1.05 (FixCam III)",
        "tilt -1.30 (FixCam II)", "blind control",
    ]  # fmt: skip
    assert variants[-1].kind == "blind" and variants[-1].pose == BLIND
    assert all(variant.kind == "fixed" for variant in camera_variants.held_variants([-0.2], None))


def test_the_freeze_test_is_alone_without_a_sweep():
    assert camera_variants.held_variants([], None) == []
    assert [variant.kind for variant in camera_variants.held_variants([], BLIND)] == ["blind"]


def test_never_seen_share_is_of_obstacles_only():
    hits = [Hit("obstacle", True), Hit("obstacle", False), Hit("wall", False), Hit("floor", False)]
    assert summarize_hits(hits) == {
        "obstacle_hits": 2, "wall_hits": 1, "floor_hits": 1, "never_seen": 1, "never_seen_share": 0.5
    }  # fmt: skip
    assert summarize_hits([])["never_seen_share"] is None


class Driver:
    """Drives straight ahead with everything stowed."""

    def __call__(self, obs):
        action = torch.zeros(obs.batch_size[0], len(robot.ACTIONS), device=obs.device)
        action[:, 0] = 1.0
        return action

    def reset(self, dones=None):
        pass


def scene_with(kind, pose=AHEAD) -> Scene:
    """An obstacle 0.8 m ahead of the base and another one far away; the camera starts at `pose`."""
    scene = Scene.empty(PoolSpec())
    scene.start_joints[:] = [robot.STOWED[joint] for joint in robot.JOINTS]
    scene.start_joints[-2:] = pose
    scene.goal[:] = (4.0, 0.0)
    slots = {"wall": 0, "box": scene.pool.first_box, "cylinder": scene.pool.first_cylinder}
    for slot, x in ((slots[kind], 0.8), (slots["box"] + 1, -1.5)):
        scene.pos[slot] = (x, 0.0, 0.1)
        scene.half_size[slot] = (0.05, 1.0 if kind == "wall" else 0.05, 0.1)
        scene.active[slot] = True
    return scene


@pytest.mark.parametrize(
    ("kind", "pose", "expected"),
    [
        ("box", AHEAD, Hit("obstacle", True)),
        ("box", BLIND, Hit("obstacle", False)),
        ("cylinder", AHEAD, Hit("obstacle", True)),
        ("wall", AHEAD, Hit("wall", True)),
    ],
)
def test_a_hit_knows_whether_the_camera_had_shown_it(make_nav_env, kind, pose, expected):
    env = make_nav_env(NavConfig(camera_pose=pose, episode_s=3.0), num_envs=2, scene=scene_with(kind, pose))
    watched = WatchedPolicy(Driver(), env)
    (group,) = run_cells(env, watched, (Cell("scene", "scene"),), 2, report=lambda line: None)
    assert (group.outcome == episode.COLLISION).all()
    assert watched.hits == [expected] * 2
    motion = watched.motion()
    assert motion is None or abs(motion.pan.mean - pose[0]) < 0.01
    assert [each["outcome"] for each in watched.examples] == ["collision"] * 2
    first = watched.examples[0]
    assert first["pan_rad"] == pytest.approx([pose[0]] * len(first["time_s"]), abs=0.01)
    assert max(first["speed_m_s"]) > 0.2 and first["comes_out_s"] == []


def test_nearest_is_measured_from_the_touching_parts(nav_env):
    nearest = NearestObstacle(nav_env.sim)
    scene = scene_with("box")
    box, other = scene.pool.first_box, scene.pool.first_box + 1
    scene.pos[box] = (0.4, 0.0, 0.1)
    scene.pos[other] = (0.6, 0.0, 1.3)
    nearest._yaw, nearest._half_size, nearest._active = (
        array[None] for array in (scene.yaw, scene.half_size, scene.active)
    )
    qpos = robot.qpos_from_joints(nav_env.sim.mj_model, robot.STOWED)
    touching = {part: np.array([name == part for name in robot.PARTS]) for part in robot.PARTS}
    assert [touch.slot for touch in nearest.find(0, scene.pos, qpos, touching["base"])] == [box]
    assert [touch.slot for touch in nearest.find(0, scene.pos, qpos, touching["head"])] == [other]
    both = nearest.find(0, scene.pos, qpos, touching["base"] | touching["head"])
    assert [(touch.part, touch.slot) for touch in both] == [("base", box), ("head", other)]
    assert both[0].distance == pytest.approx(0.4 - 0.05 - 0.0595, abs=1e-6)  # the base's front is at 0.0595 m
    assert both[0].point_b[0] == pytest.approx(0.0595, abs=1e-6)
    joints = dict(robot.STOWED) | {"lift": 0.0, "wrist_pitch": -1.5}
    low = robot.qpos_from_joints(nav_env.sim.mj_model, joints)
    assert nearest.find(0, scene.pos, low, touching["gripper"])[0].slot == FLOOR


def test_all_variants_have_the_same_corridors(make_nav_env):
    def start(pose):
        env = make_nav_env(NavConfig(camera_pose=pose), num_envs=6)
        env.set_cells([1, 1, 1, 2, 2, 2], [0, 1, 2, 0, 1, 2])
        env.reseed(7)
        env.reset()
        layout = env.sim.layout
        arrays = (layout.pos, layout.yaw, layout.half_size, layout.active, layout.start, layout.goal)
        return [array.numpy() for array in arrays] + [layout.start_joints.numpy()[:, :6]]

    for own, held in zip(start(None), start(BLIND), strict=True):
        np.testing.assert_array_equal(own, held)


def test_zero_policy_with_held_cameras(device, tmp_path):
    lines = []
    result = camera.analyse_camera(
        policies.open_policy("zero").make,
        NavConfig(episode_s=1.6),
        episodes=1,
        seeds=[0],
        device=device,
        further=[Variant("level", "fixed", (0.0, 0.0))],
        policy_name="zero",
        report=lines.append,
    )
    assert [variant["kind"] for variant in result["variants"]] == ["own", "frozen", "fixed"]
    own, frozen, fixed = result["variants"]
    assert result["num_envs"] == 6 and result["seeds"] == [0]
    assert len(own["rows"]) == 6 and own["mean_success"] == 0.0 and own["difference"] is None
    assert own["camera"]["tilt"]["mean"] == pytest.approx(robot.STOWED["head_tilt"], abs=0.02)
    assert frozen["camera_pose"] == [own["camera"][joint]["mean"] for joint in ("pan", "tilt")]
    assert fixed["camera"]["tilt"]["mean"] == pytest.approx(0.0, abs=1e-3)
    assert frozen["difference"]["mean"] == 0.0 and frozen["difference"]["won"] == 0
    assert lines[-1].startswith("  seed 0: 6 of 6 episodes")
    json.dumps(result, allow_nan=False)

    table = camera_report.table(result).splitlines()
    assert table[0].startswith("Camera: zero, 1 episodes per cell (seeds 0)")
    assert [line.split("  ")[0] for line in table[4:7]] == [v["name"] for v in result["variants"]]
    assert "frozen at its mean 0.00" in camera_report.headline(result)
    pytest.importorskip("matplotlib")
    camera_report.plot(result, tmp_path / "new" / "camera.png")
    assert (tmp_path / "new" / "camera.png").stat().st_size > 10_000
    assert own["looking"]["examples"] and "looking" not in frozen and "looking" not in fixed
    assert (tmp_path / "new" / "camera_looking.png").stat().st_size > 10_000
    two = [("a", own["looking"]), ("b", own["looking"] | {"examples": own["looking"]["examples"][:1]})]
    camera_drawing.draw_looking(two, tmp_path / "two.png")
    camera_drawing.draw_looking([("none", own["looking"] | {"examples": []})], tmp_path / "none.png")
    assert (tmp_path / "two.png").stat().st_size > (tmp_path / "new" / "camera_looking.png").stat().st_size


def test_places_are_paired_like_corridors(device):
    cfg = NavConfig(scene=scene_params("shuttle"), robot_profile="reversing", slack_s=1.5, slowness=0.01)
    result = camera.analyse_camera(
        policies.open_policy("zero").make,
        cfg,
        episodes=2,
        seeds=[0],
        device=device,
        further=[],
        conditions=camera.places(cfg),
        report=lambda line: None,
    )
    assert result["benchmark"] == "rooms" and result["cells"] == [{"family": "shuttle"}]
    own, frozen = result["variants"]
    assert own["rows"][0]["family"] == "shuttle" and own["rows"][0]["episodes"] == 2
    assert frozen["kind"] == "frozen" and frozen["difference"]["mean"] == 0.0
    assert camera_report.table(result).splitlines()[3].split()[1] == "shuttle"
    with pytest.raises(ConfigError, match=r"^scene: benchmark=rooms needs"):
        camera.places(NavConfig())


def test_no_mean_pose_without_a_long_enough_episode():
    measured = camera.Measured(Variant("own camera", "own"), [], None, [])
    with pytest.raises(ValueError, match="mean pose"):
        camera.frozen_at_mean(measured)


@pytest.mark.parametrize(
    ("episodes", "seeds", "num_envs", "held", "key"),
    [
        (0, [0], None, [], "episodes"),
        (1, [], None, [], "seeds"),
        (1, [1, 1], None, [], "seeds"),
        (2, [0], 11, [], "num_envs"),
        (1, [0], None, [Variant("high", "fixed", (0.0, 0.9))], "camera_analysis: high: head_tilt 0.9"),
    ],
)
def test_impossible_settings_name_the_key(episodes, seeds, num_envs, held, key):
    with pytest.raises(ConfigError, match=f"^{key}"):
        camera.analyse_camera(None, NavConfig(), episodes, seeds, "cpu", further=held, num_envs=num_envs)


def test_cells_by_name():
    assert camera_variants.parse_cells(["2-hard", "1-easy"]) == (Cell(2, "hard"), Cell(1, "easy"))
    for names in (["3-hard"], ["hard"], [], ["1-easy", "1-easy"], [[1]]):
        with pytest.raises(ConfigError, match=r"^camera_analysis\.cells:"):
            camera_variants.parse_cells(names)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["analysis=smell"], "analysis: unknown 'smell'; choose from camera"),
        (["plot=a.png"], "plot: only an analysis"),
        (["analysis=camera", "plot=a.txt"], "plot: expected a .png"),
        (["analysis=camera", "camera_analysis.tilts=[-2]"], "head_tilt -2.0 is outside"),
        (["analysis=camera", "camera_analysis.blind=[1]"], "camera_analysis.blind: expected 2 values"),
        (["analysis=camera", "camera_analysis.cells=[1-icy]"], "camera_analysis.cells: unknown cell '1-icy'"),
        (
            ["camera.tilts=[-2]"],
            "camera.tilts: is called camera_analysis.tilts now",
        ),
        (["analysis=camera", "scene=room.yaml"], "scene: analysis=camera runs"),
        (["analysis=camera", "num_envs=4"], "num_envs: all 300 episodes"),
    ],
)
def test_bad_input_is_one_line(monkeypatch, capfd, tmp_path, arguments, expected):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["spin-eval", "policy=zero", *arguments])
    with pytest.raises(SystemExit) as stopped:
        evaluate.main()
    assert stopped.value.code == 2
    error = capfd.readouterr().err.strip()
    assert error.startswith("spin-eval: error: ") and expected in error
    assert "\n" not in error
