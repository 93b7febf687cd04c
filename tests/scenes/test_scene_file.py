"""Scene files: what they mean, and one line for whatever is wrong with them."""

import copy
import time

import numpy as np
import pytest
import warp as wp
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from spin_rl import robot
from spin_rl.config import ConfigError
from spin_rl.scenes.motion import restart_motion
from spin_rl.scenes.scene_file import layout_from_scene, load_scene, scene_pool

GOOD = {
    "start": {"position": [0.5, -0.25], "yaw": 1.0},
    "goal": [4.0, 1.0],
    "joints": {"lift": 0.8},
    "walls": [{"position": [2.0, 2.0], "size": [6.0, 0.1, 1.5], "yaw": 0.1}],
    "boxes": [{"position": [2.0, 0.0, 1.3], "size": [0.3, 0.4, 0.2], "yaw": -0.5}],
    "cylinders": [{"position": [3, 0], "radius": 0.1, "height": 0.4}],
}


PIECES = [
    b"&a ",
    b"*a",
    b"!!int ",
    b"- ",
    b": ",
    b"? ",
    b"{",
    b"]",
    b"\n",
    b"\t",
    b"#",
    b"'",
    b"|\n",
    b"~",
    b"1e999",
    b"<<: ",
]
MOTION = {"to": [1.0, 1.0], "speed": 1.0}


def write(tmp_path, content):
    path = tmp_path / "scene.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def changed(*path, value=None, delete=False):
    """GOOD with one entry replaced, added or deleted."""
    content = copy.deepcopy(GOOD)
    at = content
    for key in path[:-1]:
        at = at[key]
    if delete:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return content


def test_numbers_arrive_where_they_belong(tmp_path, device):
    scene = load_scene(write(tmp_path, GOOD))
    layout = layout_from_scene(scene, 3, device)
    assert (scene_pool(scene).num_walls, scene_pool(scene).num_boxes, scene_pool(scene).num_cylinders) == (
        1,
        1,
        1,
    )
    assert layout.active.numpy().all() and layout.num_obstacles.numpy().tolist() == [2, 2, 2]
    for world in range(3):
        np.testing.assert_allclose(
            layout.pos.numpy()[world], [(2, 2, 0.75), (2, 0, 1.3), (3, 0, 0.2)], atol=1e-6
        )
        np.testing.assert_allclose(
            layout.half_size.numpy()[world], [(3, 0.05, 0.75), (0.15, 0.2, 0.1), (0.1, 0.1, 0.2)], atol=1e-6
        )
        np.testing.assert_allclose(layout.yaw.numpy()[world], [0.1, -0.5, 0.0], atol=1e-6)
        np.testing.assert_allclose(layout.start.numpy()[world], [0.5, -0.25, 1.0], atol=1e-6)
        np.testing.assert_allclose(layout.goal.numpy()[world], [4.0, 1.0], atol=1e-6)
        joints = dict(robot.STOWED) | {"lift": 0.8}
        np.testing.assert_allclose(
            layout.start_joints.numpy()[world], [joints[name] for name in robot.JOINTS], atol=1e-6
        )


def test_motion_arrives_where_it_belongs(tmp_path, device):
    comes = {"to": [2.0, 0.5], "speed": 0.8, "trigger": 1.2}
    content = changed("boxes", 0, "motion", value=comes)
    content["cylinders"][0]["motion"] = {"to": [3, -1], "speed": 1}
    layout = layout_from_scene(load_scene(write(tmp_path, content)), 2, device)
    for world in range(2):
        scene = layout.scene(world)
        np.testing.assert_allclose(scene.pos, [(2, 2, 0.75), (2, 0, 1.3), (3, 0, 0.2)], atol=1e-6)
        np.testing.assert_allclose(scene.home[1:], [(2, 0.5, 1.3), (3, -1, 0.2)], atol=1e-6)
        np.testing.assert_allclose(scene.home[1:, :2] + scene.retreat[1:], scene.pos[1:, :2], atol=1e-6)
        np.testing.assert_allclose(scene.motion_speed, [0, 0.8, 1], atol=1e-6)
        np.testing.assert_allclose(scene.motion_trigger, [0, 1.2, 0], atol=1e-6)
        assert scene.moves
    # It starts at its position.
    restart_motion(layout, wp.full(2, True, dtype=bool, device=device))
    np.testing.assert_allclose(layout.pos.numpy()[1], scene.pos, atol=1e-6)


