import json
import sys
from types import SimpleNamespace

import hydra
import numpy as np
import pytest
import torch
import warp as wp
from torch.utils.tensorboard import SummaryWriter

from spin_rl.cli import bench, common
from spin_rl.paths import CONF_DIR
from spin_rl.runners.ppo.runner import PPORunner
from spin_rl.speed import env as env_speed
from spin_rl.speed import scandots as visibility_speed
from spin_rl.speed import train as train_speed
from spin_rl.speed.peers import rsl_rl as rsl_rl_peer
from spin_rl.speed.peers.scandots import SightModel, scandot_tokens_numpy
from spin_rl.speed.timing import Stopwatch, Timing
from spin_rl.tasks.common.compose import plain
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.nav.spec import NAV

NUM_ENVS = 16
TINY = ["num_envs=8", "seconds=0.1", "runner.num_steps_per_env=4", "runner.algorithm.num_learning_epochs=1"]


@pytest.fixture(scope="module")
def driver(device):
    cfg = NavConfig(difficulty=2)
    return env_speed.RandomDriver(NavEnv(cfg, NUM_ENVS, device, seed=3), seed=3, warm_up_steps=0)


def test_random_driver_ends_episodes_at_different_times(driver):
    ended = []
    for _ in range(80):
        driver.step()
        ended.append(int((driver.env.outcome != 0).sum()))
    assert sum(ended) >= NUM_ENVS and max(ended) < NUM_ENVS / 2


def test_bare_physics_and_c_mujoco_do_the_same_step(driver):
    env = driver.env
    for _ in range(3):
        driver.step()
    bare = env_speed.BarePhysics(env)
    bare.copy_state()
    before = env.sim.views.qpos.clone()
    bare.step()
    assert torch.equal(env.sim.views.qpos, before)  # the environment's own state is not touched
    ours = bare._data.qpos.numpy()
    native = env_speed.NativeRollout(env, NUM_ENVS)
    for threads in (1, 2):
        theirs = native.runner(threads)()[:, 1 : 1 + ours.shape[1]]  # after the time
        moved = np.abs(theirs - before.cpu().numpy()).max(1)
        difference = np.abs(ours - theirs).max(1)
        assert (moved > 1e-3).mean() > 0.5
        # Contacts, which few worlds have here, differ more between the two solvers.
        assert np.median(difference) < 1e-4 and (difference < 1e-3).mean() > 0.7


def test_measure_env(driver, device):
    synchronize = wp.synchronize if device != "cpu" else lambda: None
    rows = env_speed.measure_env(driver, 0.2, Stopwatch(synchronize), native_worlds=4)
    assert [row.name for row in rows[:2]] == ["env step", "env step"]
    assert "mjw.step alone" in rows[0].baseline and "1 thread" in rows[1].baseline
    assert all(row.value > 0.0 and row.ratio > 0.0 and row.unit == "env steps/s" for row in rows)


def test_sweep_compares_with_the_smallest():
    made = []

    def make_env(count):
        made.append(count)
        return SimpleNamespace(num_envs=count, device="cpu", step=lambda actions: None)

    rows = env_speed.sweep(make_env, [32, 8], "cpu", 0.01, 0, Stopwatch())
    assert made == [8, 32]
    assert [row.name for row in rows] == ["env step, 8 worlds", "env step, 32 worlds"]
    assert rows[0].ratio is None and rows[1].baseline == "env step, 8 worlds" and rows[1].ratio > 0.0


def test_images_are_compared_with_scandots_of_the_same_run():
    clock = [0.0]

    def driver(seconds):
        def step():
            clock[0] += seconds

        return SimpleNamespace(env=SimpleNamespace(num_envs=8), step=step)

    row = env_speed.measure_images(driver(0.4), driver(0.1), 10.0, Stopwatch(clock=lambda: clock[0]))
    assert row.value == pytest.approx(20.0) and row.baseline_value == pytest.approx(80.0)
    assert row.ratio == pytest.approx(0.25) and "0.016x" in row.baseline


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_visibility_peers_compute_the_same_tokens(device, mount):
    cfg = NavConfig(camera_mount=mount)
    worlds = visibility_speed.obstacle_worlds(24, cfg, device, seed=2)
    sensor = worlds.sensor(occlusion=False)
    sensor.update()
    every, visible = scandot_tokens_numpy(worlds.host(24))
    # A corner on the edge of the window or of the image may fall to either side.
    for ours, theirs in ((sensor.all.numpy(), every), (sensor.visible.numpy(), visible)):
        same = np.isclose(ours, theirs, atol=1e-4).all(-1)
        assert same.mean() > 0.99 and theirs[..., 24:].mean() > 0.05

    hiding = worlds.sensor(occlusion=True)
    hiding.update()
    _, seen = scandot_tokens_numpy(worlds.host(24), [SightModel(worlds.layout, w) for w in range(24)])
    assert seen[..., 24:].sum() < 0.7 * visible[..., 24:].sum()
    assert (hiding.visible.numpy()[..., 24:] == seen[..., 24:]).mean() > 0.995


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_camera_frames(mount):
    pan, tilt = np.array([0.4, -2.0]), np.array([-0.7, 0.0])
    frames = visibility_speed.camera_frames(pan, tilt, mount)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-6)
    forward = np.stack([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)], -1)
    np.testing.assert_allclose(frames[:, :, 2], forward, atol=1e-6)
    down = frames[:, :, 0 if mount == "portrait" else 1]
    assert np.all(down[:, 2] < -0.7)


