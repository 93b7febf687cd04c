"""Obstacles that move: what is drawn, where they are over time, and that the corridor stays passable."""

import dataclasses

import numpy as np
import pytest
import warp as wp
from scene_worlds import PARAMS, corners, distractors, generate, inputs, legs, obstacles, values

from spin_rl.scenes.corridors.generator import generate_layouts
from spin_rl.scenes.layout import Layout, PoolSpec, Scene
from spin_rl.scenes.motion import move_slots, restart_motion

MOVING = dataclasses.replace(PARAMS, emerging_share=0.4, patrolling_share=0.3)
DRAWN = ("home", "retreat", "motion_speed", "motion_trigger", "motion_phase")
POOL = PoolSpec(0, 2, 1)
DT = 0.02


class Mover:
    """A layout with robots that stand at given places, and the geoms that its slots are written to."""

    def __init__(self, layout, base):
        self.layout = layout
        slots = layout.pool.num_slots
        with wp.ScopedDevice(layout.device):
            self.qpos = wp.array(base, dtype=float)
            self.ids = wp.array(np.arange(slots)[::-1].copy(), dtype=wp.int32)
            self.xpos = wp.full((layout.nworld, slots), wp.vec3(7.0, 7.0, 7.0), dtype=wp.vec3)

    def restart(self, mask=None):
        mask = np.ones(self.layout.nworld, dtype=bool) if mask is None else mask
        restart_motion(self.layout, wp.array(mask, dtype=bool, device=self.layout.device))

    def step(self):
        move_slots(self.layout, self.qpos, DT, self.ids, self.xpos)

    def pos(self):
        return self.layout.pos.numpy().copy()


def tracks(device, bases) -> Mover:
    """World by world: a box that comes out, one that goes to and fro, and a cylinder that stays."""
    scene = Scene.empty(POOL)
    scene.active[:] = True
    scene.pos[:] = scene.home[:] = [(2.0, 0.3, 0.1), (4.0, -0.2, 1.2), (1.0, 0.0, 0.3)]
    scene.retreat[:2] = [(0.0, 0.4), (-0.3, -0.4)]
    scene.motion_speed[:2] = (0.9, 0.7)
    scene.motion_trigger[0] = 1.5
    scene.motion_phase[1] = 0.3
    layout = Layout(len(bases), POOL, device)
    layout.load(scene)
    mover = Mover(layout, bases)
    mover.restart()
    return mover


def test_positions_follow_the_formulas(device):
    # World 0's robot is within 1.5 m of where the box comes out; world 1's is not.
    mover = tracks(device, [(0.6, 0.0), (0.4, 0.0)])
    assert mover.pos()[:, 0, 1] == pytest.approx(0.7)
    for step in range(1, 120):
        mover.step()
        pos, gone = mover.pos(), step * DT
        out = np.clip(1.0 - 0.9 * gone / 0.4, 0.0, 1.0)
        np.testing.assert_allclose(pos[0, 0], (2.0, 0.3 + 0.4 * out, 0.1), atol=1e-5)
        np.testing.assert_allclose(pos[1, 0], (2.0, 0.7, 0.1), atol=1e-6)
        share = np.interp((0.3 + 0.7 * gone / (2 * 0.5)) % 1.0, (0.0, 0.5, 1.0), (1.0, 0.0, 1.0))
        np.testing.assert_allclose(pos[:, 1], [(4.0 - 0.3 * share, -0.2 - 0.4 * share, 1.2)] * 2, atol=1e-5)
        assert (pos[:, 2] == np.float32((1.0, 0.0, 0.3))).all()
    geoms = mover.xpos.numpy()
    assert (geoms[0, ::-1][:2] == pos[0, :2]).all()  # slot i is geom 2 - i
    assert (geoms[1, ::-1][1] == pos[1, 1]).all()
    assert (geoms[:, 0] == 7.0).all() and (geoms[1, 2] == 7.0).all()


def test_what_has_started_to_come_out_goes_on_when_the_robot_leaves(device):
    mover = tracks(device, [(0.6, 0.0)])
    mover.step()
    mover.qpos.assign([(-5.0, 0.0)])
    for _ in range(100):
        mover.step()
    assert mover.pos()[0, 0, 1] == pytest.approx(0.3)


