"""Properties of scenes of all families."""

import dataclasses

import mujoco
import numpy as np
import pytest
import warp as wp
from omegaconf import OmegaConf
from room_worlds import distances, generate, inputs, only
from scene_worlds import corners, values
from scipy import ndimage
from scipy.spatial import distance as spatial

from spin_rl import robot
from spin_rl.config import ConfigError, from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.planning.distance_field import DistanceField
from spin_rl.planning.solvability import scene_params
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.corridors.params import GeneratorParams
from spin_rl.scenes.kinds import FAMILIES
from spin_rl.scenes.layout import Layout, PoolSpec
from spin_rl.scenes.rooms.arrange import CLOSE
from spin_rl.scenes.rooms.generator import FamilyGenerator
from spin_rl.scenes.rooms.params import (
    BLOCKED_M,
    HALF_SQUARE_M,
    FamilyParams,
    RoomParams,
    Shares,
    WalkerParams,
    scene_class,
)

PARAMS = FamilyParams()
NUM_WORLDS = 200
STOWED = np.array([robot.STOWED[joint] for joint in robot.JOINTS])


@pytest.fixture(scope="module")
def mixed(device):
    """All families in proportion to their shares."""
    return generate(NUM_WORLDS, device, PARAMS, seed=11)


@pytest.fixture(scope="module", params=FAMILIES)
def family(request, device):
    """Name and layout of every family alone."""
    return request.param, generate(60, device, only(request.param), seed=5)


def test_families_come_in_their_shares(mixed):
    drawn = np.bincount(mixed.family.numpy(), minlength=len(FAMILIES)) / NUM_WORLDS
    shares = np.array(dataclasses.astuple(PARAMS.shares)) / sum(dataclasses.astuple(PARAMS.shares))
    assert np.abs(drawn - shares).max() < 4 * np.sqrt(0.25 / NUM_WORLDS)


def test_a_family_can_be_drawn_alone(family):
    name, layout = family
    assert (layout.family.numpy() == FAMILIES.index(name)).all()


def test_everything_lies_in_the_square_and_stands_on_the_floor_or_above(family):
    _, layout = family
    for scene in layout.scenes():
        assert np.abs(scene.start[:2]).max() <= HALF_SQUARE_M and np.abs(scene.goal).max() <= HALF_SQUARE_M
        for slot in np.flatnonzero(scene.active):
            reach = np.abs(corners(scene, slot))
            if scene.motion_speed[slot] > 0.0:
                reach = np.concatenate((reach, np.abs(corners(scene, slot) + scene.retreat[slot])))
            assert reach.max() <= HALF_SQUARE_M + 1e-4
            assert scene.pos[slot, 2] - scene.half_size[slot, 2] > -1e-5
            assert (scene.half_size[slot] > 0.0).all()


def test_counts_are_within_their_ranges(family):
    name, layout = family
    got = values(layout)
    walls = got["active"][:, : PARAMS.pool.num_walls].sum(axis=1)
    fewest, most = {
        "corridor": (4, 14), "room": (4, 8), "doorway": (6, 8),
        "field": (0, 0), "crossing": (7, 12), "open": (0, 0), "shuttle": (4, 4),
    }[name]  # fmt: skip
    assert walls.min() >= fewest and walls.max() <= most
    count = got["num_obstacles"]
    if name == "field":
        # As many as drawn, less those that no place was found for.
        assert count.max() <= PARAMS.field.things[1] + 1 and count.min() >= PARAMS.field.things[0] - 2
        assert (got["active"].sum(axis=1) == count).all()
    elif name == "shuttle":
        assert count.min() >= 3 and count.max() <= 5 and (got["active"].sum(axis=1) - walls == count).all()
    elif name == "open":
        assert (count == 0).all() and not got["active"].any()
    else:
        assert count.min() <= 1 and count.max() >= 8
        assert (got["active"].sum(axis=1) - walls >= count).all()
    paper = got["scenario"] > 0
    assert (got["bend"][~paper] == 0).all()
    assert set(got["scenario"][paper]) == ({1, 2} if name == "corridor" else set())
    if name == "corridor":
        assert abs(paper.mean() - PARAMS.corridor.paper_share) < 4 * np.sqrt(0.25 / len(paper))


