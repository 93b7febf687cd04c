"""ROS 2 and Hello Robot's driver as far as the back end calls them, written from their interfaces.

Messages come when a subscription is made, and after every command. The driver follows speeds in its
navigation mode alone, and joint poses once they are activated.
"""

import math
import sys
import time
from types import ModuleType, SimpleNamespace

import numpy as np

MESSAGES = {
    "geometry_msgs.msg": ("Twist",),
    "nav_msgs.msg": ("Odometry",),
    "sensor_msgs.msg": ("JointState", "Image", "CameraInfo"),
    "std_msgs.msg": ("Float64MultiArray", "String", "Bool"),
    "std_srvs.srv": ("Trigger",),
}
ARM, LIFT, YAW, PITCH, ROLL, PAN, TILT, FINGER = range(8)
NAMES = ("wrist_extension", "joint_lift", "joint_wrist_yaw", "joint_wrist_pitch", "joint_wrist_roll")
NAMES += ("joint_head_pan", "joint_head_tilt", "joint_gripper_finger_left")


class Message(SimpleNamespace):
    """Any message; those that are made empty have the fields of a Twist."""

    Request = SimpleNamespace

    def __init__(self, **fields):
        super().__init__(**{"linear": SimpleNamespace(x=0.0), "angular": SimpleNamespace(z=0.0), **fields})


class Driver:
    """The driver, and the whole of rclpy: node, executor, publishers and services.

    Attributes:
        calls: Services and speeds as they came, and joint poses.
        silent: Topics on which nothing comes.
        refuses: Services that fail.
    """

    def __init__(self):
        self.calls, self.silent, self.refuses, self.absent = [], set(), set(), set()
        self.mode, self.is_active, self.age_s, self.is_up = "position", False, 0.0, False
        self.homed, self.runstopped, self.names = True, False, NAMES
        self.pose, self.speed, self.yaw = (
            np.array([0.1, 0.6, 3.0, -0.6, 0.0, 0.0, -0.6, 0.1]),
            (0.0, 0.0),
            0.5,
        )
        self.encoding, self.callbacks = "16UC1", {}

    # What rclpy has.
    def init(self, signal_handler_options):
        self.signals, self.is_up = signal_handler_options, True

    def shutdown(self):
        self.is_up = False

    def create_node(self, name):
        return self

    def destroy_node(self):
        pass

    def add_node(self, node):
        pass

    def spin(self):
        while self.is_up:
            self.publish_all()
            time.sleep(0.02)

    def get_clock(self):
        return self

    def now(self):
        return SimpleNamespace(nanoseconds=int(time.time() * 1e9))

    def create_subscription(self, kind, topic, callback, quality):
        self.callbacks[topic] = callback

    def create_publisher(self, kind, topic, depth):
        return SimpleNamespace(publish=lambda message: self.take(topic, message))

    def create_client(self, kind, service):
        def answer(request):
            self.calls.append(service)
            if service == "/switch_to_navigation_mode":
                self.mode = "navigation"
            self.is_active |= service == "/activate_streaming_position"
            result = SimpleNamespace(success=service not in self.refuses)
            return SimpleNamespace(done=lambda: True, result=lambda: result)

        is_there = service not in self.absent
        return SimpleNamespace(wait_for_service=lambda timeout_sec: is_there, call_async=answer)

    # What the driver does.
    def take(self, topic, message):
        if topic == "/stretch/cmd_vel":
            self.calls.append((message.linear.x, message.angular.z))
            self.speed = self.calls[-1] if self.mode == "navigation" else (0.0, 0.0)
        else:
            assert topic == "/joint_pose_cmd" and len(message.data) == 10 and message.data[8:] == [0.0, 0.0]
            self.calls.append(message.data)
            if self.is_active and self.mode in ("position", "navigation"):
                self.pose = np.array(message.data[:8])
        self.publish_all()

    def publish_all(self):
        seconds = time.time() - self.age_s
        stamp = SimpleNamespace(sec=int(seconds), nanosec=int(seconds % 1 * 1e9))
        header = SimpleNamespace(stamp=stamp)
        turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(self.yaw / 2), w=math.cos(self.yaw / 2))
        pose = SimpleNamespace(position=SimpleNamespace(x=1.0, y=2.0), orientation=turn)
        pose, twist = SimpleNamespace(pose=pose), Message()
        twist.linear.x, twist.angular.z = self.speed
        depth = {"16UC1": np.full((4, 6), 1500, "<u2"), "32FC1": np.full((4, 6), 1.5, "<f4")}
        image = depth.get(self.encoding, np.zeros((4, 6), np.uint8))
        padded = np.pad(image.view(np.uint8), ((0, 0), (0, 5)))
        messages = {
            "/odom": Message(header=header, pose=pose, twist=SimpleNamespace(twist=twist)),
            "/stretch/joint_states": Message(
                header=header, name=list(self.names), position=list(self.pose), velocity=[0.0] * 8
            ),
            "/mode": Message(data=self.mode),
            "/is_homed": Message(data=self.homed),
            "/is_runstopped": Message(data=self.runstopped),
            "/camera/depth/camera_info": Message(width=87, height=58, k=[45.84, 0, 0, 0, 52.32, 0, 0, 0, 1]),
            "/camera/depth/image_rect_raw": Message(
                header=header, encoding=self.encoding, is_bigendian=0, height=4, width=6,
                step=padded.shape[1], data=padded.tobytes(),
            ),
        }  # fmt: skip
        for topic, callback in list(self.callbacks.items()):
            if topic not in self.silent:
                callback(messages[topic])


def install(monkeypatch):
    """Put it in the place of what is not installed; return the driver."""
    driver, modules = Driver(), {}

    def module(name, **names):
        modules[name] = ModuleType(name)
        vars(modules[name]).update(names)
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(modules[parent], child, modules[name])

    module("rclpy", init=driver.init, shutdown=driver.shutdown, create_node=driver.create_node)
    module("rclpy.executors", SingleThreadedExecutor=lambda: driver)
    module("rclpy.qos", qos_profile_sensor_data=5)
    module("rclpy.signals", SignalHandlerOptions=SimpleNamespace(NO="no handlers"))
    for name, kinds in MESSAGES.items():
        package = name.partition(".")[0]
        if package not in modules:
            module(package)
        module(name, **dict.fromkeys(kinds, Message))
    for name, made in modules.items():
        monkeypatch.setitem(sys.modules, name, made)
    return driver
