# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportInvalidTypeForm=false
# pyright: reportCallIssue=false, reportArgumentType=false
# (Warp kernels and structs are another language in Python's syntax: annotations there are not types)
"""Depth images as a stereo camera measures them: shadows, holes, mixed depths, noise and disparity steps.

A pixel's inverse depth is its disparity divided by focal length and baseline. Errors of stereo matching are
errors of the disparity, so noise and quantization act on the inverse depth, and planes are linear in it.

The imagers lie beside each other along the image's ``ImageLines``, the right one where u is larger. Lines do
not depend on each other: on the CPU a thread measures ``LANES`` of them side by side, in C++ since the
compiler turns that into vector instructions, which it does not for loops over Warp arrays; on CUDA one.
"""

import warp as wp

from spin_rl.warp_kernels.images.frames import LANES, ImageLines

wp.set_module_options({"enable_backward": False})


@wp.struct
class StereoErrors:
    """What the camera does wrong; every effect is off at zero.

    Attributes:
        min_range: Measured depths below are holes [m].
        max_range: Measured depths above are holes [m].
        disparity: Focal length times baseline [pixel m]: the disparity at a depth of 1 m.
        edge_jump: A pixel is at an edge where the inverse depth bends by more than this share of itself.
        edge_dropout: Probability that a pixel at an edge is a hole.
        flying: Probability that a pixel at an edge lies between the depths on both sides.
        noise: Standard deviation of the inverse depth [1/m].
        memory: Correlation of the noise between neighbours along a line.
        step: Quantum of the inverse depth [1/m].
        dropout: Probability that any pixel is a hole; at an edge both probabilities add up.
    """

    min_range: float
    max_range: float
    disparity: float
    edge_jump: float
    edge_dropout: float
    flying: float
    noise: float
    memory: float
    step: float
    dropout: float


@wp.func
def random_state(seed: int, world: int, episode: int, stream: int) -> wp.uint32:
    """Start a random stream that depends on these four numbers only."""
    state = wp.rand_init(seed, world)
    state = wp.rand_init(int(state), episode)
    return wp.rand_init(int(state), stream)


