import json
from dataclasses import asdict, replace

import pytest

from spin_rl.benchmark import after_training, policies
from spin_rl.benchmark import registry as benchmarks
from spin_rl.benchmark.reach import REACH_CELLS
from spin_rl.benchmark.untrained import ZeroPolicy
from spin_rl.tasks.nav.spec import NAV


def standing(trained):
    return policies.PolicySource({"policy": "run"}, trained, lambda obs, device: ZeroPolicy())


def test_a_run_is_evaluated_into_its_folder(monkeypatch, capsys, tmp_path, device):
    trained = {"robot": {"profile": "re1"}, "task": {"camera_mount": "landscape"}}
    monkeypatch.setattr(policies, "open_policy", lambda name: standing(trained))
    path = after_training.evaluate_run(tmp_path, episodes=1, device=device)
    assert path == tmp_path / "reach.json"
    result = json.loads(path.read_text())
    assert result["robot"] == "re1" and result["camera_mount"] == "landscape"
    assert result["policy"] == str(tmp_path) and result["seeds"] == [0]
    # Standing still for a minute ends by the time limit.
    assert [row["timeout_rate"] for row in result["rows"]] == [1.0] * 6
    assert [row["duration_all_s"] for row in result["rows"]] == pytest.approx([60.0] * 6)
    printed = capsys.readouterr().out
    assert "SPIN (CVO)" in printed and printed.strip().splitlines()[-1].startswith(f"Wrote {path}")


def test_corridors_and_noise_are_those_of_the_training(monkeypatch, capsys, tmp_path):
    """Images as the student was trained on, not ideal ones through the filter for noisy ones."""
    trained = {"task": {"depth": {"enabled": True}}, "depth": {"filter": {"fill_px": 3}}}
    measured = []

    def evaluate_reach(make_policy, cfg, episodes, seeds, device, **options):
        measured.append(cfg)
        row = {"success_rate": 1.0, "ci95": [0.9, 1.0], "duration_s": 5.0, "episodes": 9, "causes": {}}
        rows = [row | {"scenario": cell.scenario, "difficulty": cell.difficulty} for cell in REACH_CELLS]
        depth = None if cfg.depth is None else asdict(cfg.depth)
        settings = {"seeds": [0], "robot": "paper", "camera_mount": "portrait", "depth": depth}
        return {"policy": "run", "rows": rows} | settings

    monkeypatch.setattr(policies, "open_policy", lambda name: standing(trained))
    benchmark = replace(benchmarks.BENCHMARKS["reach"], evaluate=evaluate_reach)
    monkeypatch.setattr(benchmarks, "BENCHMARKS", {"reach": benchmark})
    call = ["depth=d435i", "scene=moving", "task.episode_s=3", "num_envs=4"]
    path = after_training.evaluate_run(tmp_path, episodes=9, device="cpu", overrides=call)
    (cfg,) = measured
    asked = NAV.as_trained(["depth=d435i", "scene=moving", "task.depth.enabled=true"])
    assert cfg.depth == asked.depth and cfg.scene == asked.scene and cfg.scene.patrolling_share > 0.0
    assert cfg.episode_s == 60.0 and cfg.noise.goal_m == 0.0
    assert ", depth noise d435i, scene moving\n" in capsys.readouterr().out
    assert json.loads(path.read_text())["scene"] == "moving"

    after_training.evaluate_run(tmp_path, episodes=9, device="cpu")
    assert measured[1].depth.noise.dropout == 0.0 and measured[1].depth.filter.fill_px == 3


def test_the_benchmark_is_that_of_the_runs_task(monkeypatch, capsys, tmp_path, device):
    trained = {"task": {"name": "pick", "sight": {"far_m": 3.0}}}
    monkeypatch.setattr(policies, "open_policy", lambda name: standing(trained))
    call = ["task=pick", "scene.table_top=[0.5,0.6]"]
    path = after_training.evaluate_run(tmp_path, episodes=2, device=device, overrides=call)
    assert path == tmp_path / "pick.json"
    result = json.loads(path.read_text())
    assert result["sight"]["far_m"] == 3.0 and result["scene"] == "tabletop, scene.table_top=[0.5,0.6]"
    assert result["overall"]["timeout_rate"] == 1.0
    assert result["overall"]["duration_all_s"] == pytest.approx(7.0)
    assert "SPIN" not in capsys.readouterr().out  # other tables than the benchmark's
