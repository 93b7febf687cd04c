from dataclasses import replace

import mujoco
import numpy as np
import pytest
from viewer_worlds import POOL, SCENE, fetch_snapshot, pick_snapshot, snapshot

from spin_rl import robot
from spin_rl.scenes import kinds
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.objects.shapes import OBJECT_GEOMS, OBJECTS
from spin_rl.scenes.outline import outline
from spin_rl.viewer import style
from spin_rl.viewer.plan import Plan
from spin_rl.viewer.stage import Stage


@pytest.fixture(scope="module")
def stage() -> Stage:
    return Stage(POOL, "portrait")


def test_geoms_stand_where_a_native_model_has_them(stage):
    state = snapshot(base=(0.5, 0.1, -0.4), head_pan=0.3, lift=0.8)
    stage.pose(state)
    model = native_model(SCENE)
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos
    mujoco.mj_forward(model, data)
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        np.testing.assert_allclose(stage.data.geom(name).xpos, data.geom(geom).xpos, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(stage.data.geom(name).xmat, data.geom(geom).xmat, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(
            stage.model.geom(name).size, model.geom(geom).size, atol=1e-6, err_msg=name
        )


@pytest.mark.parametrize("mount", ["portrait", "landscape"])
def test_depth_image_agrees_with_single_rays(mount):
    stage = Stage(POOL, mount)
    stage.pose(snapshot(base=(0.2, 0.0, 0.1), head_tilt=-0.6, head_pan=0.2))
    height = 40
    depth = stage.depth_image(height)
    tan_x, tan_y = robot.camera_tan_half_fov(mount)
    assert depth.shape == (height, round(height * tan_y / tan_x))
    site = stage.data.site("camera_depth_optical_frame")
    mat = site.xmat.reshape(3, 3)
    group = np.array([0, 1, 0, 0, 0, 0], dtype=np.uint8)
    for row, column in ((3, 2), (20, depth.shape[1] // 2), (39, depth.shape[1] - 1)):
        # Down in the picture is the optical x axis, left in it the y axis.
        x = ((row + 0.5) / height * 2 - 1) * tan_x
        y = (1 - (column + 0.5) / depth.shape[1] * 2) * tan_y
        ray = mat @ (x, y, 1.0)
        norm = np.linalg.norm(ray)
        hit = mujoco.mj_ray(
            stage.model, stage.data, site.xpos, ray / norm, group, 1, -1, np.zeros(1, np.int32)
        )
        assert depth[row, column] == pytest.approx(hit / norm, abs=1e-6)
    assert depth[-1].mean() < depth[0].mean()  # the floor in front of the base is at the bottom


def test_frustum_lies_on_the_image_border(stage):
    stage.pose(snapshot())
    camera = stage.depth_camera()
    frustum = camera.frustum(1.5)
    local = (frustum - camera.pos) @ camera.mat
    np.testing.assert_allclose(local[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(local[1:]), np.tile((*camera.tan_half_fov, 1.0), (4, 1)) * 1.5)
    np.testing.assert_allclose(np.sign(local[1:, :2]).sum(0), 0.0)


def test_walls_are_cut_low_for_pictures_only(stage):
    stage.pose(snapshot())
    xpos, size = stage.low_walls()
    wall, box = stage.model.geom("wall_0").id, stage.model.geom("box_1").id
    assert xpos[wall, 2] + size[wall, 2] == pytest.approx(0.22)
    assert xpos[wall, 2] == size[wall, 2]
    np.testing.assert_array_equal(size[box], stage.model.geom_size[box])
    assert stage.model.geom_size[wall, 2] == pytest.approx(0.75)


def test_levels_of_obstacles():
    levels = kinds.levels(SCENE)
    assert [levels[slot] for slot in (POOL.first_box, POOL.first_box + 1, POOL.first_cylinder)] == [
        "low", "head", "tall"
    ]  # fmt: skip
    assert kinds.level_of(0.5, 0.7) == "arm"
    assert style.slot_colours(SCENE)[0] == style.WALL


def test_outline_is_turned_by_the_yaw():
    corners = outline(SCENE, POOL.first_box)
    half, yaw = SCENE.half_size[POOL.first_box], 0.3
    expected = SCENE.pos[POOL.first_box, :2] + (
        half[0] * np.cos(yaw) - half[1] * np.sin(yaw), half[0] * np.sin(yaw) + half[1] * np.cos(yaw)
    )  # fmt: skip
    np.testing.assert_allclose(corners[2], expected)
    circle = outline(SCENE, POOL.first_cylinder) - SCENE.pos[POOL.first_cylinder, :2]
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 0.1)


def test_plan_shows_goal_walls_and_scandots_at_their_places(stage):
    state = snapshot()
    stage.pose(state)
    plan = Plan(SCENE, 240, 224)
    picture = np.asarray(plan.draw(stage, state, np.array([[0.0, 0.0], [0.1, 0.0]])))

    def colour(*point):
        column, row = plan.pixels(np.array([point]))[0].astype(int)
        return tuple(int(c) for c in picture[row, column])

    assert colour(*SCENE.goal) == style.GOAL
    assert colour(0.3, 0.6) == style.WALL
    assert colour(*state.scandots.points[0]) == style.SEEN
    assert colour(-0.25, 0.15) == style.ROBOT  # a corner of the base, clear of the arm
    up, down = plan.pixels(np.array([[0.0, 0.5], [0.0, -0.5]]))
    assert up[1] < down[1]


@pytest.fixture(scope="module")
def table_stage() -> Stage:
    return Stage(POOL, "portrait", with_object=True)


@pytest.mark.parametrize("kind", OBJECTS)
def test_objects_are_shaped_and_stand_as_in_a_native_model(table_stage, kind):
    state = pick_snapshot(kind, base=(0.5, 0.1, -0.4))
    table_stage.pose(state)
    model = native_model(SCENE, obj=state.target.what)
    data = mujoco.MjData(model)
    data.qpos[:] = [*state.qpos, *state.target.pose]
    mujoco.mj_forward(model, data)
    shown = {table_stage.model.geom(geom).name for geom in table_stage.object_geoms}
    names = {model.geom(geom).name for geom in range(model.ngeom)}
    assert shown == names & set(OBJECT_GEOMS)
    for name in names:
        here = table_stage.data.geom(name)
        np.testing.assert_allclose(here.xpos, data.geom(name).xpos, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(here.xmat, data.geom(name).xmat, atol=1e-6, err_msg=name)
    for name in shown:
        np.testing.assert_allclose(table_stage.model.geom(name).size, model.geom(name).size, atol=1e-9)


def test_an_object_in_front_of_the_camera_is_in_the_depth_image(table_stage):
    table_stage.pose(pick_snapshot("can", pose=(0.0, 0.0, -5.0, 1.0, 0.0, 0.0, 0.0)))
    empty, camera = table_stage.depth_image(60), table_stage.depth_camera()
    ahead = camera.pos + 0.5 * camera.mat[:, 2]
    table_stage.pose(pick_snapshot("can", pose=(*ahead, 1.0, 0.0, 0.0, 0.0)))
    depth = table_stage.depth_image(60)
    changed = depth != empty
    assert changed[30, depth.shape[1] // 2] and 0.43 < depth[changed].min() < 0.5
    assert not changed[0].any() and not changed[-1].any()


def test_only_a_task_with_a_goal_shows_one(table_stage):
    table_stage.pose(pick_snapshot())
    assert table_stage.data.geom("goal").xpos[2] < -1.0
    plans = [Plan(SCENE, 200, 200, whole=whole) for whole in (True, False)]
    far, near = (np.ptp(plan.pixels(np.array([[0.0, 0.0], [1.0, 0.0]]))[:, 0]) for plan in plans)
    assert near > far  # pixels of a metre
    picture = np.asarray(plans[1].draw(table_stage, pick_snapshot(), np.zeros((1, 2))))
    assert not (picture == style.GOAL).all(-1).any()


def test_the_plan_of_a_fetch_shows_its_start_and_the_present_goal(table_stage):
    plan = Plan(SCENE, 400, 400)
    reach, carry = (fetch_snapshot(stage, base=(1.5, -0.3, -1.5)) for stage in ("reach", "carry"))
    pictures = []
    for state in (reach, replace(carry, scene=replace(SCENE, goal=np.zeros(2)))):
        table_stage.pose(state)
        np.testing.assert_allclose(table_stage.data.geom("goal").xpos[:2], state.scene.goal)
        pictures.append(np.asarray(plan.draw(table_stage, state, np.zeros((1, 2)))))
    pixel = [tuple(plan.pixels(np.array([point]))[0].astype(int)[::-1]) for point in ((3.5, 0.0), (0.0, 0.0))]
    is_goal = [[tuple(picture[at]) == style.GOAL for at in pixel] for picture in pictures]
    assert is_goal == [[True, False], [False, True]]
    row, column = pixel[1]
    near = pictures[0][row - 20 : row + 20, column - 20 : column + 20].astype(int)
    assert (np.abs(near - style.GOAL).sum(-1) < 60).any()  # a ring around the start
