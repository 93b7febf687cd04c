"""What a student is, and what it learns from."""

import copy

import pytest
import torch
from distill_worlds import DepthEnv, collect, make_algorithm, make_models, make_student_config
from fake_env import make_config

from spin_rl.models import ScandotModel
from spin_rl.runners import PPORunner, load_policy
from spin_rl.runners.distillation.runner import DistillRunner
from spin_rl.runners.distillation.student import student_config
from spin_rl.runners.interface import Camera
from spin_rl.runners.model_copy import copy_model


@pytest.fixture(scope="module")
def teacher(tmp_path_factory):
    """A run of phase 1 whose policy has learned a little."""
    folder = tmp_path_factory.mktemp("teacher")
    PPORunner(DepthEnv(), make_config(), folder).train(10)
    return folder


class PerfectEncoder(torch.nn.Module):
    """Has the latent that the teacher would have, whatever the image."""

    def __init__(self, teacher):
        super().__init__()
        self.teacher = teacher
        self.latent = None

    def forward(self, images, flat=None, hand=None):
        return self.latent


def split(model):
    """Weights of the encoder, and of the rest."""
    state = {name: value.clone() for name, value in model.state_dict().items()}
    encoder = {name for name in state if name.startswith("encoders.")}
    return {n: state[n] for n in encoder}, {n: state[n] for n in state.keys() - encoder}


def same(one, other):
    return all(torch.equal(value, other[name]) for name, value in one.items())


def test_student_starts_with_all_of_its_teacher_but_the_encoder(teacher):
    student = DistillRunner(DepthEnv(), make_student_config(teacher)).alg.student
    encoder, rest = split(student)
    expected = split(load_policy(teacher))[1]
    assert rest.keys() == expected.keys() and same(expected, rest)
    assert any(name.startswith("lstm.") for name in rest) and any("obs_normalizer" in n for n in rest)
    assert all(name.startswith("encoders.depth.") for name in encoder)


def test_with_the_teachers_latent_the_student_acts_as_its_teacher(teacher):
    """Through episodes, with memory: all that they differ in is the encoder."""
    env = DepthEnv()
    runner = DistillRunner(env, make_student_config(teacher))
    student, model = runner.alg.student, load_policy(teacher)
    student.encoders["depth"] = PerfectEncoder(model)
    obs, ended = env.get_observations(), False
    with torch.no_grad():
        for _ in range(30):
            student.encoders["depth"].latent = model.encode(obs)[..., -model.num_latents :]
            actions = student(obs)
            torch.testing.assert_close(actions, model(obs))
            obs, _, dones, _ = env.step(actions)
            student.reset(dones)
            model.reset(dones)
            ended |= bool(dones.any())
    assert ended


def test_rollouts_hold_what_the_teacher_would_do_where_the_student_goes():
    """DAgger: the student's states, the teacher's actions with its own memory, resets and the first state."""
    algorithm, env = make_algorithm(num_steps=25), DepthEnv(num_envs=4)
    student, teacher = copy.deepcopy(algorithm.student), copy.deepcopy(algorithm.teacher)
    ends = 0
    for _ in range(2):
        twin, states = copy.deepcopy(env), student.get_hidden_state()
        obs = twin.get_observations()
        ends += collect(algorithm, env)
        record = algorithm.sequences
        algorithm.recorder.begin(algorithm.sequences)
        expected = (torch.zeros(1, 4, 16),) * 2 if states is None else states
        assert all(torch.equal(own, other) for own, other in zip(record.state, expected, strict=True))
        dones = torch.zeros(4, dtype=torch.bool)
        for step in range(25):
            assert torch.equal(record.observations["depth"][step], obs["depth"])
            assert torch.equal(record.resets[step], dones & (step > 0))
            with torch.no_grad():
                torch.testing.assert_close(record.targets[step], teacher(obs).clamp(-1.0, 1.0))
                obs, _, dones, _ = twin.step(student(obs))
            student.reset(dones)
            teacher.reset(dones)
    assert ends > 0


