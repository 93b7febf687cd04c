"""Learning from a teacher that sees everything, on a toy with a camera."""

import math
from types import MappingProxyType

import pytest
import torch
from fake_env import FakeEnv, make_config
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from spin_rl.models import PerActionGaussian
from spin_rl.runners import PPORunner, load_policy, read_policy, save_policy
from spin_rl.runners.interface import Camera
from spin_rl.runners.ppo.dvo import Teacher, check_teacher
from spin_rl.runners.warm_start import warm_start

ROBOT = [0, 1]
CAMERA = 2


class CameraEnv(FakeEnv):
    """The points have a camera that shows the tokens on one side; its last action is in proprio."""

    num_actions = 3
    camera_actions = (CAMERA,)
    camera_columns = MappingProxyType({"proprio": (4,)})

    def __init__(self, *args, frozen=False, **settings):
        self.look = None
        self.frozen = frozen
        super().__init__(*args, **settings)

    def step(self, actions):
        self.look = actions[:, CAMERA].clamp(-1.0, 1.0) * (not self.frozen)
        return super().step(actions[:, ROBOT])

    def state_dict(self):
        return super().state_dict() | {"look": self.look}

    def load_state_dict(self, state):
        self.look = state["look"].clone()
        super().load_state_dict(state)

    def _observe(self):
        super()._observe()
        if self.look is None:
            self.look = torch.zeros(self.num_envs)
        self.observations["proprio"][:, 4] = self.look + 0.3
        side = self.tokens[..., :1].sign() == self.look.view(-1, 1, 1).sign()
        self.observations["scandots"].copy_((self.tokens * side).flatten(1))


def phase_1a():
    cfg = make_config()
    cfg["obs_groups"] = {name: ["proprio", "goal", "scandots_all"] for name in ("actor", "critic")}
    distribution = {
        "class_name": "spin_rl.models:PerActionGaussian",
        "init_std": [0.6, 0.6, 0.4],
        "num_used": 2,
    }
    cfg["actor"] = cfg["actor"] | {"distribution_cfg": distribution}
    return cfg


def phase_1b(teacher, **algorithm):
    cfg = make_config(**algorithm)
    cfg["algorithm"] |= {"class_name": "spin_rl.runners.ppo.dvo:ImitationPPO", "teacher": str(teacher)}
    cfg["obs_groups"]["critic"] = ["proprio", "goal", "scandots", "scandots_all"]
    return cfg


@pytest.fixture(scope="module")
def teacher(tmp_path_factory):
    """A run of phase 1a."""
    folder = tmp_path_factory.mktemp("teacher")
    snapshot = {"task": {"camera_pose": [0.0, 0.0]}}
    PPORunner(CameraEnv(frozen=True), phase_1a(), folder, snapshot=snapshot).train(20)
    return folder


def test_ignored_camera_actions_teach_nothing(teacher):
    """Their outputs keep their first weights, and their standard deviation."""
    untrained = PPORunner(CameraEnv(frozen=True), phase_1a()).alg.actor.state_dict()
    weights = load_policy(teacher).state_dict()
    for name in ("mlp.0.weight", "mlp.0.bias", "distribution.log_std_param"):
        assert torch.equal(weights[name][CAMERA], untrained[name][CAMERA])
        assert not torch.equal(weights[name][0], untrained[name][0])


def test_unused_actions_do_not_count():
    torch.manual_seed(0)
    three, two = PerActionGaussian(3, [0.5, 0.2, 0.9], num_used=2), PerActionGaussian(2, [0.5, 0.2])
    mean, actions = torch.randn(4, 3), torch.randn(4, 3)
    three.update(mean)
    two.update(mean[:, :2])
    torch.testing.assert_close(three.log_prob(actions), two.log_prob(actions[:, :2]))
    torch.testing.assert_close(three.entropy, two.entropy)
    old = (torch.randn(4, 3), torch.rand(4, 3) + 0.1)
    pair = tuple(parameter[:, :2] for parameter in old)
    torch.testing.assert_close(three.kl_divergence(old, three.params), two.kl_divergence(pair, two.params))
    with pytest.raises(ValueError, match="num_used must be 1 to 3"):
        PerActionGaussian(3, [0.5, 0.2, 0.9], num_used=4)