def test_things_come_out_of_the_walls_of_the_papers_corridors_alone(device):
    params = scene_params("emerging")
    assert isinstance(params, FamilyParams)
    still = dataclasses.replace(params, walker=WalkerParams(share=0.0), shares=Shares(crossing=0.0))
    assert still.moves and not dataclasses.replace(still, emerging_share=0.0).moves
    assert not dataclasses.replace(still, shares=Shares(corridor=0.0, crossing=0.0)).moves
    got = values(generate(NUM_WORLDS, device, still, seed=3))
    moves = (got["motion_speed"] > 0.0) & got["active"]
    paper = got["scenario"] > 0
    assert paper.any() and not moves[~paper].any()
    # Half of them, less those that stand too near to the start.
    count = got["num_obstacles"][paper].sum()
    assert 0.35 * count < moves[paper].sum() < 0.55 * count


def test_the_start_is_clear_for_mujoco_and_can_reach_the_goal(family):
    name, layout = family
    way = layout.way_m.numpy()
    assert (way >= PARAMS.way[0] - 0.1).all() and (way <= PARAMS.way[1] + 0.1).all()
    straight = np.linalg.norm(layout.start.numpy()[:, :2] - layout.goal.numpy(), axis=1)
    assert (way >= straight - 0.05).all()
    stowed = 0
    for scene in layout.scenes()[:25]:
        model = native_model(scene)
        data = mujoco.MjData(model)
        joints = dict(zip(robot.JOINTS, scene.start_joints, strict=True))
        stowed += np.allclose(scene.start_joints[:6], STOWED[:6], atol=1e-5)
        data.qpos[:] = robot.qpos_from_joints(model, joints)
        data.qpos[:3] = scene.start
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        assert data.ncon == 0
    assert stowed <= 2
    if name == "shuttle":  # it faces its first goal
        return
    headings = layout.start.numpy()[:, 2]
    assert np.histogram(headings, 4, (-np.pi, np.pi))[0].min() > 3, name


def test_goals_are_free_and_lie_in_every_direction(family):
    name, layout = family
    if name == "shuttle":  # ahead and behind, in a corridor as narrow as the robot
        return
    bearings = []
    for scene in layout.scenes():
        assert distances(scene, scene.goal[:1], scene.goal[1:])[0] >= PARAMS.goal_clearance - 1e-4
        offset = scene.goal - scene.start[:2]
        bearings.append(np.angle(np.exp(1j * (np.arctan2(offset[1], offset[0]) - scene.start[2]))))
    assert np.histogram(bearings, 4, (-np.pi, np.pi))[0].min() > 3


