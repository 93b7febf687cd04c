# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false
# (a Warp struct is an object, not a class, to a type checker, and wp.tid() has any number of values)
"""Smoothing depth images [m], in which 0 is a hole, in space and over time, and their scale for the policy.

Source: SPIN paper, "Post-processing for clean depth images"; Ku, Harakeh, Waslander, "In Defense of Classical
Image Processing: Fast Depth Completion on the CPU", 2018.

The inner loops are C++: the compiler turns them into vector instructions, which it does not for loops over
Warp arrays. All images are flat, world by world and row by row.
"""

import warp as wp

from spin_rl.warp_kernels.images.frames import LANES

wp.set_module_options({"enable_backward": False})


@wp.struct
class Smoothing:
    """Smoothing within an image; every effect is off at zero.

    Attributes:
        jump: Neighbours that differ by more than this ratio are different surfaces.
        support: A pixel with fewer neighbours on its own surface takes the median of its neighbourhood.
        blur: Weight of a neighbour in the blur; a corner's is its square.
    """

    jump: float
    support: int
    blur: float


@wp.struct
class Memory:
    """Smoothing over time, and the policy's scale; every effect is off at zero.

    Attributes:
        weight: Weight of the past in a pixel that changed little.
        change: A pixel that changed by more than this ratio since the last frame starts anew.
        hold: Frames for which a hole keeps the last depth.
        near: Depth that the policy sees as 0 [m].
        far: Depth that the policy sees as 1, as it does holes [m].
    """

    weight: float
    change: float
    hold: int
    near: float
    far: float


# A pixel's surface: those of its 3x3 neighbourhood whose depth is similar. A hole never is, since the
# tolerance is less than the depth. What is outside of the image counts as holes.
_SMOOTH = f"""
#if defined(__CUDA_ARCH__)
constexpr int lanes = 1;
#else
constexpr int lanes = {LANES};
#endif
const int count = cols - col < lanes ? cols - col : lanes;
const float* const image = depth.data + offset;
float window[3][lanes + 2] = {{}};
for (int i = 0; i < 3; ++i) {{
    const int r = row + i - 1;
    if (r < 0 || r >= rows) continue;
    const float* const p = image + r * cols + col;
    for (int l = 0; l < count; ++l) window[i][l + 1] = p[l];
    if (col > 0) window[i][0] = p[-1];
    if (col + count < cols) window[i][count + 1] = p[count];
}}
float result[lanes];
int support[lanes];
for (int l = 0; l < lanes; ++l) {{
    const float z = window[1][l + 1];
    const float tolerance = smoothing.jump * z;
    float sum = 0.0f, weights = 0.0f;
    int similar = -1;  // without the pixel itself
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {{
            const float neighbour = window[i][l + j];
            const float weight = (i == 1 ? 1.0f : smoothing.blur) * (j == 1 ? 1.0f : smoothing.blur);
            const bool same = fabsf(neighbour - z) <= tolerance;
            sum += same ? weight * neighbour : 0.0f;
            weights += same ? weight : 0.0f;
            similar += same ? 1 : 0;
        }}
    result[l] = sum / weights;
    support[l] = z > 0.0f ? similar : 9;
}}
int least = 9;
for (int l = 0; l < lanes; ++l) least = support[l] < least ? support[l] : least;
for (int l = 0; least < smoothing.support && l < lanes; ++l) {{
    if (support[l] >= smoothing.support) continue;
    // Median of what is no hole, of two middle ones the nearer.
    float sorted[9];
    int size = 0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {{
            const float value = window[i][l + j];
            if (value <= 0.0f) continue;
            int place = size++;
            for (; place > 0 && sorted[place - 1] > value; --place) sorted[place] = sorted[place - 1];
            sorted[place] = value;
        }}
    result[l] = sorted[(size - 1) / 2];
}}
float* const p = out.data + offset + row * cols + col;
for (int l = 0; l < count; ++l) p[l] = result[l];
"""


@wp.func_native(_SMOOTH)
def _smooth(
    depth: wp.array[float],
    offset: int,
    rows: int,
    cols: int,
    row: int,
    col: int,
    smoothing: Smoothing,
    out: wp.array[float],
): ...


@wp.kernel
def smooth_pixels(
    # In
    depth: wp.array[float],
    rows: int,
    cols: int,
    lanes: int,
    smoothing: Smoothing,
    # Out
    depth_out: wp.array[float],
) -> None:
    """Smooth images, one thread per world and group of pixels."""
    world, row, group = wp.tid()
    _smooth(depth, world * rows * cols, rows, cols, row, group * lanes, smoothing, depth_out)


_REMEMBER = """
const float scale = 1.0f / (memory.far - memory.near);
const float past = is_first ? 0.0f : 1.0f;
for (int i = start; i < start + count; ++i) {
    const float z = depth.data[i];
    const float last = past * history.data[i];
    const int frames = is_first ? 0 : age.data[i];
    const bool is_hole = z <= 0.0f;
    const bool is_held = is_hole && last > 0.0f && frames < memory.hold;
    const bool is_similar = last > 0.0f && fabsf(last - z) <= memory.change * z;
    const float value = is_held ? last : (is_similar ? z + memory.weight * (last - z) : z);
    float scaled = (value - memory.near) * scale;
    scaled = scaled < 0.0f ? 0.0f : scaled;
    scaled = scaled > 1.0f || value <= 0.0f ? 1.0f : scaled;
    age.data[i] = is_held ? frames + 1 : 0;
    history.data[i] = value;
    policy.data[i] = scaled;
}
"""


@wp.func_native(_REMEMBER)
def _remember(
    depth: wp.array[float],
    start: int,
    count: int,
    memory: Memory,
    is_first: bool,
    age: wp.array[wp.int32],
    history: wp.array[float],
    policy: wp.array[float],
): ...


@wp.kernel
def remember_pixels(
    # In
    depth: wp.array[float],
    size: int,
    run: int,
    memory: Memory,
    frame: wp.array[wp.int32],
    # In and out
    age: wp.array[wp.int32],
    history: wp.array[float],
    # Out
    policy_out: wp.array[float],
) -> None:
    """Mix images with those before and scale them, one thread per world and run of pixels."""
    world, group = wp.tid()
    _remember(depth, world * size + group * run, run, memory, frame[world] == 0, age, history, policy_out)