def test_teacher_acts_as_alone_and_is_blind_to_the_camera(teacher):
    """Through rollouts of the algorithm its actions are those of the loaded policy with its own memory."""
    env = CameraEnv()
    runner = PPORunner(env, phase_1b(teacher))
    model = load_policy(teacher)
    frozen_value = model.obs_normalizer.mean[4]
    assert frozen_value == pytest.approx(0.3)
    alg, obs = runner.alg, env.get_observations()
    ended = False
    with torch.no_grad():
        for _ in range(3):
            for step in range(8):
                seen = obs.clone()
                seen["proprio"][:, 4] = frozen_value
                expected = model(seen)[:, ROBOT].clamp(-1.0, 1.0)
                actions = alg.act(obs)
                torch.testing.assert_close(alg.storage.targets[step], expected)
                obs, rewards, dones, extras = env.step(actions)
                alg.process_env_step(obs, rewards, dones, extras)
                model.reset(dones)
                ended |= bool(dones.any())
            alg.storage.step = 0
    assert ended


def test_training_leaves_the_teacher_as_it_is(teacher):
    runner = PPORunner(CameraEnv(), phase_1b(teacher))
    expected = load_policy(teacher).state_dict()
    runner.train(3)
    weights = runner.alg.teacher.model.state_dict()
    assert all(torch.equal(value, weights[name]) for name, value in expected.items())
    optimized = {id(p) for group in runner.alg.optimizer.param_groups for p in group["params"]}
    assert not optimized & {id(p) for p in runner.alg.teacher.model.parameters()}


@pytest.mark.parametrize("bootstrap", [False, True])
def test_reward_is_the_distance_of_the_robot_actions(teacher, bootstrap):
    env = CameraEnv()
    settings = {"task_reward": 2.0, "imitation_reward": 0.5, "bootstrap_ends": bootstrap}
    alg = PPORunner(env, phase_1b(teacher, **settings)).alg
    obs, ends = env.get_observations(), 0
    with torch.no_grad():
        for step in range(8):
            actions = alg.act(obs)
            obs, rewards, dones, extras = env.step(actions)
            value = alg.storage.values[step].clone()
            alg.process_env_step(obs, rewards, dones, extras)
            target = alg.storage.targets[step]
            distance = ((actions[:, ROBOT].clamp(-1, 1) - target) ** 2).sum(-1).sqrt()
            cut = dones if bootstrap else extras["time_outs"]
            expected = 2.0 * rewards - 0.5 * distance + 0.95 * value * cut
            torch.testing.assert_close(alg.storage.rewards[step], expected)
            ends += int(dones.sum())
    assert ends > 0


def test_supervised_loss_knows_the_limits_of_the_actions(teacher):
    alg = PPORunner(CameraEnv(), phase_1b(teacher)).alg
    alg.actor.distribution.update(torch.tensor([[[2.0, 0.5, 9.0], [-3.0, 0.5, 9.0], [0.2, -0.5, 9.0]]]))
    batch = type("Batch", (), {"targets": torch.tensor([[[1.0, 0.5], [1.0, 0.2], [0.0, -1.0]]])})()
    weight, loss = alg._extra_losses(batch)["imitation"]
    # Error 0 beyond the limit that the teacher is at, 4 on its other side; the camera's action is free.
    assert loss.item() == pytest.approx((0.0 + 0.0 + 16.0 + 0.09 + 0.04 + 0.25) / 6)
    assert weight == 0.5