def _gap(scene, a, b):
    """Distance between two slots on the floor by points on their outlines [m]."""
    outline = []
    for slot in (a, b):
        if scene.is_cylinder[slot]:
            angle = np.linspace(0, 2 * np.pi, 48)
            ring = np.stack((np.cos(angle), np.sin(angle)), -1)
            outline.append(scene.pos[slot, :2] + scene.half_size[slot, 0] * ring)
        else:
            ends = corners(scene, slot)
            share = np.linspace(0, 1, 40)[:, None]
            outline.append(
                np.concatenate(
                    [p + share * (q - p) for p, q in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
                )
            )
    return spatial.cdist(*outline).min()


@pytest.mark.parametrize("close_share", [0.0, PARAMS.close_share])
def test_things_in_a_field_leave_gaps_or_stand_close(device, close_share):
    layout = generate(6, device, only("field", close_share=close_share), seed=2)
    close = 0
    for scene in layout.scenes():
        slots = np.flatnonzero(scene.active)
        for i, a in enumerate(slots):
            for b in slots[:i]:
                away = np.hypot(*(scene.pos[a, :2] - scene.pos[b, :2]))
                gap = _gap(scene, a, b) if away < 2.0 else np.inf
                if gap < PARAMS.gap - 1e-3:
                    # Near are rectangles along either's axes: it is farther from corner to corner, and what
                    # is round does not reach into its rectangle's corners.
                    radii = scene.half_size[[a, b], 0] @ scene.is_cylinder[[a, b]]
                    assert gap <= np.sqrt(2.0) * CLOSE + (np.sqrt(2.0) - 1.0) * radii + 1e-3
                    close += 1
    assert (close > 0) == (close_share > 0.0)


@pytest.mark.parametrize("name", ["room", "doorway", "field", "crossing"])
def test_no_gap_is_too_narrow_for_the_robot_and_leads_somewhere(name, device):
    """Floor that something 0.24 m wide could come to from where the robot fits, the robot can come to.

    That is so where nothing stands close to other things on purpose.
    """
    grid = np.arange(-HALF_SQUARE_M, HALF_SQUARE_M, 0.05)
    for scene in generate(12, device, only(name, close_share=0.0), seed=8).scenes():
        away = distances(scene, grid[None, :], grid[:, None])
        if name == "crossing":  # movers may stand in openings: the hall counts
            away[np.abs(grid) > abs(scene.pos[4, 1]) - scene.half_size[4, 1] - 0.27] = 0.0
        narrow, _ = ndimage.label(away > 0.12)
        wide, count = ndimage.label(away > 0.5 * PARAMS.gap - 0.05)
        assert count >= 1
        within = {region: set(wide[(narrow == region) & (wide > 0)]) for region in range(1, narrow.max() + 1)}
        assert all(len(regions) <= 1 for regions in within.values())


@pytest.mark.parametrize("name", ["corridor", "room", "doorway", "crossing"])
def test_walls_leave_no_way_out(name, device):
    grid = np.arange(-HALF_SQUARE_M, HALF_SQUARE_M + 0.05, 0.05)
    for scene in generate(40, device, only(name), seed=12).scenes():
        scene.active[~scene.is_wall] = False
        region, _ = ndimage.label(distances(scene, grid[None, :], grid[:, None]) > 0.03)
        row, column = np.searchsorted(grid, scene.goal[::-1])
        assert region[row, column] > 0 and region[row, column] not in (region[0, 0], region[-1, -1])


@pytest.mark.parametrize("name", ["room", "doorway"])
def test_pieces_of_furniture_have_all_their_parts(name, device):
    """What stands does so on the floor or on something: every low part has another one beside or below it."""
    scenes = generate(20, device, only(name), seed=8).scenes()
    for scene in scenes:
        walls = [s for s in np.flatnonzero(scene.active) if scene.is_wall[s]]
        bottoms = scene.pos[:, 2] - scene.half_size[:, 2]
        for slot in np.flatnonzero(scene.active & ~scene.is_wall & (bottoms > 0.01) & (bottoms < 0.65)):
            others = [s for s in np.flatnonzero(scene.active) if s != slot and s not in walls]
            assert min(_gap(scene, slot, s) for s in others) < 0.25
    assert max(scene.num_obstacles for scene in scenes) > 10


def test_movers_start_hidden_and_leave_room_where_they_reach_farthest(device):
    layout = generate(80, device, only("crossing"), seed=4)
    kinds, sides, speeds = set(), set(), []
    for scene in layout.scenes():
        hall = abs(scene.pos[4, 1]) - scene.half_size[4, 1]
        movers = np.flatnonzero(scene.active & (scene.motion_speed > 0.0))
        np.testing.assert_array_equal(scene.home[movers], scene.pos[movers])
        reach = {}
        for slot in movers:
            side = np.sign(scene.retreat[slot, 1])
            tip = scene.pos[slot, 1] - side * scene.half_size[slot, 1]
            tail = scene.pos[slot, 1] + scene.retreat[slot, 1] - side * scene.half_size[slot, 1]
            assert side * tail > hall + PARAMS.wall_thickness  # wholly behind the wall
            # Beside it, up to the other wall or to whatever else there is.
            for other in np.flatnonzero(scene.active & ~scene.is_wall):
                if other != slot and scene.pos[other, 2] - scene.half_size[other, 2] < 1.45:
                    assert _gap(scene, slot, other) >= PARAMS.gap - 2e-3
            assert side * tip + hall >= PARAMS.gap - 1e-4
            reach[slot] = hall - side * tip
            kinds.add(bool(scene.motion_trigger[slot] > 0.0))
            sides.add(side)
            speeds.append(scene.motion_speed[slot])
            # Start and goal are out of its way.
            ends = scene.pos[slot, :2], scene.pos[slot, :2] + scene.retreat[slot]
            for spot in (scene.start[:2], scene.goal):
                x, low, high = ends[0][0], *sorted((ends[0][1], ends[1][1]))
                assert np.hypot(spot[0] - x, spot[1] - np.clip(spot[1], low, high)) > 0.5
        assert all(value >= 0.29 for value in reach.values())
        assert abs(scene.start[1]) < hall and abs(scene.goal[1]) < hall
    assert kinds == {False, True} and sides == {-1.0, 1.0}
    assert min(speeds) >= PARAMS.crossing.speed[0] and max(speeds) <= PARAMS.crossing.speed[1]


def test_what_moves_is_in_crossings_or_walks(mixed):
    moving = (mixed.motion_speed.numpy() > 0.0).any(axis=1)
    families = {FAMILIES[i] for i in mixed.family.numpy()[moving]}
    assert families <= {"room", "doorway", "field", "crossing"} and len(families) >= 3
    shares = dataclasses.replace(PARAMS.shares, crossing=0.0)
    still = dataclasses.replace(PARAMS, walker=WalkerParams(share=0.0), shares=shares)
    assert PARAMS.moves and not still.moves


@pytest.mark.parametrize("name", ["room", "doorway", "field"])
def test_who_walks_runs_into_nothing_and_can_be_passed(name, device):
    params = only(name, walker=WalkerParams(share=1.0), close_share=0.0)
    walkers = 0
    for scene in generate(40, device, params, seed=6).scenes():
        (slots,) = np.nonzero(scene.active & (scene.motion_speed > 0.0))
        assert len(slots) <= 1
        for slot in slots:
            walkers += 1
            home = scene.pos[slot, :2].copy()
            assert params.walker.way[0] <= np.hypot(*scene.retreat[slot]) <= params.walker.way[1]
            assert 1.5 <= 2 * scene.half_size[slot, 2] <= 1.8 and scene.motion_trigger[slot] == 0.0
            others = [
                s for s in np.flatnonzero(scene.active)
                if s != slot and scene.pos[s, 2] - scene.half_size[s, 2] < 1.45
            ]  # fmt: skip
            # At home there is room to pass, or none at all between it and a wall.
            for end, least in ((home, params.gap), (home + scene.retreat[slot], 0.05)):
                scene.pos[slot, :2] = end
                for other in others:
                    gap = _gap(scene, slot, other)
                    assert gap >= least - 2e-3 or (scene.is_wall[other] and gap < 0.03)
                    inside = np.abs(end - scene.pos[other, :2]) < scene.half_size[other, :2]
                    assert not (scene.is_wall[other] and inside.all())
    assert walkers > 20  # some rooms are too full


def test_goals_behind_doorways_are_mostly_out_of_sight(device):
    layout = generate(60, device, only("doorway"), seed=6)
    straight = np.linalg.norm(layout.start.numpy()[:, :2] - layout.goal.numpy(), axis=1)
    # Ways that do without a detour see their goal.
    assert (layout.way_m.numpy() > 1.03 * straight).mean() > 0.6


def test_only_masked_worlds_change(device, mixed):
    layout = generate(24, device, PARAMS, seed=1)
    before = values(layout)
    mask = np.arange(24) % 3 == 0
    generate(24, device, PARAMS, seed=2, mask=mask, layout=layout)
    after = values(layout)
    for name in before:
        np.testing.assert_array_equal(before[name][~mask], after[name][~mask], err_msg=name)
    assert (before["start"][mask] != after["start"][mask]).any(axis=1).all()


def test_a_world_depends_on_seed_index_and_counter_alone(device):
    many, few = values(generate(32, device, PARAMS, seed=3)), values(generate(8, device, PARAMS, seed=3))
    mask = np.arange(32) == 5
    alone = values(generate(32, device, PARAMS, seed=3, mask=mask))
    for name, value in many.items():
        active = many["active"] if value.ndim > 1 and value.shape[1] == PARAMS.pool.num_slots else None
        for other, rows in ((few, np.arange(8)), (alone, np.array([5]))):
            a, b = value[rows], other[name][rows]
            if active is not None and name != "active":
                a, b = a[active[rows]], b[active[rows]]
            np.testing.assert_array_equal(a, b, err_msg=name)
    again = generate(32, device, PARAMS, seed=3)
    other = generate(32, device, PARAMS, seed=4)
    assert (again.start.numpy() == many["start"]).all()
    assert not (other.start.numpy() == many["start"]).all(axis=1).any()


def test_graph_replay_equals_eager(device):
    def prepare():
        layout = Layout(16, PARAMS.pool, device)
        generator = FamilyGenerator(layout, PARAMS)
        return (
            layout,
            generator,
            DistanceField(layout, device, blocked_m=BLOCKED_M),
            inputs(16, device, seed=9),
        )

    def draw(layout, generator, field, arguments):
        generator.build(**arguments)
        field.update(layout.goal, arguments["mask"])
        generator.place_starts(field.field, **arguments)

    eager, replayed = prepare(), prepare()
    draw(*prepare())
    with wp.ScopedDevice(device):
        with wp.ScopedCapture() as capture:
            draw(*replayed)
        for _ in range(3):
            draw(*eager)
            wp.capture_launch(capture.graph)
    assert replayed[3]["counter"].numpy().tolist() == [3] * 16
    for name, value in values(eager[0]).items():
        np.testing.assert_array_equal(value, values(replayed[0])[name], err_msg=name)


def test_configuration_files_have_the_defaults_of_the_code():
    assert scene_params("mixture") == PARAMS
    for name in FAMILIES:
        assert scene_params(name) == only(name)
    assert type(scene_params("nav")) is GeneratorParams
    assert scene_class({}) is GeneratorParams and scene_class({"shares": {}}) is FamilyParams
    assert "shares" not in OmegaConf.load(CONF_DIR / "scene" / "nav.yaml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shares": {"lawn": 1.0}}, r"scene\.shares\.lawn: unknown key"),
        ({"shares": {"room": -1.0}}, r"scene\.shares must not be negative"),
        (
            {"shares": {name: 0.0 for name in FAMILIES}},
            r"scene\.shares must not be negative and not all be 0",
        ),
        ({"room": {"size": [3.0, 20.0]}}, r"scene\.room\.size must be \(low, high\) within"),
        ({"furniture": {"empty_share": 2.0}}, r"scene\.furniture\.empty_share must be in"),
        ({"field": {"things": [60, 10]}}, r"scene\.field\.things must be"),
        ({"gap": 0.3}, r"scene\.gap must be at least"),
        ({"length": 8.0}, r"scene\.length has no meaning with scene\.shares"),
        ({"crossing": {"half_size": [0.1, 0.4]}}, r"scene\.crossing\.half_size must fit"),
        ({"crossing": {"lane": [3.9, 4.0]}, "wall_thickness": 0.8}, r"reach .* across"),
        ({"pool": {"num_walls": 6, "num_boxes": 20, "num_cylinders": 4}}, r"scene\.pool needs"),
    ],
)
def test_impossible_parameters_are_refused(changes, message):
    with pytest.raises(ConfigError, match=message):
        from_mapping(FamilyParams, changes, "scene")


def test_a_layout_with_another_pool_is_refused(device):
    with pytest.raises(ValueError, match=r"scene\.pool is"):
        FamilyGenerator(Layout(2, PoolSpec(), device), PARAMS)


def test_ranges_are_kept(device):
    params = only("room", room=RoomParams(size=(4.0, 4.0), wing_share=0.0), wall_height=(1.2, 1.2))
    assert params.shares == Shares(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    for scene in generate(8, device, params).scenes():
        sides = np.sort(2 * scene.half_size[:4, :2].max(axis=1))
        assert sides == pytest.approx([4.0, 4.0, 4.2, 4.2], abs=1e-4)
        assert scene.half_size[:4, 2] == pytest.approx(np.full(4, 0.6))
