"""What tests of the pilot share: boxes on a floor, and depth images of them, by formulas of their own."""

import numpy as np
from fake_robot import DATA, STOWED

from spin_rl import robot
from spin_rl.deploy.contract import Contract
from spin_rl.deploy.interface import RobotState
from spin_rl.deploy.kinematics import Frame, Kinematics
from spin_rl.deploy.network import Network
from spin_rl.deploy.pilot.pilot import Pilot

ROOM = [  # four walls, 6 x 4 m
    ((3.0, -2.1, 0.0), (3.1, 2.1, 2.0)),
    ((-3.1, -2.1, 0.0), (-3.0, 2.1, 2.0)),
    ((-3.0, 2.0, 0.0), (3.0, 2.1, 2.0)),
    ((-3.0, -2.1, 0.0), (3.0, -2.0, 2.0)),
]
PANS = np.linspace(-3.6, 1.3, 12)
KINEMATICS = Kinematics()


def contract() -> Contract:
    """Of a policy with guard and planner."""
    return Network(DATA / "tiny_room.onnx").contract


SCANDOTS = next(group.size for group in contract().observations if group.name == "scandots")


def camera_at(joints, base) -> Frame:
    """The camera in the frame of the odometry."""
    frame = KINEMATICS(joints)[robot.CAMERA_SITE]
    cos, sin = np.cos(base[2]), np.sin(base[2])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Frame(turn @ frame.pos + [base[0], base[1], 0.0], turn @ frame.mat)


def picture(boxes, camera: Frame, shape=(87, 58), fov_deg=(87.0, 58.0)) -> np.ndarray:
    """Depth of boxes (two corners) on a floor, upright, 0 beyond 10 m: slabs of Kay and Kajiya."""
    down, left = (
        np.tan(np.radians(fov) / 2) * ((2 * np.arange(n) + 1) / n - 1)
        for fov, n in zip(fov_deg, shape, strict=True)
    )
    x, y = np.meshgrid(down, -left, indexing="ij")
    rays = np.stack([x, y, np.ones(shape)], -1) @ camera.mat.T
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[..., 2] < 0.0, -camera.pos[2] / rays[..., 2], np.inf)
        for low, high in boxes:
            ends = np.sort(np.stack([(np.array(end) - camera.pos) / rays for end in (low, high)]), axis=0)
            near, far = ends[0].max(-1), ends[1].min(-1)
            depth = np.where((near <= far) & (near > 0.0), np.minimum(depth, near), depth)
    return np.where(depth < 10.0, depth, 0.0).astype(np.float32)


def stowed(pan=0.0, tilt=-0.6) -> np.ndarray:
    """The stowed joints with the head somewhere."""
    joints = STOWED.copy()
    joints[-2:] = pan, tilt
    return joints


def state_at(base, velocity=(0.0, 0.0), joints=STOWED) -> RobotState:
    return RobotState(0.0, joints, np.zeros(8), np.array(base, dtype=float), np.array(velocity, dtype=float))


def look(pilot: Pilot, boxes, base, pans=PANS, tilts=(-0.4, -1.0)) -> None:
    """Let the pilot look around from a pose of the base."""
    base = np.array(base, dtype=float)
    for tilt in tilts:
        for pan in pans:
            joints = stowed(pan, tilt)
            pilot.see(picture(boxes, camera_at(joints, base)), joints, base)


def surface_points(boxes, step=0.02) -> np.ndarray:
    """Points on the sides of boxes, (n, 3)."""
    points = []
    for low, high in boxes:
        x, y, z = (
            np.linspace(a, b, max(round((b - a) / step), 1) + 1) for a, b in zip(low, high, strict=True)
        )
        for sides in [(x, y[[0, -1]], z), (x[[0, -1]], y, z)]:
            points.append(np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3))
    return np.concatenate(points)


def distance_to(boxes, points) -> np.ndarray:
    """Distance of points (n, 3) to the nearest surface of boxes, from in- or outside, (n,)."""
    gaps = []
    for low, high in boxes:
        beyond = np.maximum(np.array(low) - points, points - np.array(high))
        gaps.append(
            np.abs(
                np.where(
                    beyond.max(-1) < 0.0, beyond.max(-1), np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
                )
            )
        )
    return np.min(gaps, axis=0)
