"""The control loop: a policy drives a robot at its fixed rate, and whatever goes wrong stops the base."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spin_rl.deploy import safety
from spin_rl.deploy.agent import ARRIVED, Agent, Inputs
from spin_rl.deploy.clock import StopSignals
from spin_rl.deploy.fetch.agent import FetchAgent
from spin_rl.deploy.fetch.stages import PLACED
from spin_rl.deploy.interface import Connection, DepthFrame, DeviceLost, Robot, RobotState
from spin_rl.deploy.log import RunLog

TIME_OVER = "time is over"
DONE = (ARRIVED, PLACED)
"""Reasons that are successes."""
_FIRST_INPUTS_S = 5.0
"""How long devices may take to their first state and image."""
_STOP_TRIES = 3
_INSTANT_S = 1e-6


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes:
        reason: One of `DONE`, `TIME_OVER`, the name of a signal, or what went wrong.
        stopped: Whether something went wrong, or somebody ended it.
        steps: Commands sent.
        missed: Ticks at which none was sent because the one before took too long.
        duration_s: From the first tick.
        distance_m: From the base to the goal at the end; None without a goal.
    """

    reason: str
    stopped: bool
    steps: int
    missed: int
    duration_s: float
    distance_m: float | None


class ControlLoop:
    """Runs one policy on one robot."""

    def __init__(
        self, robot: Robot, connection: Connection, agent: Agent | FetchAgent, log: RunLog | None = None
    ) -> None:
        """Refuse a policy that this robot cannot run.

        Args:
            robot: Connected.
            connection: What its `connect` returned.
            agent: The policy.
            log: Gets every step.

        Raises:
            ConfigError: The policy is not for this robot; one line that says why.
        """
        agent.check(connection, set(robot.told()))
        self._robot, self._agent, self._log = robot, agent, log
        self._camera = connection.camera
        self._period = agent.contract.period_s
        self._signals = StopSignals()
        self._steps = self._missed = 0
        self._distance: float | None = None

    def run(
        self, max_s: float, goal: np.ndarray | None = None, object_b: np.ndarray | None = None
    ) -> Outcome:
        """Drive until the goal is reached, the time is over, or something stops it.

        The last thing that the robot is told is to stand, whatever happens. After a signal no command is
        sent.

        Args:
            max_s: Longest time [s].
            goal: Where to drive, in the frame of the odometry [m], shape (2,).
            object_b: Where the object to pick is, in the frame of the base now [m], shape (3,).

        Raises:
            ConfigError: The robot is in no state to start, or is not told where to; nothing has moved then.
        """
        self._agent.check_aims(goal, object_b)
        with StopSignals() as self._signals:
            try:
                try:
                    state = self._wait_for_inputs()
                    if state is None:
                        return self._end(str(self._signals.name), True, 0.0)
                    safety.check_start(state)
                    self._begin(state, goal, object_b)
                    return self._drive(max_s)
                finally:
                    self._stand()
            except KeyboardInterrupt:  # it may have come before signals were ignored there
                self._stand()
                raise

    def _begin(self, state: RobotState, goal: np.ndarray | None, object_b: np.ndarray | None) -> None:
        self._steps = self._missed = 0
        self._agent.reset(state, goal, object_b)
        if self._log is not None:
            self._log.start(state, goal, object_b)

    def _stand(self) -> str:
        """Command zero velocity, more than once if need be; return what to say if that failed."""
        self._signals.ignore()
        for _ in range(_STOP_TRIES):
            try:
                self._robot.stop()
                return ""
            except Exception:  # whatever it is, the next thing to do is to try again
                continue
        return "; the robot could not be told to stand"

    def _drive(self, max_s: float) -> Outcome:
        clock, start = self._robot.clock, self._robot.clock.now()
        self._watch = safety.Watch(start)
        tick = 0
        while True:
            clock.sleep_until(start + tick * self._period)
            now = clock.now()
            if now - start >= max_s - _INSTANT_S:
                reason = TIME_OVER
            else:
                reason = self._step(tick, now - start - tick * self._period)
            if reason is not None:
                return self._end(reason + self._stand(), reason not in (*DONE, TIME_OVER), now - start)
            # The next tick that has not passed; those before it are lost, not made up for.
            due = max(tick + 1, math.ceil((clock.now() - start) / self._period - _INSTANT_S))
            self._missed += due - tick - 1
            tick = due

    def _step(self, tick: int, late_s: float) -> str | None:
        """Observe, act and command once; return why the run ends, or None."""
        robot = self._robot
        try:
            state = robot.state()
            frame = robot.depth() if self._agent.reads_images else None
            reason = self._why_stop(state, frame)
            if reason is not None:
                return reason
            depth = None if frame is None else self._agent.reduce(frame.image)
            reason = self._watch.why_stop(robot.clock.now(), state.base, depth)
            if reason is not None:
                return reason
            inputs = Inputs(state, depth, robot.told(), None if frame is None else frame.stamp_s)
            self._distance = self._agent.distance_m(state)
            reason = self._agent.progress(inputs)
            if reason is not None:
                return reason
            action, command = self._agent.act(inputs)
            # Whatever took long here, what it acts on may be too old by now.
            reason = self._why_stop(state, frame)
            if reason is not None:
                return reason
            robot.command(command)
        except DeviceLost as error:
            return f"lost: {error}"
        except ValueError as error:  # not a number, or an image of another size
            return str(error)
        self._steps += 1
        if self._log is not None:
            self._log.step(tick, late_s, inputs, action, command)
        return None

    def _why_stop(self, state: RobotState, frame: DepthFrame | None) -> str | None:
        if self._signals.name is not None:
            return self._signals.name
        return safety.why_stop(self._robot.clock.now(), state, frame, self._agent.reads_images)

    def _wait_for_inputs(self) -> RobotState | None:
        """Return the first state to start from, once there is an image too; None after a signal."""
        clock, end = self._robot.clock, self._robot.clock.now() + _FIRST_INPUTS_S
        while self._signals.name is None:
            state = self._robot.state()
            frame = self._robot.depth() if self._agent.reads_images else None
            if clock.now() >= end or not self._is_missing(state, frame):
                safety.check_frame(frame, self._camera)
                return state
            clock.sleep_until(clock.now() + self._period)
        return None

    def _is_missing(self, state: RobotState, frame: DepthFrame | None) -> bool:
        oldest = self._robot.clock.now() - safety.MAX_AGE_S
        has_image = frame is not None and frame.stamp_s >= oldest
        return state.stamp_s < oldest or (self._agent.reads_images and not has_image)

    def _end(self, reason: str, stopped: bool, duration_s: float) -> Outcome:
        outcome = Outcome(reason, stopped, self._steps, self._missed, duration_s, self._distance)
        if self._log is not None:
            self._log.end(vars(outcome))
        return outcome