def test_learning_from_a_sequence_is_as_acting_step_by_step():
    """With episode ends inside: the loss of the sequence is that of the actions which the student chose."""
    algorithm, env = make_algorithm(num_steps=25), DepthEnv(num_envs=4)
    for _ in range(2):  # the second rollout starts with a state
        chosen = []
        hook = algorithm.student.register_forward_hook(lambda *call, into=chosen: into.append(call[-1]))
        ends = collect(algorithm, env)
        hook.remove()
        algorithm.recorder.begin(algorithm.sequences)
    assert ends > 0
    errors = torch.stack(chosen) - algorithm.sequences.targets
    assert (algorithm.sequences.targets.abs() < 1.0).all()
    losses = algorithm.learn(algorithm.sequences)
    assert losses["actions"] == pytest.approx(errors.square().mean().item(), rel=1e-4)
    assert losses["robot"] == pytest.approx(errors[..., 0].square().mean().item(), rel=1e-4)
    assert losses["camera"] == pytest.approx(errors[..., 1].square().mean().item(), rel=1e-4)


def test_a_sequence_with_a_reset_is_two_episodes():
    """Losses and gradients do not flow over an episode's start."""
    whole, parts = make_algorithm(num_steps=6, num_envs=1), make_algorithm(num_steps=3, num_envs=2)
    collect(whole, DepthEnv(num_envs=1))
    sequences = whole.sequences
    sequences.resets.zero_()
    sequences.resets[3] = True
    for name, buffer in parts.sequences.observations.items():
        buffer.copy_(sequences.observations[name].view(2, 3, -1).transpose(0, 1))
    for name in ("targets", "latents"):
        getattr(parts.sequences, name).copy_(getattr(sequences, name).view(2, 3, -1).transpose(0, 1))
    losses = whole.learn(whole.sequences), parts.learn(parts.sequences)
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)
    for one, other in zip(whole.student.parameters(), parts.student.parameters(), strict=True):
        torch.testing.assert_close(one, other)
        assert one.grad is None or torch.allclose(one.grad, other.grad, atol=1e-6)


@pytest.mark.parametrize(("weight", "learned", "left"), [(0.0, "actions", "latent"), (10.0, "latent", None)])
def test_loss_falls_on_a_fixed_batch(weight, learned, left):
    algorithm = make_algorithm(num_steps=12, learning_rate=3e-3, latent_loss=weight, freeze_iterations=1000)
    collect(algorithm, DepthEnv(num_envs=4))
    history = [algorithm.learn(algorithm.sequences) for _ in range(40)]
    assert history[-1][learned] < 0.3 * history[0][learned]
    assert left is None or history[-1][left] > 0.3 * history[0][left]


def test_actor_is_frozen_for_some_iterations():
    algorithm, env = make_algorithm(freeze_iterations=2), DepthEnv(num_envs=4)
    teacher = split(algorithm.teacher)
    encoder, rest = split(algorithm.student)
    for _ in range(2):
        assert algorithm.actor_is_frozen
        collect(algorithm, env)
        algorithm.update()
        moved, still = split(algorithm.student)
        assert same(rest, still) and not same(encoder, moved)
        encoder = moved
    assert not algorithm.actor_is_frozen
    collect(algorithm, env)
    algorithm.update()
    moved, changed = split(algorithm.student)
    assert not same(encoder, moved)
    for name in ("lstm.rnn.weight_ih_l0", "lstm.rnn.weight_hh_l0", "mlp.0.weight", "mlp.0.bias"):
        assert not torch.equal(rest[name], changed[name])
    for name in rest:
        if "obs_normalizer" in name or "std" in name:
            assert torch.equal(rest[name], changed[name])
    assert all(same(one, other) for one, other in zip(teacher, split(algorithm.teacher), strict=True))


