"""The river bed as a picture of the ground: banks, islands, stones, grass, control points, and where the water is.

Made once per flight, in ground coordinates at twice the picture's resolution, and blurred so that it holds nothing finer
than the picture can show: then sampling it is exact to a few thousandths of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from stab_ros.core.river import Preset, Share
from stab_ros.core.textures import Texture, natural_texture, sample_texture, smooth_step
from stab_ros.core.types import FloatArray, Gray

COARSE = 8  # flow and tint are kept for every 8th texel
_BLUR_TEXELS = 0.75
_SUN = (-0.6, -0.5)  # where the light comes from, in the picture
_STONES = 12000  # per nominal picture's area
_GRAVEL_TINT, _GRASS_TINT, _WATER_TINT = (0.90, 0.99, 1.06), (0.62, 1.08, 0.98), (1.06, 1.06, 0.80)


@dataclass(frozen=True, eq=False)
class Extent:
    """A rectangle of ground: where its texel (0, 0) lies, texel pitch, rows and columns."""

    x_m: float
    y_m: float
    texel_m: float
    shape: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Ground:
    """What lies in an extent. brightness: (h, w) uint8; water: (h, w) uint8, from 0 land to 255 water.

    flow: (h/8, w/8, 2) float32 surface velocity, m/s. tint: (h/8, w/8, 3) float32 factors that turn grey into bgr.
    """

    extent: Extent
    brightness: Gray
    water: Gray
    flow: NDArray[np.float32]
    tint: NDArray[np.float32]


class Layout(NamedTuple):
    """The river in metres, origin at the centre of the nominal picture: what the kernels need of a preset."""

    unit_m: float  # nominal picture height
    centre_m: float
    half_width_m: float
    bend_m: float
    bend_per_m: float
    speed_m_s: float
    islands: FloatArray  # (n, 4) centre x, y and half axes

    @staticmethod
    def of(preset: Preset) -> Layout:
        width, height = preset.ground_m
        stream = preset.stream
        islands = [
            (*place_m(preset, island.centre), island.half_axes[0] * width, island.half_axes[1] * height)
            for island in preset.islands
        ]
        return Layout(height, (stream.centre - 0.5) * height, stream.width * height / 2, stream.bend * height / 2,
                      2 * math.pi / (1.3 * width), stream.speed_m_s, np.array(islands).reshape(-1, 4))


def place_m(preset: Preset, share: Share) -> tuple[float, float]:
    """A place in the nominal picture as ground coordinates, m."""
    width, height = preset.ground_m
    return (share[0] - 0.5) * width, (share[1] - 0.5) * height


def make_ground(preset: Preset, extent: Extent, seed: int, still: Gray | None = None) -> Ground:
    """Builds the ground of a preset. `still`: (h, w) uint8 picture that takes the place of the made-up banks."""
    rows, columns = extent.shape
    layout = Layout.of(preset)
    place = (extent.x_m, extent.y_m, extent.texel_m)
    shore = natural_texture([seed, 10], 1.8, 200.0)
    land = np.empty((rows, columns), np.float32)
    water = np.empty((rows, columns), np.uint8)
    flow = np.zeros((rows // COARSE + 2, columns // COARSE + 2, 2), np.float32)
    tint = np.ones((rows // COARSE + 2, columns // COARSE + 2, 3), np.float32)
    _fill_water(layout, place, shore, water, flow)
    if still is None:
        rough, grass = natural_texture([seed, 11], 1.1, 64.0), natural_texture([seed, 12], 0.8, 10.0)
        _fill_land(layout, place, shore, rough, grass, land, tint)
        _drop_stones(layout, place, shore, _stones(preset, extent, seed), land)
    else:
        _fill_still(still, place, layout.unit_m, land)
    _wet_shore(layout, place, shore, land, tint)
    for point in preset.control_points:
        _lay_control_point(place, place_m(preset, point.place), point.size_m, land)
    return Ground(extent, _blurred(land), water, flow, tint)


@numba.njit(cache=True)
def depth_m(layout, shore, x, y):  # type: ignore[no-untyped-def]
    """Distance to the nearest shore, positive in the water."""
    depth = layout.half_width_m - abs(y - centre_line(layout, x))
    for k in range(len(layout.islands)):
        cx, cy, a, b = layout.islands[k]
        depth = min(depth, (math.hypot((x - cx) / a, (y - cy) / b) - 1) * min(a, b))
    scale = 700.0 / layout.unit_m
    return depth + 0.016 * layout.unit_m * sample_texture(shore, x * scale, y * scale)


@numba.njit(cache=True)
def centre_line(layout, x):  # type: ignore[no-untyped-def]
    return layout.centre_m + layout.bend_m * math.sin(layout.bend_per_m * x + 0.6)


@numba.njit(cache=True)
def _grass_share(layout, shore, depth, x, y):  # type: ignore[no-untyped-def]
    """0 on the gravel near the water, 1 on the meadow behind."""
    scale = 500.0 / layout.unit_m
    patch = sample_texture(shore, x * scale + 311, y * scale + 97)
    return smooth_step(-0.04, 0.04, -depth / layout.unit_m - 0.11 + 0.05 * patch)


@numba.njit(cache=True)
def _fill_water(layout, place, shore, water, flow):  # type: ignore[no-untyped-def]
    x0, y0, texel = place
    soft = 0.004 * layout.unit_m
    for i in range(water.shape[0]):
        for j in range(water.shape[1]):
            depth = depth_m(layout, shore, x0 + j * texel, y0 + i * texel)
            water[i, j] = int(255 * smooth_step(-soft, soft, depth) + 0.5)
    for i in range(flow.shape[0]):
        for j in range(flow.shape[1]):
            x = x0 + j * COARSE * texel
            depth = depth_m(layout, shore, x, y0 + i * COARSE * texel)
            from_middle = 1 - min(max(depth / layout.half_width_m, 0.0), 1.0)
            speed = layout.speed_m_s * (1 - from_middle * from_middle)
            slope = layout.bend_m * layout.bend_per_m * math.cos(layout.bend_per_m * x + 0.6)
            flow[i, j, 0] = speed / math.hypot(1.0, slope)
            flow[i, j, 1] = speed * slope / math.hypot(1.0, slope)


@numba.njit(cache=True)
def _fill_land(layout, place, shore, rough, grass, land, tint):  # type: ignore[no-untyped-def]
    x0, y0, texel = place
    scale = 400.0 / layout.unit_m
    for i in range(land.shape[0]):
        for j in range(land.shape[1]):
            x, y = x0 + j * texel, y0 + i * texel
            green = _grass_share(layout, shore, depth_m(layout, shore, x, y), x, y)
            broad = sample_texture(shore, x * scale + 700, y * scale + 500)
            middle = sample_texture(rough, j * 0.21, i * 0.21)
            fine = sample_texture(rough, j, i)
            gravel = 148 + 7 * broad + 9 * middle + 11 * fine
            bush = smooth_step(0.9, 1.3, broad + 0.35 * middle)
            leaves = sample_texture(grass, j * 0.8, i * 0.8)
            meadow = 112 + 9 * broad + 9 * middle + 12 * leaves - bush * (38 - 16 * leaves)
            land[i, j] = gravel + green * (meadow - gravel)
            if i % COARSE == 0 and j % COARSE == 0:
                for c in range(3):
                    tint[i // COARSE, j // COARSE, c] = (1 - green) * _GRAVEL_TINT[c] + green * _GRASS_TINT[c]


@numba.njit(cache=True)
def _fill_still(still, place, height_m, land):  # type: ignore[no-untyped-def]
    """Spreads a picture over the nominal picture's height, mirrored at its edges."""
    x0, y0, texel = place
    rows, columns = still.shape
    scale = rows / height_m
    for i in range(land.shape[0]):
        for j in range(land.shape[1]):
            x = abs((x0 + j * texel) * scale + columns / 2) % (2 * columns - 2)
            y = abs((y0 + i * texel) * scale + rows / 2) % (2 * rows - 2)
            x, y = min(x, 2 * columns - 2 - x), min(y, 2 * rows - 2 - y)
            left, top = min(int(x), columns - 2), min(int(y), rows - 2)
            fx, fy = x - left, y - top
            upper = still[top, left] * (1 - fx) + still[top, left + 1] * fx
            lower = still[top + 1, left] * (1 - fx) + still[top + 1, left + 1] * fx
            land[i, j] = upper * (1 - fy) + lower * fy


