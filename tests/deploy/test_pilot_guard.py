"""What the pilot lets pass, what it stops, and how it drives out of where the robot is stuck."""

import numpy as np
import pytest
from fake_robot import STOWED
from pilot_worlds import KINEMATICS, ROOM, contract, look, state_at, surface_points

from spin_rl.deploy.pilot.body import Body
from spin_rl.deploy.pilot.costmap import Costmap
from spin_rl.deploy.pilot.guard import filtered
from spin_rl.deploy.pilot.pilot import Pilot
from spin_rl.deploy.pilot.trial import Drive, Trial

CONTRACT = contract()
DRIVE, BODY = Drive.of(CONTRACT, 1.0), Body(CONTRACT.shapes)
STEPS, MARGIN = 5, 0.01
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def known(points):
    """A map of points that were seen."""

    class Nothing:
        def sees_through(self, points, depth, camera):
            return np.ones(len(points), dtype=bool)

    costmap = Costmap(np.full(2, -6.0), 12.0, 0.06, memory_s=10.0, period_s=0.1)
    nothing_else, camera = Nothing(), type("At", (), {"pos": np.zeros(3)})()
    costmap.see(nothing_else, np.zeros((87, 58)), camera, np.array(points, dtype=float))
    return costmap


def trial_of(costmap, base=(0.0, 0.0, 0.0), speed=(0.0, 0.0), joints=STOWED):
    hulls = BODY.pose(KINEMATICS.bodies(joints)).hulls
    return Trial(costmap, hulls, np.array(base), np.array(speed), DRIVE, MARGIN)


def rectangles(hulls, poses, base):
    """Corners of the hulls at poses in the base frame, in the frame of the odometry, (n, 4 hulls, 4, 2)."""
    ends = np.stack([hulls.low, hulls.high])
    corners = np.stack([np.stack([ends[i, :, 0], ends[j, :, 1]], -1) for i, j in CORNERS], 1)
    placed = []
    for x, y, yaw in poses:
        angle = yaw + base[2]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        out = np.array([[np.cos(base[2]), -np.sin(base[2])], [np.sin(base[2]), np.cos(base[2])]])
        placed.append(corners @ turn.T + base[:2] + out @ (x, y))
    return np.array(placed)


def inside(corners, points):
    """Which points are in a convex polygon, by the side of every edge that they are on."""
    ahead = np.roll(corners, -1, axis=0) - corners
    to = points[:, None] - corners
    return (ahead[:, 0] * to[..., 1] - ahead[:, 1] * to[..., 0] > 0.0).all(-1)


def drive_through(command, speed, substeps=20):
    """Poses of a base that follows a command and brakes then, in steps ten times as short, by Euler."""
    pose, speed, poses = np.zeros(3), np.array(speed, dtype=float), []
    for step in range(STEPS + 4):
        wanted = np.array(command if step < STEPS else (0.0, 0.0))
        following = speed + np.clip((wanted - speed) * DRIVE.blend, -DRIVE.change, DRIVE.change)
        for part in range(substeps):
            v, w = speed + (part + 0.5) / substeps * (following - speed)
            yaw = pose[2] + 0.5 * w * 0.1 / substeps
            pose = pose + 0.1 / substeps * np.array([v * np.cos(yaw), v * np.sin(yaw), w])
            poses.append(pose)
        speed = following
    return np.array(poses)


def drawn(seed):
    """Walls and things around a robot that is in none of them, its pose, its speed and a command."""
    rng = np.random.default_rng(seed)
    low = np.column_stack([rng.uniform(-1.6, 1.4, (7, 2)), rng.choice([0.0, 0.3, 0.9], 7)])
    high = low + np.column_stack([rng.uniform(0.05, 1.0, (7, 2)), rng.uniform(0.1, 1.0, 7)])
    base = np.array([*rng.uniform(-0.2, 0.2, 2), rng.uniform(-3.0, 3.0)])
    speed = rng.uniform((-0.1, -1.0), (0.8, 1.0))
    return list(zip(low, high, strict=True)), base, speed, rng.uniform((-0.1, -1.5), (0.8, 1.5))


def touches(hulls, poses, base, points, margin=0.0):
    """Whether hulls along poses hold points at their height that are not within a cell at the start."""
    placed = rectangles(hulls, np.concatenate([np.zeros((1, 3)), poses]), base)
    for hull in range(4):
        level = (points[:, 2] > hulls.low[hull, 2]) & (points[:, 2] < hulls.high[hull, 2])
        at = points[level, :2]
        at = at[~near_at_start(placed[0, hull], at, 0.075)]
        if any(inside(corners, at).any() for corners in placed[1:, hull]):
            return True
    return False


def near_at_start(corners, points, slack):
    """Which points are in a rectangle that is larger on all sides."""
    middle = corners.mean(0)
    along, aside = (corners[1] - corners[0]) / 2, (corners[3] - corners[0]) / 2
    offset = points - middle
    return (np.abs(offset @ along / np.linalg.norm(along)) < np.linalg.norm(along) + slack) & (
        np.abs(offset @ aside / np.linalg.norm(aside)) < np.linalg.norm(aside) + slack
    )


