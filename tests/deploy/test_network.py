"""Exported files as the runtime reads them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fake_robot import DATA

from spin_rl.config import ConfigError
from spin_rl.deploy.metadata import read_metadata, write_metadata
from spin_rl.deploy.network import Network
from spin_rl.deploy.observations import Observer
from spin_rl.deploy.text import full_text, summary


def groups(network, seed):
    rng = np.random.default_rng(seed)
    return {
        group.name: rng.integers(0, 256, (1, group.size)).astype(np.uint8)
        if group.dtype == "uint8"
        else rng.normal(size=(1, group.size)).astype(np.float32)
        for group in network.contract.observations
    }


def test_memory_is_kept_and_cleared(nav_network):
    inputs = groups(nav_network, 0)
    nav_network.reset()
    assert all((values == 0.0).all() and values.shape == (1, 1, 8) for values in nav_network.memory.values())
    first, second = nav_network(inputs), nav_network(inputs)
    assert first.shape == (10,) and np.abs(first - second).max() > 1e-3
    nav_network.reset()
    np.testing.assert_array_equal(nav_network(inputs), first)


def test_a_contract_survives_being_written(nav_network, pick_network):
    for network in (nav_network, pick_network):
        metadata = write_metadata(network.contract)
        assert all(isinstance(value, str) and json.loads(value) is not ... for value in metadata.values())
        assert read_metadata(metadata, "file") == network.contract


def test_the_text_names_every_column_and_action(pick_network):
    text = full_text(pick_network.contract)
    for group in pick_network.contract.observations:
        assert f"  {group.name} " in text
        assert all(f"{term.name} {label} [" in text for term in group.terms for label in term.labels)
    for part in (*pick_network.contract.joint_names, "10 Hz", "h_in", "portrait", "87 x 58", "Depth filter"):
        assert part in text
    only = replace(pick_network.contract, simulation_only="it sees through walls")
    assert "SIMULATION ONLY: it sees through walls" in summary(only)


def changed(contract, **values):
    return write_metadata(contract) | {key: json.dumps(value) for key, value in values.items()}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"format": 2}, "format 2; this program reads 1"),
        ({"joint_names": ["lift"]}, "joint_names"),
        ({"rate_hz": 0.0}, "rate_hz: expected a positive number"),
        ({"camera": {"mount": "sideways", "fov_deg": [87.0, 58.0]}}, "camera.mount: unknown 'sideways'"),
        ({"observation_names": ["proprio"]}, "observation_names"),
        ({"depth_filter": {"blur": 2.0}}, "depth.filter.blur"),
        ({"goal": {"range_m": -1.0, "tolerance_m": 0.1}}, "goal.range_m"),
        ({"default_joint_pos": [0.0]}, "default_joint_pos: expected a list of 8 to 8 values"),
        ({"state": {"h_in": {"next": "h_out"}}}, "state.h_in.shape: a value is needed"),
        ({"parity": {}}, "parity.steps: a value is needed"),
        ({"depth_filter": None}, "depth needs depth_filter"),
        ({"camera": {"mount": "portrait", "fov_deg": [87.0, 58.0], "image": [87, 58]}}, "camera.focal_px"),
    ],
)
def test_damaged_metadata_is_refused_in_one_line(nav_network, values, message):
    with pytest.raises(ConfigError, match=message) as caught:
        read_metadata(changed(nav_network.contract, **values), "policy: x.onnx")
    assert str(caught.value).startswith("policy: x.onnx: ") and "\n" not in str(caught.value)


def test_foreign_metadata_is_refused(nav_network):
    with pytest.raises(ConfigError, match="no policy exported by spin-export, its metadata lacks 'format'"):
        read_metadata({}, "x.onnx")
    old = write_metadata(nav_network.contract)
    del old["guard"]
    with pytest.raises(ConfigError, match="its metadata lacks 'guard'; export it again"):
        read_metadata(old, "x.onnx")
    with pytest.raises(ConfigError, match="damaged metadata"):
        read_metadata(write_metadata(nav_network.contract) | {"goal": "{"}, "x.onnx")


def test_terms_must_fit_their_group(nav_network):
    proprio = nav_network.contract.observations[0]
    with pytest.raises(ValueError, match="has 30 columns and terms for 31"):
        replace(proprio, size=30)
    with pytest.raises(ValueError, match="needs a scale and a bias"):
        replace(proprio.terms[0], scale=(1.0,))
    unknown = replace(proprio, terms=(replace(proprio.terms[0], name="smell"), *proprio.terms[1:]))
    others = nav_network.contract.observations[1:]
    with pytest.raises(ConfigError, match="does not know what 'smell' is"):
        Observer(replace(nav_network.contract, observations=(unknown, *others)))


@pytest.mark.parametrize("content", [b"", b"no network"])
def test_files_that_are_no_networks_are_refused(tmp_path, content):
    path = tmp_path / "policy.onnx"
    with pytest.raises(ConfigError, match="no file"):
        Network(path)
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"policy\.onnx is no ONNX file that can be run") as caught:
        Network(path)
    assert "\n" not in str(caught.value)


def test_a_network_that_is_not_its_metadatas_is_refused(nav_network, monkeypatch):
    goal, *others = nav_network.contract.observations[1:]
    wrong = replace(goal, size=4, terms=())
    groups_of = (nav_network.contract.observations[0], wrong, *others)
    monkeypatch.setattr(
        "spin_rl.deploy.network.read_metadata",
        lambda metadata, name: replace(nav_network.contract, observations=groups_of),
    )
    with pytest.raises(ConfigError, match="inputs and outputs are not those"):
        Network(DATA / "tiny_nav.onnx")
