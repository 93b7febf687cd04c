"""A run's log: replayed, it gives the same actions; cut off, what is left of it does."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from fake_robot import STATE, FakeRobot

from spin_rl.config import ConfigError
from spin_rl.deploy.agent import Agent
from spin_rl.deploy.log import RunLog, pack_image, read_log, unpack_image
from spin_rl.deploy.loop import ControlLoop
from spin_rl.deploy.replay import replay

OBJECT = np.array([0.1, -0.7, 0.8])


def noisy(rng):
    def measure(fake, state):
        fake.image = rng.uniform(0.0, 5.0, (116, 174)).astype(np.float32)
        return replace(state, joints=state.joints + rng.normal(scale=0.01, size=8))

    return measure


def record(network, path, seed=0, **aims):
    fake = FakeRobot(faults=dict.fromkeys(range(100), noisy(np.random.default_rng(seed))))
    camera = replace(fake.connection.camera, width=174, height=116)
    fake.connection = replace(fake.connection, camera=camera)
    fake.image = np.full((116, 174), 2.0, dtype=np.float32)
    log = RunLog(path, {"name": network.contract.name})
    outcome = ControlLoop(fake, fake.connect(), Agent(network), log).run(3.0, **aims)
    log.close()
    return outcome


@pytest.fixture
def run(nav_network, tmp_path):
    record(nav_network, tmp_path / "run.jsonl", goal=np.array([3.0, 1.0]))
    return tmp_path / "run.jsonl"


def test_a_replay_gives_the_same_actions(run, nav_network):
    result = replay(read_log(run), Agent(nav_network))
    assert (result.steps, result.action_error, result.command_error) == (30, 0.0, 0.0) and result.agrees
    logged = [step.action for step in read_log(run).steps()]
    assert np.ptp(logged, axis=0).min() > 1e-4  # the policy did react


def test_an_episode_leaves_nothing_behind(run, nav_network):
    agent = Agent(nav_network)
    assert all(replay(read_log(run), agent).agrees for _ in range(2))


def test_picking_is_replayed_too(pick_network, tmp_path):
    path = tmp_path / "pick.jsonl"
    record(pick_network, path, object_b=OBJECT)
    result = replay(read_log(path), Agent(pick_network))
    assert result.steps == 30 and result.agrees and read_log(path).goal is None


def test_a_difference_is_found(run, nav_network):
    lines = run.read_text().splitlines()
    tick = next(line for line in lines if '"tick": 7' in line)
    changed = tick.replace('"base_velocity": [0.0, 0.0]', '"base_velocity": [0.01, 0.0]')
    assert changed != tick
    run.write_text("\n".join(changed if line == tick else line for line in lines))
    result = replay(read_log(run), Agent(nav_network))
    assert not result.agrees and result.first == 7 and result.action_error > 1e-6
    assert replay(read_log(run), Agent(nav_network, speed_scale=0.5)).first == 0


def test_what_a_crash_leaves_can_be_read(run, nav_network):
    whole = run.read_bytes()
    run.write_bytes(whole[: int(0.6 * len(whole))])
    logged = read_log(run)
    result = replay(logged, Agent(nav_network))
    assert logged.end is None and 5 < result.steps < 30 and result.agrees


@pytest.mark.parametrize("content", ["", "no json", '{"format": 99}', "[1, 2]", '{"format": 1}'])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "log.jsonl"
    path.write_text(content)
    with pytest.raises(ConfigError, match=r"^replay: .*log\.jsonl"):
        read_log(path)
    with pytest.raises(ConfigError, match="no file"):
        read_log(tmp_path / "none.jsonl")


def damaged(lines):
    """Every value of a log, missing and of other kinds, one at a time."""
    for number, line in enumerate(lines):
        for path in leaves(line):
            for value in ("missing", None, "x", [], [1.0, "y"], {"a": 1}, -1e300):
                changed = copy.deepcopy(lines)
                *above, last = path
                at = changed[number]
                for key in above:
                    at = at[key]
                at.pop(last)
                if value != "missing":
                    at[last] = value
                yield changed


def leaves(line, above=()):
    for key, value in line.items():
        yield (*above, key)
        if isinstance(value, dict):
            yield from leaves(value, (*above, key))


def test_damage_is_one_line(run, nav_network, tmp_path):
    begin, start, first, *_, end = [json.loads(line) for line in run.read_text().splitlines()]
    refused, path = 0, tmp_path / "damaged.jsonl"
    for lines in damaged([begin, start, first, end]):
        path.write_text("\n".join(map(json.dumps, lines)))
        try:
            replay(read_log(path), Agent(nav_network))
        except ConfigError as error:
            assert str(error).startswith(("replay", "goal: ")) and "\n" not in str(error)
            refused += 1
    assert refused > 100


def spoil(log, line, *keys, value=None):
    """Change an entry of a line, or leave it out."""
    lines = [json.loads(text) for text in log.read_text().splitlines()]
    place = lines[line]
    for key in keys[:-1]:
        place = place[key]
    if value is None:
        del place[keys[-1]]
    else:
        place[keys[-1]] = value
    log.write_text("\n".join(map(json.dumps, lines)))


@pytest.mark.parametrize(
    ("spot", "value"),
    [
        ((1, "goal"), None),
        ((1, "goal"), "x"),
        ((1, "start", "joints"), None),
        ((3, "state"), None),
        ((3, "state", "joints"), ["x"] * 8),
        ((3, "depth"), None),
        ((3, "depth"), False),
        ((3, "depth", "zlib_f4"), "AAAA"),
        ((3, "depth", "shape"), [1, 1]),
        ((3, "command", "turn"), None),
        ((3, "action"), [[1.0], [2.0, 3.0]]),
    ],
)
def test_damaged_logs_are_one_line(run, nav_network, spot, value):
    spoil(run, *spot, value=value)
    with pytest.raises(ConfigError, match=r"^(replay: .*run\.jsonl is damaged|goal: )") as caught:
        replay(read_log(run), Agent(nav_network))
    assert "\n" not in str(caught.value)


def test_a_step_without_its_image_is_damage(run, nav_network):
    text = run.read_text().splitlines()
    line = json.loads(text[3])
    line["depth"] = None
    run.write_text("\n".join([*text[:3], json.dumps(line), *text[4:]]))
    with pytest.raises(ConfigError, match="no image at tick 1"):
        replay(read_log(run), Agent(nav_network))


def test_nothing_moved_is_nothing_that_agrees(nav_network, tmp_path):
    log = RunLog(tmp_path / "run.jsonl", {})
    log.start(STATE, np.zeros(2), None)
    log.close()
    assert not replay(read_log(tmp_path / "run.jsonl"), Agent(nav_network)).agrees


def test_images_keep_all_their_digits():
    image = np.random.default_rng(1).uniform(0.0, 9.0, (7, 5)).astype(np.float32)
    np.testing.assert_array_equal(unpack_image(pack_image(image[::-1])), image[::-1])
