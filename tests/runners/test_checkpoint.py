"""Checkpoints survive kills, full disks and damage, and refuse what does not fit."""

import random
import time
from pathlib import Path

import pytest
import torch
import training_jobs
from fake_env import FakeEnv, make_config

from spin_rl.runners import PPORunner, checkpoint
from spin_rl.runners.checkpoint import (
    find_checkpoint,
    load_checkpoint,
    load_module_state,
    resolve_checkpoint,
    save_checkpoint,
    save_numbered,
)

KILLS = 12


def wait_for(path: Path, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not path.exists():
        assert time.monotonic() < end, f"{path} did not appear"
        time.sleep(0.005)


def test_a_killed_run_always_leaves_its_progress(tmp_path, processes):
    """SIGKILL at random moments: what is left loads, last and numbered ones alike."""
    rng = random.Random(0)
    last = tmp_path / "checkpoints" / "last.pt"
    for _ in range(KILLS):
        last.unlink(missing_ok=True)
        process = processes.Process(target=training_jobs.train_with_a_save_each_iteration, args=(tmp_path,))
        process.start()
        wait_for(last)
        time.sleep(rng.uniform(0.0, 0.25))
        process.kill()
        process.join()
        state = load_checkpoint(resolve_checkpoint(tmp_path))
        newest = max(int(path.stem.removeprefix("iteration_")) for path in last.parent.glob("iteration_*.pt"))
        assert state["iteration"] >= 1
        assert load_checkpoint(last.parent / f"iteration_{newest:07d}.pt")["iteration"] == newest
    cfg = make_config()
    cfg["critic"] = cfg["critic"] | {"hidden_dims": [512, 512]}
    runner = PPORunner(FakeEnv(num_envs=4), cfg)
    runner.load(tmp_path)
    assert runner.train(state["iteration"] + 1)["iterations"] == state["iteration"] + 1


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "last.pt"
    save_checkpoint(path, {"iteration": 1})

    def fill_the_disk(content, file):
        file.write(b"half of")
        raise OSError("No space left on device")

    monkeypatch.setattr(checkpoint.torch, "save", fill_the_disk)
    with pytest.raises(OSError, match="No space"):
        save_checkpoint(path, {"iteration": 2})
    assert load_checkpoint(path)["iteration"] == 1


def test_numbered_ones_are_kept_newest_first(tmp_path):
    for iteration in (1, 2, 3, 10, 20):
        save_numbered(tmp_path, iteration, {"iteration": iteration})
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["iteration_0000003.pt", "iteration_0000010.pt", "iteration_0000020.pt", "last.pt"]
    assert load_checkpoint(tmp_path / "last.pt")["iteration"] == 20


def test_numbered_ones_need_no_hard_links(tmp_path, monkeypatch):
    def refuse(*args):
        raise PermissionError("no links here")

    monkeypatch.setattr(checkpoint.os, "link", refuse)
    save_numbered(tmp_path, 7, {"iteration": 7})
    assert load_checkpoint(tmp_path / "iteration_0000007.pt")["iteration"] == 7


@pytest.mark.parametrize("damage", ["truncated", "empty", "text", "missing"])
def test_damaged_last_falls_back_to_a_numbered_one(tmp_path, capsys, damage):
    folder = tmp_path / "checkpoints"
    for iteration in (4, 5):
        save_numbered(folder, iteration, {"iteration": iteration, "weights": torch.ones(1000)})
    last = folder / "last.pt"
    content = last.read_bytes()
    last.unlink()  # it shares its bytes with a numbered one
    if damage != "missing":
        last.write_bytes({"truncated": content[:2000], "empty": b"", "text": b"not a checkpoint"}[damage])
    path, state = find_checkpoint(tmp_path)
    assert (path.name, state["iteration"]) == ("iteration_0000005.pt", 5)
    assert ("last.pt" in capsys.readouterr().err) == (damage != "missing")


def test_nothing_to_load_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match="no checkpoint"):
        find_checkpoint(tmp_path)
    with pytest.raises(FileNotFoundError, match="no checkpoint"):
        find_checkpoint(tmp_path / "absent.pt")
    (tmp_path / "last.pt").write_bytes(b"")
    with pytest.raises(ValueError, match="None of the 1 checkpoints"):
        find_checkpoint(tmp_path)


def test_loading_runs_no_code(tmp_path):
    """A pickle that would call a function is refused."""

    class Attack:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "harm",))

    torch.save({"version": 1, "attack": Attack()}, tmp_path / "last.pt")
    with pytest.raises(ValueError, match="cannot be read"):
        load_checkpoint(tmp_path / "last.pt")
    assert not (tmp_path / "harm").exists()


def test_content_that_could_not_be_read_back_is_named(tmp_path):
    with pytest.raises(TypeError, match=r"env\.levels\[1\]: set"):
        save_checkpoint(tmp_path / "last.pt", {"env": {"levels": [1, {2}]}})


def test_other_versions_are_refused(tmp_path):
    torch.save({"version": 99}, tmp_path / "last.pt")
    with pytest.raises(ValueError, match="format version"):
        load_checkpoint(tmp_path / "last.pt")


def test_differences_of_architecture_are_named():
    model = torch.nn.Linear(3, 2)
    before = model.weight.clone()
    with pytest.raises(
        ValueError, match=r"bias is missing; extra is not in the model; weight is \(2, 4\)"
    ) as error:
        load_module_state(model, {"weight": torch.ones(2, 4), "extra": torch.ones(1)}, "actor", "last.pt")
    assert "\n" not in str(error.value)
    torch.testing.assert_close(model.weight, before)