def test_what_is_let_pass_ends_in_nothing():
    """Exact poses among the points themselves: no command that hits one within its time is let pass."""
    hulls = BODY.pose(KINEMATICS.bodies(STOWED)).hulls
    stopped = changed = 0
    for seed in range(80):
        boxes, base, speed, asked = drawn(seed)
        points = surface_points(boxes)
        trial = trial_of(known(points), base, speed)
        command = filtered(asked, STEPS, trial)
        changed += command is not asked
        if not trial.is_free(command[None], STEPS)[0]:
            stopped += 1  # it looks ahead less, or stands
            continue
        assert not touches(hulls, drive_through(command, speed), base, points), seed
    assert 15 < changed < 75 and stopped < 40  # some boxes are drawn where the robot is


def test_what_is_stopped_would_have_come_near():
    """No command is kept from the robot that leaves the room of a cell around all that it drives over."""
    hulls = BODY.pose(KINEMATICS.bodies(STOWED)).hulls
    wide = type(hulls)(hulls.low - 0.075, hulls.high + 0.075)
    kept = 0
    for seed in range(80):
        boxes, base, speed, asked = drawn(100 + seed)
        points = surface_points(boxes)
        if not trial_of(known(points), base, speed).is_free(asked[None], STEPS)[0]:
            kept += 1
            placed = rectangles(wide, drive_through(asked, speed), base)
            level = [
                (points[:, 2] > wide.low[hull, 2]) & (points[:, 2] < wide.high[hull, 2]) for hull in range(4)
            ]
            assert any(
                inside(corners[hull], points[level[hull], :2]).any()
                for corners in placed
                for hull in range(4)
            ), seed
    assert kept > 20


def test_on_a_free_floor_every_command_passes():
    trial = trial_of(known(np.zeros((0, 3))))
    commands = np.random.default_rng(0).uniform((-0.1, -1.5), (0.8, 1.5), (50, 2))
    assert trial.is_free(commands, STEPS).all()
    assert filtered(commands[0], STEPS, trial) is not None
    np.testing.assert_array_equal(filtered(commands[0], STEPS, trial), commands[0])


@pytest.mark.parametrize(
    ("bottom", "top", "passes"), [(0.9, 1.0, False), (0.0, 0.1, False), (1.5, 1.6, True), (0.0, 0.02, True)]
)
def test_a_bar_counts_at_the_robots_heights(bottom, top, passes):
    points = surface_points([((0.35, -1.0, bottom), (0.4, 1.0, top))])
    trial = trial_of(known(points), speed=(0.5, 0.0))
    assert trial.is_free(np.array([[0.8, 0.0]]), STEPS)[0] == passes


@pytest.mark.parametrize(("nearest", "passes"), [(0.185, False), (0.2, True)])
def test_all_that_was_seen_in_a_cell_counts(nearest, passes):
    """Two points in a cell beside the way of the base, which reaches to 0.182 m and the margin to 0.192 m."""
    trial = trial_of(known(np.array([[0.33, nearest, 0.1], [0.33, 0.236, 0.1]])), speed=(0.7, 0.0))
    assert trial.is_free(np.array([[0.8, 0.0]]), STEPS)[0] == passes


def test_what_the_robot_overlaps_already_does_not_hold_it():
    """A thing in the gripper's box, at its right: the base may go ahead and back."""
    hulls = BODY.pose(KINEMATICS.bodies(STOWED)).hulls
    middle = 0.5 * (hulls.low[3] + hulls.high[3])
    trial = trial_of(known(np.array([[middle[0], hulls.low[3, 1] + 0.03, middle[2]]])))
    assert trial.is_free(np.array([[0.3, 0.0], [-0.1, 0.0], [0.0, 0.0]]), STEPS).all()


@pytest.mark.parametrize("beside", [0.185, 0.15])
@pytest.mark.parametrize("margin", [True, False])
def test_what_is_too_near_may_be_left_and_not_come_nearer_to(beside, margin):
    """A point at the left side of the base, within its margin or in its box."""
    trial = trial_of(known(np.array([[-0.1, beside, 0.04]])))
    trial = trial if margin else trial.without_margin()
    along, left, right = [0.2, 0.0], [0.0, 0.5], [0.0, -0.5]
    assert trial.is_free(np.array([[0.0, 0.0], along, left, right]), STEPS).tolist() == [True] * 3 + [False]


