"""Exported policies against the trained ones, and what they say of themselves."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tiny_policies import DATA, LIKE, export_tiny, make_tiny

from spin_rl import robot
from spin_rl.cli import export as command
from spin_rl.config import ConfigError
from spin_rl.deploy.network import Network
from spin_rl.export import parity as parity_module
from spin_rl.export.graph import recurrent
from spin_rl.export.groups import describe_group
from spin_rl.export.parity import agrees, compare, draw
from spin_rl.export.write import export_fetch, export_policy
from spin_rl.paths import POLICY_DIR
from spin_rl.runners.policy_file import read_policy

SHIPPED = sorted(file.stem for file in POLICY_DIR.glob("*.safetensors"))
TEACHERS = ("nav-cvo", "nav-dvo", "nav-room", "nav-wide")


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_policy_acts_the_same_once_exported(name, tmp_path):
    done = export_policy(read_policy(name), tmp_path / f"{name}.onnx")
    assert done.parity.steps == 500 and done.parity.resets > 1
    assert done.parity.action_error < 1e-4 and done.parity.state_error < 1e-4
    contract = Network(done.path).contract
    assert contract.name == name and contract.rate_hz == 10.0 and contract.parity.steps == 500
    assert name in contract.model_card and contract.training["command"]
    assert (contract.simulation_only is not None) == (name in TEACHERS)
    guard = read_policy(name).config["task"].get("guard", {})
    assert contract.has_pilot == guard.get("enabled", False) == bool(contract.shapes)
    expected = {"absolute"} if name.startswith("nav") else {"increments"}
    assert {contract.actions.mode} == expected
    assert (contract.goal is not None) == name.startswith("nav")
    if name == "nav-room":
        assert contract.goal.range_m == 5.0


def test_a_file_tells_nothing_of_the_machine_that_wrote_it(tmp_path):
    written = export_tiny("tiny_nav", tmp_path, tmp_path / "tiny_nav.onnx").path.read_bytes()
    for path in (Path(torch.__file__).parents[1], POLICY_DIR.parent, tmp_path):
        assert str(path).encode() not in written


@pytest.mark.parametrize("name", LIKE)
def test_the_files_of_the_runtimes_tests_are_what_is_exported_now(name, tmp_path):
    """Otherwise run tests/export/tiny_policies.py."""
    export_tiny(name, tmp_path, tmp_path / f"{name}.onnx")
    new, kept = Network(tmp_path / f"{name}.onnx"), Network(DATA / f"{name}.onnx")
    for field in vars(new.contract):
        if field not in ("program", "parity"):
            assert getattr(new.contract, field) == getattr(kept.contract, field), field
    rng = np.random.default_rng(0)
    actor = recurrent(read_policy(make_tiny(name, tmp_path)).build(), name)
    dims = {group.name: group.size for group in new.contract.observations}
    for _ in range(3):
        groups = draw(actor, dims, rng)
        np.testing.assert_allclose(new(groups), kept(groups), atol=1e-5)


def test_the_check_notices_another_network(tmp_path):
    path = tmp_path / "a.onnx"
    export_tiny("tiny_nav", tmp_path, path)
    other = recurrent(read_policy(make_tiny("tiny_nav", tmp_path, seed=2)).build(), "other")
    assert not agrees(compare(Network(path), other, 20))
    same = recurrent(read_policy(make_tiny("tiny_nav", tmp_path, seed=1)).build(), "same")
    assert agrees(compare(Network(path), same, 20))
    with torch.no_grad():
        same.obs_normalizer._mean += 1e-3
    assert not agrees(compare(Network(path), same, 20))


def test_the_check_notices_a_memory_that_is_not_cleared(tmp_path, monkeypatch):
    path = tmp_path / "a.onnx"
    export_tiny("tiny_nav", tmp_path, path)
    network, actor = Network(path), recurrent(read_policy(make_tiny("tiny_nav", tmp_path)).build(), "same")
    network(draw(actor, {g.name: g.size for g in network.contract.observations}, np.random.default_rng(0)))
    monkeypatch.setattr(network, "reset", lambda: None)
    assert not agrees(compare(network, actor, 20))


def test_nothing_is_written_that_acts_differently(tmp_path, monkeypatch):
    monkeypatch.setattr("spin_rl.export.parity.TOLERANCE", 0.0)
    with pytest.raises(ConfigError, match="acts differently once exported"):
        export_tiny("tiny_nav", tmp_path, tmp_path / "a.onnx")
    assert not (tmp_path / "a.onnx").exists() and parity_module.NUM_STEPS == 500


@pytest.mark.parametrize(("mount", "image"), [("portrait", (87, 58)), ("landscape", (58, 87))])
def test_cameras_are_described(tmp_path, mount, image):
    changes = {"camera_mount": mount, "camera_pose": [0.1, -0.7]}
    metadata_image = list(image)
    path = make_tiny("tiny_nav", tmp_path, **changes)
    policy = read_policy(path)
    policy.metadata["actor"]["depth_encoder"]["image"] = metadata_image
    policy.metadata["actor"]["depth_encoder"] |= {"kernels": [8, 4], "strides": [8, 4]}
    camera = export_policy_contract(policy, tmp_path).camera
    assert (camera.mount, camera.image, camera.pose) == (mount, image, (0.1, -0.7))
    assert camera.fov_deg == pytest.approx(robot.CAMERA_FOV_DEG[:: 1 if mount == "portrait" else -1])
    for size, focal, fov in zip(image, camera.focal_px, camera.fov_deg, strict=True):
        assert np.degrees(2 * np.arctan(size / 2 / focal)) == pytest.approx(fov)


def export_policy_contract(policy, folder):
    from spin_rl.export.describe import describe

    return describe(policy, units=8)


def test_a_fetch_is_a_bundle(tmp_path):
    nav, pick = (make_tiny(name, tmp_path) for name in ("tiny_nav", "tiny_pick"))
    files = export_fetch(str(nav), str(pick), tmp_path / "fetch")
    assert [done.path.name for done in files] == ["tiny_nav.onnx", "tiny_pick.onnx"]
    settings = json.loads((tmp_path / "fetch" / "fetch.json").read_text())
    assert {stage["name"]: stage["policy"] for stage in settings["stages"]} == {
        "reach": "tiny_nav.onnx",
        "align": None,
        "pick": "tiny_pick.onnx",
        "retract": None,
        "carry": "tiny_nav.onnx",
        "place": None,
    }
    assert settings["settings"]["limits"]["pick"] == 12.0 and settings["settings"]["pick_range_m"] == [
        0.2,
        1.6,
    ]
    ranges = [Network(done.path).contract.camera.range_m for done in files]
    assert ranges == [(0.2, 4.0), (0.2, 1.6)]


def test_policies_of_a_fetch_may_have_the_same_name(tmp_path):
    paths = []
    for name, key in zip(("tiny_nav", "tiny_pick"), ("a", "b"), strict=True):
        (tmp_path / key).mkdir()
        paths.append(make_tiny(name, tmp_path).rename(tmp_path / key / "model.safetensors"))
    files = export_fetch(str(paths[0]), str(paths[1]), tmp_path / "fetch")
    assert [done.path.name for done in files] == ["nav.onnx", "pick.onnx"]
    assert [Network(done.path).contract.task for done in files] == ["nav", "pick"]
    settings = json.loads((tmp_path / "fetch" / "fetch.json").read_text())
    assert settings["policies"] == {"nav": "nav.onnx", "pick": "pick.onnx"}


def test_what_cannot_be_exported_is_refused(tmp_path):
    camera = Network(DATA / "tiny_nav.onnx").contract.camera
    with pytest.raises(ConfigError, match="reads 'privileged', which cannot be exported"):
        describe_group("privileged", 40, camera)
    with pytest.raises(ConfigError, match="hand_in_image has no meaning without images"):
        describe_group("hand_in_image", 3, replace(camera, range_m=None))
    with pytest.raises(ConfigError, match="no recurrent memory"):
        recurrent(torch.nn.Linear(1, 1), "a")


def call(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["spin-export", *map(str, arguments)])
    command.main()


def test_the_command_writes_and_shows(tmp_path, monkeypatch, capsys):
    out = tmp_path / "new" / "tiny.onnx"
    call(monkeypatch, f"policy={make_tiny('tiny_nav', tmp_path)}", f"out={out}")
    assert f"Wrote {out}" in capsys.readouterr().out
    call(monkeypatch, f"show={out}")
    shown = capsys.readouterr().out
    assert "tiny_nav: task nav, 10 Hz" in shown and "Checked: 500 steps" in shown
    (out.parent / "fetch.json").write_text('{"stages": []}')
    call(monkeypatch, f"show={out.parent}")
    assert capsys.readouterr().out == '{"stages": []}\n' + shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "policy: a name or path is needed"),
        (["policy=none"], "policy: There is no policy 'none'"),
        (["policy=zero"], "policy: zero learned nothing"),
        (["policy=/etc/passwd"], "policy: The checkpoint /etc/passwd cannot be read"),
        (["policy=nav-cvo", "pick=pick-depth"], "pick: is of a fetch"),
        (["policy=nav-cvo", "out=x.pt"], "out: a policy's file is named <name>.onnx"),
        (["policy=pick-depth", "fetch=true"], "was trained with task=pick"),
        (["show=none.onnx"], "there is no file none.onnx"),
        (["show=none.onnx", "policy=nav-cvo"], "show: exports nothing, leave policy= out"),
        ([f"show={DATA.parent}"], "holds no exported policy"),
        (
            ["policy=nav-cvo", "fetch=true", f"out={DATA / 'tiny_nav.onnx'}"],
            "tiny_nav.onnx is a file; a fetch",
        ),
    ],
)
def test_bad_input_is_one_line(monkeypatch, capsys, arguments, message):
    with pytest.raises(SystemExit) as ended:
        call(monkeypatch, *arguments)
    error = capsys.readouterr().err
    assert ended.value.code == 2 and message in error and error.count("\n") == 1
