"""Policies written to files act as the model that was trained."""

import pytest
import safetensors.torch
import torch
from fake_env import FakeEnv, make_config

from spin_rl import paths
from spin_rl.runners import PPORunner, load_policy, read_policy, save_policy
from spin_rl.runners.policy_file import write_policy


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    runner = PPORunner(FakeEnv(), make_config(), folder, snapshot={"task": {"name": "fake"}, "num_envs": 12})
    runner.train(2)
    return runner, folder


def act(model, steps=5):
    """Deterministic actions over steps with a reset."""
    env = FakeEnv(seed=5)
    model.reset()
    actions = []
    with torch.no_grad():
        for step in range(steps):
            actions.append(model(env.get_observations()))
            dones = env.step(actions[-1])[2]
            model.reset(dones | (step == 2))
    return torch.stack(actions)


@pytest.mark.parametrize("source", ["name", "file", "run", "checkpoint"])
def test_loaded_policy_acts_as_the_trained_one(run, tmp_path, monkeypatch, source):
    runner, folder = run
    monkeypatch.setattr(paths, "POLICY_DIR", tmp_path)
    metadata = save_policy(tmp_path / "nav-test.safetensors", folder, {"hardware": "two cores"})
    where = {
        "name": "nav-test",
        "file": tmp_path / "nav-test.safetensors",
        "run": folder,
        "checkpoint": folder / "checkpoints" / "last.pt",
    }[source]
    policy = load_policy(where, FakeEnv().get_observations())
    assert not policy.training
    expected = act(runner.alg.actor.eval())
    runner.alg.actor.train()
    assert torch.equal(act(policy), expected)
    assert metadata["facts"] == {"hardware": "two cores"}
    assert read_policy(where).config == {"task": {"name": "fake"}, "num_envs": 12}
    assert read_policy(where).metadata["env_steps"] == 2 * 8 * 12


def test_file_holds_the_actor_only(run, tmp_path):
    runner, folder = run
    save_policy(tmp_path / "a.safetensors", folder)
    weights = safetensors.torch.load_file(tmp_path / "a.safetensors")
    assert weights.keys() == runner.alg.actor.state_dict().keys()


def test_observations_that_do_not_fit_are_named(run):
    obs = FakeEnv().get_observations().clone()
    obs["proprio"] = torch.zeros(12, 6)
    with pytest.raises(ValueError, match=r"reads 'proprio' of size 5; the environment's has size 6"):
        load_policy(run[1], obs)
    del obs["goal"]
    obs["proprio"] = torch.zeros(12, 5)
    with pytest.raises(ValueError, match="'goal' of size 3"):
        load_policy(run[1], obs)


def test_unknown_names_list_the_shipped_ones(run, tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "POLICY_DIR", tmp_path)
    save_policy(tmp_path / "nav-test.safetensors", run[1])
    with pytest.raises(FileNotFoundError, match=r"no policy 'nav-tset'.*nav-test"):
        load_policy("nav-tset")


def test_bad_files_are_refused(run, tmp_path):
    path = tmp_path / "a.safetensors"
    path.write_bytes(b"no header here")
    with pytest.raises(ValueError, match="not a policy file"):
        load_policy(path)
    safetensors.torch.save_file({"x": torch.zeros(1)}, path)
    with pytest.raises(ValueError, match="not a policy file"):
        load_policy(path)
    with pytest.raises(ValueError, match=r"named <name>\.safetensors"):
        save_policy(tmp_path / "a.pt", run[1])


@pytest.mark.parametrize("section", ["actor", "distribution_cfg"])
def test_a_file_cannot_name_any_class(run, tmp_path, section):
    path = tmp_path / "a.safetensors"
    metadata = save_policy(path, run[1])
    attack = {"class_name": "subprocess:Popen", "args": ["true"]}
    metadata["actor"] = attack if section == "actor" else metadata["actor"] | {"distribution_cfg": attack}
    write_policy(path, safetensors.torch.load_file(path), metadata)
    with pytest.raises(ValueError, match="class_name must be a"):
        load_policy(path)


def test_a_pointnet_takes_any_number_of_scandots(run):
    obs = FakeEnv().get_observations()
    more = obs.clone()
    more["scandots"] = torch.cat([obs["scandots"], obs["scandots"]], -1)
    once, twice = (load_policy(run[1], o)(o) for o in (obs, more))
    assert torch.allclose(once, twice)  # repeated tokens change nothing
