import json
from dataclasses import asdict

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra

from spin_rl.benchmark import settings
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.fetch.spec import FETCH
from spin_rl.tasks.nav.spec import NAV
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.spec import PICK

TRAINED = {
    "robot": {"profile": "re1"},
    "task": {
        "camera_mount": "landscape",
        "episode_s": 20.0,
        "noise": {"goal_m": 0.5},
        "scandots": {"window_m": 3.0, "occlusion": False},
    },
}


@pytest.fixture
def cfg():
    return compose("eval")


def test_evaluation_is_nominal(cfg):
    task = NAV.configure(cfg)
    assert task.episode_s == 60.0
    assert not task.curriculum.enabled and task.curriculum.start == 1.0
    assert set(vars(task.noise).values()) == {0.0}
    assert task.dynamics.speed_scale == (1.0, 1.0)
    assert task.dynamics.base_lag_s == (0.15, 0.15) and task.dynamics.joint_lag_s == (0.1, 0.1)


def test_guard_and_planner_are_a_policys_own_whatever_it_sees(cfg):
    trained = {"task": {"guard": {"enabled": True, "margin_m": 0.03}, "planner": {"enabled": True}}}
    for seen in ({}, {"depth": {"enabled": True}}):
        task = settings.for_policy(cfg, {"task": trained["task"] | seen}, [])["task"]
        assert task["guard"]["enabled"] and task["guard"]["margin_m"] == 0.03 and task["planner"]["enabled"]
    alone = settings.for_policy(cfg, trained, ["task.planner.enabled=false"])["task"]
    assert alone["guard"]["enabled"] and not alone["planner"]["enabled"]


def test_a_camera_that_followed_a_gaze_while_it_learned_is_on_its_own(cfg):
    trained = {
        "task": {"teach_gaze": True, "gaze_poses": [[0.0, -0.1], [0.0, -1.4]], "camera_action": "target"}
    }
    task = NAV.configure(settings.for_policy(cfg, trained, []))
    assert not task.teach_gaze and task.gaze_poses == () and task.camera_action == "target"


def test_how_far_a_goal_is_shown_is_the_policys_own(cfg):
    trained = {"task": {"goal_range_m": 4.0}}
    assert NAV.configure(settings.for_policy(cfg, trained, [])).goal_range_m == 4.0
    asked = settings.for_policy(cfg, trained, ["task.goal_range_m=null"])
    assert NAV.configure(asked).goal_range_m is None


def test_picks_are_evaluated_nominally_and_far_from_the_object():
    task = PICK.configure(compose("eval", ["task=pick"]))
    assert task.end_on_success and task.near_share == (0.0, 0.0) and task.episode_s == 7.0
    assert not task.curriculum.enabled and task.curriculum.start == 1.0
    assert set(vars(task.noise).values()) == {0.0}
    assert task.dynamics == PickConfig().dynamics


def test_what_a_pick_policy_sees_is_its_own():
    cfg = compose("eval", ["task=pick"])
    trained = {"task": {"sight": {"far_m": 2.0}, "end_on_success": False, "camera_pose": [0.0, -0.2]}}
    task = PICK.configure(settings.for_policy(cfg, trained, ["task=pick"]))
    assert task.sight.far_m == 2.0 and task.camera_pose == (0.0, -0.2) and task.end_on_success


def test_a_detector_is_of_policies_that_are_told_where_the_object_is():
    cfg = compose("eval", ["task=pick"])
    seen = {"task": {"detector": "segmentation"}}
    for groups, asked, detector in (
        (["proprio", "object"], ["task=pick"], "segmentation"),
        (["proprio", "depth"], ["task=pick"], "none"),
        (["proprio", "object"], ["task=pick", "task.detector=none"], "none"),
    ):
        trained = seen | {"runner": {"obs_groups": {"actor": groups}}}
        assert PICK.configure(settings.for_policy(cfg, trained, asked)).detector == detector


def test_body_and_inputs_are_the_policys(cfg):
    task = NAV.configure(settings.for_policy(cfg, TRAINED, ()))
    assert task.robot_profile == "re1"
    assert task.camera_mount == "landscape"
    assert task.scandots.window_m == 3.0 and not task.scandots.occlusion
    # The rest is the benchmark's.
    assert task.scandots.near_m == 0.1
    assert task.episode_s == 60.0 and task.noise.goal_m == 0.0
    assert NAV.configure(cfg).robot_profile == "paper"  # the argument is left alone


