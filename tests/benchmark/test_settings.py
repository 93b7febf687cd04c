import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra

from spin_rl.benchmark import settings
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.build import env_config

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
    return settings.compose()


def test_evaluation_is_nominal(cfg):
    task = env_config(cfg)
    assert task.episode_s == 60.0
    assert not task.curriculum.enabled and task.curriculum.start == 1.0
    assert set(vars(task.noise).values()) == {0.0}
    assert task.dynamics.speed_scale == (1.0, 1.0)
    assert task.dynamics.base_lag_s == (0.15, 0.15) and task.dynamics.joint_lag_s == (0.1, 0.1)


def test_body_and_inputs_are_the_policys(cfg):
    task = env_config(settings.for_policy(cfg, TRAINED, ()))
    assert task.robot_profile == "re1"
    assert task.camera_mount == "landscape"
    assert task.scandots.window_m == 3.0 and not task.scandots.occlusion
    # The rest is the benchmark's.
    assert task.scandots.near_m == 0.1
    assert task.episode_s == 60.0 and task.noise.goal_m == 0.0
    assert env_config(cfg).robot_profile == "paper"  # the argument is left alone


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
    cfg = settings.compose([override])
    task = env_config(settings.for_policy(cfg, TRAINED, [override]))
    assert {key: getattr(task, key) for key in expected} == expected


def test_one_scandot_key_does_not_hide_the_others():
    override = "task.scandots.window_m=1.0"
    task = env_config(settings.for_policy(settings.compose([override]), TRAINED, [override]))
    assert task.scandots.window_m == 1.0 and not task.scandots.occlusion


def test_a_policy_without_configuration_changes_nothing(cfg):
    assert settings.for_policy(cfg, None, ()) == cfg


def test_composing_leaves_a_running_command_alone():
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        running = GlobalHydra.instance().hydra
        assert settings.compose().task.episode_s == 60.0
        assert GlobalHydra.instance().hydra is running


@pytest.mark.parametrize(
    ("choice", "overridden", "expected"),
    [
        ("nav", (), None),
        ("nav", ("episodes=3", "task.scenario=2", "scene_file=a.yaml"), None),
        ("moving", ("scene=moving",), "moving"),
        ("nav", ("scene.width=1.1", "+scene.length=6"), "nav, scene.width=1.1, +scene.length=6"),
    ],
)
def test_corridors_have_a_name_unless_they_are_the_benchmarks(choice, overridden, expected):
    assert settings.scene_label(choice, overridden) == expected