def _stones(preset: Preset, extent: Extent, seed: int) -> FloatArray:
    """(n, 6): x, y, half axes in m, angle, tone in grey levels; sizes by a power law, the largest on top."""
    rng = np.random.default_rng([seed, 20])
    width, height = preset.ground_m
    rows, columns = extent.shape
    area = rows * columns * extent.texel_m**2
    n = int(_STONES * area / (width * height))
    x = extent.x_m + rng.random(n) * columns * extent.texel_m
    y = extent.y_m + rng.random(n) * rows * extent.texel_m
    size = np.minimum(0.0014 * height * (1 - rng.random(n)) ** (-1 / 1.7), 0.022 * height)
    stones = np.stack([x, y, size, size * rng.uniform(0.55, 1.0, n), rng.uniform(0, math.pi, n),
                       rng.normal(150, 26, n)], axis=1)
    return np.asarray(stones[np.argsort(size, kind="stable")])


@numba.njit(cache=True)
def _drop_stones(layout, place, shore, stones, land):  # type: ignore[no-untyped-def]
    """Stones lie thick on the gravel; in the grass only few of the larger ones."""
    for k in range(len(stones)):
        x, y, a, b, angle, tone = stones[k]
        depth = depth_m(layout, shore, x, y)
        green = _grass_share(layout, shore, depth, x, y)
        if green < 0.4 or k % 40 == 0:
            shift = 0.35 * b
            _draw_stone(place, x - _SUN[0] * shift, y - _SUN[1] * shift, a, b, angle, -1.0, land)
            _draw_stone(place, x, y, a, b, angle, max(tone, 40.0), land)


