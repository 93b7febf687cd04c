"""Configurations: what is wrong with one is said in one line that names the key."""

from dataclasses import dataclass, field
from functools import cache

import pytest
import yaml
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from spin_rl.config import ConfigError, from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.sim.config import SimConfig
from spin_rl.tasks.common.compose import plain
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.spec import NAV


@cache
def composed(*overrides, name="train"):
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose(name, list(overrides))


def changed(override):
    """The training configuration with one value changed, or added with a +; quicker than composing it."""
    key, _, value = override.partition("=")
    cfg = composed().copy()
    OmegaConf.update(cfg, key.removeprefix("+"), yaml.safe_load(value), force_add=key.startswith("+"))
    return cfg


# --- from_mapping -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Inner:
    size: float = 1.0

    def __post_init__(self):
        if self.size < 0:
            raise ValueError("outer.inner.size must not be negative")


@dataclass(frozen=True)
class Outer:
    name: str = "a"
    count: int = 1
    flag: bool = False
    limit: float | None = None
    pair: tuple[float, float] = (0.0, 1.0)
    many: tuple[int, ...] = ()
    scales: dict[str, float] = field(default_factory=dict)
    inner: Inner = field(default_factory=Inner)


def test_values_arrive_with_their_types():
    values = {"name": "b", "count": 3, "flag": True, "limit": 2, "pair": [1, 2.5], "many": [1, 2, 3]}
    values |= {"scales": {"x": 1}, "inner": {"size": 4}}
    made = from_mapping(Outer, values)
    assert made == Outer("b", 3, True, 2.0, (1.0, 2.5), (1, 2, 3), {"x": 1.0}, Inner(4.0))
    assert isinstance(made.limit, float) and isinstance(made.inner.size, float)
    assert from_mapping(Outer, {}) == Outer()
    assert from_mapping(Outer, {"limit": None, "inner": Inner(2.0)}) == Outer(inner=Inner(2.0))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"nmae": "b"}, "outer.nmae: unknown key; choose from name, count, flag"),
        ({"inner": {"sise": 1.0}}, "outer.inner.sise: unknown key; choose from size"),
        ({"name": 3}, "outer.name: expected a name, got 3"),
        ({"count": 1.0}, "outer.count: expected a whole number, got 1.0"),
        ({"count": True}, "outer.count: expected a whole number, got True"),
        ({"count": None}, "outer.count: expected a whole number, got None"),
        ({"flag": "yes"}, "outer.flag: expected true or false, got 'yes'"),
        ({"flag": 1}, "outer.flag: expected true or false, got 1"),
        ({"limit": "x"}, "outer.limit: expected a number or null, got 'x'"),
        ({"limit": False}, "outer.limit: expected a number or null, got False"),
        ({"pair": [1.0]}, "outer.pair: expected 2 values, got 1"),
        ({"pair": 1.0}, "outer.pair: expected a list, got 1.0"),
        ({"pair": [0.0, "x"]}, "outer.pair[1]: expected a number, got 'x'"),
        ({"many": [1, 2.5]}, "outer.many[1]: expected a whole number, got 2.5"),
        ({"scales": [1.0]}, "outer.scales: expected a mapping, got [1.0]"),
        ({"scales": {"x": "y"}}, "outer.scales.x: expected a number, got 'y'"),
        ({"inner": 3}, "outer.inner: expected a mapping, got 3"),
        ({"inner": {"size": -1.0}}, "outer.inner.size must not be negative"),
    ],
)
def test_what_does_not_fit_is_named(values, message):
    with pytest.raises(ConfigError) as raised:
        from_mapping(Outer, values, "outer")
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


# --- the task's groups ------------------------------------------------------------------------------