# What lies around pixel u of lane l, in inverse depths: here[l] and here[l + 2] across the lines,
# before[l + 1] and after[l + 1] along them. Outside of the image they are the pixel's own.
_MEASURE = f"""
#if defined(__CUDA_ARCH__)
constexpr int lanes = 1;
#else
constexpr int lanes = {LANES};
#endif
constexpr float nothing = 1.0e-3f;  // inverse depth of a ray without a hit
const auto pickmin = [](float a, float b) {{ return a < b ? a : b; }};
const auto pickmax = [](float a, float b) {{ return a > b ? a : b; }};
const auto inverted = [](float z) {{ return z > 0.0f ? 1.0f / z : nothing; }};
const int count = lines.count - first < lanes ? lines.count - first : lanes;
const int start = first * lines.stride;
const float* const image = depth.data + image_offset + start;
float before[lanes + 2] = {{}}, here[lanes + 2] = {{}}, after[lanes + 2] = {{}};
float result[lanes] = {{}}, noise[lanes], reach[lanes];
wp::uint32 state[lanes];

// Lines that are columns lie beside each other in memory, which makes their loops much faster.
const int stride = lines.stride;
const auto read = [&](const float* p, float* values) {{
    if (stride == 1) for (int l = 0; l < count; ++l) values[l] = p[l];
    else for (int l = 0; l < count; ++l) values[l] = p[l * stride];
}};
const auto write = [&](const float* values, float* p) {{
    if (stride == 1) for (int l = 0; l < count; ++l) p[l] = values[l];
    else for (int l = 0; l < count; ++l) p[l * stride] = values[l];
}};
const auto load = [&](int u, float* s) {{
    const float* const p = image + u * lines.step;
    float z[lanes] = {{}};
    read(p, z);
    for (int l = 0; l < lanes; ++l) s[l + 1] = inverted(z[l]);
    s[0] = first > 0 ? inverted(p[-stride]) : s[1];
    s[count + 1] = first + count < lines.count ? inverted(p[count * stride]) : s[count];
}};
// Sum of four random bytes, less its mean, over its standard deviation.
const auto normal = [](wp::uint32 bits) {{
    const wp::uint32 pairs = (bits & 0x00FF00FFu) + ((bits >> 8) & 0x00FF00FFu);
    return ((float)(int)((pairs & 0xFFFFu) + (pairs >> 16)) - 510.0f) * (1.0f / 147.799f);
}};

const bool exact = errors.noise <= 0.0f && errors.step <= 0.0f;
const float per_step = errors.step > 0.0f ? 1.0f / errors.step : 0.0f;
const float jump = errors.edge_jump > 0.0f ? errors.edge_jump : 1.0e9f;
const float farthest = errors.max_range > 0.0f ? errors.max_range : 1.0e9f;
const float fresh = errors.noise * sqrtf(1.0f - errors.memory * errors.memory);
for (int l = 0; l < lanes; ++l) {{
    state[l] = wp::rand_init(stream, first + l);
    noise[l] = errors.noise * normal(state[l]);
    reach[l] = 1.0e9f;
}}
load(lines.length - 1, here);
for (int l = 0; l < lanes + 2; ++l) after[l] = here[l];
for (int u = lines.length - 1; u >= 0; --u) {{
    load(u > 0 ? u - 1 : 0, before);
    for (int l = 0; l < lanes; ++l) {{
        const float s = here[l + 1];
        const float across_a = here[l], across_b = here[l + 2];
        const float along_a = before[l + 1], along_b = after[l + 1];
        const float bend_across = fabsf(across_a + across_b - 2.0f * s);
        const float bend_along = fabsf(along_a + along_b - 2.0f * s);
        const bool edge = pickmax(bend_across, bend_along) > jump * s;
        const float low = pickmin(pickmin(pickmin(across_a, across_b), pickmin(along_a, along_b)), s);
        const float high = pickmax(pickmax(pickmax(across_a, across_b), pickmax(along_a, along_b)), s);

        // Where the pixel is in the right image: outside of it, or behind something nearer?
        const float column = (float)u - errors.disparity * s;
        const bool hidden = errors.disparity > 0.0f && (column < -0.5f || column >= reach[l]);
        reach[l] = pickmin(reach[l], column);

        const wp::uint32 first_bits = wp::rand_pcg(state[l]);
        const wp::uint32 second_bits = wp::rand_pcg(first_bits);
        const wp::uint32 third_bits = wp::rand_pcg(second_bits);
        state[l] = third_bits;
        noise[l] = errors.memory * noise[l] + fresh * normal(first_bits);
        const float chance = (float)(int)(second_bits >> 8) * (1.0f / 16777216.0f);
        const bool dropped = chance < errors.dropout + (edge ? errors.edge_dropout : 0.0f);
        const bool flies = edge && (float)(int)(third_bits & 0xFFFFu) * (1.0f / 65536.0f) < errors.flying;
        const float mixed = low + (float)(int)(third_bits >> 16) * (1.0f / 65536.0f) * (high - low);

        const float disturbed = (flies ? mixed : s) + noise[l];
        const float stepped = (float)(int)(disturbed * per_step + 0.5f) * errors.step;
        const float inverse = errors.step > 0.0f ? stepped : disturbed;
        const float measured = 1.0f / inverse;
        const bool seen = s > nothing && !hidden && !dropped && inverse > 0.0f;
        // The measured depth, 0 for a hole, or -1 for what is exactly the image's.
        const float value = exact && !flies ? -1.0f : measured;
        result[l] = seen ? value : 0.0f;
    }}
    float z[lanes] = {{}}, delayed[lanes];
    read(image + u * lines.step, z);
    for (int l = 0; l < lanes; ++l) {{
        z[l] = result[l] < 0.0f ? z[l] : result[l];
        z[l] = z[l] >= errors.min_range && z[l] <= farthest ? z[l] : 0.0f;
    }}
    const int pixel = start + u * lines.step;
    write(z, ring.data + slot_now + pixel);
    read(ring.data + slot_shown + pixel, delayed);
    write(delayed, out.data + image_offset + pixel);
    for (int l = 0; l < lanes + 2; ++l) {{
        after[l] = here[l];
        here[l] = before[l];
    }}
}}
"""


@wp.func_native(_MEASURE)
def _measure(
    depth: wp.array[float],
    image_offset: int,
    lines: ImageLines,
    first: int,
    errors: StereoErrors,
    stream: int,
    ring: wp.array[float],
    slot_now: int,
    slot_shown: int,
    out: wp.array[float],
): ...


