"""Distillation where an image takes the place of a flat group, the object (SPIN 2.2, the pick policy)."""

import pytest
import torch
from distill_worlds import DepthEnv, collect, make_algorithm, make_student_config
from fake_env import make_config
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from spin_rl.runners import PPORunner, load_policy, save_policy
from spin_rl.runners.distillation.runner import DistillRunner


def make_teacher(folder, groups):
    """A run whose policy reads the object, and in its MLP the observations too."""
    cfg = make_config()
    cfg["obs_groups"] = {"actor": groups, "critic": ["proprio", "goal", "object"]}
    cfg["actor"] |= {"skip": True, "hidden_dims": [12]}
    PPORunner(DepthEnv(), cfg, folder).train(6)
    return folder


@pytest.fixture(scope="module")
def teacher(tmp_path_factory):
    return make_teacher(tmp_path_factory.mktemp("teacher"), ["proprio", "goal", "object"])


class Normalized(torch.nn.Module):
    """Has the teacher's normalized object as its latent, whatever the image."""

    def __init__(self, teacher, first):
        super().__init__()
        normalizer = teacher.obs_normalizer
        columns = slice(first, first + 10)
        self.mean, self.std = normalizer._mean[:, columns], normalizer._std[:, columns] + normalizer.eps
        self.object = None

    def forward(self, images, flat=None, hand=None):
        return (self.object - self.mean) / self.std


@pytest.mark.parametrize(
    ("groups", "first", "tolerance"),
    # Where the object is not the last group, sums over columns have another order.
    [(["proprio", "goal", "object"], 8, 0.0), (["proprio", "object", "goal"], 5, 1e-6)],
)
def test_with_the_normalized_object_the_student_acts_as_its_teacher(tmp_path, groups, first, tolerance):
    """Through episodes, with memory: all that they differ in is where the object comes from."""
    folder = make_teacher(tmp_path, groups)
    env = DepthEnv()
    student, model = DistillRunner(env, make_student_config(folder)).alg.student, load_policy(folder)
    assert student.obs_groups == ["proprio", "goal"] and student.encoders["depth"].latent == 10
    student.encoders["depth"] = source = Normalized(model, first)
    obs, ended, actions = env.get_observations(), False, []
    with torch.no_grad():
        for _ in range(30):
            source.object = obs["object"].clone()
            actions.append(student(obs))
            torch.testing.assert_close(actions[-1], model(obs), rtol=0.0, atol=tolerance)
            obs, _, dones, _ = env.step(actions[-1])
            student.reset(dones)
            model.reset(dones)
            ended |= bool(dones.any())
        # They do read it.
        source.object = obs["object"] + 1.0
        assert not torch.allclose(student(obs), model(obs), atol=1e-3)
    assert ended


def test_the_latent_to_learn_is_the_normalized_object():
    algorithm, env = make_algorithm(seen="object"), DepthEnv(num_envs=4)
    normalizer = algorithm.teacher.obs_normalizer
    normalizer._mean[:, 8:], normalizer._std[:, 8:] = 1.5, 2.0
    source, objects = Normalized(algorithm.teacher, 8), []
    hook = algorithm.teacher.obs_normalizer.register_forward_hook(
        lambda *_: objects.append(env.get_observations()["object"].clone())
    )
    collect(algorithm, env)
    hook.remove()
    source.object = torch.stack(objects)
    assert algorithm.sequences.latents.shape == (6, 4, 10)
    torch.testing.assert_close(algorithm.sequences.latents, source(None))


@pytest.mark.parametrize(("latent_loss", "learned"), [(0.0, "actions"), (10.0, "latent")])
def test_loss_falls_on_a_fixed_batch(latent_loss, learned):
    """Through the frozen policy into the encoder, or straight into it."""
    settings = {"learning_rate": 1e-2, "latent_loss": latent_loss, "freeze_iterations": 1000}
    algorithm = make_algorithm(num_steps=12, seen="object", **settings)
    normalizer = algorithm.teacher.obs_normalizer
    normalizer._mean[:, 8:], normalizer._std[:, 8:] = 1.0, 3.0
    collect(algorithm, DepthEnv(num_envs=4))
    history = [algorithm.learn(algorithm.sequences) for _ in range(40)]
    assert history[-1][learned] < 0.3 * history[0][learned]
    encoders = {id(parameter) for parameter in algorithm.student.encoders.parameters()}
    for parameter in algorithm.student.parameters():
        has_gradient = parameter.grad is not None and bool(parameter.grad.abs().max() > 0.0)
        assert has_gradient == (id(parameter) in encoders)


def test_a_run_lowers_the_loss_and_leaves_a_policy(tmp_path, teacher):
    """Over the end of the frozen phase."""
    cfg = make_student_config(teacher, freeze_iterations=20, latent_loss=0.1, learning_rate=3e-3)
    runner = DistillRunner(DepthEnv(), cfg, tmp_path)
    before = {name: value.clone() for name, value in runner.alg.student.state_dict().items()}
    runner.train(60)
    events = EventAccumulator(str(tmp_path)).Reload()
    for tag in ("Loss/actions", "Loss/latent"):
        losses = [event.value for event in events.Scalars(tag)]
        assert sum(losses[-15:]) < 0.6 * sum(losses[:15]), tag
    moved = {name for name, value in runner.alg.student.state_dict().items() if (value != before[name]).any()}
    assert {"encoders.depth.convolutions.0.weight", "lstm.rnn.weight_ih_l0", "mlp.0.weight"} <= moved
    save_policy(tmp_path / "student.safetensors", tmp_path)
    policy = load_policy(tmp_path / "student.safetensors", DepthEnv().get_observations())
    assert list(policy.blocks) == ["proprio", "goal", "depth"]
    assert policy(DepthEnv().get_observations()).shape == (12, 2)
