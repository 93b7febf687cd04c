"""Checkpoints and policies from anywhere: damage, forged content and other programs' classes are one line."""

import copy
import json
import sys

import pytest
import safetensors.torch
import torch
from fake_env import FakeEnv, make_config
from hypothesis import given, settings
from hypothesis import strategies as st

from spin_rl.paths import POLICY_DIR
from spin_rl.runners import PPORunner, checkpoint, load_checkpoint, read_policy, save_checkpoint
from spin_rl.runners.policy_file import save_policy, write_policy

FUZZ = settings(max_examples=80, derandomize=True, deadline=None, database=None)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    PPORunner(FakeEnv(), make_config(), folder, snapshot={"task": {"name": "fake"}}).train(2)
    return folder


@pytest.fixture(scope="module")
def policy(run):
    save_policy(run / "policy.safetensors", run)
    return run / "policy.safetensors"


def last(run):
    return run / "checkpoints" / "last.pt"


def refused(read, path, *words):
    with pytest.raises(ValueError) as error:
        read(path)
    message = str(error.value)
    assert path.name in message and "\n" not in message and len(message) < 400
    assert all(word in message for word in words), message


@pytest.mark.parametrize("kind", ["checkpoint", "policy"])
def test_any_changed_byte_is_noticed(run, policy, tmp_path, kind):
    source, read = {"checkpoint": (last(run), load_checkpoint), "policy": (policy, read_policy)}[kind]
    content, path = source.read_bytes(), tmp_path / source.name

    @FUZZ
    @given(st.integers(0, len(content) - 1), st.integers(1, 255), st.sampled_from([1, 40, 4096]))
    def check(at, difference, length):
        damaged = bytearray(content)
        for i in range(at, min(at + length, len(content))):
            damaged[i] = 0 if length > 1 else damaged[i] ^ difference
        path.write_bytes(damaged)
        if damaged != content:
            refused(read, path)

    check()
    for part in (content[:0], content[:-1], content[: len(content) // 2], content[1:], content + b"x"):
        path.write_bytes(part)
        refused(read, path)


def test_any_flipped_bit_of_a_shipped_policy_is_noticed(tmp_path):
    source = POLICY_DIR / "pick-teacher.safetensors"
    content, path = source.read_bytes(), tmp_path / source.name

    @settings(FUZZ, max_examples=40)
    @given(st.integers(0, 8 * len(content) - 1))
    def check(bit):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        refused(read_policy, path)

    check()


@pytest.fixture
def old_checkpoint(run, tmp_path):
    """A checkpoint as they were before they had a checksum."""
    path = tmp_path / "old.pt"
    torch.save(load_checkpoint(last(run)) | {"version": 1}, path)
    return path


def test_old_files_are_read_and_their_weights_cannot_be_damaged(run, policy, old_checkpoint, tmp_path):
    runner = PPORunner(FakeEnv(), make_config())
    runner.load(old_checkpoint)
    assert runner.train(3)["iterations"] == 3
    content = old_checkpoint.read_bytes()
    weights = load_checkpoint(old_checkpoint)["actor"]["lstm.rnn.weight_hh_l0"]
    at = content.index(weights.numpy().tobytes())
    old_checkpoint.write_bytes(content[: at + 5] + bytes([content[at + 5] ^ 1]) + content[at + 6 :])
    refused(load_checkpoint, old_checkpoint, "damaged")

    old = tmp_path / "old.safetensors"
    trained = read_policy(policy)
    header = {"spin_rl": json.dumps(dict(trained.metadata) | {"version": 1})}
    safetensors.torch.save_file(dict(trained.weights), old, header)
    assert read_policy(old).metadata["iteration"] == 2


def test_a_new_file_without_its_checksum_is_refused(run, policy, tmp_path):
    path = tmp_path / "a.pt"
    torch.save(load_checkpoint(last(run)), path)
    refused(load_checkpoint, path, "no checksum")
    trained, path = read_policy(policy), tmp_path / "a.safetensors"
    safetensors.torch.save_file(dict(trained.weights), path, {"spin_rl": json.dumps(dict(trained.metadata))})
    refused(read_policy, path, "checksum")


def resume(path):
    PPORunner(FakeEnv(), make_config()).load(path)


def set_weight(value):
    def change(state):
        state["actor"]["mlp.0.bias"][0] = value

    return change


def put(*path):
    *keys, last_key, value = path

    def change(state):
        for key in keys:
            state = state[key]
        state[last_key] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (set_weight(float("nan")), ["actor.mlp.0.bias", "not finite"]),
        (set_weight(1e38), ["actor.mlp.0.bias", "1e+38"]),
        (put("actor", "obs_normalizer._var", -torch.ones(1, 8)), ["actor.obs_normalizer._var"]),
        (put("actor", "lstm.rnn.bias_hh_l0", torch.zeros(64, dtype=torch.int32)), ["bias_hh_l0", "int32"]),
        (put("learning_rate", float("nan")), ["learning_rate"]),
        (put("iteration", -5), ["iteration"]),
        (put("minutes", float("inf")), ["minutes"]),
        (
            put("optimizer", "state", 0, "exp_avg", torch.full((2,), float("nan"))),
            ["optimizer.state.0.exp_avg"],
        ),
        (put("optimizer", "state", 0, "exp_avg", torch.zeros(3)), ["optimizer"]),
        (put("optimizer", "state", 0, {}), []),
        (put("optimizer", {}), ["optimizer"]),
        (put("processes", []), ["processes"]),
        (put("processes", 0, "env", {}), ["processes.env"]),
        (put("processes", 0, "rng_cpu", torch.zeros(3, dtype=torch.uint8)), ["processes"]),
        (put("processes", 0, "memory", [None]), ["another algorithm"]),
        (put("config", "{"), ["config"]),
        (put("config", "[" * 100_000), ["config"]),
        (put("config", '{"runner": {"obs_groups": 5, "actor": {}}, "run": null}'), ["config"]),
    ],
)
def test_forged_content_is_named(run, tmp_path, change, words):
    state = copy.deepcopy(load_checkpoint(last(run)))
    change(state)
    path = tmp_path / "forged.pt"
    save_checkpoint(path, state)
    if words:
        refused(resume, path, *words)
    else:
        resume(path)


