"""Where hand and camera are by the robot's joints: forward kinematics from its MJCF, by NumPy alone."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spin_rl import robot
from spin_rl.paths import ROBOT_XML

_PLANAR = robot.DOF_NAMES[:3]
"""Joints of the base's pose in the world, which is not part of a frame in the base."""


@dataclass(frozen=True)
class Frame:
    """A frame in the base frame, which is on the floor between the wheels: x forward, y left, z up.

    Attributes:
        pos: Its origin [m], shape (3,).
        mat: Its axes as columns, shape (3, 3).
    """

    pos: np.ndarray
    mat: np.ndarray

    def to_base(self, points: np.ndarray) -> np.ndarray:
        """Turn points of this frame into the base frame [m], shape (..., 3)."""
        return points @ self.mat.T + self.pos


@dataclass(frozen=True)
class _Body:
    name: str
    parent: int
    pos: np.ndarray
    mat: np.ndarray
    joint: int | None  # index into robot.JOINTS
    share: float
    is_slide: bool
    axis: np.ndarray


class Kinematics:
    """Frames of the robot's bodies, and of its sites, which have the names of the official URDF's links."""

    def __init__(self, path: Path = ROBOT_XML) -> None:
        """Read bodies, joints and sites of an MJCF whose root body is the base."""
        self._bodies: list[_Body] = []
        self._sites: dict[str, tuple[str, np.ndarray, np.ndarray]] = {}
        base = ElementTree.parse(path).getroot().find("worldbody/body")
        if base is None:
            raise ValueError(f"{path}: no body")
        self._read(base, parent=-1)

    def __call__(self, joints: np.ndarray) -> dict[str, Frame]:
        """Return the frames of all sites by name; `joints` in `robot.JOINTS` order [m, rad], shape (8,)."""
        return self.sites(self.bodies(joints))

    def bodies(self, joints: np.ndarray) -> dict[str, Frame]:
        """Return the frames of all bodies by name, in the order of the MJCF; `joints` as above."""
        poses: list[Frame] = []
        for body in self._bodies:
            pos, mat = body.pos, body.mat
            if body.joint is not None:
                value = body.share * float(joints[body.joint])
                if body.is_slide:
                    pos = pos + mat @ (value * body.axis)
                else:
                    mat = mat @ _turn(body.axis, value)
            if body.parent >= 0:
                parent = poses[body.parent]
                pos, mat = parent.pos + parent.mat @ pos, parent.mat @ mat
            poses.append(Frame(pos, mat))
        return {body.name: pose for body, pose in zip(self._bodies, poses, strict=True)}

    def sites(self, bodies: Mapping[str, Frame]) -> dict[str, Frame]:
        """Return the frames of all sites by name, from what `bodies` returned."""
        return {
            name: Frame(bodies[body].pos + bodies[body].mat @ pos, bodies[body].mat @ mat)
            for name, (body, pos, mat) in self._sites.items()
        }

    def _read(self, element: ElementTree.Element, parent: int) -> None:
        index = len(self._bodies)
        joints = [joint for joint in element.findall("joint") if joint.get("name") not in _PLANAR]
        if len(joints) > 1:
            raise ValueError(f"body {element.get('name')!r} has more than one joint")
        joint, share, is_slide, axis = None, 0.0, False, np.array([0.0, 0.0, 1.0])
        for found in joints:
            source, share = robot.DOF_SOURCE[robot.DOF_NAMES.index(found.get("name", "")) - len(_PLANAR)]
            joint, is_slide = robot.JOINTS.index(source), found.get("type") == "slide"
            axis = _numbers(found, "axis", "0 0 1")
        name = element.get("name", "")
        self._bodies.append(_Body(name, parent, *_pose(element), joint, share, is_slide, axis))
        for site in element.findall("site"):
            self._sites[site.get("name", "")] = (name, *_pose(site))
        for child in element.findall("body"):
            self._read(child, index)


def _numbers(element: ElementTree.Element, key: str, default: str) -> np.ndarray:
    return np.array(element.get(key, default).split(), dtype=float)


def _pose(element: ElementTree.Element) -> tuple[np.ndarray, np.ndarray]:
    return _numbers(element, "pos", "0 0 0"), rotation(_numbers(element, "quat", "1 0 0 0"))


def rotation(quat: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length, shape (3, 3)."""
    w, x, y, z = quat / np.linalg.norm(quat)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
