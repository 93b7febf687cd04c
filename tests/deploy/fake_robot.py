"""A robot that moves as it is told at once, in a time of its own, and breaks where a test wants it to."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from spin_rl import robot
from spin_rl.deploy.interface import CameraInfo, Command, Connection, DepthFrame, RobotState

DATA = Path(__file__).parents[1] / "data"
CAMERA = CameraInfo("portrait", 87, 58, (87.0, 58.0))
STOWED = np.array([robot.STOWED[joint] for joint in robot.JOINTS])
STATE = RobotState(0.0, STOWED, np.zeros(8), np.zeros(3), np.zeros(2))


@dataclass
class FakeRobot:
    """A `Robot`, and its clock.

    Attributes:
        connection: What it says it is.
        start: Its first state.
        faults: By the number of the state that is asked for (the first is 0): what happens then, a function
            of the robot that may raise or return another state.
        work_s: By the same numbers: how long the step takes [s].
        calls: "command", "stop" and "close" as they came.
        commands: Those that came.
    """

    connection: Connection = field(default_factory=lambda: Connection(is_real=False, camera=CAMERA))
    start: RobotState = STATE
    faults: dict = field(default_factory=dict)
    work_s: dict = field(default_factory=dict)
    calls: list = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    image: np.ndarray = field(default_factory=lambda: np.full((58, 87), 2.0, dtype=np.float32))
    image_age_s: float = 0.0
    told_groups: dict = field(default_factory=dict)

    def __post_init__(self):
        self.clock, self.time, self.asked, self.now_moving = self, 0.0, -1, np.zeros(2)
        self.pose = self.start.base.copy()

    def now(self):
        return self.time

    def sleep_until(self, time_s):
        step = max(time_s - self.time, 0.0)
        self.pose = self.pose + step * self.now_moving[0] * np.array([1.0, 0.0, 0.0])
        self.time += step

    def connect(self):
        return self.connection

    def state(self):
        self.asked += 1
        self.time += self.work_s.get(self.asked, 0.0)
        state = replace(self.start, stamp_s=self.time, base=self.pose)
        fault = self.faults.get(self.asked)
        return state if fault is None else fault(self, state) or state

    def depth(self):
        return None if self.image is None else DepthFrame(self.time - self.image_age_s, self.image)

    def command(self, command):
        self.calls.append("command")
        self.commands.append(command)
        self.now_moving = np.array([command.forward, command.turn])

    def stop(self):
        self.calls.append("stop")
        self.now_moving = np.zeros(2)

    def close(self):
        self.calls.append("close")

    def told(self):
        return self.told_groups


LAST: list[FakeRobot] = []
"""Robots that `open_robot` made, for tests of the command."""


def open_robot(settings, contract):
    LAST.append(FakeRobot(**settings))
    return LAST[-1]
