"""Hand and camera against the official URDF's kinematics (RE1V0, hello-robot-stretch-urdf 0.1.2)."""

import json
from pathlib import Path

import numpy as np
import pytest

from spin_rl import robot
from spin_rl.deploy.kinematics import Kinematics

SAMPLES = json.loads((Path(__file__).parents[1] / "data" / "re1_forward_kinematics.json").read_text())[
    "samples"
]


@pytest.fixture(scope="module")
def kinematics():
    return Kinematics()


@pytest.mark.parametrize("sample", SAMPLES, ids=range(len(SAMPLES)))
def test_frames_equal_the_urdfs(kinematics, sample):
    frames = kinematics(np.array([sample["joints"][joint] for joint in robot.JOINTS]))
    for name, matrix in sample["frames"].items():
        matrix = np.array(matrix)
        np.testing.assert_allclose(frames[name].pos, matrix[:3, 3], atol=2e-5, err_msg=name)
        np.testing.assert_allclose(frames[name].mat, matrix[:3, :3], atol=5e-5, err_msg=name)


def test_a_body_with_two_joints_is_refused(tmp_path):
    joints = '<joint name="lift"/><joint name="wrist_yaw"/>'
    path = tmp_path / "robot.xml"
    path.write_text(f'<mujoco><worldbody><body name="base">{joints}</body></worldbody></mujoco>')
    with pytest.raises(ValueError, match="more than one joint"):
        Kinematics(path)
    path.write_text("<mujoco/>")
    with pytest.raises(ValueError, match="no body"):
        Kinematics(path)
