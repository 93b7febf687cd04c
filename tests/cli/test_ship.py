import json
import sys

import pytest

from spin_rl.cli import ship
from spin_rl.paths import POLICY_DIR

ROW = {"success_rate": 0.5, "ci95": [0.4, 0.6], "duration_s": None, "episodes": 10}
REPORTS = {
    "reach": {"rows": [ROW | {"scenario": 1, "difficulty": "easy", "causes": {"base": 1.0}}]},
    "pick": {
        "overall": ROW | {"untouched_rate": 0.5, "causes": {"dropped": 1.0}},
        "rows": [ROW | {"object": "mug", "untouched_rate": 0.5, "causes": {"dropped": 1.0}}],
    },
}


@pytest.mark.parametrize(
    ("benchmark", "heading", "cause"),
    [("reach", "Reach: new, 10 episodes per cell", "base"), ("pick", "Pick: new, 10 episodes", "dropped")],
)
def test_a_card_is_headed_by_the_policys_own_name(monkeypatch, capsys, tmp_path, benchmark, heading, cause):
    run, policies = tmp_path / "run", tmp_path / "policies"
    run.mkdir()
    policies.mkdir()
    summary = {"device": "cpu", "seed": 3, "processes": 1, "env_steps": 5, "minutes": 2, "success_rate": 0.5}
    (run / "summary.json").write_text(json.dumps(summary))
    report = REPORTS[benchmark] | {
        "policy": "runs/try7",
        "benchmark": benchmark,
        "seeds": [0, 2],
        "episodes_per_seed": 5,
        "robot": "paper",
        "camera_mount": "portrait",
    }
    (tmp_path / "report.json").write_text(json.dumps(report))
    monkeypatch.setattr(ship, "POLICY_DIR", policies)
    monkeypatch.setattr(ship, "save_policy", lambda path, run, facts: path.write_bytes(b"weights"))
    arguments = [str(run), "new", str(tmp_path / "report.json"), "--command", "spin-train seed=3"]
    monkeypatch.setattr(sys, "argv", ["ship", *arguments])
    ship.main()
    card = (policies / "new.md").read_text()
    assert f"\n{heading}" in card and "runs/try7" not in card
    assert f"{cause} 100%" in card and "`spin-train seed=3`" in card
    assert f"`spin-eval policy=new benchmark={benchmark} episodes=5 seeds=[0,2]`" in card
    assert str(policies / "new.safetensors") in capsys.readouterr().out


def test_shipped_cards_are_headed_by_their_policies():
    files = sorted(POLICY_DIR.glob("*.safetensors"))
    assert files
    for file in files:
        card = file.with_suffix(".md").read_text()
        assert any(f"\n{benchmark}: {file.stem}, " in card for benchmark in ("Reach", "Pick", "Rooms"))
