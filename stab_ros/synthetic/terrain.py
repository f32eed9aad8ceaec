"""Procedural texture of the ground: banks, islands, stones, grass, control points, and a mask of the water.

It is generated once per flight, in ground coordinates, finer than the image, and blurred to avoid aliasing. Ground
truth is then unbiased to a thousandth of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from stab_ros.core.kernels import lazy_kernel
from stab_ros.core.types import Float32Array, FloatArray, Gray
from stab_ros.synthetic.river import SceneSettings, Share
from stab_ros.synthetic.textures import Texture, natural_texture, sample_texture, smooth_step

TexelGrid: TypeAlias = tuple[float, float, float]  # x, y of texel (0, 0) and texel pitch, m

COARSE = 8  # flow and tint are stored for every 8th texel
BEND_PHASE = 0.6  # of the centre line at x = 0, rad
_BLUR_TEXELS = 0.85
_SUN = (-0.6, -0.5)  # direction of the light in the image
# number in the nominal image; smallest and largest size (shares of the image height) and exponent of the power law
_STONES = (16000, (0.0014, 0.016, 1.9))
_BUSHES = (2500, (0.007, 0.03, 2.5))
_GRAVEL_TINT, _GRASS_TINT, _WATER_TINT = (0.90, 0.99, 1.06), (0.62, 1.08, 0.98), (1.06, 1.06, 0.80)


@dataclass(frozen=True, eq=False)
class Extent:
    """A rectangle of ground: position of texel (0, 0), m, size of a texel, m, and shape (rows, columns)."""

    x_m: float
    y_m: float
    texel_m: float
    shape: tuple[int, int]


@dataclass(frozen=True, eq=False)
class GroundTexture:
    """Texture of the ground and velocity of the water.

    Attributes:
        extent: the rectangle of ground.
        brightness: (h, w) uint8 grey levels.
        water: (h, w) uint8, from 0 for land to 255 for water.
        flow: (h/8, w/8, 2) float32 surface velocity, m/s.
        tint: (h/8, w/8, 3) float32 factors from grey to bgr.
    """

    extent: Extent
    brightness: Gray
    water: Gray
    flow: Float32Array
    tint: Float32Array


class Layout(NamedTuple):
    """Geometry of the river for the kernels, in m, with the origin at the centre of the nominal image."""

    unit_m: float  # nominal image height
    centre_m: float
    half_width_m: float
    bend_m: float
    bend_per_m: float
    speed_m_s: float
    rigid: bool
    islands: FloatArray  # (n, 4) centre x, y and half axes

    @staticmethod
    def of(preset: SceneSettings) -> Layout:
        width, height = preset.ground_m
        stream = preset.stream
        islands = [
            (*place_m(preset, island.centre), island.half_axes[0] * width, island.half_axes[1] * height)
            for island in preset.islands
        ]
        return Layout(height, (stream.centre - 0.5) * height, stream.width * height / 2, stream.bend * height / 2,
                      2 * math.pi / (1.3 * width), stream.speed_m_s, stream.rigid, np.array(islands).reshape(-1, 4))


def place_m(preset: SceneSettings, share: Share) -> tuple[float, float]:
    """Ground coordinates, m, of a position in the nominal image."""
    width, height = preset.ground_m
    return (share[0] - 0.5) * width, (share[1] - 0.5) * height


def make_ground(preset: SceneSettings, extent: Extent, seed: int, still: Gray | None = None) -> GroundTexture:
    """Generates the ground of a scene. still: (h, w) uint8 image of the ground in place of the procedural one."""
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
        _drop_stones(layout, place, shore, rough, _scatter(preset, extent, seed, *_STONES), land)
        _plant_bushes(layout, place, shore, grass, _scatter(preset, extent, seed, *_BUSHES), land)
    else:
        _fill_still(still, place, layout.unit_m, land)
    _wet_shore(layout, place, shore, land, tint)
    for point in preset.control_points:
        _lay_control_point(place, place_m(preset, point.place), point.size_m, land)
    return GroundTexture(extent, _blurred(land), water, flow, tint)


@lazy_kernel()
def depth_m(layout: Layout, shore: Texture, x: float, y: float) -> float:
    """Distance to the nearest shore, positive in the water."""
    depth = layout.half_width_m - abs(y - centre_line(layout, x))
    for k in range(len(layout.islands)):
        cx, cy, a, b = layout.islands[k]
        depth = min(depth, (math.hypot((x - cx) / a, (y - cy) / b) - 1) * min(a, b))
    scale = 700.0 / layout.unit_m
    return float(depth + 0.016 * layout.unit_m * sample_texture(shore, x * scale, y * scale))


@lazy_kernel()
def centre_line(layout: Layout, x: float) -> float:
    """The y of mid-stream at x, m."""
    return layout.centre_m + layout.bend_m * math.sin(layout.bend_per_m * x + BEND_PHASE)


@lazy_kernel()
def _grass_share(layout: Layout, shore: Texture, depth: float, x: float, y: float) -> float:
    """0 on the gravel near the water, 1 on the meadow behind."""
    scale = 500.0 / layout.unit_m
    patch = sample_texture(shore, x * scale + 311, y * scale + 97)
    return float(smooth_step(-0.04, 0.04, -depth / layout.unit_m - 0.11 + 0.05 * patch))


@lazy_kernel()
def _fill_water(layout: Layout, place: TexelGrid, shore: Texture, water: Gray, flow: Float32Array) -> None:
    x0, y0, texel = place
    dry, deep = -0.002 * layout.unit_m, 0.022 * layout.unit_m  # between them the bed shows through
    for i in range(water.shape[0]):
        for j in range(water.shape[1]):
            depth = depth_m(layout, shore, x0 + j * texel, y0 + i * texel)
            water[i, j] = int(255 * smooth_step(dry, deep, depth) + 0.5)
    for i in range(flow.shape[0]):
        for j in range(flow.shape[1]):
            if layout.rigid:
                flow[i, j, 0], flow[i, j, 1] = layout.speed_m_s, 0.0
                continue
            x = x0 + j * COARSE * texel
            depth = depth_m(layout, shore, x, y0 + i * COARSE * texel)
            from_middle = 1 - min(max(depth / layout.half_width_m, 0.0), 1.0)
            speed = layout.speed_m_s * (1 - from_middle * from_middle)
            slope = layout.bend_m * layout.bend_per_m * math.cos(layout.bend_per_m * x + BEND_PHASE)
            flow[i, j, 0] = speed / math.hypot(1.0, slope)
            flow[i, j, 1] = speed * slope / math.hypot(1.0, slope)


@lazy_kernel()
def _fill_land(layout: Layout, place: TexelGrid, shore: Texture, rough: Texture, grass: Texture,
               land: Float32Array, tint: Float32Array) -> None:
    x0, y0, texel = place
    scale = 400.0 / layout.unit_m
    for i in range(land.shape[0]):
        for j in range(land.shape[1]):
            x, y = x0 + j * texel, y0 + i * texel
            green = _grass_share(layout, shore, depth_m(layout, shore, x, y), x, y)
            broad = sample_texture(shore, x * scale + 700, y * scale + 500)
            middle = sample_texture(rough, j * 0.21, i * 0.21)
            gravel = 146 + 7 * broad + 8 * middle + 10 * sample_texture(rough, j, i)
            blades = sample_texture(grass, j * 0.8, i * 0.8)
            meadow = 114 + 10 * broad + 8 * middle + 11 * blades
            land[i, j] = gravel + green * (meadow - gravel)
            if i % COARSE == 0 and j % COARSE == 0:
                for c in range(3):
                    tint[i // COARSE, j // COARSE, c] = (1 - green) * _GRAVEL_TINT[c] + green * _GRASS_TINT[c]


@lazy_kernel()
def _fill_still(still: Gray, place: TexelGrid, height_m: float, land: Float32Array) -> None:
    """Scales an image to the height of the nominal image, mirrored at its borders."""
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


def _scatter(preset: SceneSettings, extent: Extent, seed: int, density: int,
             sizes: tuple[float, float, float]) -> FloatArray:
    """Random ellipses (n, 6): x, y and half axes, m, angle, tone (standard normal), in ascending order of size.

    density: number in the nominal image. sizes: smallest and largest, as shares of the image height, and the exponent
    of their power law.
    """
    rng = np.random.default_rng([seed, 20, density])
    width, height = preset.ground_m
    rows, columns = extent.shape
    n = int(density * rows * columns * extent.texel_m**2 / (width * height))
    x = extent.x_m + rng.random(n) * columns * extent.texel_m
    y = extent.y_m + rng.random(n) * rows * extent.texel_m
    smallest, largest, exponent = sizes
    size = np.minimum(smallest * (1 - rng.random(n)) ** (-1 / exponent), largest) * height
    found = np.stack([x, y, size, size * rng.uniform(0.55, 1.0, n), rng.uniform(0, math.pi, n), rng.normal(0, 1, n)], 1)
    return np.asarray(found[np.argsort(size, kind="stable")])


@lazy_kernel()
def _drop_stones(layout: Layout, place: TexelGrid, shore: Texture, rough: Texture, stones: FloatArray,
                 land: Float32Array) -> None:
    """Draws stones on the gravel and in shallow water."""
    for k in range(len(stones)):
        x, y, a, b, angle, tone = stones[k]
        depth = depth_m(layout, shore, x, y)
        if _grass_share(layout, shore, depth, x, y) < 0.35:
            shift = 0.4 * b
            _draw_dome(place, x - _SUN[0] * shift, y - _SUN[1] * shift, a, b, angle, 70.0, 0.0, rough, land)
            _draw_dome(place, x, y, a, b, angle, min(max(150 + 24 * tone, 70.0), 215.0), 8.0, rough, land)


@lazy_kernel()
def _plant_bushes(layout: Layout, place: TexelGrid, shore: Texture, leaves: Texture, bushes: FloatArray,
                  land: Float32Array) -> None:
    """Draws groups of bushes in the meadow."""
    scale = 330.0 / layout.unit_m
    for k in range(len(bushes)):
        x, y, a, b, angle, tone = bushes[k]
        depth = depth_m(layout, shore, x, y)
        group = sample_texture(shore, x * scale + 123, y * scale + 456)
        if _grass_share(layout, shore, depth, x, y) > 0.9 and group > 0.55:
            _draw_dome(place, x - 0.6 * a * _SUN[0], y - 0.6 * a * _SUN[1], a, b, angle, 42.0, 5.0, leaves, land)
            _draw_dome(place, x, y, a, b, angle, 88 + 9 * tone, 15.0, leaves, land)


@lazy_kernel()
def _draw_dome(place: TexelGrid, x: float, y: float, a: float, b: float, angle: float, tone: float, grain: float,
               texture: Texture, land: Float32Array) -> None:
    """Draws a dome of half axes a, b, lit by the sun, with an irregular outline; flat, as a shadow, if grain is 0."""
    x0, y0, texel = place
    cos, sin = math.cos(angle), math.sin(angle)
    rim, reach = texel / b, 1.25 * a
    for i in range(max(int((y - reach - y0) / texel), 0), min(int((y + reach - y0) / texel) + 2, land.shape[0])):
        for j in range(max(int((x - reach - x0) / texel), 0), min(int((x + reach - x0) / texel) + 2, land.shape[1])):
            dx, dy = x0 + j * texel - x, y0 + i * texel - y
            p, q = (cos * dx + sin * dy) / a, (cos * dy - sin * dx) / b
            radius = math.sqrt(p * p + q * q) + 0.08 * sample_texture(texture, 7 * p + 90 * tone, 7 * q)
            cover = 1 - smooth_step(1 - rim, 1 + rim, radius)
            if cover > 0:
                lit = (dx * _SUN[0] + dy * _SUN[1]) / a - 0.6 * radius * radius if grain > 0 else 0.0
                level = tone + 34 * lit + grain * sample_texture(texture, j * 0.9 + 50 * tone, i * 0.9)
                land[i, j] += cover * (level - land[i, j])


@lazy_kernel()
def _wet_shore(layout: Layout, place: TexelGrid, shore: Texture, land: Float32Array, tint: Float32Array) -> None:
    """Darkens wet ground and tints the river bed."""
    x0, y0, texel = place
    for i in range(land.shape[0]):
        for j in range(land.shape[1]):
            depth = depth_m(layout, shore, x0 + j * texel, y0 + i * texel) / layout.unit_m
            land[i, j] *= 1 - 0.38 * smooth_step(-0.022, -0.002, depth)
            if i % COARSE == 0 and j % COARSE == 0:
                under = smooth_step(-0.004, 0.02, depth)
                for c in range(3):
                    tint[i // COARSE, j // COARSE, c] += under * (_WATER_TINT[c] - tint[i // COARSE, j // COARSE, c])


@lazy_kernel()
def _lay_control_point(place: TexelGrid, at: tuple[float, float], size: float, land: Float32Array) -> None:
    """Draws a square with alternating black and white quadrants, anti-aliased over one texel."""
    x0, y0, texel = place
    half = size / 2
    for i in range(max(int((at[1] - size - y0) / texel), 0), min(int((at[1] + size - y0) / texel), land.shape[0])):
        for j in range(max(int((at[0] - size - x0) / texel), 0), min(int((at[0] + size - x0) / texel), land.shape[1])):
            dx, dy = (x0 + j * texel - at[0]) / texel, (y0 + i * texel - at[1]) / texel
            inside = half / texel - max(abs(dx), abs(dy)) + 0.5
            cover = min(max(inside, 0.0), 1.0)
            side = min(max(dx, -0.5), 0.5) * min(max(dy, -0.5), 0.5) * 4
            land[i, j] += cover * (132 + 104 * side - land[i, j])


def _blurred(land: Float32Array) -> Gray:
    """`land` blurred by a Gaussian and rounded to uint8, independent of the version of OpenCV."""
    offsets = np.arange(-3, 4)
    kernel = np.exp(-(offsets**2) / (2 * _BLUR_TEXELS**2))
    return np.asarray(_blur(land, (kernel / kernel.sum()).astype(np.float32)))


@lazy_kernel()
def _blur(land: Float32Array, kernel: Float32Array) -> Gray:
    """Separable filter: along rows in place, then along columns."""
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