def train_config(*overrides):
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return plain(hydra.compose("bench", [*TINY, *overrides]))


def test_peer_learns_from_the_same_rollout(driver, device):
    cfg = train_config()["runner"]
    runner = PPORunner(driver.env, cfg, None, device)
    with torch.no_grad():
        obs = driver.env.get_observations()
        for _ in range(4):
            obs, rewards, dones, extras = driver.env.step(runner.alg.act(obs))
            dones[0] = 1
            runner.alg.process_env_step(obs, rewards, dones, extras)
        runner.alg.compute_returns(obs)
    peer = rsl_rl_peer.RslRlPeer(runner.alg, cfg["obs_groups"], cfg)
    theirs, ours = peer._ppo.storage, runner.alg.storage
    assert torch.equal(theirs.rewards.squeeze(-1), ours.rewards)
    assert torch.equal(theirs.dones.squeeze(-1).bool(), ours.dones)
    groups = [ours.observations[name] for name in cfg["obs_groups"]["actor"]]
    assert torch.equal(theirs.observations["actor"], torch.cat(groups, dim=-1))
    actor = peer._ppo.actor
    assert actor.is_recurrent and actor.rnn.rnn.hidden_size == 256 and not peer._ppo.critic.is_recurrent
    for _ in range(2):  # the rollout stays
        before = actor.rnn.rnn.weight_hh_l0.clone()
        peer.update()
        assert not torch.equal(actor.rnn.rnn.weight_hh_l0, before)


def test_processes_are_compared_with_one(monkeypatch):
    rates = [1.0, 2.0, 300.0, 500.0, 400.0]  # the first two iterations warm up
    commands = []

    def train(command, **kwargs):
        commands.append(command)
        (run_dir,) = (word.partition("=")[2] for word in command if word.startswith("run_dir="))
        with SummaryWriter(run_dir) as writer:
            for step, rate in enumerate(rates):
                writer.add_scalar("Perf/total_fps", rate, step)
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(train_speed.subprocess, "run", train)
    row = train_speed.measure_processes(2, ["num_envs=8"], "cpu", 3, Timing((1 / 250.0,)))
    assert row.value == pytest.approx(400.0) and row.spread == pytest.approx((300.0, 500.0))
    assert row.ratio == pytest.approx(1.6) and row.baseline_value == pytest.approx(250.0)
    assert {"--nproc-per-node=2", "num_envs=8", "max_iterations=5", "device=cpu"} <= set(commands[0])


def test_failed_training_is_an_error(monkeypatch):
    failed = SimpleNamespace(returncode=1, stderr="Traceback\nthe reason\n")
    monkeypatch.setattr(train_speed.subprocess, "run", lambda command, **kwargs: failed)
    with pytest.raises(RuntimeError, match="the reason"):
        train_speed.measure_processes(2, [], "cpu", 3, Timing((1.0,)))


def run_main(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["spin-bench", *arguments])
    bench.main()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["what=speed"], "what: unknown 'speed'; choose from visibility, depth, env, update, train, places"),
        (["seconds=0"], "seconds: expected a positive number"),
        (["seconds=long"], "seconds: expected a positive number"),
        (["num_envs=0"], "num_envs: expected a whole number from 1 on"),
        (["processes=0"], "processes: expected a whole number from 1 to 1024"),
        (["world_counts=64"], "world_counts: expected a list"),
        (["world_counts=[64,-1]"], "world_counts[1]: expected a whole number from 1 on"),
        (["seed=x"], "seed: expected a whole number"),
        (["device=tpu"], "device: unknown device 'tpu'"),
        (["out=."], "out: . is a folder"),
        (["task.episode_s=-1"], "task.episode_s must exceed"),
        (["waht=env"], "waht"),
        (["algo=dvo1b"], "algo: dvo1b learns from a teacher"),
        (["algo=dvo1b_paper", "teacher=nav-dvo", "what=env"], "algo: dvo1b_paper learns from a teacher"),
    ],
)
def test_bad_input_is_one_line_that_names_the_key(monkeypatch, capfd, tmp_path, arguments, expected):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(bench, "_warn_if_busy", lambda: None)
    with pytest.raises(SystemExit) as stopped:
        run_main(monkeypatch, *arguments)
    assert stopped.value.code == 2
    error = capfd.readouterr().err.strip()
    assert error.startswith("spin-bench: error: ") and expected in error
    assert "\n" not in error