@numba.njit(cache=True)
def _draw_stone(place, x, y, a, b, angle, tone, land):  # type: ignore[no-untyped-def]
    """A lit dome of half axes a, b with a soft rim; a negative tone draws its shadow."""
    x0, y0, texel = place
    cos, sin = math.cos(angle), math.sin(angle)
    rim = texel / b
    for i in range(max(int((y - a - y0) / texel), 0), min(int((y + a - y0) / texel) + 2, land.shape[0])):
        for j in range(max(int((x - a - x0) / texel), 0), min(int((x + a - x0) / texel) + 2, land.shape[1])):
            dx, dy = x0 + j * texel - x, y0 + i * texel - y
            p, q = (cos * dx + sin * dy) / a, (cos * dy - sin * dx) / b
            radius = math.sqrt(p * p + q * q)
            cover = 1 - smooth_step(1 - rim, 1 + rim, radius)
            if cover <= 0:
                continue
            lit = tone + 34 * (dx * _SUN[0] + dy * _SUN[1]) / a - 20 * radius * radius
            target = land[i, j] * 0.5 if tone < 0 else lit + 0.3 * (land[i, j] - 140)
            land[i, j] += cover * (target - land[i, j])


@numba.njit(cache=True)
def _wet_shore(layout, place, shore, land, tint):  # type: ignore[no-untyped-def]
    """Wet ground is darker; the bed under water takes the water's tint."""
    x0, y0, texel = place
    for i in range(land.shape[0]):
        for j in range(land.shape[1]):
            depth = depth_m(layout, shore, x0 + j * texel, y0 + i * texel) / layout.unit_m
            land[i, j] *= 1 - 0.38 * smooth_step(-0.022, -0.002, depth)
            if i % COARSE == 0 and j % COARSE == 0:
                under = smooth_step(-0.003, 0.006, depth)
                for c in range(3):
                    tint[i // COARSE, j // COARSE, c] += under * (_WATER_TINT[c] - tint[i // COARSE, j // COARSE, c])


@numba.njit(cache=True)
def _lay_control_point(place, at, size, land):  # type: ignore[no-untyped-def]
    """A square of `size` with four quadrants, black and white in turn; edges one texel soft."""
    x0, y0, texel = place
    half = size / 2
    for i in range(max(int((at[1] - size - y0) / texel), 0), min(int((at[1] + size - y0) / texel), land.shape[0])):
        for j in range(max(int((at[0] - size - x0) / texel), 0), min(int((at[0] + size - x0) / texel), land.shape[1])):
            dx, dy = (x0 + j * texel - at[0]) / texel, (y0 + i * texel - at[1]) / texel
            inside = half / texel - max(abs(dx), abs(dy)) + 0.5
            cover = min(max(inside, 0.0), 1.0)
            side = min(max(dx, -0.5), 0.5) * min(max(dy, -0.5), 0.5) * 4
            land[i, j] += cover * (132 + 104 * side - land[i, j])


def _blurred(land: NDArray[np.float32]) -> Gray:
    """`land` blurred by a Gaussian, as uint8 (rounded); written out here so that every cv2 version gives the same."""
    offsets = np.arange(-3, 4)
    kernel = np.exp(-(offsets**2) / (2 * _BLUR_TEXELS**2))
    return np.asarray(_blur(land, (kernel / kernel.sum()).astype(np.float32)))


@numba.njit(cache=True)
def _blur(land, kernel):  # type: ignore[no-untyped-def]
    """Rows in place, then columns into the result."""
    rows, columns = land.shape
    reach = len(kernel) // 2
    for i in range(rows):
        row = land[i].copy()
        for j in range(columns):
            total = np.float32(0)
            for k in range(len(kernel)):
                total += kernel[k] * row[min(max(j + k - reach, 0), columns - 1)]
            land[i, j] = total
    result = np.empty((rows, columns), np.uint8)
    total_row = np.empty(columns, np.float32)
    for i in range(rows):
        total_row[:] = 0
        for k in range(len(kernel)):
            source = land[min(max(i + k - reach, 0), rows - 1)]
            for j in range(columns):
                total_row[j] += kernel[k] * source[j]
        for j in range(columns):
            result[i, j] = int(min(max(total_row[j] + np.float32(0.5), np.float32(0)), np.float32(255)))
    return result
