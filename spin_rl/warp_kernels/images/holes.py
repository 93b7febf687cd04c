# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false
# (a Warp struct is an object, not a class, to a type checker, and wp.tid() has any number of values)
"""Filling the holes of depth images [m], in which 0 is a hole: dilation and closing.

Source: SPIN paper, "Post-processing for clean depth images"; Ku, Harakeh, Waslander, "In Defense of Classical
Image Processing: Fast Depth Completion on the CPU", 2018. Their morphology works on inverted depth, so that
a dilation (a maximum there) prefers what is near; here it is a minimum of the depth over pixels that are no
holes.

The inner loops are C++: the compiler turns them into vector instructions, which it does not for loops over
Warp arrays. All images are flat, world by world and row by row.
"""

import warp as wp

from spin_rl.warp_kernels.images.frames import LANES, ImageLines

MAX_REACH = 8
"""Largest half side of a window that fills holes [pixel]."""

wp.set_module_options({"enable_backward": False})


# The nearest of a window, for some pixels of a row at once. What is outside of the image counts as holes.
_TAKE_NEAREST = f"""
#if defined(__CUDA_ARCH__)
constexpr int lanes = 1;
#else
constexpr int lanes = {LANES};
#endif
constexpr float hole = 1.0e9f;
const int count = cols - col < lanes ? cols - col : lanes;
const int begin = col < reach_cols ? -col : -reach_cols;
const int end = col + count + reach_cols > cols ? cols - col : count + reach_cols;
float line[lanes + 2 * {MAX_REACH}], nearest[lanes];
for (int l = 0; l < lanes; ++l) nearest[l] = hole;
for (int i = -reach_rows; i <= reach_rows; ++i) {{
    if (row + i < 0 || row + i >= rows) continue;
    const float* const p = around.data + offset + (row + i) * cols + col;
    // At the image's sides from a copy with holes beyond.
    const bool inside = begin == -reach_cols && end == lanes + reach_cols;
    if (!inside) {{
        for (int l = 0; l < lanes + 2 * {MAX_REACH}; ++l) line[l] = 0.0f;
        for (int c = begin; c < end; ++c) line[c + {MAX_REACH}] = p[c];
    }}
    const float* const source = inside ? p : line + {MAX_REACH};
    const int reach = is_diamond ? reach_cols - (i < 0 ? -i : i) : reach_cols;
    for (int j = -reach; j <= reach; ++j)
        for (int l = 0; l < lanes; ++l) {{
            const float z = source[l + j] > 0.0f ? source[l + j] : hole;
            nearest[l] = z < nearest[l] ? z : nearest[l];
        }}
}}
const float* const image = depth.data + offset + row * cols + col;
float* const result = out.data + offset + row * cols + col;
for (int l = 0; l < count; ++l) {{
    const float filled = nearest[l] < hole ? nearest[l] : 0.0f;
    result[l] = keep && image[l] > 0.0f ? image[l] : filled;
}}
"""


@wp.func_native(_TAKE_NEAREST)
def _take_nearest(
    depth: wp.array[float],
    around: wp.array[float],
    offset: int,
    rows: int,
    cols: int,
    row: int,
    col: int,
    reach_rows: int,
    reach_cols: int,
    is_diamond: bool,
    keep: bool,
    out: wp.array[float],
): ...


@wp.kernel
def dilate(
    # In
    depth: wp.array[float],
    around: wp.array[float],
    rows: int,
    cols: int,
    lanes: int,
    reach_rows: int,
    reach_cols: int,
    is_diamond: bool,
    keep: bool,
    # Out
    depth_out: wp.array[float],
) -> None:
    """Fill holes with the nearest depth around them, one thread per world and group of pixels."""
    world, row, group = wp.tid()
    _take_nearest(
        depth,
        around,
        world * rows * cols,
        rows,
        cols,
        row,
        group * lanes,
        reach_rows,
        reach_cols,
        is_diamond,
        keep,
        depth_out,
    )


# Two sweeps along some lines at once. The first leaves, at holes, the last depth before them in `out` and the
# number of holes since in `gaps`; the second meets these from the other end.
_CLOSE = f"""
#if defined(__CUDA_ARCH__)
constexpr int lanes = 1;
#else
constexpr int lanes = {LANES};
#endif
constexpr float never = 1.0e6f;
const int count = lines.count - first < lanes ? lines.count - first : lanes;
const auto sweep = [&](auto stride) {{
    float last[lanes] = {{}}, gap[lanes];
    for (int l = 0; l < lanes; ++l) gap[l] = never;
    const int start = offset + first * stride;
    for (int u = 0; u < lines.length; ++u) {{
        const int pixel = start + u * lines.step;
        for (int l = 0; l < count; ++l) {{
            const float z = depth.data[pixel + l * stride];
            last[l] = z > 0.0f ? z : last[l];
            gap[l] = z > 0.0f ? 0.0f : gap[l] + 1.0f;
            out.data[pixel + l * stride] = last[l];
            gaps.data[pixel + l * stride] = gap[l];
        }}
    }}
    for (int l = 0; l < lanes; ++l) {{
        last[l] = 0.0f;
        gap[l] = never;
    }}
    for (int u = lines.length - 1; u >= 0; --u) {{
        const int pixel = start + u * lines.step;
        for (int l = 0; l < count; ++l) {{
            const float z = depth.data[pixel + l * stride];
            last[l] = z > 0.0f ? z : last[l];
            gap[l] = z > 0.0f ? 0.0f : gap[l] + 1.0f;
            const float before = out.data[pixel + l * stride];
            const float farther = before > last[l] ? before : last[l];
            const bool closes = gaps.data[pixel + l * stride] + gap[l] <= reach;
            out.data[pixel + l * stride] = z > 0.0f ? z : (closes ? farther : 0.0f);
        }}
    }}
}};
// Lines that are columns lie beside each other in memory, which makes these loops much faster.
struct One {{
    CUDA_CALLABLE operator wp::int32() const {{ return 1; }}
}};
if (lines.stride == 1) sweep(One());
else sweep(lines.stride);
"""


@wp.func_native(_CLOSE)
def _close(
    depth: wp.array[float],
    offset: int,
    lines: ImageLines,
    first: int,
    reach: float,
    gaps: wp.array[float],
    out: wp.array[float],
): ...


@wp.kernel
def close_lines(
    # In
    depth: wp.array[float],
    lines: ImageLines,
    lanes: int,
    longest: int,
    # Scratch
    gaps: wp.array[float],
    # Out
    depth_out: wp.array[float],
) -> None:
    """Fill short runs of holes from their two ends, one thread per world and group of lines."""
    world, group = wp.tid()
    # At every hole of a run, the distances to its two ends add up to the run's length plus one.
    reach = float(longest + 1)
    _close(depth, world * lines.count * lines.length, lines, group * lanes, reach, gaps, depth_out)
