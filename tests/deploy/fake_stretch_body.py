"""stretch_body and pyrealsense2 as far as the back end calls them, written from their documentation.

Positions jump to what was commanded: those of base, lift and arm when `push_command` sends them, those of
the Dynamixel servos at once; `is_slow` servos need time. As in the library, servos leave out moves by
nothing, the computer's time is put on every status whether the device answered or not, boards have clocks of
their own, and the gripper is told and moved in percent, its speed being that of its servo.
"""

import signal
import sys
import time
from types import ModuleType, SimpleNamespace

import numpy as np

FINGER_RAD_PER_PCT = 0.09 / 70.0 / 2.0 / 0.171
PCT_PER_SERVO_RAD = 19.0
WRIST = ("wrist_yaw", "wrist_pitch", "wrist_roll")
LAST: list = []
"""Robots that were made."""


class Joint:
    def __init__(self, body, name, queued):
        self.body, self.name, self.queued = body, name, queued
        self.status = {"timestamp_pc": 0, "pos": 0.1, "vel": 0.0}
        if queued:
            self.status["motor"] = {"timestamp": 0}

    def move_to(self, x, v_m=None, v_r=None):
        self.body.calls.append((self.name, x, v_m if v_r is None else v_r))
        if self.queued:
            self.body.queue.append(lambda: self.status.update(pos=x))
        elif not self.body.is_slow:
            self.status["pos"] = x

    def move_by(self, x):
        self.body.calls.append((self.name, "by", x))
        if not self.queued and abs(x) > 2e-5:
            self.move_to(self.status["pos"] + x)


class Gripper(Joint):
    """In percent of its own, negative while it presses."""

    def __init__(self, body):
        super().__init__(body, "stretch_gripper", queued=False)
        self.gripper_conversion = SimpleNamespace(
            finger_to_robotis=lambda rad: rad / FINGER_RAD_PER_PCT,
            robotis_to_finger=lambda pct: pct * FINGER_RAD_PER_PCT,
        )
        self.move_to(0.0)

    def world_rad_to_pct(self, rad):
        return PCT_PER_SERVO_RAD * rad - 3.0

    def move_to(self, pct, v_r=None):
        super().move_to(pct, v_r=v_r)
        self.status["gripper_conversion"] = {"finger_rad": pct * FINGER_RAD_PER_PCT, "finger_vel": 9.9}


class Chain:
    """Servos on one bus, moved by name."""

    def __init__(self, joints):
        self.motors = {joint.name: joint for joint in joints}
        self.joints = list(self.motors)
        self.status = {name: joint.status for name, joint in self.motors.items()}
        self.comm_errors = SimpleNamespace(status={"n_rx": 0})

    def move_to(self, joint, x, v_r=None):
        self.motors[joint].move_to(x, v_r=v_r)

    def move_by(self, joint, x):
        self.motors[joint].move_by(x)


class Base:
    def __init__(self, body):
        self.body = body
        self.status = {"timestamp_pc": time.time(), "x": 0.0, "y": 0.0, "theta": 0.0}
        self.status |= {"x_vel": 0.0, "theta_vel": 0.0}
        self.status |= {"left_wheel": {"timestamp": 0}, "right_wheel": {"timestamp": 0}}

    def set_velocity(self, v_m, w_r):
        self.body.calls.append(("base", v_m, w_r))
        self.body.queue.append(lambda: self.status.update(x_vel=v_m, theta_vel=w_r))