def test_bad_gradients_are_skipped_without_a_trace():
    algorithm = make_algorithm(num_mini_batches=2)
    collect(algorithm, DepthEnv(num_envs=4))
    algorithm.learn(algorithm.sequences)  # the optimizer has its moments
    weights = [parameter.clone() for parameter in algorithm.student.parameters()]
    algorithm.sequences.targets[:] = torch.nan
    for _ in range(2):
        losses = algorithm.learn(algorithm.sequences)
        assert losses == {"skipped_steps": 2.0, "actor_is_frozen": 0.0}
    for before, now in zip(weights, algorithm.student.parameters(), strict=True):
        assert torch.equal(before, now)
    with pytest.raises(FloatingPointError, match="not finite in 3 whole updates"):
        algorithm.learn(algorithm.sequences)


def test_being_further_out_than_a_target_at_the_limit_is_no_error():
    algorithm = make_algorithm(num_steps=1, num_envs=1)
    algorithm.student.decode = lambda x, **_: (
        torch.tensor([[[3.0, -0.5]]], requires_grad=True) + 0.0 * x.sum()
    )
    algorithm.sequences.targets[0, 0] = torch.tensor([1.0, -1.0])
    losses = algorithm.learn(algorithm.sequences)
    assert losses["robot"] == 0.0 and losses["camera"] == pytest.approx(0.25)


def test_teachers_that_cannot_be_distilled_are_named(teacher):
    cfg = make_student_config(teacher)
    cfg["actor"] = cfg["actor"] | {"rnn_hidden_dim": 8}
    with pytest.raises(ValueError, match=r"teacher: .* cannot be distilled: its rnn_hidden_dim: 16, the new"):
        DistillRunner(DepthEnv(), cfg)
    for groups in (
        ["proprio", "goal"],
        ["proprio", "depth"],
        ["proprio", "object_start"],
        ["proprio", "object", "scandots"],
        ["proprio", "object", "depth"],
    ):
        with pytest.raises(ValueError, match=f"teacher: it reads {', '.join(groups)}; a teacher reads one"):
            student_config({"obs_groups": groups, "actor": {}}, {})


@pytest.mark.parametrize(
    ("further", "message"),
    [
        (["goal", "goal"], "goal is read already"),
        (["proprio"], "proprio is read already"),
        (["object"], "object tells what a student has to see for itself"),
        (["scandots"], "scandots is read already"),
        (["scandots_all"], "scandots_all tells what"),
        (["privileged"], "privileged tells what"),
        (None, "expected a list of groups, got None"),
        ("goal", "expected a list of groups, got 'goal'"),
    ],
)
def test_further_groups_are_new_and_no_secrets(further, message):
    teacher = {"obs_groups": ["proprio", "scandots"], "actor": {}}
    with pytest.raises(ValueError, match=rf"^runner\.further_groups: {message}"):
        student_config(teacher, {}, further)
    assert student_config(teacher, {}, ["goal"])["obs_groups"]["actor"] == ["proprio", "depth", "goal"]
    with pytest.raises(ValueError, match=r"^runner\.depth_encoder\.hand_window: needs hand_in_image"):
        student_config(teacher, {"hand_window": 9}, ["goal"])


def test_a_feed_forward_teacher_has_a_feed_forward_student():
    student, _ = make_models()
    obs = DepthEnv(num_envs=4).get_observations()
    models = [
        ScandotModel(obs, {"actor": ["proprio", "goal", g]}, "actor", 2, (8,), depth_encoder=student_encoder)
        for g, student_encoder in (("scandots", None), ("depth", student.encoders["depth"].cfg.__dict__))
    ]
    copy_model(models[1], models[0], Camera())
    latent = torch.randn(4, 16)
    for model in models:
        (name,) = model.encoders
        model.encoders[name] = PerfectEncoder(None)
        model.encoders[name].latent = latent
    assert torch.equal(models[0](obs), models[1](obs))