def test_student_learns_to_act_as_the_teacher(teacher, tmp_path):
    """From random weights: both with the supervised loss, and less far by reinforcement alone."""
    results = {}
    for name, settings in {
        "hybrid": {"imitation_loss": 1.0, "imitation_anneal": 1.0},
        "paper": {"task_reward": 0.0, "imitation_reward": 0.1, "imitation_loss": 0.0, "bootstrap_ends": True},
    }.items():
        cfg = phase_1b(teacher, learning_rate=3e-3, schedule="fixed", **settings)
        PPORunner(CameraEnv(num_envs=24), cfg, tmp_path / name).train(30)
        events = EventAccumulator(str(tmp_path / name)).Reload()

        def curve(tag, events=events):
            return [event.value for event in events.Scalars(tag)]

        results[name] = curve("Loss/imitation")
        rewards = curve("Reward/imitation")
        assert sum(rewards[-5:]) > 0.9 * sum(rewards[:5])
        assert all(math.isfinite(value) for value in curve("Reward/teacher_distance"))
    assert results["hybrid"][-1] < 0.3 * results["hybrid"][0]
    assert results["paper"][-1] < 0.7 * results["paper"][0]


@pytest.mark.parametrize("held_before", [True, False])
def test_a_camera_that_is_held_elsewhere_starts_without_effect(teacher, tmp_path, held_before):
    """A constant pose that was never trained with must not count against it."""
    env = CameraEnv()
    source = read_policy(teacher)
    pose = source.config["task"]["camera_pose"] if held_before else [3.0, -1.0]
    runner = PPORunner(env, phase_1b(teacher), tmp_path)
    warm_start(runner.alg, source, Camera.of(env), camera_pose=pose, critic=False)
    obs = env.get_observations().clone()
    told = []
    for value in (0.0, 7.0):
        for group, columns in env.camera_columns.items():
            obs[group][:, list(columns)] = value
        with torch.no_grad():
            told.append(runner.alg.actor(obs).clone())
        runner.alg.actor.reset()
    assert torch.equal(*told) != held_before


def test_camera_actions_that_said_something_else_start_at_zero(teacher, tmp_path):
    """A target of the head is no speed."""
    env = CameraEnv()
    runner = PPORunner(env, phase_1b(teacher), tmp_path)
    source = read_policy(teacher)
    source.config["task"] = {"camera_pose": None, "camera_action": "target"}
    acts = {}
    for action in ("target", "rate"):
        warm_start(runner.alg, source, Camera.of(env), critic=False, camera_action=action)
        runner.alg.actor.reset()
        with torch.no_grad():
            acts[action] = runner.alg.actor(env.get_observations())
    assert (acts["rate"][:, CAMERA] == 0.0).all() and (acts["target"][:, CAMERA] != 0.0).all()
    others = [index for index in range(env.num_actions) if index != CAMERA]
    torch.testing.assert_close(acts["rate"][:, others], acts["target"][:, others])


def test_warm_started_student_starts_as_the_teacher_and_is_a_policy(teacher, tmp_path):
    env = CameraEnv()
    runner = PPORunner(env, phase_1b(teacher), tmp_path)
    line = warm_start(runner.alg, read_policy(teacher), Camera.of(env), critic=False)
    assert (
        "proprio (4 of 5 columns)" in line and "scandots_all as scandots" in line and "new action 2" in line
    )
    obs = env.get_observations().clone()
    obs["scandots"] = obs["scandots_all"]
    with torch.no_grad():
        targets, own = runner.alg.teacher(obs), runner.alg.actor(obs)
    torch.testing.assert_close(own[:, ROBOT].clamp(-1.0, 1.0), targets)
    assert (own[:, CAMERA] == 0.0).all()
    runner.alg.actor.reset()
    runner.alg.teacher.model.reset()

    runner.train(2)
    save_policy(tmp_path / "student.safetensors", tmp_path)
    runner.alg.actor.eval().reset()
    with torch.no_grad():
        expected = runner.alg.actor(obs)
        for path in (tmp_path, tmp_path / "student.safetensors"):
            assert torch.equal(load_policy(path, obs)(obs), expected)


