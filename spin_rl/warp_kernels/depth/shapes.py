"""Inverse depth of one shape at the pixels of an image, as C++ that Warp compiles for CPU and CUDA.

A pixel looks along ``r = (x, y, 1)`` in the optical frame, so that a point at depth z is ``z r``. With
``s = 1 / z``, the half-space ``n . p <= d`` becomes ``n . r <= d s``: a bound on s that is linear in row and
column. A solid is then an interval of s at every pixel, from ``far`` to ``near``, whose ends are the largest
and the smallest of a few such lines; round shapes add a square root. A camera outside sees the near end, one
inside sees the far end from within, as MuJoCo's rays do. The nearest solid of a pixel has the largest s, in
whatever order the solids come: there is no division per solid and no sorting.

Each shape is written once (``_SHAPES``) and compiled twice:

- ``draw_<shape>`` raises the inverse depth of a rectangle of pixels, ``LANES`` columns at a time. It is C++
  because the compiler turns this loop into vector instructions, and a loop over Warp arrays, whose strides it
  cannot know, it does not.
- ``<shape>_at`` returns the inverse depth at one pixel, for one CUDA thread each.

``lines`` are the records that ``spin_rl.warp_kernels.depth.project`` writes: lines (a, b, c), which stand for
``a row + b column + c``, then a vector of constants for each round piece.
"""

from functools import reduce

import warp as wp

LANES = 16
"""Pixels that a ``draw`` function computes together; an image needs at least as many columns."""

RECORD_SIZE = 13
"""Vectors in the record of a shape: as many as a capsule needs."""

_BIG = "1.0e30f"

wp.set_module_options({"enable_backward": False})


def _chain(function: str, values: list[str]) -> str:
    """C++ expression that applies a function of two to all values."""
    return reduce(lambda left, right: f"{function}({left}, {right})", values)


def _box(num_near: int) -> str:
    """Six faces, of which the camera is in front of the first ``num_near``."""
    values = [f"l{i}" for i in range(6)]
    far = _chain("pickmax", values[num_near:])
    if num_near == 0:
        return f"value = {far};"
    near = _chain("pickmin", values[:num_near])
    return f"const float near = {near}; const float far = {far}; value = near >= far ? near : 0.0f;"


def _interval(name: str, z: str, square: str, constants: str) -> str:
    """Interval of s inside a quadric, with ``square`` the term under the root beside z squared.

    ``constants`` holds the camera's distance from the centre, relative to the radius, and 1 if the camera is
    outside, -1 if it is inside. An empty interval ends before it begins.
    """
    return f"""
const float {name}_root = {z} * {z} - {constants}[1] * ({square});
const float {name}_half = sqrtf(pickmax({name}_root, 0.0f));
const float {name}_front = {constants}[0] * {z} + {name}_half;
const float {name}_near = {constants}[1] > 0.0f ? {name}_front : {_BIG};
const float {name}_back = {constants}[1] > 0.0f ? {constants}[0] * {z} - {name}_half : {name}_front;
const float {name}_far = {name}_root >= 0.0f ? {name}_back : {_BIG} * 2.0f;
"""


_TUBE = (
    # Between the caps: z, across, cap towards the camera, cap away from it; k0[2] is 1 outside of both.
    _interval("side", "l0", "l1 * l1", "k0")
    + f"""
const float cap = k0[2] > 0.0f ? l2 : {_BIG};
const float tube_near = pickmin(side_near, cap);
const float tube_far = pickmax(side_far, k0[2] > 0.0f ? l3 : pickmax(l2, l3));
"""
)


def _union(pieces: list[str]) -> str:
    """What is seen of a convex union of pieces; those that lie behind the camera do not count."""
    hit = {name: f"{name}_near >= pickmax({name}_far, 0.0f)" for name in pieces}
    entry = _chain("pickmax", [f"({hit[name]} ? {name}_near : 0.0f)" for name in pieces])
    leave = _chain("pickmin", [f"({hit[name]} ? {name}_far : {_BIG})" for name in pieces])
    return f"const float entry = {entry}; value = entry < {_BIG} ? entry : {leave};"


_CAPSULE = (
    _TUBE
    + _interval("a", "l6", "l4 * l4 + l5 * l5", "k1")
    + _interval("b", "l9", "l7 * l7 + l8 * l8", "k2")
    + _union(["tube", "a", "b"])
)