class Robot:
    """A robot.

    Attributes:
        calls: As they came.
        is_alive: Whether its threads read the devices.
        is_slow: Whether servos stay where they are for now.
        silent: Devices that do not answer.
    """

    starts, tool = True, (*WRIST, "stretch_gripper")

    def __init__(self):
        self.calls, self.queue, self.is_alive, self.homed = [], [], True, True
        self.is_slow, self.silent = False, set()
        self.base = Base(self)
        self.lift, self.arm = Joint(self, "lift", True), Joint(self, "arm", True)
        self.head = Chain([Joint(self, "head_pan", False), Joint(self, "head_tilt", False)])
        tool = [Gripper(self) if n == "stretch_gripper" else Joint(self, n, False) for n in self.tool]
        self.end_of_arm = Chain(tool)
        self.pimu = {"runstop_event": False, "timestamp": 0}
        LAST.append(self)

    def startup(self):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it has handlers of its own
        self.calls.clear()
        return self.starts

    def is_homed(self):
        return self.homed

    def get_status(self):
        if self.is_alive:
            self.pull_status()
        chains = {"head": self.head.status, "end_of_arm": self.end_of_arm.status}
        own = {name: getattr(self, name).status for name in ("base", "lift", "arm")}
        return {**own, **chains, "pimu": self.pimu}

    def pull_status(self):
        parts = (self.base, self.lift, self.arm, *self.head.motors.values(), *self.end_of_arm.motors.values())
        for part in parts:
            part.status["timestamp_pc"] = time.time()
        boards = {"lift": self.lift.status["motor"], "arm": self.arm.status["motor"], "pimu": self.pimu}
        boards |= {name: self.base.status[name] for name in ("left_wheel", "right_wheel")}
        for name, board in boards.items():
            if name not in self.silent:
                board["timestamp"] += 0.04
        for name in {"head", "end_of_arm"} & self.silent:
            getattr(self, name).comm_errors.status["n_rx"] += 1

    def push_command(self):
        self.calls.append(("push",))
        for send in self.queue:
            send()
        self.queue.clear()

    def stop(self):
        self.calls.append(("shutdown",))
        if not self.starts:
            raise AttributeError("nothing to stop")


class Camera:
    """Attributes of pyrealsense2; `frames` is how many it gives, `domain` by which clock its stamps are."""

    def __init__(self):
        self.raw, self.frames, self.domain, self.is_lost, self.stopped = 2000, 1 << 30, "global", False, False
        self.age_s, self.names, self.used = 0.03, ["Intel RealSense D405", "Intel RealSense D435I"], ""

    def module(self):
        library = ModuleType("pyrealsense2")
        library.stream, library.format = SimpleNamespace(depth="depth"), SimpleNamespace(z16="z16")
        library.camera_info = SimpleNamespace(name="name", serial_number="number")
        devices = [SimpleNamespace(get_info=dict(name=n, number=n[-4:]).get) for n in self.names]
        library.context = lambda: SimpleNamespace(query_devices=lambda: devices)
        library.timestamp_domain = SimpleNamespace(hardware_clock="hardware")
        library.pipeline, library.config = lambda: self, lambda: self
        library.rs2_fov = lambda intrinsics: [87.0, 58.0]
        return library

    def enable_device(self, number):
        self.used = number

    def enable_stream(self, stream, width, height, kind, rate):
        self.size = (height, width)

    def start(self, config):
        if self.size[0] > 720:
            raise RuntimeError("Couldn't resolve requests")
        return self

    def __getattr__(self, name):  # the way to the scale and to the intrinsics
        return lambda *arguments: {"get_depth_scale": 0.001}.get(name, self)

    def try_wait_for_frames(self, timeout_ms):
        if self.is_lost:
            raise RuntimeError("Device disconnected")
        self.frames -= 1
        return self.frames >= 0, SimpleNamespace(get_depth_frame=lambda: self)

    def get_frame_timestamp_domain(self):
        return self.domain

    def get_timestamp(self):
        return 1000.0 * (time.time() - self.age_s)

    def get_data(self):
        return np.full(self.size, self.raw, dtype=np.uint16)

    def stop(self):
        self.stopped = True


def install(monkeypatch):
    """Put both in the place of what is not installed; return the camera."""
    library = ModuleType("stretch_body.robot")
    library.Robot = type("Robot", (Robot,), {})
    camera = Camera()
    monkeypatch.setitem(sys.modules, "stretch_body", ModuleType("stretch_body"))
    monkeypatch.setitem(sys.modules, "stretch_body.robot", library)
    monkeypatch.setitem(sys.modules, "pyrealsense2", camera.module())
    LAST.clear()
    return library.Robot, camera
