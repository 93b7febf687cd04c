import sys
from types import SimpleNamespace

import pytest
import torch
from tensordict import TensorDict

from spin_rl.analysis.camera import analysis
from spin_rl.analysis.camera.sampled import SampledCamera
from spin_rl.analysis.camera.variants import sampled_variant
from spin_rl.benchmark import policies
from spin_rl.cli import evaluate
from spin_rl.config import ConfigError
from spin_rl.policy import find_policy
from spin_rl.runners.policy_file import read_policy
from spin_rl.tasks.nav.config import NavConfig

CAMERA = (8, 9)
WORLDS = 4000


@pytest.fixture(scope="module")
def trained():
    source = read_policy(find_policy("nav-cvo"))
    dims = source.metadata["obs_dims"]
    obs = TensorDict(
        {group: torch.zeros(WORLDS, dims[group]) for group in source.metadata["obs_groups"]}, [WORLDS]
    )
    return source.build, obs


def test_the_camera_alone_is_drawn_with_the_deviation_of_training(trained):
    build, obs = trained
    policy = build()
    plain = policy(obs)
    policy.reset()
    sampled = SampledCamera(policy, CAMERA)
    drawn = sampled(obs)
    others = [i for i in range(plain.shape[1]) if i not in CAMERA]
    torch.testing.assert_close(drawn[:, others], plain[:, others])
    difference = (drawn - plain)[:, CAMERA]
    std = policy.distribution.log_std_param.exp()[list(CAMERA)]
    # Of 4000 draws: within five standard errors.
    assert torch.all((difference.std(0) / std - 1.0).abs() < 5 / (2 * WORLDS) ** 0.5)
    assert torch.all((difference.mean(0) / std).abs() < 5 / WORLDS**0.5)
    assert abs(torch.corrcoef(difference.T)[0, 1]) < 5 / WORLDS**0.5


def test_what_is_drawn_follows_from_the_seed_and_differs_from_step_to_step(trained):
    build, obs = trained

    def two_steps(seed):
        policy = SampledCamera(build(), CAMERA, seed)
        first = policy(obs)
        policy.reset()
        return first, policy(obs)

    (first, second), (again, _), (other, _) = two_steps(0), two_steps(0), two_steps(1)
    torch.testing.assert_close(first, again)
    assert not torch.allclose(first[:, CAMERA], second[:, CAMERA])
    assert not torch.allclose(first[:, CAMERA], other[:, CAMERA])


def test_the_memory_of_those_that_are_done_is_cleared_and_of_no_others():
    cleared = []
    policy = SimpleNamespace(distribution=object(), reset=cleared.append)
    done = torch.tensor([True, False])
    SampledCamera(policy, CAMERA).reset(done)
    assert cleared[0] is done


def test_a_camera_that_is_held_is_not_drawn():
    held = NavConfig(camera_pose=(0.0, -0.6))
    with pytest.raises(ConfigError, match=r"^camera_analysis\.sampled: task\.camera_pose holds the camera"):
        analysis.analyse_camera(None, held, 1, [0], "cpu", further=[sampled_variant()])


def test_the_command_line_asks_for_it(monkeypatch, capfd, tmp_path):
    monkeypatch.chdir(tmp_path)
    given = [
        "policy=nav-cvo",
        "analysis=camera",
        "camera_analysis.sampled=true",
        "task.camera_pose=[0.0,-0.6]",
    ]
    monkeypatch.setattr(sys, "argv", ["spin-eval", *given])
    with pytest.raises(SystemExit):
        evaluate.main()
    assert "camera_analysis.sampled: task.camera_pose holds" in capfd.readouterr().err


@pytest.mark.parametrize("policy", [SimpleNamespace(), SimpleNamespace(distribution=None)])
def test_what_has_no_distribution_cannot_be_drawn(policy):
    with pytest.raises(ConfigError, match=r"^camera_analysis\.sampled: this policy draws no actions"):
        SampledCamera(policy, CAMERA)


def test_it_is_a_variant_of_the_camera_analysis(device):
    def run(name):
        return analysis.analyse_camera(
            policies.open_policy(name).make,
            NavConfig(episode_s=1.6),
            episodes=1,
            seeds=[0],
            device=device,
            further=[sampled_variant()],
            policy_name=name,
            report=lines.append,
        )

    lines = []
    own, _, sampled = run("nav-cvo")["variants"]
    assert (sampled["kind"], sampled["camera_pose"]) == ("sampled", None)
    assert "looking" in own and "looking" not in sampled
    assert sampled["camera"]["tilt"]["rate"] > 2.0 * own["camera"]["tilt"]["rate"]
    lines.clear()
    with pytest.raises(ConfigError, match=r"^camera_analysis\.sampled"):
        run("zero")
    assert len(lines) == 1  # before any episode is driven