# Number of lines, of vectors of constants, and C++ that sets `value` from lines l0, ... and constants k0, ...
_SHAPES: dict[str, tuple[int, int, str]] = {
    "plane": (1, 0, "value = l0;"),
    **{f"box{near}": (6, 0, _box(near)) for near in range(4)},
    "ellipsoid": (
        3,
        1,
        _interval("ball", "l2", "l0 * l0 + l1 * l1", "k0") + _union(["ball"]),
    ),
    "cylinder": (4, 1, _TUBE + _union(["tube"])),
    "capsule": (10, 3, _CAPSULE),
}

_HELPERS = """
const auto pickmin = [](float a, float b) { return a < b ? a : b; };
const auto pickmax = [](float a, float b) { return a > b ? a : b; };
"""


def _load(shape: str) -> str:
    """Read a record: coefficients a0, b0, c0, ... of the lines, constants k0, ..."""
    num_lines, num_constants, _ = _SHAPES[shape]
    lines = [
        f"const float a{i} = lines.data[first + {i}][0], b{i} = lines.data[first + {i}][1], "
        f"c{i} = lines.data[first + {i}][2];"
        for i in range(num_lines)
    ]
    constants = [f"const auto k{i} = lines.data[first + {num_lines + i}];" for i in range(num_constants)]
    return "\n".join(lines + constants)


def _draw(shape: str) -> str:
    num_lines, _, value = _SHAPES[shape]
    at_row = "\n".join(f"const float r{i} = a{i} * row + c{i};" for i in range(num_lines))
    at_segment = "\n".join(f"const float s{i} = r{i} + b{i} * column;" for i in range(num_lines))
    at_lane = "\n".join(f"const float l{i} = s{i} + b{i} * lane;" for i in range(num_lines))
    return f"""{_HELPERS}{_load(shape)}
for (int row = rect[0]; row < rect[1]; ++row) {{
{at_row}
for (int start = rect[2]; start < rect[3]; start += {LANES}) {{
// The last segment is moved back into the image: what it draws twice does no harm.
const int column = start < columns - {LANES} ? start : columns - {LANES};
float* const out = image.data + offset + row * columns + column;
{at_segment}
for (int lane = 0; lane < {LANES}; ++lane) {{
{at_lane}
float value;
{value}
// In this order a value that is not a number loses.
out[lane] = pickmax(value, out[lane]);
}}
}}
}}
"""


def _at(shape: str) -> str:
    num_lines, _, value = _SHAPES[shape]
    lines = "\n".join(f"const float l{i} = a{i} * row + c{i} + b{i} * column;" for i in range(num_lines))
    return f"{_HELPERS}{_load(shape)}\n{lines}\nfloat value;\n{value}\nreturn value;"


def _make_draw(shape: str):
    @wp.func_native(_draw(shape))
    def draw(
        image: wp.array[float],
        offset: int,
        columns: int,
        rect: wp.vec4i,
        lines: wp.array[wp.vec3],
        first: int,
    ): ...

    return draw


def _make_at(shape: str):
    @wp.func_native(_at(shape))
    def at(lines: wp.array[wp.vec3], first: int, row: float, column: float) -> float: ...

    return at


draw_plane, plane_at = _make_draw("plane"), _make_at("plane")
draw_box0, box0_at = _make_draw("box0"), _make_at("box0")
draw_box1, box1_at = _make_draw("box1"), _make_at("box1")
draw_box2, box2_at = _make_draw("box2"), _make_at("box2")
draw_box3, box3_at = _make_draw("box3"), _make_at("box3")
draw_ellipsoid, ellipsoid_at = _make_draw("ellipsoid"), _make_at("ellipsoid")
draw_cylinder, cylinder_at = _make_draw("cylinder"), _make_at("cylinder")
draw_capsule, capsule_at = _make_draw("capsule"), _make_at("capsule")


@wp.func_native("for (int i = 0; i < count; ++i) image.data[offset + i] = 0.0f;")
def clear_pixels(image: wp.array[float], offset: int, count: int): ...


@wp.func_native("""
for (int i = 0; i < count; ++i) {
const float inverse = image.data[offset + i];
image.data[offset + i] = inverse > least ? 1.0f / inverse : 0.0f;
}
""")
def pixels_to_depth(image: wp.array[float], offset: int, count: int, least: float): ...
