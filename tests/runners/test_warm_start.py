"""A warm start: where both see the same, the new model does what the source does."""

import functools

import pytest
import torch
from fake_env import FakeEnv, make_config
from tensordict import TensorDict

from spin_rl.models import ScandotModel, ScandotRecurrentModel
from spin_rl.runners import PPORunner, read_policy, save_policy
from spin_rl.runners.interface import Camera
from spin_rl.runners.model_copy import copy_model
from spin_rl.runners.warm_start import warm_start

ENVS, STEPS, ACTIONS = 5, 7, 4
DIMS = {"proprio": 6, "goal": 3, "extra": 2, "scandots": 96, "scandots_all": 96}
GAUSSIAN = {"class_name": "rsl_rl.modules:GaussianDistribution", "init_std": 0.5}
CAMERA = Camera(actions=(3,), columns={"proprio": (1, 4)})


def make_obs(seed=0, **dims):
    """Observations (STEPS, ENVS, dim) in which all scandots are visible."""
    generator = torch.Generator().manual_seed(seed)
    groups = {
        name: 2.0 + 3.0 * torch.randn(STEPS, ENVS, dim, generator=generator)
        for name, dim in (DIMS | dims).items()
    }
    tokens = groups["scandots"].view(STEPS, ENVS, 3, 32)
    tokens[..., 24:] = (tokens[..., 24:] > 2.0).float()
    groups["scandots_all"] = groups["scandots"].clone()
    return TensorDict(groups, batch_size=[STEPS, ENVS])


def make_model(kind, groups, seed, obs=None, **settings):
    """A model whose every parameter and statistic differs from a new one's."""
    torch.manual_seed(seed)
    if kind == "recurrent":
        settings = {"rnn_hidden_dim": 8} | settings
    model_class = {"feed_forward": ScandotModel, "recurrent": ScandotRecurrentModel}[kind]
    settings = {"hidden_dims": (12,), "encoder_hidden": (10,), "distribution_cfg": GAUSSIAN} | settings
    obs = make_obs() if obs is None else obs
    return model_class(obs[0], {"actor": groups}, "actor", ACTIONS, **settings)


def trained(model, obs):
    model.train()
    model.update_normalization(obs.flatten(0, 1))
    with torch.no_grad():
        model.distribution.std_param.copy_(torch.linspace(0.1, 0.4, ACTIONS))
    return model.eval()


def act(model, obs):
    """Deterministic actions over steps, with an episode's end inside, (STEPS, ENVS, ACTIONS)."""
    model.reset()
    outputs = []
    with torch.no_grad():
        for step in range(STEPS):
            outputs.append(model.eval()(obs[step]))
            model.reset(torch.arange(ENVS) == step)
    return torch.stack(outputs)


FLAT, ALL, SEEN = ["proprio", "goal"], ["scandots_all"], ["scandots"]


