"""Capturing a sequence of kernel launches once and replaying it, on CPU and CUDA alike."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
import warp as wp


@contextmanager
def torch_order(device: str | wp.Device) -> Iterator[None]:
    """Launch on a device and, on CUDA, in the order of Torch's current stream: nobody has to wait.

    Warp has a stream of its own there. It keeps in step with Torch's default stream, but with no other.
    """
    device = wp.get_device(device)
    if not device.is_cuda:
        with wp.ScopedDevice(device):
            yield
        return
    stream = wp.stream_from_torch(torch.cuda.current_stream(torch.device(str(device))))
    # Both ways: what Warp's own stream holds comes before, what it gets later comes after.
    with wp.ScopedDevice(device), wp.ScopedStream(stream, sync_enter=True, sync_exit=True):
        yield


class StepGraph:
    """A function that only launches kernels, replayed as one graph.

    On the CPU device the captured graph is many times faster than eager launches. Run the function once
    eagerly before, which compiles and loads every kernel. Arrays that the function uses must keep their
    addresses, and values that change must live in arrays: scalars are frozen by the capture.
    """

    def __init__(self, launch: Callable[[], None], device: str, *, capture: bool = True) -> None:
        """Capture a function.

        Args:
            launch: Launches kernels on the device, reads nothing back and allocates nothing that must last.
            device: Warp device.
            capture: False keeps eager launches, for tests and debugging.
        """
        self._launch = launch
        self._device = wp.get_device(device)
        self._graph = None
        if not capture:
            return
        # A graph that the collector destroys while another is being captured corrupts the capture on CUDA.
        enabled = gc.isenabled()
        gc.disable()
        try:
            with wp.ScopedDevice(self._device), wp.ScopedCapture(self._device) as captured:
                launch()
        finally:
            if enabled:
                gc.enable()
        self._graph = captured.graph

    def replay(self) -> None:
        """Run the sequence once, on CUDA in the order of Torch's current stream."""
        with torch_order(self._device):
            if self._graph is None:
                self._launch()
            else:
                wp.capture_launch(self._graph)