def test_preset_follows_the_device(monkeypatch):
    monkeypatch.setattr(common, "num_gpus", lambda: 1)
    assert common.with_preset(["what=env"]) == ["what=env", "preset=gpu"]
    assert common.with_preset(["device=cpu"]) == ["device=cpu"]
    assert common.with_preset(["preset=paper"]) == ["preset=paper"]
    monkeypatch.setattr(common, "num_gpus", lambda: 0)
    assert common.with_preset(["what=env"]) == ["what=env"]


def test_bench_trains_with_the_settings_of_spin_train():
    with hydra.initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        ours, theirs = (hydra.compose(name) for name in ("bench", "train"))
    assert NAV.configure(ours) == NAV.configure(theirs)
    assert plain(ours)["runner"] == plain(theirs)["runner"] and ours.num_envs == theirs.num_envs


@pytest.mark.slow
def test_everything_end_to_end(monkeypatch, capfd, device, tmp_path):
    monkeypatch.setattr(visibility_speed, "MIN_WORLDS", 8)
    monkeypatch.setattr(visibility_speed, "SIGHT_WORLDS", 4)
    monkeypatch.setattr(train_speed, "MIN_BLOCKS", 1)
    out = tmp_path / "new" / "bench.json"
    run_main(monkeypatch, *TINY, "preset=cpu", f"device={device}", f"out={out}", "world_counts=[2,4]")
    lines = capfd.readouterr().out.strip().splitlines()
    assert lines[-1].startswith(f"Wrote {out}: ")
    result = json.loads(out.read_text())
    assert result["device"] == device and result["settings"]["num_envs"] == 8
    assert "preset=cpu" in result["settings"]["overrides"] and str(out) not in out.read_text()
    names = [row["name"] for row in result["rows"]]
    for name in ("scandots, 14 obstacles, frustum and window", "env step", "env step, 4 worlds",
                 "env step with depth images",
                 "update: LSTM of the actor", "update: 2 minibatches instead of 4",
                 "train: env step + inference", "train: full training, 1 process"):  # fmt: skip
        assert name in names
    for row in result["rows"]:
        assert row["value"] > 0.0 and row["spread"][0] <= row["value"] <= row["spread"][1]
        assert (row["ratio"] is None) == (row["baseline"] is None)
        assert any(row["name"] in line for line in lines)
    epochs = next(row for row in result["rows"] if row["name"] == "update: 5 epochs instead of 1")
    assert epochs["ratio"] < 1.0


def test_training_from_depth(monkeypatch, capfd, device, tmp_path):
    monkeypatch.setattr(train_speed, "MIN_BLOCKS", 1)
    actors = []
    peer_of = rsl_rl_peer.RslRlPeer.__init__

    def remember(self, ours, *arguments):
        actors.append(ours.actor)
        peer_of(self, ours, *arguments)

    monkeypatch.setattr(rsl_rl_peer.RslRlPeer, "__init__", remember)
    out = tmp_path / "bench.json"
    run_main(monkeypatch, *TINY, "preset=cpu", f"device={device}", f"out={out}",
             "what=train", "algo=direct_depth")  # fmt: skip
    assert list(actors[0].encoders) == ["depth"]
    assert all(row["value"] > 0.0 for row in json.loads(out.read_text())["rows"])


def test_places(monkeypatch, device, tmp_path):
    out = tmp_path / "bench.json"
    run_main(monkeypatch, *TINY, "preset=cpu", f"device={device}", f"out={out}", "what=places")
    rows = {row["name"]: row for row in json.loads(out.read_text())["rows"]}
    assert rows["training, mixture"]["baseline"] == "training, corridor"
    assert {f"{part}, office, 205 things" for part in ("physics", "nearby", "scandots", "depth")} < set(rows)
    assert not any(name.startswith("nearby, corridor") for name in rows)  # physics has all of its 16 slots
    assert all(row["value"] > 0.0 for row in rows.values())
