"""The behaviour analysis: its criteria on traces made by hand, and the analysis of whole episodes."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.analysis.behaviour import analysis, report
from spin_rl.analysis.behaviour.events import (
    FAILED,
    NOT_NEEDED,
    SHOWN,
    Event,
    arm_clearance,
    avoidance,
    events_of,
    rerouting,
    stop_and_look,
)
from spin_rl.analysis.behaviour.series import LABELS, series_of
from spin_rl.analysis.behaviour.tendencies import tendencies_of, tendency
from spin_rl.analysis.behaviour.trace import FAR_M, DriveTrace
from spin_rl.benchmark import registry
from spin_rl.cli import evaluate
from spin_rl.planning.solvability import scene_params
from spin_rl.scenes.layout import PoolSpec, Scene
from spin_rl.tasks.common.config import CurriculumConfig
from spin_rl.tasks.nav.config import NavConfig

DOF = {name: i for i, name in enumerate(robot.DOF_NAMES)}
SLOT = PoolSpec().first_box
STEPS = 80
REACH = registry.find("reach", "nav")


def trace(**changes):
    """Eight seconds along +x at half a metre a second, nothing near."""
    scene = Scene.empty(PoolSpec())
    scene.half_size[SLOT] = (0.15, 0.15, 0.2)
    scene.pos[SLOT] = (3.0, 5.0, 0.2)
    scene.active[SLOT] = True
    qpos = np.zeros((STEPS, len(DOF)))
    qpos[:, 0] = 0.05 * np.arange(STEPS)
    made = DriveTrace(
        condition="1 hard",
        seed=0,
        world=0,
        outcome="success",
        period=0.1,
        scene=scene,
        qpos=qpos,
        hand=np.tile((0.0, 5.0, 0.5), (STEPS, 1)),
        slot_pos=np.tile(scene.pos, (STEPS, 1, 1)),
        seen=np.zeros((STEPS, scene.pool.num_slots), dtype=bool),
    )
    return replace(made, **changes)


def entering(begin=30, **changes):
    """A box comes to x = 3 m within a second, from the side, while the base is at x = 1.5 m."""
    made = trace(**changes)
    pos = made.slot_pos.copy()
    share = np.clip((np.arange(STEPS) - begin) / 10, 0.0, 1.0)
    pos[:, SLOT, 1] = 1.5 * (1.0 - share)
    return replace(made, slot_pos=pos)


def turned_off(made, begin=42, yaw=0.6, until=60):
    """The base turns to the left from an observation on, and drives on in that direction for a while."""
    qpos = made.qpos.copy()
    heading = np.where((np.arange(STEPS) >= begin) & (np.arange(STEPS) < until), yaw, 0.0)
    qpos[:, 2] = heading
    step = 0.05 * np.stack([np.cos(heading), np.sin(heading)], -1)
    qpos[1:, :2] = np.cumsum(step[:-1], axis=0)
    return replace(made, qpos=qpos)


def stopped(made, begin=42, until=60, sweep=0.0):
    """The base stands for a while, in which the camera may sweep."""
    qpos = made.qpos.copy()
    stands = (np.arange(STEPS) >= begin) & (np.arange(STEPS) < until)
    qpos[1:, 0] = np.cumsum(np.where(stands[:-1], 0.0, 0.05))
    qpos[:, DOF["head_pan"]] = sweep * np.clip((np.arange(STEPS) - begin) / 5, 0.0, 1.0)
    return replace(made, qpos=qpos)


def results(found):
    return [event.result for event in found]


def test_a_trace_knows_what_is_near_and_in_the_way():
    made = entering(begin=0)
    distance, slot = made.nearest(made.obstacles)
    assert made.obstacles == [SLOT] and set(slot) == {SLOT}
    assert distance[-1] == pytest.approx(3.95 - 3.15) and distance[20] == pytest.approx(1.85)
    blocks = made.in_way(SLOT)
    # From 1.5 m before the box's side on, until its back is behind the base's front.
    places = made.qpos[blocks, 0]
    assert places.min() == pytest.approx(3.0 - 0.15 - 1.5 - 0.22, abs=0.15)
    assert places.max() == pytest.approx(3.0 + 0.15 + 0.22 - 0.06, abs=0.1)
    assert made.bearing(slot)[20] == pytest.approx(0.0, abs=1e-6)
    left = entering(begin=1000)
    assert np.degrees(left.bearing(np.full(STEPS, SLOT))[0]) == pytest.approx(26.6, abs=0.1)
    assert not left.in_way(SLOT).any()
    nothing = trace(scene=Scene.empty(PoolSpec()))
    assert (nothing.nearest(nothing.obstacles)[0] == FAR_M).all() and events_of(nothing) == []


def test_nothing_happens_where_nothing_moves_into_the_way():
    still = trace()
    standing = replace(still, slot_pos=np.tile((3.0, 0.0, 0.2), (STEPS, PoolSpec().num_slots, 1)))
    for made in (still, entering(begin=1000), standing):
        assert [*avoidance(made), *rerouting(made), *stop_and_look(made)] == []
    # A base that turns anyway is not driving straight on.
    turning = entering()
    turning.qpos[:, 2] = 0.1 * np.arange(STEPS) % 0.2
    assert list(rerouting(turning)) == []


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        (lambda made: made, {"avoidance": NOT_NEEDED, "stop": NOT_NEEDED, "rerouting": NOT_NEEDED}),
        (turned_off, {"avoidance": SHOWN, "stop": NOT_NEEDED, "rerouting": SHOWN}),
        (stopped, {"avoidance": SHOWN, "stop": NOT_NEEDED, "rerouting": NOT_NEEDED}),
        (lambda made: stopped(made, sweep=0.8), {"avoidance": SHOWN, "stop": SHOWN, "rerouting": NOT_NEEDED}),
        # Too short, too late, and a turn that does not lead aside.
        (lambda made: stopped(made, until=44, sweep=0.8), {"avoidance": SHOWN, "stop": NOT_NEEDED}),
        (
            lambda made: turned_off(made, begin=64, until=70),
            {"avoidance": NOT_NEEDED, "rerouting": NOT_NEEDED},
        ),
        (lambda made: turned_off(made, until=44), {"avoidance": SHOWN, "rerouting": NOT_NEEDED}),
    ],
)
def test_reactions_to_what_moves_into_the_way(change, shown):
    finders = {"avoidance": avoidance, "stop": stop_and_look, "rerouting": rerouting}
    made = change(entering())
    for name, expected in shown.items():
        (event,) = finders[name](made)
        assert event.result == expected and event.slot == SLOT, name
        assert 3.5 <= event.time_s <= 4.1


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"outcome": "collision", "hits": (("base", SLOT),)}, [FAILED]),
        ({"outcome": "collision", "hits": (("base", 0),)}, []),  # of a wall
        ({"outcome": "timeout"}, [FAILED]),
    ],
)
def test_failures_count_where_they_are_of_the_situation(changes, expected):
    assert results(rerouting(turned_off(entering(**changes)))) == expected


def floating(heights, **changes):
    """Something hangs at 0.5 to 0.9 m; the hand passes under its middle after four seconds."""
    made = trace(**changes)
    pos = made.slot_pos.copy()
    pos[:, SLOT] = (3.0, 0.0, 0.7)
    made.scene.pos[SLOT] = (3.0, 0.0, 0.7)
    hand = np.stack([made.qpos[:, 0] + 1.0, np.zeros(STEPS), heights], -1)
    return replace(made, slot_pos=pos, hand=hand)


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (0.6, 0.3, [SHOWN]),  # lowered under it
        (0.8, 1.1, [SHOWN]),  # raised over it
        (0.3, 0.3, [NOT_NEEDED]),
        (0.45, 0.41, [NOT_NEEDED]),  # hardly at all
    ],
)
def test_arm_clearance(before, after, expected):
    # It comes within 12 cm of the footprint at x = 2.73 m of the hand, after 3.46 s.
    heights = np.where(np.arange(STEPS) < 25, before, after)
    (event,) = arm_clearance(floating(heights))
    assert [event.result] == expected and event.time_s == pytest.approx(3.5, abs=0.1)
    assert results(arm_clearance(floating(np.where(np.arange(STEPS) < 10, before, after)))) == [NOT_NEEDED]


def test_arm_clearance_fails_by_a_hit_of_the_arm_alone():
    low = np.full(STEPS, 0.3)
    hit = {"outcome": "collision"}
    assert results(arm_clearance(floating(low, hits=(("wrist", SLOT),), **hit))) == [FAILED]
    assert results(arm_clearance(floating(low, hits=(("mast", SLOT),), **hit))) == []
    assert results(arm_clearance(floating(low, hits=(("mast", SLOT + 1),), **hit))) == [NOT_NEEDED]
    low_box = trace(hand=np.tile((3.0, 5.0, 0.5), (STEPS, 1)))
    assert list(arm_clearance(low_box)) == []  # it stands on the floor


def test_tendencies_are_differences_within_episodes():
    near = np.array([0.1, 0.2, 1.7, 1.8])
    samples = [(near, np.array([-0.8, -0.6, -0.3, -0.1]) + offset) for offset in (0.0, 5.0, -3.0)]
    found = tendency("t", "rad", samples, (0.0, 1.0, 2.0, np.inf), "m", lambda x: x < 1, lambda x: x > 1)
    assert found.difference == pytest.approx(-0.5) and found.ci95 == pytest.approx((-0.5, -0.5))
    assert found.episodes == 3 and found.counts == (6, 6, 0)
    assert found.means[2] is None and found.means[0] == pytest.approx(-0.7 + 2 / 3)
    noisy = [
        (near, values + shift * (near < 1))
        for (_, values), shift in zip(samples, (-0.1, 0.0, 0.1), strict=True)
    ]
    spread = tendency("t", "rad", noisy, (0.0, 2.0), "m", lambda x: x < 1, lambda x: x > 1)
    assert spread.ci95 == pytest.approx((-0.5 - 1.96 * 0.1 / np.sqrt(3), -0.5 + 1.96 * 0.1 / np.sqrt(3)))
    empty = tendency("t", "rad", [], (0.0, 1.0), "m", lambda x: x < 1, lambda x: x > 1)
    assert empty.difference is None and empty.ci95 is None and empty.means == (None,)


def test_tendencies_of_traces_follow_camera_hand_and_side():
    made = entering(begin=0)
    near = made.nearest(made.obstacles)[0] < 0.6
    qpos = made.qpos.copy()
    qpos[:, DOF["head_tilt"]] = np.where(near, -0.9, -0.2)
    found = tendencies_of([replace(made, qpos=qpos)])
    assert found["tilt"].difference == pytest.approx(-0.7)
    hung = floating(np.where(np.arange(STEPS) < 30, 0.6, 0.3))
    assert tendencies_of([hung])["hand"].difference == pytest.approx(-0.3, abs=0.05)
    assert found["hand"].difference is None  # nothing floats there
    sides = []
    for y, pan in ((0.5, 0.4), (-0.5, -0.4)):
        side = trace()
        side.slot_pos[:, SLOT] = (3.0, y, 0.2)
        side.qpos[:, DOF["head_pan"]] = pan
        sides.append(side)
    assert tendencies_of(sides)["pan"].means[2] == pytest.approx(-0.4)  # to the right, 45 to 15 degrees
    assert tendencies_of(sides)["pan"].means[4] == pytest.approx(0.4)


def test_counts():
    made = [
        *rerouting(turned_off(entering())),
        *rerouting(entering()),
        *rerouting(entering(outcome="timeout")),
    ]
    counted = analysis.count(made)
    assert (counted["situations"], counted["shown"], counted["not_needed"], counted["failed"]) == (3, 1, 1, 1)
    assert counted["shown_share"] == pytest.approx(1 / 3) and counted["ci95"][0] < 1 / 3 < counted["ci95"][1]
    assert analysis.count([])["shown_share"] is None


class Driver:
    """Drives ahead with everything stowed."""

    def __call__(self, obs):
        action = torch.zeros(obs.batch_size[0], len(robot.ACTIONS), device=obs.device)
        action[:, 0] = 1.0
        return action

    def reset(self, dones=None):
        pass


@pytest.fixture(scope="module")
def result(device):
    cfg = NavConfig(
        episode_s=3.0,
        curriculum=CurriculumConfig(enabled=False, start=1.0),
        scene=scene_params("moving"),
    )
    found = analysis.analyse_behaviour(
        REACH, lambda obs, device: Driver(), cfg, 4, [3], device,
        overrides=["scene=moving"], report=lambda line: None,
    )  # fmt: skip
    return json.loads(json.dumps(found, allow_nan=False))


def test_episodes_are_followed_to_their_end(make_nav_env):
    from spin_rl.analysis.behaviour.watch import BehaviourWatch
    from spin_rl.benchmark.reach import REACH_CELLS, run_cells

    env = make_nav_env(NavConfig(episode_s=2.0), num_envs=6)
    watch = BehaviourWatch(Driver(), env, seed=4)
    groups = run_cells(env, watch, REACH_CELLS, 1, report=lambda line: None)
    assert sorted(made.world for made in watch.traces) == list(range(6))
    for made in watch.traces:
        steps = int(groups[made.world].steps[0])
        assert made.steps == steps and made.seed == 4 and made.outcome in ("collision", "timeout")
        assert bool(made.hits) == (made.outcome == "collision") or made.outcome == "collision"
        assert made.seen.shape == (steps, env.sim.layout.pool.num_slots)
        assert made.qpos[-1, 0] != made.qpos[0, 0] and made.seen.any()
        reach = np.linalg.norm(made.hand[:, :2] - made.qpos[:, :2], axis=1)
        assert (reach < 1.0).all() and made.hand[:, 2].min() > 0.2


def test_events_of_a_whole_analysis_can_be_replayed(result):
    assert result["analysis"] == "behaviour" and set(result["tendencies"]) == {"tilt", "pan", "hand"}
    assert sum(count["situations"] for count in result["behaviours"].values()) == len(result["events"])
    for event in result["events"]:
        scenario, difficulty = event["condition"].split()
        assert event["play"].startswith(f"scenario={scenario} difficulty={difficulty} seed=3 world=")
        assert event["play"].endswith(" scene=moving") and event["result"] in (SHOWN, NOT_NEEDED, FAILED)


def test_report(result, tmp_path):
    text = report.table(result)
    assert text.startswith("Behaviour: policy, 4 episodes per condition (seeds 3)")
    assert "camera tilt near an obstacle" in text and "share shown" in text and "over 2 m" in text
    assert "-180 to -90 deg" in text and report.headline(result).startswith("avoidance ")
    some = [
        {"behaviour": "rerouting", "result": kind, "time_s": 1.0, "play": "seed=0"}
        for kind in (SHOWN, FAILED)
    ]
    chosen = report.examples(result | {"events": [*some, *some, *some]}, 2)
    assert len(chosen["rerouting, shown"]) == len(chosen["rerouting, failed"]) == 2
    pytest.importorskip("matplotlib")
    report.plot(result | {"events": []}, tmp_path / "new" / "behaviour.png")
    assert (tmp_path / "new" / "behaviour.png").stat().st_size > 10_000
    over_time = tmp_path / "new" / "behaviour_episodes.png"
    assert not over_time.exists()  # where nothing happened
    made = entering(begin=0)
    event = Event("avoidance", 2.0, SLOT, SHOWN)
    told = analysis._told(made, event, "seed=0") | {"series": series_of(made, event)}
    report.plot(result | {"events": [told]}, tmp_path / "new" / "behaviour.png")
    assert over_time.stat().st_size > 10_000


def test_examples_are_of_different_episodes_where_there_are():
    """One episode may have shown all behaviours: figures of it alone would say little."""
    one, other = trace(), trace(world=1)
    found = [
        (one, Event("avoidance", 1.0, SLOT, NOT_NEEDED)),
        (one, Event("avoidance", 2.0, SLOT, SHOWN)),
        (one, Event("stop and look", 2.0, SLOT, SHOWN)),
        (other, Event("stop and look", 3.0, SLOT, SHOWN)),
        (one, Event("rerouting", 2.0, SLOT, FAILED)),
    ]
    chosen = analysis.examples_of(found)
    assert chosen == [found[1][1], found[3][1], found[4][1]]  # of the last there is no other


def test_an_episode_over_time():
    made = entering(begin=0)
    event = Event("avoidance", 2.0, SLOT, SHOWN)
    qpos = made.qpos.copy()
    qpos[:, 2], qpos[:, DOF["head_tilt"]] = 0.01 * np.arange(STEPS), -0.3
    series = series_of(replace(made, qpos=qpos), event)
    assert set(LABELS) < set(series) and all(len(series[name]) == STEPS for name in LABELS)
    assert series["time_s"][20] == 2.0 and series["heading_rad"][20] == 0.0
    assert series["heading_rad"][30] == pytest.approx(0.1) and series["tilt_rad"][5] == -0.3
    assert series["speed_m_s"][5] == pytest.approx(0.5)
    np.testing.assert_allclose(series["distance_m"], made.distance(SLOT, made.qpos[:, :2]), atol=1e-4)
    assert series["obstacle_m"] == [0.0, 0.4] and not series["floats"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["analysis=behaviour", "benchmark=pick"], "analysis: behaviour needs benchmark=reach or"),
        (["analysis=failures", "videos=here"], "videos: only analysis=behaviour makes them"),
        (["analysis=behaviour", "videos=file"], "videos: file is a file"),
        (["analysis=behaviour", "num_envs=3"], "num_envs: all 300 episodes"),
    ],
)
def test_bad_input_is_one_line(monkeypatch, capfd, tmp_path, arguments, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    monkeypatch.setattr(sys, "argv", ["spin-eval", "policy=zero", *arguments])
    with pytest.raises(SystemExit) as stopped:
        evaluate.main()
    error = capfd.readouterr().err.strip()
    assert stopped.value.code == 2 and expected in error and "\n" not in error