VALUES = st.sampled_from(
    [None, True, -1, 1.5, 1e300, 10**40, "", "x\ny", [], [5], {}, {"a": [1]}, float("nan")]
)


def test_missing_and_mistyped_content_of_a_checkpoint_is_one_line(run, tmp_path):
    original = load_checkpoint(last(run))
    path = tmp_path / "forged.pt"
    keys, runner = sorted(original.keys() - {"version"}), PPORunner(FakeEnv(), make_config())

    @settings(FUZZ, max_examples=30)
    @given(st.sampled_from(keys), VALUES | st.just("missing"))
    def check(key, value):
        state = {name: part for name, part in original.items() if name != key}
        save_checkpoint(path, state if value == "missing" else state | {key: value})
        for read in (runner.load, lambda at: read_policy(at).build()):
            try:
                read(path)
            except ValueError as error:
                assert "forged.pt" in str(error) and "\n" not in str(error)

    check()


def test_missing_and_mistyped_metadata_is_one_line(policy, tmp_path):
    trained = read_policy(policy)
    path = tmp_path / "forged.safetensors"
    places = [(key,) for key in trained.metadata] + [("actor", key) for key in trained.metadata["actor"]]
    places += [("obs_dims", "goal"), ("config", "task"), ("actor", "distribution_cfg", "std_range")]

    @FUZZ
    @given(st.sampled_from(places), VALUES | st.just("missing"))
    def check(place, value):
        metadata = copy.deepcopy(dict(trained.metadata))
        at = metadata
        for key in place[:-1]:
            at = at[key]
        at.pop(place[-1])
        if value != "missing":
            at[place[-1]] = value
        write_policy(path, trained.weights, metadata)
        try:
            read_policy(path).build()
        except ValueError as error:
            assert "\n" not in str(error) and len(str(error)) < 600
        else:
            assert place[-1] not in ("obs_groups", "obs_dims", "num_actions", "iteration", "class_name")

    check()


@pytest.mark.parametrize("name", ["this:s", "antigravity:x", "os.system", "spin_rl.files:os.system", 5, None])
def test_no_other_packages_are_imported_for_a_file(policy, tmp_path, name):
    trained = read_policy(policy)
    metadata = dict(trained.metadata) | {"actor": dict(trained.metadata["actor"]) | {"class_name": name}}
    path = tmp_path / "a.safetensors"
    write_policy(path, trained.weights, metadata)
    with pytest.raises(ValueError, match=r"actor\.class_name"):
        read_policy(path).build()
    assert not {"this", "antigravity"} & sys.modules.keys()


def test_numbered_checkpoints_above_are_set_aside_and_what_is_written_stays(tmp_path):
    folder = tmp_path / "checkpoints"
    for iteration in (20, 30, 40):
        checkpoint.save_numbered(folder, iteration, {"iteration": iteration})
    moved = checkpoint.set_aside(folder / "iteration_0000020.pt")
    assert sorted(path.name for path in moved) == ["iteration_0000030.pt", "iteration_0000040.pt", "last.pt"]
    assert checkpoint.find_checkpoint(tmp_path)[1]["iteration"] == 20
    for iteration in (21, 22, 23, 24):
        checkpoint.save_numbered(folder, iteration, {"iteration": iteration})
    (folder / "last.pt").unlink()  # it shares its bytes with a numbered one
    (folder / "last.pt").write_bytes(b"torn")
    assert checkpoint.find_checkpoint(tmp_path)[1]["iteration"] == 24
    # Also where others have higher numbers, as in a folder of an older program.
    for iteration in (50, 51, 52):
        checkpoint.save_numbered(folder, iteration, {"iteration": iteration})
    checkpoint.save_numbered(folder, 25, {"iteration": 25})
    assert (folder / "iteration_0000025.pt").exists()
