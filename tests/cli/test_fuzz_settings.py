"""Every setting of every command, with values that cannot be meant: one line, and nothing is started."""

import copy
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spin_rl.cli import bench, common, distill, evaluate, measurement, play, refusals, run_folder, train
from spin_rl.tasks.common.compose import compose

COMMANDS = {
    "train": (train.train, ["run_dir=here", "device=cpu"]),
    "train pick": (train.train, ["task=pick", "task_preset=pick", "run_dir=here", "device=cpu"]),
    "train mixture": (train.train, ["scene=mixture", "depth=d435i", "run_dir=here", "device=cpu"]),
    "train dvo1b": (
        train.train,
        ["algo=dvo1b", "teacher=nav-dvo", "init=null", "run_dir=here", "device=cpu"],
    ),
    "distill": (distill.distill, ["teacher=nav-cvo", "run_dir=here", "device=cpu"]),
    "eval": (evaluate.evaluate, ["policy=zero", "device=cpu"]),
    "eval fetch": (evaluate.evaluate, ["policy=zero", "task=fetch", "pick=zero", "device=cpu"]),
    "play": (play.play, ["policy=zero", "viewer=none", "device=cpu"]),
    "bench": (bench.bench, ["what=env", "device=cpu"]),
}
KEYS = {
    "train": common.keys_of(train.Options, common.GROUPS),
    "distill": common.keys_of(distill.Options, common.GROUPS - {"algo"}),
    "eval": common.keys_of(measurement.Options, common.TASK_GROUPS),
    "play": common.keys_of(play.Options, common.TASK_GROUPS),
    "bench": common.keys_of(bench.Options, common.GROUPS | {"teacher"}),
}
# What nobody can mean, whatever the setting: each is refused everywhere.
NONSENSE = (math.nan, math.inf, -1e30, 10**400, {"a": {"b": 1}}, [[["x"]]])
# Settings of a kind -> what has another kind. A null may turn something off.
OTHER_KINDS = {
    bool: ("abc", 5, [1]),
    int: ("abc", [[1]], True),
    float: ("abc", [1.0], False),
    str: (5, []),
}
# Known to no command, or read only with others: bench measures nothing that has a teacher.
UNREAD = {"bench": {"teacher"}}


class Reached(Exception):
    """A command would have begun its work."""


@pytest.fixture(autouse=True)
def nothing_starts(monkeypatch, tmp_path):
    def reach(*_, **__):
        raise Reached

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(run_folder, "claimed", reach)
    monkeypatch.setattr(train, "_open_sources", lambda *_: None)  # no policy of dvo1a is shipped
    monkeypatch.setattr(evaluate, "_measure", reach)
    monkeypatch.setattr(play, "Players", reach)
    monkeypatch.setattr(bench, "_measure", reach)
    monkeypatch.setattr(bench, "_warn_if_busy", lambda: None)


def leaves(values, path=()):
    """Paths to every value that is no mapping, also those inside of lists."""
    children = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in children:
        inner = isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], list))
        if inner and value:
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value


def changed(values, path, value):
    values = copy.deepcopy(values)
    at = values
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    return values


def refusal(command, values, path=()):
    """What a command says of a configuration, None if it would begin; `path` is what the user has set."""
    name = command.split()[0]
    try:
        common.check_keys(name, values, KEYS[name])
        COMMANDS[command][0](common.Call(values, [*COMMANDS[command][1], ".".join(map(str, path)) + "=x"]))
    except Reached:
        return None
    except common.USER_ERRORS as error:
        return refusals.reason(error, name, ())
    raise AssertionError("it came to an end")


@pytest.fixture(scope="module")
def composed():
    return {command: compose(command.split()[0], given) for command, (_, given) in COMMANDS.items()}


def is_named(path, said):
    """Whether a message tells which setting is meant, or the group whose only one it is."""
    return any(str(part) in said for part in path[-3:] if isinstance(part, str))


def wrong_values(value):
    kinds = OTHER_KINDS.get(type(value), ("abc", 5) if isinstance(value, list) else ())
    return (*NONSENSE, *kinds)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_setting_takes_what_cannot_be_meant(command, composed):
    """All settings, each with two wrong values in turn; the commands have some hundred settings each."""
    values = composed[command]
    assert refusal(command, values) is None
    accepted, unnamed = [], []
    for number, (path, value) in enumerate(leaves(values)):
        if path[0] in UNREAD.get(command, ()):
            continue
        wrong = wrong_values(value)
        for chosen in {number % len(wrong), (3 * number + 1) % len(wrong)}:
            said = refusal(command, changed(values, path, wrong[chosen]), path)
            where = ".".join(map(str, path))
            if said is None:
                accepted.append((where, wrong[chosen]))
            elif "\n" in said or len(said) > 600 or not is_named(path, said):
                unnamed.append((where, wrong[chosen], said))
    assert accepted == [] and unnamed == []


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@pytest.mark.parametrize("command", ["train", "distill", "eval", "play", "bench"])
def test_any_value_anywhere_is_taken_or_refused_in_one_line(command, composed):
    values = composed[command]
    paths = [path for path, _ in leaves(values)]

    @settings(max_examples=60, derandomize=True, deadline=None, database=None)
    @given(st.sampled_from(paths), VALUES)
    def check(path, value):
        for at in range(1, len(path) + 1):  # the setting, and the groups that it is in
            said = refusal(command, changed(values, path[:at], value))
            assert said is None or "\n" not in said

    check()


@pytest.mark.parametrize("command", ["train", "distill", "eval", "play", "bench"])
def test_every_key_is_needed_and_no_other_is_taken(command, composed):
    values = composed[command]
    for key in values:
        if key not in ("reward", "robot", "depth", "scene", "sim"):  # a task's own defaults would do
            left = {name: value for name, value in values.items() if name != key}
            assert key in (refusal(command, left) or ""), key
    assert "bogus" in refusal(command, values | {"bogus": 1})
    for group in common.GROUPS & set(values):
        assert "bogus" in refusal(command, changed(values, (group, "bogus"), 1)), group


def test_the_walk_finds_a_setting_that_takes_anything(composed, monkeypatch):
    values = composed["bench"]
    monkeypatch.setattr(bench, "read_options", lambda *_: type("O", (), {"device": "cpu"}))
    assert refusal("bench", changed(values, ("sim", "substeps"), math.nan)) is None
