"""The robot in C MuJoCo: real contacts, small steps, depth by rays. No policy was trained in this.

Time stands still while the policy thinks, unless `realtime` is set.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol

import mujoco
import numpy as np

from spin_rl import robot
from spin_rl.config import Choice, Range, from_mapping
from spin_rl.deploy.backends.cameras import make_camera
from spin_rl.deploy.backends.handled import IMPRATIO, HandledObject, standing_object
from spin_rl.deploy.backends.motion import Movers
from spin_rl.deploy.backends.renderers import RAYS, RENDERERS
from spin_rl.deploy.backends.scandots import NativeScandots
from spin_rl.deploy.contract import Contract, Profile
from spin_rl.deploy.interface import Clock, Command, Connection, DepthFrame, RobotState
from spin_rl.deploy.observations import in_base
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import Scene
from spin_rl.scenes.objects.shapes import OBJECTS, SceneObject
from spin_rl.scenes.scene_file import find_scene, load_scene

TIMESTEP_S = 0.002
_TRACTION_N = 150.0
"""What the wheels can push: the robot's weight of 243 N by a friction of 0.6."""
_TRACTION_NM = 25.0
"""Likewise in turning, by half the distance of the wheels."""


@dataclass(frozen=True)
class Settings:
    """Settings of the back end, `robot.<key>=<value>` on the command line.

    Attributes:
        scene: Scene file, or the name of one in conf/scenes_examples.
        pixels: Columns of the camera's own image; None takes the policy's.
        realtime: Whether simulated time passes as real time does.
        renderer: What makes the images, see `cameras`.
        object: An object to grasp; with one, policies that pick and fetches are told what they must know.
        object_at: Where it stands, on the highest box there, which is the table [m].
    """

    scene: Path
    pixels: Annotated[int, Range(1, 1280)] | None = None
    realtime: bool = False
    renderer: Annotated[str, Choice(RENDERERS)] = RAYS
    object: Annotated[str, Choice(OBJECTS)] | None = None
    object_at: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Reject one without the other."""
        if (self.object is None) != (self.object_at is None):
            raise ValueError("robot.object, robot.object_at: one needs the other")


def open_robot(settings: Mapping[str, Any], contract: Contract) -> MujocoRobot:
    """Make the robot; see `backends`.

    Raises:
        ConfigError: A setting is wrong.
    """
    cfg = from_mapping(Settings, settings, "robot")
    scene = load_scene(find_scene(cfg.scene))
    thing = None
    if cfg.object is not None and cfg.object_at is not None:
        thing = standing_object(scene, cfg.object, cfg.object_at)
    return MujocoRobot(
        scene, contract, pixels=cfg.pixels, realtime=cfg.realtime, renderer=cfg.renderer, thing=thing
    )


class Umpire(Protocol):
    """Looks on and says when an episode is over: then the runstop is pressed."""

    @property
    def is_over(self) -> bool:
        """Whether it is."""
        ...

    def add_substep(self, data: mujoco.MjData) -> None:
        """Look at the physics step just made; contacts and poses are of its start."""
        ...

    def judge(self, data: mujoco.MjData) -> None:
        """Look at the control step just made."""
        ...


class MujocoRobot:
    """One robot in one scene; a `Robot`, and its own clock.

    Attributes:
        clock: The robot itself: simulated time.
        model: The model.
        data: Its state.
        umpire: Looks on, if there is one.
        handled: What it knows of the object to grasp, if there is one.
    """

    def __init__(
        self,
        scene: Scene,
        contract: Contract,
        *,
        pixels: int | None = None,
        realtime: bool = False,
        renderer: str = RAYS,
        thing: tuple[SceneObject, int] | None = None,
    ) -> None:
        """Put the robot at the scene's start.

        Args:
            scene: The world.
            contract: Gives servo speeds, camera and image size.
            pixels: See `Settings`.
            realtime: See `Settings`.
            renderer: See `Settings`.
            thing: An object to grasp, and the slot of the table that it stands on.
        """
        self.clock: Clock = self
        self.model = native_model(scene, obj=None if thing is None else thing[0], movable=True)
        self.model.opt.timestep = TIMESTEP_S
        defaults = mujoco.MjOption()
        self.model.opt.iterations, self.model.opt.ls_iterations = defaults.iterations, defaults.ls_iterations
        for joint in robot.DOF_NAMES[:3]:
            force = _TRACTION_NM if joint == "base_yaw" else _TRACTION_N
            actuator = self.model.actuator(joint).id
            self.model.actuator_forcelimited[actuator] = True
            self.model.actuator_forcerange[actuator] = -force, force
        self.handled: HandledObject | None = None
        if thing is not None:
            self.model.opt.impratio = IMPRATIO
            self.handled = HandledObject(scene, thing[1], thing[0], self.model, contract)
        self.data = mujoco.MjData(self.model)
        self._touched: set[tuple[int, int]] = set()
        self.umpire: Umpire | None = None
        self._movers = Movers(scene)
        names = np.array(scene.pool.geom_names())[self._movers.slots]
        self._mocap = [int(self.model.body(name).mocapid[0]) for name in names]
        self._goal = (float(scene.goal[0]), float(scene.goal[1]))
        self._scandots: NativeScandots | None = None
        if contract.scandots is not None:
            self._scandots = NativeScandots(scene, self.model, contract)
        self._servos = _Servos(contract.speed_profile)
        self._camera = make_camera(self.model, contract, pixels=pixels, renderer=renderer)
        self._realtime, self._epoch = realtime, time.monotonic()
        joints: dict[str, float] = dict(zip(robot.JOINTS, scene.start_joints.tolist(), strict=True))
        self.data.qpos[:] = robot.qpos_from_joints(self.model, joints)
        self.data.qpos[:3] = scene.start
        self._put_movers()
        mujoco.mj_forward(self.model, self.data)
        self._command = self._holding()

    @property
    def touched(self) -> set[tuple[str, str]]:
        """Names of the geoms that touched each other so far, in order."""
        pairs = (sorted(self.model.geom(geom).name for geom in pair) for pair in self._touched)
        return {(first, second) for first, second in pairs}

    def connect(self) -> Connection:
        """Say what there is."""
        object_b = None
        if self.handled is not None:
            object_b = tuple(in_base(self.handled.start, self.data.qpos[:3]).tolist())
        return Connection(is_real=False, camera=self._camera.info, goal=self._goal, object_b=object_b)

    def now(self) -> float:
        """Return the simulated time [s]."""
        return float(self.data.time)

    def sleep_until(self, time_s: float) -> None:
        """Simulate up to a time [s]."""
        is_step = self.data.time < time_s - 1e-9
        if is_step and self.handled is not None:
            self.handled.clear()
        while self.data.time < time_s - 1e-9:
            self._servos.drive(self._command, self.data)
            if self._mocap:
                self._movers.advance(self.data.qpos[:2], TIMESTEP_S)
                self._put_movers()
            mujoco.mj_step(self.model, self.data)
            self._note_contacts()
            if self.handled is not None:
                self.handled.add_substep(self.data)
            if self.umpire is not None:
                self.umpire.add_substep(self.data)
        if is_step and self.umpire is not None:
            self.umpire.judge(self.data)
        if self._realtime:
            time.sleep(max(self._epoch + time_s - time.monotonic(), 0.0))

    def state(self) -> RobotState:
        """Return the present state."""
        qpos, qvel, yaw = self.data.qpos, self.data.qvel, self.data.qpos[2]
        forward = qvel[0] * math.cos(yaw) + qvel[1] * math.sin(yaw)
        return RobotState(
            stamp_s=self.now(),
            joints=_joints(qpos),
            joint_velocity=_joints(qvel),
            base=qpos[:3].copy(),
            base_velocity=np.array([forward, qvel[2]]),
            runstop=self.umpire is not None and self.umpire.is_over,
        )

    def depth(self) -> DepthFrame:
        """Return the present image."""
        mujoco.mj_kinematics(self.model, self.data)
        return DepthFrame(self.now(), self._camera.image(self.data))

    def command(self, command: Command) -> None:
        """Follow a command from now on."""
        self._command = command

    def stop(self) -> None:
        """Stand, and hold the joints."""
        self._command = self._holding()

    def close(self) -> None:
        """Do nothing: there are no devices."""

    def told(self) -> Mapping[str, np.ndarray]:
        """Return what a simulator knows: scandots of a policy that needs them, and all about an object."""
        mujoco.mj_kinematics(self.model, self.data)
        groups: dict[str, np.ndarray] = {}
        if self._scandots is not None:
            groups |= self._scandots.group(self.data, self._movers)
        if self.handled is not None:
            groups |= self.handled.told(self.data)
        return groups

    def _holding(self) -> Command:
        return Command(0.0, 0.0, _joints(self.data.qpos), np.full(len(robot.JOINTS), np.inf))

    def _put_movers(self) -> None:
        if self._mocap:
            self.data.mocap_pos[self._mocap] = self._movers.pos

    def _note_contacts(self) -> None:
        self._touched.update(map(tuple, self.data.contact.geom.tolist()))


class _Servos:
    """First-order joints and base, as `sim.drive` has them, with a command's own speed limits."""

    def __init__(self, profile: Profile) -> None:
        self._lag = profile.base_time_constant
        self._gain = -math.expm1(-TIMESTEP_S / profile.joint_time_constant) / TIMESTEP_S
        self._most = np.array([profile.base_acceleration, profile.turn_acceleration]) * TIMESTEP_S
        self._base = np.zeros(2)
        self._joint = [robot.JOINTS.index(joint) for joint, _ in robot.DOF_SOURCE]
        self._share = np.array([share for _, share in robot.DOF_SOURCE])

    def drive(self, command: Command, data: mujoco.MjData) -> None:
        """Write the velocity set-points of one step."""
        wanted = np.array([command.forward, command.turn])
        step = (wanted - self._base) * -math.expm1(-TIMESTEP_S / self._lag)
        self._base = self._base + np.clip(step, -self._most, self._most)
        yaw = data.qpos[2] + 0.5 * TIMESTEP_S * self._base[1]
        forward, turn = self._base
        limit = self._share * command.joint_speed[self._joint]
        gap = self._share * command.joints[self._joint] - data.qpos[3 : len(robot.DOF_NAMES)]
        data.ctrl[:3] = forward * math.cos(yaw), forward * math.sin(yaw), turn
        data.ctrl[3:] = np.clip(gap * self._gain, -limit, limit)


def _joints(values: np.ndarray) -> np.ndarray:
    """Read `robot.JOINTS` values out of generalized ones, shape (13,) -> (8,)."""
    return np.array(
        [
            values[3],
            values[4] + values[5],
            *values[6:9],
            0.5 * (values[9] + values[10]),
            *values[11:13],
        ]
    )