PICK_TRAINED = {
    "robot": {"profile": "re1"},
    "task": {
        "camera_mount": "landscape",
        "hold_s": 0.5,
        "sight": {"far_m": 2.0},
        "manipulation": {"increments": {"forward_speed": 0.11}},
        "depth": {"enabled": False},
    },
    "depth": {"filter": {"blur": 0.0, "fill_px": 3}},
}


def with_images(trained, **changes):
    task = trained["task"] | {"depth": {"enabled": True}}
    return trained | {"task": task, "depth": {"filter": {"blur": 0.5, "fill_px": 3} | changes}}


def test_a_fetch_has_the_robot_of_both_policies_and_what_each_sees():
    joint = settings.of_fetch(TRAINED, PICK_TRAINED)
    task = FETCH.configure(settings.for_policy(compose("eval", ["task=fetch"]), joint, ["task=fetch"]))
    assert task.robot_profile == "re1" and task.camera_mount == "landscape" and task.depth is None
    assert task.scandots.window_m == 3.0 and not task.scandots.occlusion
    assert task.sight.far_m == 2.0 and task.manipulation.increments.forward_speed == 0.11
    far = settings.of_fetch(TRAINED | {"task": TRAINED["task"] | {"goal_range_m": 4.0}}, PICK_TRAINED)
    far = FETCH.configure(settings.for_policy(compose("eval", ["task=fetch"]), far, ["task=fetch"]))
    assert task.goal_range_m is None and far.goal_range_m == 4.0
    # The rest is the benchmark's.
    assert task.hold_s == 1.0 and set(vars(task.noise).values()) == {0.0} and task.episode_s == 300.0


def test_images_of_a_fetch_are_filtered_as_those_who_read_them_need():
    joint = settings.of_fetch(with_images(TRAINED), PICK_TRAINED)
    assert joint["task"]["depth"] == {"enabled": True} and joint["depth"]["filter"]["blur"] == 0.5
    assert "filter" not in settings.of_fetch(TRAINED, PICK_TRAINED).get("depth", {})
    assert settings.of_fetch({}, {}) == {"task": {"depth": {"enabled": False}}}
    assert settings.of_fetch({}, PICK_TRAINED)["robot"] == {"profile": "re1"}


def test_each_policy_of_a_fetch_reads_depths_in_its_own_range():
    def ranges(nav, pick):
        joint = settings.of_fetch(nav, pick)
        task = FETCH.configure(settings.for_policy(compose("eval", ["task=fetch"]), joint, ["task=fetch"]))
        return (task.depth.filter.near_m, task.depth.filter.far_m), task.pick_range_m

    near, far = {"near_m": 0.2, "far_m": 1.6}, {"near_m": 0.3, "far_m": 5.0}
    both = with_images(TRAINED, **far), with_images(PICK_TRAINED, **near)
    assert ranges(*both) == ((0.3, 5.0), (0.2, 1.6))
    assert ranges(both[0], with_images(PICK_TRAINED, **far)) == ((0.3, 5.0), None)
    assert ranges(both[0], PICK_TRAINED) == ((0.3, 5.0), None)
    assert ranges(TRAINED, both[1]) == ((0.2, 1.6), None)


@pytest.mark.parametrize(
    ("overrides", "far", "blur"),
    [
        (["depth=d435i"], 1.6, 0.5),
        (["depth=d435i", "depth.filter.far_m=3.0"], 3.0, 0.5),
        ([], 1.6, 0.1),
    ],
)
def test_another_camera_leaves_the_policy_its_range(overrides, far, blur):
    overrides = ["task=pick", *overrides]
    trained = {"task": {"depth": {"enabled": True}}, "depth": {"filter": {"far_m": 1.6, "blur": 0.1}}}
    task = PICK.configure(settings.for_policy(compose("eval", overrides), trained, overrides))
    assert (task.depth.filter.far_m, task.depth.filter.blur) == (far, blur)


@pytest.mark.parametrize(
    ("nav", "pick", "message"),
    [
        (
            TRAINED | {"robot": {"profile": "paper"}},
            PICK_TRAINED,
            "^pick: robot.profile is re1 there and paper in the policy that drives$",
        ),
        (
            TRAINED,
            PICK_TRAINED | {"task": {"camera_mount": "portrait"}},
            "^pick: task.camera_mount is portrait there and landscape in",
        ),
        (
            with_images(TRAINED),
            with_images(PICK_TRAINED, blur=0.7),
            "^pick: depth.filter.blur is 0.7 there and 0.5 in",
        ),
    ],
)
def test_one_robot_cannot_be_that_of_two_policies(nav, pick, message):
    with pytest.raises(ConfigError, match=message):
        settings.of_fetch(nav, pick)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("robot=paper", {"robot_profile": "paper"}),
        ("robot.profile=paper", {"robot_profile": "paper"}),
        ("task.camera_mount=portrait", {"camera_mount": "portrait"}),
        ("task=nav", {"camera_mount": "landscape", "robot_profile": "re1"}),
    ],
)
def test_the_user_has_the_last_word(override, expected):
    cfg = compose("eval", [override])
    task = NAV.configure(settings.for_policy(cfg, TRAINED, [override]))
    assert {key: getattr(task, key) for key in expected} == expected


