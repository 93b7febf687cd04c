"""The depth camera of a Stretch by pyrealsense2: all calls of that library. Never tried on a camera.

Written from the library's documentation (2.59): `context`, `pipeline`, `config`, `try_wait_for_frames`.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from spin_rl.config import ConfigError
from spin_rl.deploy.interface import CameraInfo, Clock, DepthFrame, DeviceLost
from spin_rl.extras import require

_RATE_HZ = 30
_NO_WAIT_MS = 1
_HEAD_CAMERA = "D435"
"""Part of its name; a Stretch 3 has another camera at the gripper, whose view is as wide."""


class RealSense:
    """A D435i as it is mounted on the head of a Stretch 1, 2 or 3: on its side."""

    def __init__(self, clock: Clock, width: int, height: int) -> None:
        """Import the library; images will have this size, one that the camera offers.

        Raises:
            ConfigError: The library is missing.
        """
        self._rs: Any = require("pyrealsense2", "pyrealsense2", "stretch", "backend")
        self._clock, self._size = clock, (width, height)
        self._pipeline: Any = None
        self._last: DepthFrame | None = None

    def start(self) -> CameraInfo:
        """Start the stream of depth images.

        Raises:
            ConfigError: There is no camera, or it does not offer this size.
        """
        rs, (width, height) = self._rs, self._size
        pipeline, config = rs.pipeline(), rs.config()
        config.enable_device(self._serial_number())
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, _RATE_HZ)
        try:
            profile = pipeline.start(config)
        except RuntimeError as error:
            raise ConfigError(f"camera: no depth images of {width} x {height}: {error}") from None
        self._pipeline = pipeline
        self._scale = float(profile.get_device().first_depth_sensor().get_depth_scale())
        stream = profile.get_stream(rs.stream.depth).as_video_stream_profile()
        across, down = rs.rs2_fov(stream.get_intrinsics())
        return CameraInfo("portrait", width, height, (float(across), float(down)))

    def _serial_number(self) -> str:
        info = self._rs.camera_info
        names = {}
        for device in self._rs.context().query_devices():
            names[device.get_info(info.name)] = device.get_info(info.serial_number)
        for name, number in names.items():
            if _HEAD_CAMERA in name:
                return number
        raise ConfigError(f"camera: there is no {_HEAD_CAMERA}i, only {', '.join(names) or 'none'}")

    def frame(self) -> DepthFrame | None:
        """Return the latest image, however old.

        Raises:
            DeviceLost: The camera does not answer.
            ConfigError: Its stamps are by a clock of its own, so that nobody knows how old images are.
        """
        try:
            is_new, frames = self._pipeline.try_wait_for_frames(_NO_WAIT_MS)
        except RuntimeError as error:
            raise DeviceLost(f"the camera: {error}") from None
        if is_new and (depth := frames.get_depth_frame()):
            if depth.get_frame_timestamp_domain() == self._rs.timestamp_domain.hardware_clock:
                raise ConfigError("camera: stamps are by its own clock; enable its global time")
            # None is from the future, or the last one would stay new if the computer's clock was set back.
            age_s = max(time.time() - depth.get_timestamp() / 1000.0, 0.0)
            metres = np.asanyarray(depth.get_data()).astype(np.float32) * np.float32(self._scale)
            self._last = DepthFrame(self._clock.now() - age_s, metres)
        return self._last

    def stop(self) -> None:
        """Stop the stream."""
        if self._pipeline is not None:
            self._pipeline.stop()
            self._pipeline = None