@pytest.mark.parametrize(
    ("source", "target"),
    [
        pytest.param(("recurrent", FLAT + SEEN, {}), ("recurrent", FLAT + SEEN, {}), id="same"),
        pytest.param(
            ("feed_forward", FLAT + SEEN, {}), ("feed_forward", FLAT + SEEN, {}), id="same feed-forward"
        ),
        pytest.param(
            ("recurrent", FLAT + SEEN, {"hidden_dims": ()}),
            ("recurrent", FLAT + SEEN, {"hidden_dims": ()}),
            id="same without hidden layers",
        ),
        pytest.param(("recurrent", FLAT + ALL, {}), ("recurrent", FLAT + SEEN, {}), id="all to visible"),
        pytest.param(
            ("recurrent", FLAT + ALL, {"encoder": "concat"}),
            ("recurrent", FLAT + SEEN, {"encoder": "concat"}),
            id="all to visible, concatenated",
        ),
        pytest.param(
            ("recurrent", FLAT + ALL, {"scandot_latent": 5, "skip": True}),
            ("recurrent", FLAT + SEEN, {"scandot_latent": 9, "skip": True}),
            id="a wider latent",
        ),
        pytest.param(
            ("recurrent", FLAT + SEEN, {"scandot_latent": 5, "encoder": "concat"}),
            ("recurrent", FLAT + SEEN, {"scandot_latent": 9, "encoder": "concat"}),
            id="a wider latent, concatenated",
        ),
        pytest.param(
            ("recurrent", FLAT + ALL, {"encoder_hidden": (6, 10)}),
            ("recurrent", FLAT + SEEN, {"encoder_hidden": (7, 15), "scandot_latent": 20}),
            id="a wider encoder",
        ),
        pytest.param(
            ("feed_forward", FLAT + ALL, {}),
            ("recurrent", FLAT + SEEN, {"skip": True}),
            id="feed-forward to recurrent",
        ),
        pytest.param(
            ("feed_forward", FLAT + ALL, {"hidden_dims": ()}),
            ("recurrent", FLAT + SEEN, {"skip": True, "hidden_dims": (), "rnn_hidden_dim": 5}),
            id="feed-forward to recurrent without hidden layers",
        ),
        pytest.param(
            ("recurrent", FLAT + ALL, {}),
            ("recurrent", FLAT + SEEN, {"skip": True}),
            id="to a skip connection",
        ),
        pytest.param(
            ("recurrent", FLAT + ALL, {"skip": True}),
            ("recurrent", [*FLAT, "extra", *SEEN], {"skip": True}),
            id="both with a skip connection, another group",
        ),
        pytest.param(
            ("recurrent", FLAT + ALL, {}),
            ("recurrent", ["extra", "goal", "proprio", *SEEN, *ALL], {}),
            id="more groups in another order",
        ),
    ],
)
def test_the_same_is_done_where_the_same_is_seen(source, target):
    obs = make_obs()
    model = trained(make_model(source[0], source[1], 1, **source[2]), obs)
    new = make_model(target[0], target[1], 2, **target[2])
    assert not torch.allclose(act(new, obs), act(model, obs), atol=1e-2)
    copy_model(new, model, Camera())
    torch.testing.assert_close(act(new, obs), act(model, obs), atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(new.distribution.std_param, model.distribution.std_param)
    # In training too: a rollout's distribution is that of its sequence.
    if new.is_recurrent:
        zeros = torch.zeros(1, ENVS, new.rnn_hidden_dim)
        resets = torch.zeros(STEPS, ENVS, dtype=torch.bool)
        resets[1 : ENVS + 1] = torch.eye(ENVS, dtype=torch.bool)
        with torch.no_grad():
            sequence = new(obs, hidden_state=(zeros, zeros), resets=resets)
        torch.testing.assert_close(sequence, act(model, obs), atol=1e-5, rtol=1e-5)


def test_what_a_wider_latent_has_more_is_learned_from_the_first_step_on():
    obs = make_obs()
    model = trained(make_model("feed_forward", FLAT + SEEN, 1, scandot_latent=5), obs)
    new = make_model("feed_forward", FLAT + SEEN, 2, scandot_latent=9)
    copy_model(new, model, Camera())
    new(obs).square().mean().backward()
    latent = new.blocks["scandots"]
    assert (new.mlp[0].weight.grad[:, latent.start + 5 : latent.stop].abs() > 0).any()


def test_new_columns_of_a_group_do_not_count_until_they_are_learned():
    obs, wide = make_obs(), make_obs(proprio=8)
    wide["proprio"][..., :6] = obs["proprio"]
    for group in ("goal", "scandots", "scandots_all"):
        wide[group] = obs[group]
    model = trained(make_model("recurrent", FLAT + ALL, 1), obs)
    new = make_model("recurrent", FLAT + SEEN, 2, obs=wide)
    copy_model(new, model, Camera())
    torch.testing.assert_close(act(new, wide), act(model, obs), atol=1e-5, rtol=1e-5)
    zeros = torch.zeros(1, ENVS, 8)
    resets = torch.zeros(STEPS, ENVS, dtype=torch.bool)
    new(wide, hidden_state=(zeros, zeros), resets=resets).square().mean().backward()
    assert (new.lstm.rnn.weight_ih_l0.grad[:, 6:8].abs() > 0).any()


IMAGES = {"image": [9, 6], "channels": [4], "kernels": [3], "strides": [2], "hidden": [7]}
DEPTH = [*FLAT, "depth"]


def make_depth_model(seed, groups, **encoder):
    obs = make_depth_obs()
    model = make_model("recurrent", groups, seed, obs, depth_encoder=IMAGES | encoder, skip=True)
    return trained(model, obs)


def make_depth_obs():
    generator = torch.Generator().manual_seed(0)
    obs = make_obs()
    obs["depth"] = torch.randint(0, 256, (STEPS, ENVS, 54), generator=generator, dtype=torch.uint8)
    return obs


@pytest.mark.parametrize(
    ("source", "target"),
    [
        pytest.param((DEPTH, False), (DEPTH, True), id="flat groups are new"),
        pytest.param((DEPTH, True), (DEPTH, True), id="the same"),
        pytest.param((DEPTH, True), (["extra", "goal", "depth", "proprio"], True), id="another order"),
    ],
)
def test_an_encoder_that_reads_flat_groups_starts_as_its_source(source, target):
    obs = make_depth_obs()
    model = make_depth_model(1, source[0], reads_flat=source[1])
    new = make_depth_model(2, target[0], reads_flat=target[1])
    assert not torch.allclose(act(new, obs), act(model, obs), atol=1e-2)
    copy_model(new, model, Camera())
    torch.testing.assert_close(act(new, obs), act(model, obs), atol=1e-5, rtol=1e-5)
    new.encode(obs).square().mean().backward()
    flat = new.encoders["depth"].mlp[0].weight.grad[:, -new.obs_dim :]
    assert (flat.abs().amax(0) > 0).all(), "all of them are learned from the first step on"


@pytest.mark.parametrize(
    "source",
    [
        {"reads_flat": True},
        {"reads_flat": False},
        {"hand_window": 7},
        {"hand_window": 7, "reads_flat": True, "shortcut": True},
    ],
)
def test_a_window_around_the_hand_starts_without_effect(source):
    obs = make_depth_obs()
    obs["hand_in_image"] = 0.3 * torch.randn(STEPS, ENVS, 3)
    groups = [*FLAT, "hand_in_image", "depth"] if "hand_window" in source else DEPTH
    make = functools.partial(make_model, "recurrent", obs=obs, skip=True)
    model = trained(make(groups=groups, seed=1, depth_encoder=IMAGES | source), obs)
    layers = IMAGES | {"reads_flat": True, "shortcut": True, "hand_window": 7}
    new = make(groups=["hand_in_image", *DEPTH], seed=2, depth_encoder=layers)
    copy_model(new, model, Camera())
    torch.testing.assert_close(act(new, obs), act(model, obs), atol=1e-5, rtol=1e-5)
    if groups == DEPTH:
        new.encode(obs).square().mean().backward()
        size = new.encoders["depth"].cfg.num_features
        assert (new.encoders["depth"].mlp[0].weight.grad[:, size : size + 32].abs().amax(0) > 0).any()
    with pytest.raises(ValueError, match=r"hand_window=7.*the new one's.*hand_window=0"):
        copy_model(make(groups=groups, seed=1, depth_encoder=IMAGES), new, Camera())


@pytest.mark.parametrize(
    "encoder",
    [{"reads_flat": False}, {"reads_flat": True, "hidden": [8]}, {"reads_flat": True, "strides": [1]}],
)
def test_an_encoder_that_cannot_act_as_its_source_is_named(encoder):
    model = make_depth_model(1, DEPTH, reads_flat=True)
    with pytest.raises(ValueError, match="its encoder of depth is") as error:
        copy_model(make_depth_model(2, DEPTH, **encoder), model, Camera())
    own, other = str(error.value).split("the new one's is")
    key = list(encoder)[-1]
    assert key in own and own.partition(key)[2][:12] != other.partition(key)[2][:12], "it shows what differs"
    assert "\n" not in str(error.value)


def make_object_obs():
    """Depth images, and what is told of an object, 4 columns."""
    obs = make_depth_obs()
    generator = torch.Generator().manual_seed(5)
    for name in ("object", "object_at_start"):
        obs[name] = 1.0 + 2.0 * torch.randn(STEPS, ENVS, 4, generator=generator)
    return obs


def test_scandots_are_not_told_of_an_object():
    obs = make_object_obs()
    model = make_model("recurrent", [*FLAT, "object"], 1, obs, skip=True)
    with pytest.raises(ValueError, match="it reads object, which has no counterpart"):
        copy_model(make_model("recurrent", FLAT + ALL, 2, obs, skip=True), model, Camera())


def test_an_image_of_an_object_begins_with_where_it_was_at_the_start():
    """A student acts as a teacher that is told so, and learns from images from the first step on."""
    obs = make_object_obs()
    generator = torch.Generator().manual_seed(6)
    teacher = trained(make_model("recurrent", [*FLAT, "object"], 1, obs, skip=True), obs)
    layers = IMAGES | {"reads_flat": True, "shortcut": True}
    groups = [*FLAT, "depth", "object_at_start"]
    settings = {"skip": True, "depth_encoder": layers, "scandot_latent": 4}
    student = trained(make_model("recurrent", groups, 2, obs, **settings), obs)
    copy_model(student, teacher, Camera())
    told = obs.clone()
    told["object"] = obs["object_at_start"]
    torch.testing.assert_close(act(student, obs), act(teacher, told), atol=1e-5, rtol=1e-5)
    assert not torch.allclose(act(student, obs), act(teacher, obs), atol=1e-2)
    student.encode(obs).square().mean().backward()
    assert (student.encoders["depth"].mlp[-1].weight.grad.abs() > 0).any()

    other = trained(make_model("recurrent", groups[::-1], 3, obs, **settings), obs)
    with torch.no_grad():
        for parameter in student.encoders.parameters():
            parameter.add_(0.1 * torch.randn(parameter.shape, generator=generator))
    copy_model(other, student, Camera())
    torch.testing.assert_close(act(other, obs), act(student, obs), atol=1e-5, rtol=1e-5)


def test_a_shortcut_starts_without_effect_where_the_source_has_none():
    obs = make_depth_obs()
    model = make_depth_model(1, DEPTH, reads_flat=True)
    new = make_depth_model(2, DEPTH, reads_flat=True, shortcut=True)
    copy_model(new, model, Camera())
    torch.testing.assert_close(act(new, obs), act(model, obs), atol=1e-5, rtol=1e-5)
    with pytest.raises(ValueError, match=r"shortcut=True.*the new one's.*shortcut=False"):
        copy_model(model, new, Camera())


def test_an_unlearned_camera_starts_still_and_without_effect():
    obs = make_obs()
    obs["proprio"][..., [1, 4]] = torch.tensor([0.3, -0.2])  # the pose at which it was frozen
    model = trained(make_model("recurrent", FLAT + ALL, 1), obs)
    new = make_model("recurrent", FLAT + SEEN, 2)
    copy_model(new, model, CAMERA, new_std=CAMERA.actions)
    moved = obs.clone()
    moved["proprio"][..., [1, 4]] = torch.randn(STEPS, ENVS, 2)
    for seen in (obs, moved):
        actions = act(new, seen)
        torch.testing.assert_close(actions[..., :3], act(model, obs)[..., :3], atol=1e-5, rtol=1e-5)
        assert (actions[..., 3] == 0.0).all()
    torch.testing.assert_close(new.distribution.std_param, torch.tensor([0.1, 0.2, 0.3, 0.5]))


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        (("recurrent", FLAT + SEEN, {}), ("feed_forward", FLAT + SEEN, {}), "LSTM has no counterpart"),
        (("feed_forward", FLAT + SEEN, {}), ("recurrent", FLAT + SEEN, {}), r"runner\.actor\.skip=true"),
        (
            ("recurrent", FLAT + SEEN, {}),
            ("recurrent", FLAT + SEEN, {"rnn_hidden_dim": 9}),
            "rnn_hidden_dim: 8, the new one's: 9",
        ),
        (
            ("recurrent", FLAT + SEEN, {"hidden_dims": (5,)}),
            ("recurrent", FLAT + SEEN, {}),
            r"layers of the MLP: \[5, 'ELU', 4\]",
        ),
        (
            ("recurrent", FLAT + SEEN, {}),
            ("recurrent", FLAT + SEEN, {"activation": "tanh"}),
            r"'ELU'.*'Tanh'",
        ),
        (
            ("recurrent", FLAT + SEEN, {}),
            ("recurrent", FLAT + SEEN, {"encoder_hidden": (3,)}),
            "its encoder of scandots is",
        ),
        (
            ("recurrent", FLAT + SEEN, {"scandot_latent": 9}),
            ("recurrent", FLAT + SEEN, {"scandot_latent": 5}),
            r"its encoder of scandots is .* 9\], the new one's is .* 5\]",
        ),
        (
            ("recurrent", FLAT + SEEN, {}),
            ("recurrent", FLAT + SEEN, {"obs_normalization": False}),
            "obs_normalization",
        ),
        (("recurrent", [*FLAT, "extra", *SEEN], {}), ("recurrent", FLAT + SEEN, {}), "it reads extra"),
        (("recurrent", FLAT + SEEN, {}), ("recurrent", FLAT, {}), "it reads scandots"),
        (("recurrent", FLAT + SEEN + ALL, {}), ("recurrent", FLAT + SEEN, {}), "it reads scandots_all"),
    ],
)
def test_what_cannot_be_mapped_is_named(source, target, message):
    model, new = (
        make_model(source[0], source[1], 1, **source[2]),
        make_model(target[0], target[1], 2, **target[2]),
    )
    before = {name: value.clone() for name, value in new.state_dict().items()}
    with pytest.raises(ValueError, match=message) as error:
        copy_model(new, model, Camera())
    assert "\n" not in str(error.value)
    assert all(torch.equal(value, before[name]) for name, value in new.state_dict().items())


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp("source")
    runner = PPORunner(FakeEnv(), make_config(), folder, snapshot={"task": {"camera_pose": None}})
    runner.train(2)
    return runner, folder