def test_one_scandot_key_does_not_hide_the_others():
    override = "task.scandots.window_m=1.0"
    task = NAV.configure(settings.for_policy(compose("eval", [override]), TRAINED, [override]))
    assert task.scandots.window_m == 1.0 and not task.scandots.occlusion


def test_a_policy_without_configuration_changes_nothing(cfg):
    assert settings.for_policy(cfg, None, ()) == cfg


def test_composing_leaves_a_running_command_alone():
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        running = GlobalHydra.instance().hydra
        assert compose("eval")["task"]["episode_s"] == 60.0
        assert GlobalHydra.instance().hydra is running


@pytest.mark.parametrize(
    ("overridden", "expected"),
    [
        ((), None),
        (("episodes=3", "task.scenario=2", "scene_file=a.yaml"), None),
        (("scene=nav",), None),
        (("scene=moving",), "moving"),
        (("scene=moving", "scene.passage=0.6"), "moving, scene.passage=0.6"),
        (("scene.width=1.1", "+scene.length=6"), "nav, scene.width=1.1, +scene.length=6"),
    ],
)
def test_corridors_have_a_name_unless_they_are_the_benchmarks(overridden, expected):
    assert settings.scene_label(overridden) == expected


def test_an_evaluation_after_training_keeps_corridors_and_images():
    call = [
        "teacher=nav-cvo",
        "depth=d435i",
        "+scene.length=6",
        "seed=2",
        "depth.noise.patches=0",
        "sim=fast",
    ]
    assert settings.conditions(call) == ["depth=d435i", "+scene.length=6", "depth.noise.patches=0"]


@pytest.mark.parametrize("choice", ["ideal", "d435i"])
def test_noise_has_the_name_of_its_file(choice):
    task = NAV.configure(compose("eval", [f"depth={choice}", "task.depth.enabled=true"]))
    noise = asdict(task.depth.noise)
    assert settings.noise_label(noise) == choice
    assert settings.noise_label(json.loads(json.dumps(noise))) == choice
    assert settings.noise_label(noise | {"dropout": 0.3}) == f"{choice}, dropout=0.3"


def test_images_that_nobody_reads_are_told():
    overrides = ["episodes=3", "depth.noise.patches=0"]
    blind = NAV.configure(compose("eval", overrides))
    assert settings.unused_depth(blind, overrides) == (
        "depth: depth.noise.patches=0 changes nothing, since this policy reads no images"
    )
    assert settings.unused_depth(blind, ["episodes=3", "task.depth.enabled=false"]) is None
    reads = {"task": {"depth": {"enabled": True}}}
    seeing = NAV.configure(settings.for_policy(compose("eval", overrides), reads, overrides))
    assert settings.unused_depth(seeing, overrides) is None


@pytest.mark.parametrize("override", ["task.difficulty=hard", "+task.scenario=1"])
def test_a_choice_of_corridors_that_a_benchmark_does_not_make_is_told(override):
    assert settings.unused_cell(["episodes=3", "task.episode_s=9"]) is None
    message = settings.unused_cell(["episodes=3", override])
    assert message is not None and message.startswith(override.lstrip("+").partition("=")[0])


def test_policies_are_shown_as_they_are_measured(cfg):
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        assert hydra.compose("play").task == cfg["task"]


@pytest.mark.parametrize(
    ("camera", "key", "value"), [("blind", "scandots", 10.0), ("fixcam_I", "camera_pose", [0, 0])]
)
def test_a_camera_that_is_asked_for_goes_before_that_of_training(camera, key, value):
    trained = {"task": {"camera_pose": [0.0, -1.5], "scandots": {"near_m": 0.1}}}
    task = settings.for_policy(compose("eval", [f"camera={camera}"]), trained, [f"camera={camera}"])["task"]
    assert (task["scandots"]["near_m"] if key == "scandots" else task[key]) == value
    task = settings.for_policy(compose("eval", []), trained, [])["task"]
    assert task["camera_pose"] == [0.0, -1.5] and task["scandots"]["near_m"] == 0.1
