"""The command `spin-deploy`, in this process, on the fake robot."""

import sys

import fake_robot
import numpy as np
import pytest
from fake_robot import DATA, STATE

from spin_rl.cli import deploy as command
from spin_rl.config import ConfigError
from spin_rl.deploy.log import RunLog


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
        ([f"policy={DATA / 'tiny_nav.onnx'}", "backend=os"], "backend: the module os has no open_robot"),
        (
            [f"policy={DATA / 'tiny_nav.onnx'}", "backend=fake_robot", "goal=[1,0]", "log=/tmp"],
            "log: /tmp is",
        ),
        (
            [f"policy={DATA / 'tiny_nav.onnx'}", "backend=fake_robot", "goal=[1,0]", "log=/dev/null/x"],
            "log: cannot write /dev/null/x",
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


def test_a_log_that_does_not_tell_its_policy_is_refused(monkeypatch, capsys, tmp_path):
    log = tmp_path / "a.jsonl"
    RunLog(log, {"policy": 5}).start(STATE, np.zeros(2), None)
    assert call(monkeypatch, f"replay={log}") == 2
    assert f"replay: {log} is damaged, its first line" in capsys.readouterr().err
