"""What messages of ROS 2 hold, read without ROS."""

from __future__ import annotations

from typing import Any

import numpy as np

from spin_rl.config import ConfigError


def seconds(message: Any) -> float:
    """Return when a message was stamped, by the clock of its sender [s]."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def metres(message: Any) -> np.ndarray:
    """Read a depth image of `sensor_msgs/Image`, shape (height, width) [m], float32.

    Raises:
        ConfigError: It is encoded otherwise than REP 118 has depth images.
    """
    kinds = {"16UC1": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
    if message.encoding not in kinds:
        raise ConfigError(f"robot.depth: images are {message.encoding!r}, expected one of {', '.join(kinds)}")
    kind, scale = kinds[message.encoding]
    order = ">" if message.is_bigendian else "<"
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)
    size = np.dtype(kind).itemsize * message.width
    values = np.ascontiguousarray(rows[:, :size]).view(f"{order}{kind}")
    return values.astype(np.float32) * np.float32(scale)