def test_default_configurations_are_usable():
    train = NAV.configure(composed())
    assert train.robot_profile == "paper" and train.curriculum.enabled and train.reward["success"] > 0
    assert train.sim == SimConfig(timestep=0.05, substeps=2, nearby=24)  # the cpu preset's
    assert (
        NAV.configure(composed("sim=default")).sim == NAV.configure(composed("preset=gpu")).sim == SimConfig()
    )
    assert not NAV.configure(composed(name="eval")).curriculum.enabled
    assert NAV.configure(composed("robot=re1")).robot_profile == "re1"


def test_files_and_code_have_the_same_defaults():
    conf, code = NAV.configure(composed("sim=default")), NavConfig()
    for name in ("scene", "scandots", "curriculum", "dynamics", "sim", "episode_s", "goal_tolerance_m"):
        assert getattr(conf, name) == getattr(code, name), name


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("+task.episode=3", "task.episode: unknown key"),
        ("+task.noise.lift=1.0", "task.noise.lift: unknown key"),
        ("+task.sim=3", "task.sim: unknown key"),
        ("+scene.widht=1.0", "scene.widht: unknown key"),
        ("+sim.solver=newton", "sim.solver: unknown key"),
        ("+robot.speed=2.0", "robot.speed: unknown key"),
        ("+reward.sucess=1.0", "reward.sucess: unknown term"),
        ("task.name=pick", "task: 'pick' is not a task"),
        ("task.episode_s=long", "task.episode_s: expected a number, got 'long'"),
        ("task.episode_s=null", "task.episode_s: expected a number, got None"),
        ("task.dynamics.base_lag_s=0.1", "task.dynamics.base_lag_s: expected a list"),
        ("scene.width=wide", "scene.width: expected a number, got 'wide'"),
        ("sim.substeps=2.5", "sim.substeps: expected a whole number, got 2.5"),
        ("reward.success=much", "reward.success: the scale must be a finite number, got 'much'"),
        ("robot.profile=3", "robot.profile: expected a name, got 3"),
        ("robot.profile=jet", "robot: unknown profile 'jet'"),
        ("task.episode_s=-1", "task.episode_s must exceed one control step"),
        ("task.episode_s=.nan", "task.episode_s: expected a number of at most 1e+06 either way, got nan"),
        ("task.episode_s=.inf", "task.episode_s: expected a number of at most 1e+06 either way, got inf"),
        ("task.goal_tolerance_m=0", "task.goal_tolerance_m must be positive"),
        ("task.camera_mount=sideways", "task.camera_mount: unknown 'sideways'"),
        ("task.scenario=3", "task.scenario must be 0, 1 or 2"),
        ("task.difficulty=-2", "task.difficulty must be -1, 0, 1 or 2"),
        ("task.scandots.window_m=0", "task.scandots.window_m must be positive"),
        ("task.scandots.near_m=-0.1", "task.scandots.near_m must be positive"),
        ("task.curriculum.start=1.5", "task.curriculum.start must be in [0, 1]"),
        ("task.curriculum.up=-0.1", "task.curriculum.up must be in [0, 1]"),
        ("task.dynamics.speed_scale=[1.0,0.5]", "task.dynamics.speed_scale must be 0 < low <= high"),
        ("task.dynamics.joint_lag_s=[0.0,0.5]", "task.dynamics.joint_lag_s must be 0 < low <= high"),
        ("task.noise.goal_m=-1.0", "task.noise.goal_m must not be negative"),
        ("scene.width=0.5", "scene.width must leave passage"),
        ("sim.timestep=0.0", "sim.timestep must be in (0, 0.05] s"),
        ("sim.iterations=0", "sim.iterations must be at least 1"),
        ("sim.overflow=ignore", "sim.overflow must be count or raise, got 'ignore'"),
        ("reward.success=.inf", "reward.success: the scale must be a finite number"),
    ],
)
def test_bad_value_of_a_group_is_named(override, message):
    with pytest.raises(ConfigError) as raised:
        NAV.configure(changed(override))
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


def test_missing_value_is_named():
    cfg = changed("+sim.threads=???")
    with pytest.raises(ConfigError, match=r"sim\.threads: a value is needed"):
        plain(cfg)