def test_resumed_run_equals_an_uninterrupted_one(teacher, tmp_path):
    cfg = phase_1b(teacher, imitation_anneal=0.8)
    whole = PPORunner(CameraEnv(), cfg)
    whole.train(6)
    cfg["save_interval"] = 3
    PPORunner(CameraEnv(), cfg, tmp_path).train(6)
    second = PPORunner(CameraEnv(seed=99), cfg | {"seed": 99})
    second.load(tmp_path / "checkpoints" / "iteration_0000003.pt")
    # A shorter time limit, or none, must not bring back what has faded: 2 of 6 iterations were over.
    assert second.alg.imitation_weight == pytest.approx(0.5 * (1 - 2 / 6 / 0.8))
    second.alg.set_progress(0.0)
    assert second.alg.imitation_weight == pytest.approx(0.5 * (1 - 2 / 6 / 0.8))
    second.train(6)
    assert second.alg.imitation_weight == 0.0
    weights = whole.alg.actor.state_dict()
    for name, value in second.alg.actor.state_dict().items():
        assert torch.equal(value, weights[name]), name


def test_checkpoint_of_another_algorithm_is_refused(teacher, tmp_path):
    cfg = phase_1b(teacher)
    PPORunner(CameraEnv(), cfg, tmp_path).train(1)
    cfg["algorithm"] = make_config()["algorithm"]
    with pytest.raises(ValueError, match=r"of another algorithm; .* init="):
        PPORunner(CameraEnv(), cfg).load(tmp_path)


def test_wrong_teachers_are_named(teacher, tmp_path):
    with pytest.raises(FileNotFoundError, match="no policy 'nobody'"):
        PPORunner(CameraEnv(), phase_1b("nobody"))
    cfg = phase_1b(teacher)
    cfg["algorithm"]["teacher"] = None
    with pytest.raises(ValueError, match="teacher: expected the name"):
        PPORunner(CameraEnv(), cfg)

    PPORunner(CameraEnv(), make_config(), tmp_path / "cvo", snapshot={"task": {}}).train(1)
    with pytest.raises(ValueError, match=r"reads proprio, goal, scandots; a teacher reads scandots_all"):
        PPORunner(CameraEnv(), phase_1b(tmp_path / "cvo"))

    with pytest.raises(ValueError, match="has 3 actions, the environment 2"):
        PPORunner(FakeEnv(), phase_1b(teacher))
    env = CameraEnv()
    env.observations["goal"] = torch.zeros(12, 4)
    with pytest.raises(ValueError, match=r"teacher: .* reads 'goal' of size 3; the environment's has size 4"):
        Teacher.load(teacher, env.get_observations(), 3, Camera.of(env), "cpu")

    cfg = phase_1a()
    cfg["actor"]["obs_normalization"] = False
    snapshot = {"task": {"camera_pose": [0.0, 0.0]}}
    PPORunner(CameraEnv(), cfg, tmp_path / "raw", snapshot=snapshot).train(1)
    with pytest.raises(ValueError, match="without obs_normalization"):
        check_teacher(read_policy(tmp_path / "raw"))


@pytest.mark.parametrize(
    ("key", "value"), [("imitation_anneal", 0.0), ("imitation_anneal", 1.5), ("imitation_loss", -1.0)]
)
def test_impossible_settings_are_named(teacher, key, value):
    with pytest.raises(ValueError, match=rf"algorithm\.{key}: expected"):
        PPORunner(CameraEnv(), phase_1b(teacher, **{key: value}))
    with pytest.raises(ValueError, match=r"algorithm\.imitation_los is not a setting"):
        PPORunner(CameraEnv(), phase_1b(teacher, imitation_los=1.0))
