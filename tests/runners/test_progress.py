"""Statistics of episodes, joined over processes, rollouts and iterations."""

import math
import sys
from types import SimpleNamespace

import pytest
from rsl_rl.utils import wandb_log_writer

from spin_rl.runners.progress import RecentEpisodes, ScalarWriter, join_statistics

ONE = {"episodes": 1.0, "success_rate": 1.0, "overflow/contacts": 2.0}
OTHER = {"episodes": 3.0, "success_rate": 0.0, "overflow/contacts": 1.0}
EMPTY = {"episodes": 0.0, "success_rate": math.nan, "overflow/contacts": 4.0}


def test_statistics_are_weighted_by_episodes_and_counts_are_summed():
    joined = join_statistics([ONE, OTHER, EMPTY])
    assert joined == {"episodes": 4.0, "success_rate": 0.25, "overflow/contacts": 7.0}


def test_statistics_of_one_part_stay_as_they_are():
    part = {"episodes": 7.0, "success_rate": 0.1, "overflow/contacts": 3.0}
    assert join_statistics([part]) == part


def test_without_an_episode_there_are_counts_and_plain_means():
    assert join_statistics([]) == {"episodes": 0}
    joined = join_statistics([EMPTY | {"level": 0.25}, EMPTY | {"level": 0.75}])
    assert (joined["episodes"], joined["overflow/contacts"], joined["level"]) == (0.0, 8.0, 0.5)
    assert math.isnan(joined["success_rate"])


def test_recent_episodes_forget_old_iterations():
    recent = RecentEpisodes(iterations=2)
    assert math.isnan(recent.mean("success_rate"))
    recent.add({"episodes": 100.0, "success_rate": 1.0})
    for part in (ONE, EMPTY, OTHER):
        recent.add(part)
    assert recent.mean("success_rate") == pytest.approx(0.25)


def test_scalars_go_to_weights_and_biases_as_well(monkeypatch, tmp_path):
    calls = []

    class Config(dict):
        pass

    fake = SimpleNamespace(
        init=lambda **options: calls.append(("init", options["project"])),
        log=lambda values, step: calls.append((values, step)),
        finish=lambda: calls.append("finish"),
        config=Config(),
    )
    monkeypatch.setitem(sys.modules, "wandb", fake)
    monkeypatch.setattr(wandb_log_writer, "wandb", fake)
    writer = ScalarWriter(tmp_path, 0, "my-project", {"runner": {"seed": 1}})
    scalars = {"Train/mean_reward": 1.5, "Loss/kl": math.nan, "Perf/env_steps": 100.0}
    writer.write(1, scalars)
    writer.close()
    assert calls[0] == ("init", "my-project") and calls[-1] == "finish"
    assert calls[1:-1] == [({"Train/mean_reward": 1.5}, 1), ({"Perf/env_steps": 100.0}, 1)]
    assert fake.config == {"runner": {"seed": 1}}
    assert list(tmp_path.glob("events.out.tfevents*"))
