import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from viewer_worlds import POOL, fetch_snapshot, pick_snapshot, snapshot

from spin_rl.config import ConfigError
from spin_rl.extras import require
from spin_rl.viewer import style
from spin_rl.viewer.camera import DRIVE_VIEW, GRASP_VIEW, TABLE_VIEW, PinholeCamera
from spin_rl.viewer.overlay import draw_overlays
from spin_rl.viewer.picture import SIZE, PictureMaker, _view, camera_label, camera_picture, depth_picture
from spin_rl.viewer.snapshot import Scandots
from spin_rl.viewer.stage import DepthCamera, Stage
from spin_rl.viewer.video import check_video, open_video

GREY = np.full((100, 100, 3), 128, np.uint8)
# Looks down from 2 m; 100 pixels are 2 m.
ABOVE = PinholeCamera(np.array([0.0, 0.0, 2.0]), np.eye(3), 2 * np.degrees(np.arctan(0.5)), 100, 100)
# Far away, to leave the picture to the scandots.
ELSEWHERE = DepthCamera(np.array([50.0, 0.0, 0.0]), np.eye(3), (0.1, 0.1))


def test_seen_scandots_are_bright_and_unseen_ones_dim():
    dots = Scandots(np.array([[0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]]), np.array([True, False]))
    picture = np.asarray(draw_overlays(GREY, ABOVE, ELSEWHERE, dots)).astype(int)
    np.testing.assert_allclose(picture[25, 75], style.SEEN, atol=2)
    unseen = picture[25, 25]
    assert (unseen != 128).any()
    assert np.abs(unseen - 128).sum() < np.abs(picture[25, 75] - 128).sum()
    np.testing.assert_array_equal(picture[75, 25], 128)


def test_frustum_is_tinted_and_outlined():
    # At 1 m height, looking down: its far end is a square of half side 0.6 m on the floor.
    camera = DepthCamera(np.array([0.0, 0.0, 1.0]), np.diag([1.0, -1.0, -1.0]), (0.6, 0.6))
    nothing = Scandots(np.zeros((0, 3)), np.zeros(0, bool))
    picture = np.asarray(draw_overlays(GREY, ABOVE, camera, nothing)).astype(int)
    inside, outside, border = picture[50, 65], picture[50, 90], picture[50, 80]
    np.testing.assert_array_equal(outside, 128)
    assert inside[0] > 128 > inside[2]  # orange
    assert np.abs(border - style.FRUSTUM).sum() < 90


def test_points_outside_the_picture_are_no_trouble():
    dots = Scandots(np.array([[0.0, 0.0, 3.0], [1e6, 0.0, 0.0], [0.0, 0.0, 2.0]]), np.array([True] * 3))
    np.testing.assert_array_equal(np.asarray(draw_overlays(GREY, ABOVE, ELSEWHERE, dots)), GREY)


def test_near_is_brighter_than_far_in_the_depth_picture():
    picture = np.asarray(depth_picture(np.array([[0.3, 2.0, 3.5, np.inf]]))).sum(-1)[0]
    assert (np.diff(picture.astype(int)) < 0).all()


def test_the_policys_own_image_is_shown_where_there_is_one():
    stage = Stage(POOL, "portrait")
    ideal = snapshot()
    stage.pose(ideal)
    np.testing.assert_array_equal(camera_picture(stage, ideal, 40), depth_picture(stage.depth_image(40)))
    image = np.full((4, 2), 4.0)
    image[1, 0] = 0.5
    own = replace(ideal, depth=image)
    shown = np.asarray(camera_picture(stage, own, 40)).astype(int).sum(-1)
    assert shown.shape == (40, 20)
    near = np.zeros((4, 2), bool)
    near[1, 0] = True
    np.testing.assert_array_equal(shown > shown.min(), near.repeat(10, 0).repeat(10, 1))
    assert camera_label(own) != camera_label(ideal)