def test_a_robot_that_is_stuck_at_a_wall_does_not_push_into_it():
    """It drives itself out; the wall is within the margin that it leaves out then."""
    wall = [((-2.0, 0.188, 0.0), (2.0, 0.3, 1.5))]
    pilot = piloted((0.0, 0.0, 0.0), (2.0, 1.5))
    poses = drive(pilot, (0.0, 0.0, 0.0), wall, (0.0, 1.0), 60, looks=10)
    corners = rectangles(BODY.pose(KINEMATICS.bodies(STOWED)).hulls, poses, np.zeros(3))
    assert corners[:, 0, :, 1].max() < 0.188
    assert np.abs(poses[-1, :2]).max() > 0.1


def piloted(base, goal):
    pilot = Pilot(CONTRACT)
    pilot.reset(np.array(base, dtype=float), np.array(goal, dtype=float))
    return pilot


def drive(pilot, base, boxes, action, steps, looks=None):
    """Drive the base by an action of the policy; return its poses."""
    base, speed, poses = np.array(base, dtype=float), np.zeros(2), []
    for step in range(steps):
        if looks is None or step % looks == 0:
            look(pilot, boxes, base, pans=(-2.0, -1.0, 0.0, 1.0), tilts=(-0.7,))
        steered = pilot.steer(np.array([*action, *[0.0] * 8]), state_at(base, speed))
        assert np.abs(steered[:2]).max() <= 1.0
        command = DRIVE.command_of(steered[:2])
        following = speed + np.clip((command - speed) * 0.5, -DRIVE.change, DRIVE.change)
        v, w = 0.5 * (speed + following)
        yaw = base[2] + 0.05 * w
        base = base + 0.1 * np.array([v * np.cos(yaw), v * np.sin(yaw), w])
        speed = following
        poses.append(base)
    return np.array(poses)


@pytest.mark.parametrize("action", [(1.0, 0.0), (1.0, 0.4), (0.6, -0.3)])
def test_the_robot_never_drives_into_the_walls_that_it_saw(action):
    pilot = piloted((0.0, 0.0, 0.3), (2.5, 1.5))
    poses = drive(pilot, (0.0, 0.0, 0.3), ROOM, action, 60)
    points = surface_points(ROOM, 0.05)
    for pose in poses:
        corners = rectangles(BODY.pose(KINEMATICS.bodies(STOWED)).hulls, np.zeros((1, 3)), pose)[0, 0]
        assert not inside(corners, points[:, :2]).any()
    assert np.abs(poses[:, 0]).max() > 0.5


def test_a_robot_that_is_stuck_drives_out_towards_the_goal():
    """In a dead end, with a policy that wants ahead for ever; the goal is behind the wall."""
    dead_end = [((0.5, -0.5, 0.0), (0.6, 0.5, 1.5)), ((-0.7, 0.45, 0.0), (0.6, 0.55, 1.5)),
                ((-0.7, -0.55, 0.0), (0.6, -0.45, 1.5))]  # fmt: skip
    pilot = piloted((0.0, 0.0, 0.0), (2.0, 0.0))
    poses = drive(pilot, (0.0, 0.0, 0.0), dead_end, (1.0, 0.0), 26, looks=4)
    held = np.linalg.norm(poses[12:17, :2] - poses[12, :2], axis=-1).max()
    assert held < 0.15
    moved = drive(pilot, poses[-1], dead_end, (1.0, 0.0), 40, looks=4)
    before, after = pilot.route.field.at(np.array([poses[-1, :2], moved[-1, :2]]))
    assert before > 2.5 and after < before - 0.2  # around the walls, out of them again
    points = surface_points(dead_end)
    hulls = BODY.pose(KINEMATICS.bodies(STOWED)).hulls
    for pose in moved:
        assert not inside(rectangles(hulls, np.zeros((1, 3)), pose)[0, 0], points[:, :2]).any()


def test_a_robot_that_moves_is_left_alone():
    pilot = piloted((-2.0, 0.0, 0.0), (2.0, 0.0))
    base, speed = np.array([-2.0, 0.0, 0.0]), np.array([0.2, 0.0])
    look(pilot, [], base, pans=(0.0,), tilts=(-0.6,))
    for _ in range(60):
        action = np.array([0.25, 0.1, *[0.3] * 8])
        assert pilot.steer(action, state_at(base, speed)) is action and not pilot.is_guarded
        base = base + (0.02, 0.0, 0.0)


def test_a_robot_that_stands_still_for_long_is_moved():
    """Nothing keeps it, yet it asks for nothing: after twice the time it counts as stuck."""
    pilot = piloted((-2.0, 0.0, 0.0), (2.0, 0.0))
    base = np.array([-2.0, 0.0, 0.0])
    look(pilot, [], base, pans=(0.0,), tilts=(-0.6,))
    patience = round(2 * CONTRACT.planner.stuck_s * CONTRACT.rate_hz)
    guarded = []
    for _ in range(patience + 3):
        steered = pilot.steer(np.zeros(10), state_at(base))
        guarded.append(pilot.is_guarded)
    assert guarded == [False] * (patience - 1) + [True] * 4
    assert steered[0] > 0.0 and abs(steered[1]) < 1e-6  # straight to the goal