def test_inactive_slots_stay_where_they_are(device):
    mover = tracks(device, [(0.6, 0.0)])
    mover.layout.active.fill_(False)
    mover.step()
    assert (mover.xpos.numpy() == 7.0).all()


def test_a_restart_leaves_neighbours_alone(device):
    mover = tracks(device, [(0.6, 0.0)] * 3)
    first = mover.pos()
    for _ in range(9):
        mover.step()
    later, moved = mover.pos(), mover.layout.moved.numpy().copy()
    mover.restart(np.array([False, True, False]))
    now = mover.pos()
    assert (now[1] == first[1]).all() and (now[1, :2] != later[1, :2]).any()
    assert (now[[0, 2]] == later[[0, 2]]).all()
    assert (mover.layout.moved.numpy()[[0, 2]] == moved[[0, 2]]).all()


def test_corridors_are_the_same_bits_with_and_without_motion(device):
    still, moving = values(generate(64, device, seed=3)), values(generate(64, device, seed=3, params=MOVING))
    for name in still:
        assert np.array_equal(still[name], moving[name]) == (name not in DRAWN), name


def test_the_same_seed_gives_the_same_motion_and_another_draw_does_not(device):
    first, again = (values(generate(32, device, seed=5, params=MOVING)) for _ in range(2))
    for name in DRAWN:
        assert np.array_equal(first[name], again[name]), name
    speeds = first["motion_speed"][first["motion_speed"] > 0.0]
    assert len(np.unique(speeds)) == len(speeds) > 20
    layout, arguments = Layout(32, PoolSpec(), device), inputs(32, device, seed=5)
    for _ in range(2):
        generate_layouts(layout, MOVING, **arguments)
    assert not np.isin(speeds, values(layout)["motion_speed"]).any()


def test_other_worlds_keep_their_motion(device):
    layout = generate(8, device, seed=1, difficulty=2, params=MOVING)
    before = values(layout)
    mask = np.arange(8) % 2 == 0
    generate_layouts(layout, MOVING, **inputs(8, device, seed=2, mask=mask))
    after = values(layout)
    for name in DRAWN:
        assert np.array_equal(before[name][~mask], after[name][~mask]), name
    assert not np.array_equal(before["motion_speed"][mask], after["motion_speed"][mask])


def test_shares_ranges_and_who_may_move(device):
    coming, patrolling, far = [], [], 0
    for scene in generate(400, device, seed=2, difficulty=2, params=MOVING).scenes():
        away = np.linalg.norm(scene.pos[:, :2] - scene.start[:2], axis=1)
        fixed = [*np.flatnonzero(scene.is_wall), *distractors(scene), *np.flatnonzero(~scene.active)]
        assert not scene.motion_speed[fixed].any()
        for slot in obstacles(scene):
            far += away[slot] > MOVING.emerging_trigger[1]
            if scene.motion_speed[slot] > 0.0:
                trigger = scene.motion_trigger[slot]
                assert away[slot] > (trigger or 1.0)
                if away[slot] > MOVING.emerging_trigger[1]:
                    (coming if trigger else patrolling).append((scene, slot))
    assert len(coming) / far == pytest.approx(0.4, abs=0.04)
    assert len(patrolling) / far == pytest.approx(0.3, abs=0.04)
    for kind, name, (low, high) in (
        (coming, "motion_trigger", MOVING.emerging_trigger),
        (coming + patrolling, "motion_speed", MOVING.motion_speed),
        (patrolling, "motion_phase", (0.0, 1.0)),
    ):
        drawn = np.array([getattr(scene, name)[slot] for scene, slot in kind])
        assert low <= drawn.min() < low + 0.05 * (high - low)
        assert high >= drawn.max() > high - 0.05 * (high - low)