def test_the_goal_may_lie_where_something_is_only_for_a_time(tmp_path):
    away = changed("cylinders", 0, "motion", value={"to": [3.0, 2.0], "speed": 1.0})
    away["goal"] = [3.0, 0.05]
    load_scene(write(tmp_path, away))
    away["cylinders"][0]["motion"]["trigger"] = 2.0
    load_scene(write(tmp_path, away))
    away["goal"] = [3.0, 2.05]
    with pytest.raises(ConfigError, match="goal: lies inside cylinder_0"):
        load_scene(write(tmp_path, away))


def test_three_hundred_obstacles_load(tmp_path, device):
    many = [{"position": [i % 20 + 2.0, i // 20 + 2.0], "size": [0.1, 0.1, 0.1]} for i in range(300)]
    scene = load_scene(write(tmp_path, {"start": GOOD["start"], "goal": [1, 0], "boxes": many}))
    assert layout_from_scene(scene, 1, device).active.numpy().sum() == 300
    with pytest.raises(ConfigError, match="at most 300"):
        load_scene(write(tmp_path, {"start": GOOD["start"], "goal": [1, 0], "boxes": many + many[:1]}))


def test_an_empty_floor_is_a_scene(tmp_path):
    scene = load_scene(write(tmp_path, {"start": GOOD["start"], "goal": [1, 0]}))
    assert not scene.active.any() and scene.pool.num_slots == 1


BAD = {
    "unknown top key": (changed("wals", value=[]), "unknown key 'wals'"),
    "unknown slot key": (changed("boxes", 0, "colour", value=1), r"boxes\[0\]: unknown key 'colour'"),
    "unknown joint": (changed("joints", "elbow", value=1.0), "joints: unknown key 'elbow'"),
    "radius on a box": (changed("boxes", 0, "radius", value=1), r"boxes\[0\]: unknown key 'radius'"),
    "missing goal": (changed("goal", delete=True), "goal is missing"),
    "missing size": (changed("walls", 0, "size", delete=True), r"walls\[0\]: size is missing"),
    "moving wall": (changed("walls", 0, "motion", value=MOTION), r"walls\[0\]: unknown key 'motion'"),
    "motion without speed": (
        changed("boxes", 0, "motion", value={"to": [1, 1]}),
        r"boxes\[0\].motion: speed is missing",
    ),
    "motion upwards": (
        changed("boxes", 0, "motion", value=MOTION | {"to": [1, 1, 1]}),
        r"boxes\[0\].motion.to: expected a list of 2",
    ),
    "motion that stands": (
        changed("boxes", 0, "motion", value=MOTION | {"speed": 0}),
        r"boxes\[0\].motion.speed: must be positive",
    ),
    "motion to where it is": (
        changed("boxes", 0, "motion", value=MOTION | {"to": [2.0, 0.0]}),
        r"boxes\[0\].motion.to: must differ from the position",
    ),
    "motion that never starts": (
        changed("cylinders", 0, "motion", value=MOTION | {"trigger": -1}),
        r"cylinders\[0\].motion.trigger: must be positive",
    ),
    "motion with a typing error": (
        changed("cylinders", 0, "motion", value=MOTION | {"sped": 1}),
        r"cylinders\[0\].motion: unknown key 'sped'",
    ),
    "unknown piece": (
        {**GOOD, "furniture": [{"piece": "char", "position": [1, 1]}]},
        r"furniture\[0\].piece: unknown 'char'; choose from chair",
    ),
    "piece that stands nowhere": (
        {**GOOD, "furniture": [{"piece": "chair"}]},
        r"furniture\[0\]: position is missing",
    ),
    "pieces without names": ({**GOOD, "pieces": [1]}, r"pieces: expected names, got \[1\]"),
    "bad part of a piece": (
        {
            **GOOD,
            "furniture": [{"piece": "own", "position": [5, 5]}],
            "pieces": {"own": {"boxes": [{"position": [0, 0], "size": [1, 1]}]}},
        },
        r"pieces.own.boxes\[0\].size: expected a list of 3",
    ),
    "piece that moves": (
        {
            **GOOD,
            "furniture": [{"piece": "own", "position": [5, 5]}],
            "pieces": {"own": {"boxes": [{"position": [0, 0], "size": [1, 1, 1], "motion": MOTION}]}},
        },
        r"pieces.own.boxes\[0\]: unknown key 'motion'",
    ),
    "missing height": (changed("cylinders", 0, "height", delete=True), r"cylinders\[0\]: height is missing"),
    "short size": (changed("boxes", 0, "size", value=[1.0, 1.0]), r"boxes\[0\].size: expected a list of 3"),
    "long position": (changed("boxes", 0, "position", value=[1, 1, 1, 1]), r"boxes\[0\].position: .* 2 or 3"),
    "long goal": (changed("goal", value=[1, 1, 1]), "goal: expected a list of 2"),
    "negative size": (
        changed("boxes", 0, "size", value=[1.0, -1.0, 1.0]),
        r"boxes\[0\].size: must be positive",
    ),
    "zero radius": (changed("cylinders", 0, "radius", value=0), r"cylinders\[0\].radius: must be positive"),
    "not a number": (changed("boxes", 0, "yaw", value=float("nan")), r"boxes\[0\].yaw: expected a number"),
    "infinite": (changed("goal", value=[float("inf"), 0]), "goal: expected a number"),
    "huge": (changed("goal", value=[10**400, 0]), "goal: expected a number"),
    "text": (changed("start", "yaw", value="left"), "start.yaw: expected a number"),
    "boolean": (changed("start", "yaw", value=True), "start.yaw: expected a number"),
    "boxes not a list": (changed("boxes", value={"a": 1}), "boxes: expected a list"),
    "joint out of range": (changed("joints", "lift", value=2.0), r"joints.lift: must be in \[0.0, 1.1\]"),
    "list at the top": ([1, 2], "the scene: expected keys"),
    "empty file": ("", "the scene: expected keys"),
    "broken YAML": ("start: [1, 2\ngoal: }", "not valid YAML at line 2"),
    "impossible date": ("start: 2020-99-99", "not valid YAML"),
    "start in a box": (changed("start", "position", value=[3.0, 0.2]), "start: .* collision .*cylinder_0"),
    "start under a box": (
        changed("start", "position", value=[2.1, -0.05]),
        r"start: .* collision \(.*box_0|start: .* collision \(box_0",
    ),
    "goal at the start": (changed("goal", value=[0.5, -0.2]), "goal: must be at least 0.2 m from the start"),
    "the same key twice": (
        "start: {position: [0, 0]}\ngoal: [3, 0]\ngoal: [4, 0]\n",
        "line 3: the key 'goal' is",
    ),
    "a tag that does not fit": ("start: !!bool abc\ngoal: [3, 0]\n", "not valid YAML: KeyError"),
    "a tag of Python": ("start: !!python/object/apply:os.getcwd []", "not valid YAML at line 1"),
    "a list as a key": ("? [1, 2]\n: 3\n", "not valid YAML"),
    "20 MB of comment": ("#" * 20_000_000, "larger than 256 kB"),
    "too many values": ("goal: [" + "1," * 60_000 + "]", "more than 50000 values"),
    "aliases of aliases": (
        "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 11)),
        "more than 50000 values",
    ),
    "an alias of itself": ("start: &a [*a]", "stands for nothing yet"),
    "lists in lists": ("goal: " + "[" * 200 + "]" * 200, "more than 20 lists"),
    "lists without an end": ("goal: " + "[" * 200_000, "not valid YAML|more than"),
    "goal inside": (changed("goal", value=[3.0, 0.05]), "goal: lies inside cylinder_0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_get_one_line_with_file_and_key(case, tmp_path):
    content, message = BAD[case]
    path = write(tmp_path, content)
    start = time.process_time()
    with pytest.raises(ConfigError, match=message) as caught:
        load_scene(path)
    assert time.process_time() - start < 1.0
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_any_file_is_a_scene_or_refused_in_one_line(tmp_path):
    """Bytes of a good file are replaced; what is then read is read, and nothing else happens."""
    content = yaml.safe_dump(GOOD).encode()
    path = tmp_path / "scene.yaml"

    @settings(max_examples=150, derandomize=True, deadline=None, database=None)
    @given(st.integers(0, len(content)), st.integers(0, 6), st.binary(max_size=6) | st.sampled_from(PIECES))
    def check(at, length, inserted):
        path.write_bytes(content[:at] + inserted + content[at + length :])
        try:
            load_scene(path)
        except ConfigError as error:
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)

    check()


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match=r"nothing.yaml: cannot read the file"):
        load_scene(tmp_path / "nothing.yaml")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not a text file"):
        load_scene(binary)