def test_a_run_starts_from_a_checkpoint_or_a_policy_file(source, tmp_path):
    runner, folder = source
    save_policy(tmp_path / "a.safetensors", folder)
    for path, has_critic in ((folder, True), (tmp_path / "a.safetensors", False)):
        new = PPORunner(FakeEnv(), make_config() | {"seed": 9})
        line = warm_start(new.alg, read_policy(path), Camera(actions=(1,)))
        assert line.startswith(
            f"Initialized from {path} (iteration 2); actor: proprio, goal, scandots, memory"
        )
        assert "critic: new, a policy file" in line or has_critic
        for name, value in new.alg.actor.state_dict().items():
            expected = runner.alg.actor.state_dict()[name].clone()
            if name == "distribution.std_param":
                expected[1] = 0.6  # the camera's is as configured
            assert torch.equal(value, expected), name
        weights = new.alg.critic.state_dict()
        same = [torch.equal(value, weights[name]) for name, value in runner.alg.critic.state_dict().items()]
        assert all(same) if has_critic else not all(same)
        new.train(1)


def test_a_critic_that_does_not_fit_or_judges_another_reward_stays_new(source):
    cfg = make_config() | {"seed": 9}
    cfg["critic"] = cfg["critic"] | {"hidden_dims": [17]}
    new = PPORunner(FakeEnv(), cfg)
    assert "critic: new, its layers of the MLP" in warm_start(new.alg, read_policy(source[1]), Camera())
    new = PPORunner(FakeEnv(), make_config() | {"seed": 9})
    before = {name: value.clone() for name, value in new.alg.critic.state_dict().items()}
    assert "critic: new, its reward" in warm_start(new.alg, read_policy(source[1]), Camera(), critic=False)
    assert all(torch.equal(value, before[name]) for name, value in new.alg.critic.state_dict().items())


def test_an_actor_that_does_not_fit_is_an_error(source):
    cfg = make_config()
    cfg["actor"] = cfg["actor"] | {"rnn_hidden_dim": 17}
    with pytest.raises(ValueError, match=r"^init: .* cannot start the actor: its rnn_hidden_dim"):
        warm_start(PPORunner(FakeEnv(), cfg).alg, read_policy(source[1]), Camera())


def test_the_error_names_what_a_shipped_policy_was_trained_with():
    with pytest.raises(ValueError, match=r"cannot start the actor: .*; it was trained with algo=rooms$"):
        warm_start(PPORunner(FakeEnv(), make_config()).alg, read_policy("nav-room"), Camera())