@wp.kernel
def measure_lines(
    # In
    depth: wp.array[float],
    lines: ImageLines,
    lanes: int,
    errors: StereoErrors,
    seed: wp.array[wp.int32],
    episode: wp.array[wp.int32],
    frame: wp.array[wp.int32],
    latency: wp.array[wp.int32],
    num_slots: int,
    # In and out
    ring: wp.array[float],
    # Out
    depth_out: wp.array[float],
) -> None:
    """Let a stereo camera measure, one thread per world and group of lines."""
    world, group = wp.tid()
    now = frame[world]
    # An episode's first frames have no older one.
    shown = now - wp.min(latency[world], now)
    # The last group is moved back into the image: what it measures twice is the same.
    first = wp.max(wp.min(group * lanes, lines.count - lanes), 0)
    size = lines.count * lines.length
    slot_now = (world * num_slots + now % num_slots) * size
    slot_shown = (world * num_slots + shown % num_slots) * size
    stream = int(random_state(seed[0], world, episode[world], 1 + now))
    _measure(depth, world * size, lines, first, errors, stream, ring, slot_now, slot_shown, depth_out)


@wp.kernel
def punch_patches(
    # In
    lines: ImageLines,
    num_patches: int,
    radius: float,
    seed: wp.array(dtype=wp.int32),
    episode: wp.array(dtype=wp.int32),
    frame: wp.array(dtype=wp.int32),
    latency: wp.array(dtype=wp.int32),
    num_slots: int,
    # In and out
    ring: wp.array(dtype=float),
    depth: wp.array(dtype=float),
) -> None:
    """Make patches of holes, one thread per world and patch."""
    world, patch = wp.tid()
    now = frame[world]
    size = lines.count * lines.length
    slot = (world * num_slots + now % num_slots) * size
    is_shown = wp.min(latency[world], now) == 0
    # Streams below zero: those above are the lines'.
    rng = random_state(seed[0], world, episode[world], -1 - now * num_patches - patch)
    centre_line = wp.randf(rng) * float(lines.count)
    centre_u = wp.randf(rng) * float(lines.length)
    half_lines = wp.randf(rng, 1.0, radius)
    half_length = wp.randf(rng, 1.0, radius)
    first_line = wp.max(int(wp.ceil(centre_line - half_lines)), 0)
    last_line = wp.min(int(wp.floor(centre_line + half_lines)), lines.count - 1)
    for line in range(first_line, last_line + 1):
        across = (float(line) - centre_line) / half_lines
        half = half_length * wp.sqrt(wp.max(1.0 - across * across, 0.0))
        first_u = wp.max(int(wp.ceil(centre_u - half)), 0)
        last_u = wp.min(int(wp.floor(centre_u + half)), lines.length - 1)
        for u in range(first_u, last_u + 1):
            pixel = line * lines.stride + u * lines.step
            ring[slot + pixel] = 0.0
            if is_shown:
                depth[world * size + pixel] = 0.0


@wp.kernel
def begin_episodes(
    # In
    mask: wp.array(dtype=bool),
    seed: wp.array(dtype=wp.int32),
    min_latency: int,
    max_latency: int,
    rotation: float,
    translation: float,
    # In and out
    episode: wp.array(dtype=wp.int32),
    # Out
    frame_out: wp.array(dtype=wp.int32),
    latency_out: wp.array(dtype=wp.int32),
    mount_pos_out: wp.array(dtype=wp.vec3),
    mount_rot_out: wp.array(dtype=wp.mat33),
) -> None:
    """Draw latency and mount of the masked worlds' new episodes."""
    world = wp.tid()
    if not mask[world]:
        return
    episode[world] = episode[world] + 1
    frame_out[world] = 0
    rng = random_state(seed[0], world, episode[world], 0)
    latency_out[world] = min_latency + int(wp.randf(rng) * float(max_latency - min_latency + 1))
    x = wp.randf(rng, -1.0, 1.0)
    y = wp.randf(rng, -1.0, 1.0)
    z = wp.randf(rng, -1.0, 1.0)
    mount_pos_out[world] = translation * wp.vec3(x, y, z)
    x = wp.randf(rng, -1.0, 1.0)
    y = wp.randf(rng, -1.0, 1.0)
    z = wp.randf(rng, -1.0, 1.0)
    turn = rotation * wp.vec3(x, y, z)
    mount_rot_out[world] = wp.quat_to_matrix(wp.quat_from_axis_angle(wp.normalize(turn), wp.length(turn)))