@pytest.mark.slow  # compiles the renderer
def test_pictures_show_the_goal_where_the_projection_puts_it(tmp_path):
    stage = Stage(POOL, "portrait")
    maker = PictureMaker(stage, "test", 0.1, samples=1)
    # On the way to the goal, which is then in full view.
    states = [snapshot(time=0.1 * i, base=(2.0 + 0.1 * i, 0.0, 0.0)) for i in range(3)]
    pictures = [maker.draw(state) for state in states]
    assert all(picture.size == SIZE for picture in pictures)
    rendered = maker._renderer.render().astype(int)
    view = maker._renderer.camera()
    green = (rendered[..., 1] > rendered[..., 0] + 40) & (rendered[..., 1] > rendered[..., 2] + 20)
    rows, columns = np.nonzero(green)
    (column, row), _ = (part[0] for part in view.project(np.array([[3.5, 0.0, 0.008]])))
    assert green.sum() > 50
    assert abs(columns.mean() + 0.5 - column) < 3 and abs(rows.mean() + 0.5 - row) < 4
    assert np.abs(np.asarray(pictures[0]).astype(int) - np.asarray(pictures[2])).mean() > 1.0

    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "tiny.mp4"
    with open_video(path, fps=10) as append:
        for picture in pictures:
            append(picture)
    assert [file.name for file in tmp_path.iterdir()] == ["tiny.mp4"]
    import imageio.v2 as imageio

    with imageio.get_reader(path) as video:
        frames = list(video.iter_data())
    assert len(frames) == 3
    assert np.abs(frames[0].astype(int) - np.asarray(pictures[0])).mean() < 6.0


def test_gif_keeps_every_picture(tmp_path):
    path = tmp_path / "a.gif"
    with open_video(path, fps=10) as append:
        for shade in (0, 120, 240):
            append(Image.new("RGB", SIZE, (shade, shade, shade)))
    with Image.open(path) as gif:
        assert gif.n_frames == 3 and gif.info["duration"] == 100


def test_gif_keeps_pixels_that_hardly_change(tmp_path):
    path = tmp_path / "a.gif"
    pictures = [np.full((SIZE[1], SIZE[0], 3), 200, np.uint8) for _ in range(3)]
    for i, shade in enumerate((200, 204, 240)):
        pictures[i][:, : SIZE[0] // 2] = shade
        pictures[i][:10, -10 * (i + 1) :] = 0  # so that no two are the same
    with open_video(path, fps=10) as append:
        for picture in pictures:
            append(Image.fromarray(picture))
    shades = []
    with Image.open(path) as gif:
        assert gif.n_frames == 3
        for i in range(3):
            gif.seek(i)
            shades.append(np.asarray(gif.convert("RGB")).astype(int)[150, 100, 0])
    assert shades[0] == shades[1] < shades[2]
    assert abs(shades[0] - 200) < 4 and abs(shades[2] - 240) < 4


def test_a_failed_video_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError), open_video(tmp_path / "a.gif", fps=10) as append:
        append(Image.new("RGB", SIZE))
        raise RuntimeError
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "message"), [("a.avi", "should end in .mp4 or .gif"), ("folder.gif", "is a folder")]
)
def test_videos_that_cannot_be_written(tmp_path, name, message):
    (tmp_path / "folder.gif").mkdir()
    with pytest.raises(ConfigError, match=f"video: .*{message}"):
        check_video(tmp_path / name)


def test_a_missing_package_is_one_line_that_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ConfigError) as error:
        require("imageio_ffmpeg", "imageio[ffmpeg]", "viewer", "video")
    message = str(error.value)
    assert message.startswith("video: needs imageio[ffmpeg]") and "pip install 'spin-rl[viewer]'" in message
    assert "\n" not in message


def test_at_the_table_the_view_stays_however_the_robot_turns():
    place = pick_snapshot().target.what.start_pose[:2]
    for yaw in (0.0, 2.0):
        base = (1.0, 0.2, yaw)
        for state, view in (
            (fetch_snapshot("reach", base=base), DRIVE_VIEW),
            (fetch_snapshot("align", base=base), TABLE_VIEW),
            (fetch_snapshot("pick", base=base), GRASP_VIEW),
            (fetch_snapshot("place", base=base), DRIVE_VIEW),
            (pick_snapshot(base=base), GRASP_VIEW),
            (snapshot(base=base), DRIVE_VIEW),
        ):
            pose, chosen = _view(state)
            assert chosen == view
            np.testing.assert_allclose(pose[:2], base[:2])
            right = (np.sin(pose[2]), -np.cos(pose[2]))
            offset = place - pose[:2]
            if view != DRIVE_VIEW:
                np.testing.assert_allclose(right, offset / np.linalg.norm(offset), atol=1e-12)
            else:
                assert pose[2] == yaw