@pytest.mark.parametrize(("scenario", "level"), [(1, 0.0), (1, 1.0), (2, 0.0), (2, 1.0)])
def test_obstacles_wait_in_their_wall_and_leave_the_passage(scenario, level, device):
    width = PARAMS.easy_width + level * (PARAMS.width - PARAMS.easy_width)
    layout = generate(100, device, scenario=scenario, difficulty=2, level=level, params=MOVING)
    drawn = layout.scenes()
    mover = Mover(layout, [scene.goal for scene in drawn])
    mover.restart()
    waiting = layout.scenes()
    sides = set()
    for was, now in zip(drawn, waiting, strict=True):
        for slot in np.flatnonzero(was.motion_trigger > 0.0):
            points = corners(now, slot)
            leg = leg_of(corners(was, slot), legs(was, width))
            across = int(np.argmin(leg[1] - leg[0]))
            below, above = leg[0][across] - points[:, across].max(), points[:, across].min() - leg[1][across]
            assert max(below, above) == pytest.approx(0.03, abs=1e-3)
            sides.add((across, below > above))
            # To the nearer wall, straight across.
            assert np.abs(now.pos[slot] - was.pos[slot])[1 - across] < 1e-6
    assert len(sides) == (2 if scenario == 1 else 4)
    reduced = []
    for _ in range(40):
        mover.step()
        for was, now in zip(drawn, layout.scenes(), strict=True):
            for slot in np.flatnonzero(was.motion_speed > 0.0):
                leg = leg_of(corners(was, slot), legs(was, width))
                across = int(np.argmin(leg[1] - leg[0]))
                points = corners(now, slot)[:, across]
                free = max(points.min() - leg[0][across], leg[1][across] - points.max())
                assert free >= PARAMS.passage - 1e-4
                reduced.append(np.linalg.norm(now.pos[slot] - was.pos[slot]))
    assert min(reduced) < 0.01 and max(reduced) > 0.4


def leg_of(points, rectangles):
    """The leg of the corridor that an obstacle stands in."""
    inside = [(points > low - 1e-4).all() and (points < high + 1e-4).all() for low, high in rectangles]
    return rectangles[inside.index(True)]


def test_graph_replay_equals_eager(device):
    def make():
        layout = Layout(16, PoolSpec(), device)
        return Mover(layout, np.linspace((0.0, 0.0), (4.0, 0.0), 16)), inputs(16, device, difficulty=2)

    def launch(mover, arguments):
        generate_layouts(mover.layout, MOVING, **arguments)
        restart_motion(mover.layout, arguments["mask"])
        for _ in range(30):
            mover.step()

    eager, replayed = make(), make()
    with wp.ScopedDevice(device):
        launch(*make())
        with wp.ScopedCapture() as capture:
            launch(*replayed)
        for _ in range(2):
            launch(*eager)
            wp.capture_launch(capture.graph)
    for name, value in values(eager[0].layout).items():
        assert np.array_equal(value, values(replayed[0].layout)[name]), name
    assert np.array_equal(eager[0].xpos.numpy(), replayed[0].xpos.numpy())
    moved = eager[0].layout.moved.numpy()
    assert (moved > 0.0).sum() > 10 and np.array_equal(moved, replayed[0].layout.moved.numpy())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"emerging_share": 0.7, "patrolling_share": 0.4}, "scene.emerging_share, patrolling_share"),
        ({"patrolling_share": -0.1}, "scene.patrolling_share must not be negative"),
        ({"motion_speed": (0.0, 1.0)}, "scene.motion_speed"),
        ({"emerging_share": 0.1, "emerging_trigger": (1.0, 1.5)}, "scene.emerging_trigger must be at least"),
        ({"emerging_share": 0.1, "motion_speed": (0.3, 1.0)}, "scene.emerging_trigger must be at least"),
        ({"hard_obstacles": 8}, "scene.hard_obstacles"),
    ],
)
def test_bad_parameters_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(PARAMS, **change)


def test_hard_corridors_have_as_many_obstacles_as_asked_for(device):
    params = dataclasses.replace(PARAMS, length=8.0, first_leg=(3.0, 5.0), hard_obstacles=7)
    for scenario in (1, 2):
        got = values(generate(100, device, scenario=scenario, difficulty=2, params=params))
        assert (got["num_obstacles"] == 7).mean() > 0.99
    mixed = values(generate(200, device, level=0.5, params=params))
    assert mixed["num_obstacles"].max() == 4
