"""The command `spin-deploy`, in this process, on the fake robot."""

import sys

import fake_robot
import pytest
from fake_robot import DATA

from spin_rl.cli import deploy as command
from spin_rl.config import ConfigError


def call(monkeypatch, *arguments):
    """Run the command; return its status."""
    monkeypatch.setattr(sys, "argv", ["spin-deploy", *map(str, arguments)])
    fake_robot.LAST.clear()
    with pytest.raises(SystemExit) as ended:
        command.main()
    return ended.value.code


def drive(monkeypatch, *arguments):
    return call(monkeypatch, f"policy={DATA / 'tiny_nav.onnx'}", "backend=fake_robot", *arguments)


def test_drives_logs_and_replays(monkeypatch, capsys, tmp_path):
    log = tmp_path / "runs" / "a.jsonl"
    assert drive(monkeypatch, "goal=[9,0]", "max_s=1.5", f"log={log}", "speed_scale=0.5") == 1
    assert "time is over: 1.5 s, 15 commands, 0 missed" in capsys.readouterr().out
    assert fake_robot.LAST[0].calls[-2:] == ["stop", "close"]
    assert call(monkeypatch, f"replay={log}") == 0
    assert "15 steps (time is over)" in capsys.readouterr().out
    log.write_text(log.read_text().replace('"speed_scale": 0.5', '"speed_scale": 1.0', 1))
    assert call(monkeypatch, f"replay={log}", f"policy={DATA / 'tiny_nav.onnx'}") == 1
    assert "differs from step 0 on" in capsys.readouterr().out


def test_logs_of_other_policies_and_damaged_ones_are_one_line(monkeypatch, capsys, tmp_path):
    log = tmp_path / "a.jsonl"
    drive(monkeypatch, "goal=[9,0]", "max_s=0.3", f"log={log}")
    whole = log.read_text()
    capsys.readouterr()
    for change, message in [
        (('"sha256"', '"sha"'), "replay.sha256: a value is needed"),
        (('"speed_scale": 1.0', '"speed_scale": 7.0'), "replay.speed_scale: expected"),
        (('"name": "tiny_nav"', '"name": "other"'), "is tiny_nav, and"),
    ]:
        log.write_text(whole.replace(*change, 1))
        assert call(monkeypatch, f"replay={log}") == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
    log.write_text(whole)
    assert call(monkeypatch, f"replay={log}", f"policy={DATA / 'tiny_pick.onnx'}") == 2
    assert "is tiny_pick, and" in capsys.readouterr().err


def test_a_policy_is_not_overwritten_by_its_log(monkeypatch, capsys, tmp_path):
    policy = tmp_path / "a.onnx"
    policy.write_bytes((DATA / "tiny_nav.onnx").read_bytes())
    given = [f"policy={policy}", "backend=fake_robot", "goal=[9,0]", f"log={tmp_path}/b/../a.onnx"]
    assert call(monkeypatch, *given) == 2
    assert "is the policy's own file" in capsys.readouterr().err
    assert policy.read_bytes() == (DATA / "tiny_nav.onnx").read_bytes()


def test_arriving_and_being_stopped_have_their_status(monkeypatch, capsys):
    assert drive(monkeypatch, "goal=[0.1,0]") == 0
    assert "arrived" in capsys.readouterr().out
    assert drive(monkeypatch, "goal=[9,0]", "robot.image_age_s=2") == 3
    assert "image is 2.00 s old" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["backend=fake_robot"], "policy: a value is needed"),
        (["policy=x.onnx"], "backend: a value is needed"),
        (["policy=x.onnx", "backend=fake_robot"], "there is no file x.onnx"),
        ([f"policy={DATA / 'tiny_nav.onnx'}", "backend=spot"], "backend: unknown 'spot'"),
        ([f"policy={DATA / 'tiny_nav.onnx'}", "backend=../spot"], "backend: unknown '../spot'"),
        ([f"policy={DATA / 'tiny_nav.onnx'}", "backend=json"], "backend: the module json has no open_robot"),
        (
            [f"policy={DATA / 'tiny_nav.onnx'}", "backend=fake_robot", "goal=[1,0]", "log=/"],
            "log: / cannot be written",
        ),
        (
            [f"policy={DATA / 'tiny_nav.onnx'}", "backend=fake_robot", "goal=[1,0]", "log=/dev/null"],
            "log: /dev/null cannot be written: it is not a regular file",
        ),
        ([f"policy={DATA / 'tiny_nav.onnx'}", "backend=fake_robot"], "goal: tiny_nav needs one"),
        ([f"policy={DATA / 'tiny_pick.onnx'}", "backend=fake_robot"], "object: tiny_pick needs one"),
        (["speed_scale=2"], "speed_scale: expected"),
        (["goal=[1]"], "goal: expected 2 values"),
        (["speed=1"], "speed: unknown key"),
        (["nonsense"], "nonsense: expected key=value"),
        (["replay=none.jsonl"], "replay: there is no file"),
    ],
)
def test_bad_input_is_one_line(monkeypatch, capsys, arguments, message):
    assert call(monkeypatch, *arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("spin-deploy: error: ") and message in error and error.count("\n") == 1


def test_help_says_what_there_is(monkeypatch, capsys):
    assert call(monkeypatch, "--help") == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in command.Options.__dataclass_fields__)
    assert call(monkeypatch) == 2


def test_robots_of_packages_that_are_missing(monkeypatch, tmp_path):
    (tmp_path / "needy_robot.py").write_text("import not_installed_here\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=r"needs a package that is not installed.*not_installed_here"):
        command.open_backend("needy_robot", {}, None)
