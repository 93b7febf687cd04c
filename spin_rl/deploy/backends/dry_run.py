"""A robot that is watched and not moved: what it would be told is printed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spin_rl import robot
from spin_rl.deploy.interface import Command, Connection, DepthFrame, Robot, RobotState


class DryRun:
    """A `Robot` that has the sensors of another one; commands end in lines of text.

    Attributes:
        clock: That of the robot.
    """

    def __init__(self, watched: Robot) -> None:
        """Watch a robot."""
        self.clock = watched.clock
        self._watched = watched

    def connect(self) -> Connection:
        """Connect the robot."""
        return self._watched.connect()

    def state(self) -> RobotState:
        """Return the robot's state."""
        return self._watched.state()

    def depth(self) -> DepthFrame | None:
        """Return its image."""
        return self._watched.depth()

    def told(self) -> Mapping[str, np.ndarray]:
        """Return what it tells."""
        return self._watched.told()

    def command(self, command: Command) -> None:
        """Print a command."""
        joints = ", ".join(
            f"{name} {value:.3f}" for name, value in zip(robot.JOINTS, command.joints, strict=True)
        )
        print(f"dry run: {command.forward:+.3f} m/s, {command.turn:+.3f} rad/s, {joints}", flush=True)

    def stop(self) -> None:
        """Print that it would stand."""
        print("dry run: stop", flush=True)

    def close(self) -> None:
        """Let go of the robot's devices."""
        self._watched.close()
