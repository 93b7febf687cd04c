from spin_rl.benchmark import after_training
from spin_rl.cli import run_folder
from spin_rl.tasks.common.compose import compose


def test_the_evaluation_after_a_training_knows_its_call(monkeypatch, tmp_path):
    overrides = ("depth=d435i", "scene=moving")
    calls = []
    monkeypatch.setattr(after_training, "evaluate_run", lambda run_dir, **options: calls.append(options))
    summary = {"success_rate": 0.5, "env_steps": 100}
    for episodes in (7, 0):
        values = compose("train", [f"evaluate={episodes}", "run_dir=here", "device=cpu"])
        options = run_folder.read_options(run_folder.RunOptions, values, overrides)
        run_folder.write_results(tmp_path, summary, options)
    (options,) = calls
    assert options["episodes"] == 7 and options["overrides"] == overrides
