from types import SimpleNamespace

from spin_rl.benchmark import after_training
from spin_rl.cli import run_folder


def test_the_evaluation_after_a_training_knows_its_call(monkeypatch, tmp_path):
    overrides = ["depth=d435i", "scene=moving"]
    call = SimpleNamespace(overrides=SimpleNamespace(task=overrides))
    monkeypatch.setattr(run_folder.HydraConfig, "get", lambda: call)
    calls = []
    monkeypatch.setattr(after_training, "evaluate_run", lambda run_dir, **options: calls.append(options))
    summary = {"success_rate": 0.5, "env_steps": 100}
    run_folder.write_results(tmp_path, summary, {"seed": 1, "evaluate": 7}, "cpu")
    (options,) = calls
    assert options["episodes"] == 7 and options["overrides"] == overrides
    run_folder.write_results(tmp_path, summary, {"seed": 1, "evaluate": 0}, "cpu")
    assert len(calls) == 1
