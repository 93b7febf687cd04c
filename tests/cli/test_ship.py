import json
import sys

from spin_rl.cli import ship
from spin_rl.paths import POLICY_DIR


def test_a_card_is_headed_by_the_policys_own_name(monkeypatch, capsys, tmp_path):
    run, policies = tmp_path / "run", tmp_path / "policies"
    run.mkdir()
    policies.mkdir()
    summary = {"device": "cpu", "seed": 3, "processes": 1, "env_steps": 5, "minutes": 2, "success_rate": 0.5}
    (run / "summary.json").write_text(json.dumps(summary))
    row = {"scenario": 1, "difficulty": "easy", "success_rate": 0.5, "ci95": [0.4, 0.6], "duration_s": None}
    report = {
        "policy": "runs/try7",
        "benchmark": "reach",
        "rows": [row | {"episodes": 10, "causes": {"base": 1.0}}],
        "seeds": [0],
        "robot": "paper",
        "camera_mount": "portrait",
    }
    (tmp_path / "reach.json").write_text(json.dumps(report))
    monkeypatch.setattr(ship, "POLICY_DIR", policies)
    monkeypatch.setattr(ship, "save_policy", lambda path, run, facts: path.write_bytes(b"weights"))
    arguments = [str(run), "nav-new", str(tmp_path / "reach.json"), "--command", "spin-train seed=3"]
    monkeypatch.setattr(sys, "argv", ["ship", *arguments])
    ship.main()
    card = (policies / "nav-new.md").read_text()
    assert "\nReach: nav-new, 10 episodes per cell" in card and "runs/try7" not in card
    assert "base 100%" in card and "`spin-train seed=3`" in card
    assert str(policies / "nav-new.safetensors") in capsys.readouterr().out


def test_shipped_cards_are_headed_by_their_policies():
    files = sorted(POLICY_DIR.glob("*.safetensors"))
    assert files
    for file in files:
        assert f"\nReach: {file.stem}, " in file.with_suffix(".md").read_text()
