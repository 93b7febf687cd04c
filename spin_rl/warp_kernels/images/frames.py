# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""What the kernels of depth images share: lines of pixels, and counting frames."""

import warp as wp

LANES = 16
"""Pixels or lines that a thread of the CPU computes side by side, in vector instructions."""

wp.set_module_options({"enable_backward": False})


@wp.struct
class ImageLines:
    """Parallel lines of pixels in a flattened image, row by row in memory.

    Attributes:
        count: Number of lines.
        length: Pixels of a line.
        stride: From a pixel to the same one of the next line.
        step: From a pixel to the next one of its line.
    """

    count: int
    length: int
    stride: int
    step: int


def image_lines(rows: int, cols: int, *, along_rows: bool = True) -> ImageLines:
    """Lines of an image of some rows and columns: its rows, or with `along_rows` false its columns."""
    lines = ImageLines()
    lines.count, lines.length = (rows, cols) if along_rows else (cols, rows)
    lines.stride, lines.step = (cols, 1) if along_rows else (1, cols)
    return lines


@wp.kernel
def count_frames(
    # In and out
    frame: wp.array(dtype=wp.int32),
) -> None:
    """Count one more frame in every world."""
    world = wp.tid()
    frame[world] = frame[world] + 1


@wp.kernel
def restart_frames(
    # In
    mask: wp.array(dtype=bool),
    # Out
    frame_out: wp.array(dtype=wp.int32),
) -> None:
    """Count from zero in the masked worlds."""
    world = wp.tid()
    if mask[world]:
        frame_out[world] = 0
